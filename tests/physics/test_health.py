"""What looks wrong with samples: each fault is found with its number, and no other."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import dechirp as dc
from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import measure_frame
from dechirp.radar.cube import label_cube
from noise import noise_cube

STEP = 2.0**-15  # of a converter of 16 bits, full scale 1


def radar_of(n_rx=4, *, n_tx=1, sampling="complex", n_samples=256, n_chirps=64):
    """77 GHz, receivers and transmitters half a wavelength apart as a virtual line."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=3e-6 + n_samples / 10e6,
        sample_rate_hz=10e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    half_m = chirp.wavelength_m / 2
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp,
            n_chirps=n_chirps,
            interval_s=35e-6 * max(1, n_samples // 256),
            multiplexing=dc.multiplexing.Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None,
        ),
        array=dc.Array(
            tx_m=[(0, n_rx * half_m * k, 0) for k in range(n_tx)],
            rx_m=[(0, half_m * k, 0) for k in range(n_rx)],
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def target(range_m, velocity_m_per_s=0.0, *, azimuth_deg=0.0, rcs_m2=10.0):
    ahead = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
    return dc.Target(
        name=f"{range_m}/{velocity_m_per_s}/{azimuth_deg}",
        position_m=tuple(range_m * ahead),
        velocity_m_per_s=tuple(velocity_m_per_s * ahead),
        rcs_m2=rcs_m2,
    )


STREET = [
    target(3.1, rcs_m2=1.0, azimuth_deg=20),
    target(7.3, 9.0, rcs_m2=30.0, azimuth_deg=-35),
    target(12.9, -6.0, azimuth_deg=5),
    target(19.7, 0.2, rcs_m2=0.1, azimuth_deg=-10),
    target(26.4, rcs_m2=100.0, azimuth_deg=50),
    target(33.0, 12.0, rcs_m2=0.01, azimuth_deg=0),
]


def recorded(radar, targets=STREET, *, n_frames=2, seed=0, peak=0.5, bits=16):
    """Echoes and noise as a converter of so many bits gives them, its full scale 1."""
    cube = dc.simulate(dc.Scene(targets=targets), radar, n_frames=n_frames, seed=seed)
    numbers = cube.values.view(np.float32)
    step = 2.0 ** (1 - bits)
    numbers *= peak / np.max(np.abs(numbers))
    numbers[:] = np.round(numbers / step) * step
    return cube.assign_attrs(units="full scale")


def measured(cube, radar):
    """Measure frame by frame, as recordings larger than memory are read."""
    frames = [
        measure_frame(cube.isel(frame=slice(index, index + 1)), radar)
        for index in range(cube.sizes["frame"])
    ]
    return xr.concat(frames, "frame")


def judged(cube, radar):
    """Findings by setting; of several of the same setting, the first."""
    found = recording_findings(measured(cube, radar), radar)
    return {finding.setting: finding for finding in reversed(found)}


def warnings(cube, radar):
    return {setting for setting, found in judged(cube, radar).items() if found.level != "note"}


# Nothing wrong


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("n_rx", "n_tx"), [(1, 1), (4, 1), (4, 2)])
def test_clean_echoes_give_no_warning(sampling, n_rx, n_tx):
    radar = radar_of(n_rx, n_tx=n_tx, sampling=sampling)

    assert warnings(recorded(radar, n_frames=3), radar) == set()
    absolute = dc.simulate(dc.Scene(targets=STREET), radar, n_frames=3, seed=1)
    assert warnings(absolute, radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", [0.0, 0.3, 12.0])
def test_one_strong_target_gives_no_warning(sampling, velocity):
    radar = radar_of(sampling=sampling)

    # 3 dB below full scale; at 16 bits its noise is some steps of the converter, and at 12
    # bits below one, so that samples are rounded to the same numbers again and again.
    for bits in (16, 12):
        cube = recorded(radar, [target(3, velocity)], peak=10 ** (-3 / 20), bits=bits)
        assert warnings(cube, radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", [0.0, 0.3, 12.0])
def test_echoes_without_any_noise_give_no_warning(sampling, velocity):
    radar = radar_of(sampling=sampling)
    targets = [target(3, velocity, azimuth_deg=20), target(20, velocity / 2, azimuth_deg=-20)]
    cube = dc.simulate(dc.Scene(targets=targets), radar, impairments=(), n_frames=2)

    assert warnings(cube, radar) == set()


def test_a_street_of_moving_scatterers_gives_no_warning():
    radar, rng = radar_of(n_chirps=128), np.random.default_rng(3)
    targets = [
        target(*place, azimuth_deg=azimuth, rcs_m2=10.0**decades)
        for *place, azimuth, decades in rng.uniform(
            (1, -20, -60, -2), (36, 20, 60, 2), size=(100, 4)
        )
    ]

    assert warnings(recorded(radar, targets, n_frames=1), radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_noise_alone_is_called_noise_and_nothing_else(sampling):
    radar = radar_of(sampling=sampling)
    rng = np.random.default_rng(5)
    frames = [noise_cube(radar, rng) for _ in range(3)]
    found = judged(xr.concat(frames, "frame").assign_attrs(units="sqrt(W)"), radar)

    assert list(found) == ["recording"]
    assert found["recording"].level == "warning"
    assert "noise only" in found["recording"].value


def test_an_echo_that_only_integration_shows_is_an_echo():
    radar = radar_of(1)
    rng = np.random.default_rng(6)
    cube = noise_cube(radar, rng).assign_attrs(units="sqrt(W)")
    tone = np.exp(2j * np.pi * (26 / 256 * np.arange(256) + 13 / 64 * np.arange(64)[:, None]))
    # -24 dB a sample: 18 dB over noise with all 64 x 256, and in the mean spectrum 1.5 dB less
    # than the scatter of its bins.
    cube.values[0, :, 0] += 0.063 * tone

    assert judged(cube, radar) == {}


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_samples", [32, 200])
def test_bursts_in_noise_stay_as_rare_as_their_law_says(sampling, n_samples):
    radar = radar_of(1, sampling=sampling, n_samples=n_samples, n_chirps=1000)
    rng = np.random.default_rng(7)
    highest = max(
        float(measure_frame(noise_cube(radar, rng), radar).burst.max()) for _ in range(10)
    )

    # Once in 1e12 chirps it exceeds 1. Tails fall as exponentials of the energy, so that 1e4
    # chirps of 256 samples reach (ln 1e4 + ln 1e3) / (ln 1e12 + ln 1e3), 0.47 of it; less
    # evenly for few samples. Far lower, and the limit would be too high to find anything.
    assert 0.3 < highest < 0.85


# The converter


def test_clipping_is_counted_exactly():
    radar = radar_of(2)
    cube = recorded(radar, peak=0.9)
    numbers = cube.values.view(np.float32)
    numbers[1, :, 1] = np.clip(numbers[1, :, 1] * 1.5, -1, 1 - STEP)
    clipped = np.count_nonzero((numbers == -1) | (numbers == 1 - STEP))

    found = judged(cube, radar)["recording.clipping"]

    assert clipped > 30
    assert found.level == "warning"
    assert found.value.startswith(f"{clipped} of {numbers.size} values")
    assert "receiver 1, frame 1;" in found.value
    assert f"{clipped / numbers[1, :, 1].size:.3%}" in found.value


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_converter_with_a_lower_end_is_known_by_its_pile(sampling):
    radar = radar_of(2, sampling=sampling)
    # 12 bits in numbers of 16, whose ends are 1/16 of full scale.
    cube = recorded(radar, peak=0.07, bits=16)
    numbers = cube.values.view(np.float32)
    np.clip(numbers, -1 / 16, 1 / 16 - STEP, out=numbers)
    clipped = np.count_nonzero((numbers == -1 / 16) | (numbers == 1 / 16 - STEP))

    found = judged(cube, radar)["recording.clipping"]

    assert clipped > 100
    assert found.value.startswith(f"{clipped} of {numbers.size} ")


def test_one_number_at_the_end_is_a_note():
    radar = radar_of(1)
    cube = recorded(radar)
    cube.values[0, 3, 0, 100] = -1

    found = judged(cube, radar)["recording.clipping"]

    assert found.level == "note"
    assert found.value.startswith("1 of ")


def test_the_crest_of_a_slow_echo_is_no_clipping():
    radar = radar_of(1, sampling="real", n_samples=1024)
    # Runs of 8 equal numbers at the crests, where some tenths of a step are several samples.
    slow = np.round(500 * np.cos(2 * np.pi * 1.37 * np.arange(1024) / 1024)) / 2048
    samples = np.broadcast_to(slow.astype(np.float32), (1, 64, 1, 1024)).copy()
    cube = label_cube(samples, radar, units="full scale")

    assert np.count_nonzero(slow == slow.max()) > 10
    assert "recording.clipping" not in judged(cube, radar)


@pytest.mark.parametrize(("offset", "level"), [(-0.3, "note"), (0.6, "warning")])
def test_the_offset_of_a_receiver_is_measured(offset, level):
    radar = radar_of(3, sampling="real")
    cube = recorded(radar, peak=0.2)
    cube.values[:, :, 2] += np.float32(offset)

    measures, found = measured(cube, radar), judged(cube, radar)["recording.offset"]

    # The echoes' own mean is far below 1e-3: they have many periods in a chirp.
    assert measures["mean"].values[:, 2] == pytest.approx(offset, abs=1e-3)
    assert found.level == level
    assert f"receiver 2: {measures['mean'].values[:, 2].mean():.4g} of full scale" in found.value


# The mixer


@pytest.mark.parametrize("velocity", [0.0, 7.0])
@pytest.mark.parametrize(("level_db", "level"), [(-45, "note"), (-25, "note"), (-12, "warning")])
def test_the_level_of_an_image_is_measured(velocity, level_db, level):
    radar = radar_of(2)
    cube = recorded(radar, [target(6.3, velocity, rcs_m2=1e3), target(15, -velocity)])
    cube.values[:, :, 1] += 10 ** (level_db / 20) * np.exp(0.7j) * cube.values[:, :, 1].conj()

    image = measured(cube, radar)["image"].values
    found = judged(cube, radar)["recording.iq_image"]

    assert np.isnan(image[:, 0]).all()
    assert 10 * np.log10(image[:, 1]) == pytest.approx(level_db, abs=0.5)
    assert found.level == level
    assert (
        f"an image of {10 * np.log10(np.median(image[:, 1])):.1f} dB in receiver 1:" in found.value
    )
    # The nearest bin of the window, 0.29 m each.
    assert float(found.value.split("at ")[1].split(" m")[0]) == pytest.approx(6.3, abs=0.3)


def test_an_echo_that_moves_otherwise_is_no_image():
    radar = radar_of(1)
    mirror_m = radar.frame.chirp.max_range_m - 20
    cube = recorded(radar, [target(20, 5), target(mirror_m, 5, rcs_m2=500.0)])

    # At the mirrored beat frequency, 6 dB below: an image would recede where it approaches.
    assert judged(cube, radar) == {}


def test_real_samples_are_found_however_each_chirp_is_turned_in_phase():
    radar = radar_of(1)
    cube = recorded(radar)
    phases = np.exp(1j * np.arange(cube.sizes["chirp"]))  # as a calibration of many transmitters
    turned = cube.copy(data=(cube.values.real * phases[:, None, None]).astype(np.complex64))

    found = judged(turned, radar)["recording.iq"]

    assert found.level == "warning"
    assert "its own mirror image to 100.00%" in found.value


def test_parts_in_the_wrong_order_are_found():
    radar = radar_of(1)
    cube = recorded(radar)
    swapped = cube.copy(data=cube.values.imag + 1j * cube.values.real)

    found = judged(swapped, radar)["recording.iq"]

    assert found.level == "warning"
    assert "at negative beat frequencies" in found.value
    share = float(found.value.split("%")[0])
    assert share > 99
    assert "recording.iq" not in judged(cube, radar)


@pytest.mark.parametrize("factor", [1, 1j, np.exp(0.6j)], ids=["I", "Q", "both"])
def test_real_samples_stored_as_complex_are_found(factor):
    radar = radar_of(2)
    real = recorded(radar_of(2, sampling="real"))
    cube = real.copy(data=(real.values * factor).astype(np.complex64))

    found = judged(cube, radar)["recording.iq"]

    assert found.level == "warning"
    assert "mirror image to 100.00%" in found.value
    said = {1: "the Q part has no signal", 1j: "the I part has no signal"}
    assert said.get(factor, "proportional") in found.value


# The receivers


def test_receivers_that_give_nothing_are_named():
    radar = radar_of(4)
    cube = recorded(radar)
    cube.values[:, :, 1] *= 0.01
    cube.values[:, :, 3] = 0.25
    got = [
        f.value for f in recording_findings(measured(cube, radar), radar) if f.level == "warning"
    ]

    assert got[0] == "the same number always in receiver 3"
    # Receivers of one scene differ by less than 1 dB; 40 dB were taken.
    below = float(got[1].removeprefix("receiver 1 ").split(" dB below")[0])
    assert below == pytest.approx(40, abs=1)
    assert len(got) == 2


def test_a_receiver_that_is_stuck_at_times_is_named_with_its_frames():
    radar = radar_of(2)
    cube = recorded(radar, n_frames=4)
    cube.values[1:3, :, 0] = -0.5j

    found = judged(cube, radar)["recording.receivers"]

    assert found.value == "the same number always in receiver 0 of frames 1 to 2"


def test_a_copied_receiver_is_named():
    radar = radar_of(4)
    cube = recorded(radar)
    cube.values[:, :, 2] = cube.values[:, :, 0]

    assert judged(cube, radar)["recording.receivers"].value == (
        "receiver 2 bit-identical to receiver 0"
    )


ALL_AROUND = [
    target(4 + 3.1 * n, (-1) ** n * n, azimuth_deg=azimuth, rcs_m2=10.0 * 2**n)
    for n, azimuth in enumerate((-50, -35, -20, -8, 4, 15, 28, 42, 55))
]


@pytest.mark.parametrize(("n_rx", "order"), [(4, [0, 2, 1, 3]), (4, [2, 0, 1, 3]), (8, None)])
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_exchanged_receivers_are_found(n_rx, order, sampling):
    radar = radar_of(n_rx, n_tx=2, sampling=sampling)
    order = order or [0, 1, 6, 3, 4, 5, 2, 7]
    cube = recorded(radar, ALL_AROUND)
    mixed = cube.copy(data=np.ascontiguousarray(cube.values[:, :, order]))

    found = judged(mixed, radar)["recording.receiver_order"]

    # Recorded receiver i is number order[i] of the line: the line is the inverse, or reversed.
    along = [order.index(k) for k in range(n_rx)]
    named = {" ".join(map(str, along)), " ".join(map(str, along[::-1]))}
    assert any(f"; {name} has " in found.value for name in named)
    assert found.level == "warning"
    assert "recording.receiver_order" not in judged(cube, radar)


def test_nothing_is_said_on_orders_that_echoes_cannot_tell():
    radar = radar_of(4)
    narrow = ALL_AROUND[3:5]
    for targets, order in [
        (ALL_AROUND, [3, 2, 1, 0]),  # reversed: angles are mirrored
        (narrow, [0, 2, 1, 3]),  # two directions
        ([], [0, 2, 1, 3]),
    ]:
        cube = recorded(radar, targets)
        mixed = cube.copy(data=np.ascontiguousarray(cube.values[:, :, order]))
        assert "recording.receiver_order" not in judged(mixed, radar)


# Single chirps


def with_bursts(cube, places, *, over_noise_db, length, rng):
    """Add bursts of so many samples, at the same time in all receivers."""
    noise_w = np.mean(np.abs(np.diff(cube.values, axis=1)) ** 2) / 2
    amplitude = np.sqrt(noise_w * 10 ** (over_noise_db / 10))
    out = cube.copy(deep=True)
    for frame, chirp in places:
        start = rng.integers(40, cube.sizes["sample"] - length)
        burst = amplitude * np.exp(2j * np.pi * rng.random(length))
        if not np.iscomplexobj(out.values):
            burst = np.sqrt(2) * burst.real
        out.values[frame, chirp, :, start : start + length] += burst.astype(out.dtype)
    return out


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_tx", [1, 2])
@pytest.mark.parametrize("over_noise_db", [15, 60])
def test_bursts_are_found_in_exactly_their_chirps(sampling, n_tx, over_noise_db):
    radar = radar_of(2, n_tx=n_tx, sampling=sampling)
    echoes = [target(9.1), target(21, rcs_m2=0.1)]  # at rest, so that noise is what changes
    cube = dc.simulate(dc.Scene(targets=echoes), radar, n_frames=3, seed=2)
    places = [(0, 0), (0, 17), (0, 18), (0, 19), (2, 5), (2, 63)]
    rng = np.random.default_rng(8)
    hit = with_bursts(cube, places, over_noise_db=over_noise_db, length=20, rng=rng)

    measures, found = measured(hit, radar), judged(hit, radar)

    assert np.argwhere(measures.burst.values > 1).tolist() == [list(place) for place in places]
    said = found["recording.interference"].value
    assert said.startswith(f"bursts in 6 of {3 * cube.sizes['chirp']} chirps")
    assert said.endswith("chirps 0 and 17 to 19 of frame 0; chirps 5 and 63 of frame 2")
    # 20 of 256 samples; those that the predictor lags behind, 16, may count at 60 dB, and at
    # 15 dB a third of random samples is weaker than what counts.
    share = measures.burst_share.values[measures.burst.values > 1]
    assert np.all((share > 0.5 * 20 / 256) & (share < 40 / 240))
    assert "recording.chirps" not in found


def test_bursts_in_a_third_of_the_chirps_leave_the_others_clean():
    radar = radar_of(1, n_chirps=128)
    cube, rng = recorded(radar, n_frames=1), np.random.default_rng(9)
    chirps = sorted(rng.choice(128, 42, replace=False).tolist())
    hit = with_bursts(cube, [(0, m) for m in chirps], over_noise_db=40, length=12, rng=rng)

    assert np.flatnonzero(measured(hit, radar).burst.values[0] > 1).tolist() == chirps


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_damaged_first_chirp_is_named_with_its_frames(sampling):
    radar = radar_of(2, sampling=sampling)
    cube = recorded(radar, [target(9.1, 0.5)], n_frames=3)
    cube.values[1:, 0] *= -1  # upside down

    found = judged(cube, radar)

    assert list(found) == ["recording.chirps"]
    assert found["recording.chirps"].value.endswith("chirp 0 of frames 1 to 2")


def test_a_chirp_of_zeros_is_named_even_in_noise():
    radar = radar_of(1)
    cube = noise_cube(radar, np.random.default_rng(10)).assign_attrs(units="sqrt(W)")
    cube.values[0, 40] = 0

    assert judged(cube, radar)["recording.chirps"].value.endswith("chirp 40 of frame 0")


# What is lost, and what is silent


def test_lost_chirps_count_for_nothing():
    radar = radar_of(4, n_tx=2)
    cube = recorded(radar)
    gap = np.zeros((2, 128), bool)
    gap[0, [3, 4, 100]] = gap[1] = True
    marked = cube.assign_coords(gap=(("frame", "chirp"), gap))
    marked.values[gap] = 0
    noted = recording_findings(measured(marked, radar), radar)
    marked.values[gap] = 7 + 1j

    assert recording_findings(measured(marked, radar), radar) == noted
    assert [finding for finding in noted if finding.level != "note"] == []


@pytest.mark.parametrize(("number", "what"), [(0, "zero"), (-0.25, "the same number")])
def test_silence_is_said_once(number, what):
    radar = radar_of(2)
    samples = np.full((2, 64, 2, 256), number, np.complex64)
    (found,) = recording_findings(
        measured(label_cube(samples, radar, units="full scale"), radar), radar
    )

    assert found.level == "warning"
    assert found.value.startswith(f"silent in all frames: every sample is {what}")


def test_frames_keep_their_numbers_when_the_first_are_not_read():
    radar = radar_of(1)
    samples = recorded(radar, n_frames=3).values
    samples[1] = 0
    cube = label_cube(samples, radar, units="full scale", first_frame=10)

    assert judged(cube, radar)["recording"].value.startswith("silent in frame 11:")


@pytest.mark.parametrize("scale", [1e-9, 1e12])
def test_the_unit_of_samples_does_not_matter(scale):
    radar = radar_of(4)
    cube = recorded(radar, ALL_AROUND)
    cube.values[:, 7] *= -1
    cube.values[:] += 0.05 * cube.values.conj()
    cube = cube.assign_attrs(units="sqrt(W)")
    scaled = cube.copy(data=cube.values * np.float32(scale))

    here, there = judged(cube, radar), judged(scaled, radar)

    assert set(here) == {"recording.iq_image", "recording.chirps"}
    assert {name: found.value for name, found in here.items()} == {
        name: found.value for name, found in there.items()
    }


@given(data=st.data())
def test_no_finite_samples_stop_it(data):
    n_frames, n_chirps, n_rx = (data.draw(st.integers(1, most)) for most in (2, 9, 5))
    n_samples = data.draw(st.sampled_from([2, 3, 7, 16, 17, 33]))
    n_tx = data.draw(st.sampled_from([n for n in (1, 2, 3) if n_chirps % n == 0]))
    sampling = data.draw(st.sampled_from(["complex", "real"]))
    radar = radar_of(
        n_rx, n_tx=n_tx, sampling=sampling, n_samples=n_samples, n_chirps=n_chirps // n_tx
    )
    kind = np.complex64 if sampling == "complex" else np.float32
    shape = (n_frames, n_chirps, n_rx, n_samples)
    finite = st.floats(allow_nan=False, allow_infinity=False, width=32)
    n_parts = 2 if sampling == "complex" else 1
    numbers = hnp.arrays(np.float32, (*shape[:3], n_parts * n_samples), elements=finite)
    samples = data.draw(numbers).view(kind)
    gap = data.draw(hnp.arrays(bool, shape[:2]))
    units = data.draw(st.sampled_from(["full scale", "sqrt(W)"]))
    cube = label_cube(samples, radar, units=units)
    cube = cube.assign_coords(gap=(("frame", "chirp"), gap))

    found = recording_findings(measured(cube, radar), radar)

    assert all(finding.level in ("note", "warning") for finding in found)
