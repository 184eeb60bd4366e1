"""Quality checks of recordings: converter, mixer, receivers, bursts and lost chirps."""

import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import dechirp as dc
from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import measure_frame_quality
from dechirp.processing.quality.receivers import working_receivers
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.radar.cube import label_cube
from nightly import nightly_except
from noise_cubes import simulate_noise_cube

STEP = 2.0**-15  # of a 16-bit converter with full scale 1


def make_radar(n_rx=4, *, n_tx=1, sampling="complex", n_samples=256, n_chirps=64):
    """Return a 77 GHz radar with a virtual uniform linear array at half a wavelength."""
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


def make_target(range_m, velocity_m_per_s=0.0, *, azimuth_deg=0.0, rcs_m2=10.0):
    ahead = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
    return dc.Target(
        name=f"{range_m}/{velocity_m_per_s}/{azimuth_deg}",
        position_m=tuple(range_m * ahead),
        velocity_m_per_s=tuple(velocity_m_per_s * ahead),
        rcs_m2=rcs_m2,
    )


STREET_TARGETS = [
    make_target(3.1, rcs_m2=1.0, azimuth_deg=20),
    make_target(7.3, 9.0, rcs_m2=30.0, azimuth_deg=-35),
    make_target(12.9, -6.0, azimuth_deg=5),
    make_target(19.7, 0.2, rcs_m2=0.1, azimuth_deg=-10),
    make_target(26.4, rcs_m2=100.0, azimuth_deg=50),
    make_target(33.0, 12.0, rcs_m2=0.01, azimuth_deg=0),
]


def simulate_recording(radar, targets=STREET_TARGETS, *, n_frames=2, seed=0, peak=0.5, bits=16):
    """Simulate echoes and noise, quantised by a converter with full scale 1."""
    cube = dc.simulate(dc.Scene(targets=targets), radar, n_frames=n_frames, seed=seed)
    numbers = cube.values.view(np.float32)
    step = 2.0 ** (1 - bits)
    numbers *= peak / np.max(np.abs(numbers))
    numbers[:] = np.round(numbers / step) * step
    return cube.assign_attrs(units="1")


def measure_frames(cube, radar):
    """Measure frame by frame, as recordings larger than memory are read."""
    frames = [
        measure_frame_quality(cube.isel(frame=slice(index, index + 1)), radar)
        for index in range(cube.sizes["frame"])
    ]
    return xr.concat(frames, "frame")


def find_by_setting(cube, radar):
    """Return findings by setting; the first one of several for the same setting."""
    findings = recording_findings(measure_frames(cube, radar), radar)
    return {finding.setting: finding for finding in reversed(findings)}


def warning_settings(cube, radar):
    return {
        setting
        for setting, finding in find_by_setting(cube, radar).items()
        if finding.level != "note"
    }


# Clean recordings


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("n_rx", "n_tx"), nightly_except(2, [(1, 1), (4, 1), (4, 2)]))
def test_clean_echoes_cause_no_warning(sampling, n_rx, n_tx):
    radar = make_radar(n_rx, n_tx=n_tx, sampling=sampling)

    assert warning_settings(simulate_recording(radar, n_frames=3), radar) == set()
    absolute = dc.simulate(dc.Scene(targets=STREET_TARGETS), radar, n_frames=3, seed=1)
    assert warning_settings(absolute, radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", nightly_except(2, [0.0, 0.3, 12.0]))
def test_strong_target_causes_no_warning(sampling, velocity):
    radar = make_radar(sampling=sampling)

    # The peak is 3 dB below full scale. The noise is some steps of the converter at 16 bits and
    # less than one at 12 bits, so that samples repeat after rounding.
    for bits in (16, 12):
        cube = simulate_recording(
            radar, [make_target(3, velocity)], peak=10 ** (-3 / 20), bits=bits
        )
        assert warning_settings(cube, radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", [0.0, 0.3, 12.0])
def test_noise_free_echoes_cause_no_warning(sampling, velocity):
    radar = make_radar(sampling=sampling)
    targets = [
        make_target(3, velocity, azimuth_deg=20),
        make_target(20, velocity / 2, azimuth_deg=-20),
    ]
    cube = dc.simulate(dc.Scene(targets=targets), radar, impairments=(), n_frames=2)

    assert warning_settings(cube, radar) == set()


def test_crowded_street_causes_no_warning():
    radar, rng = make_radar(n_chirps=128), np.random.default_rng(3)
    targets = [
        make_target(*place, azimuth_deg=azimuth, rcs_m2=10.0**decades)
        for *place, azimuth, decades in rng.uniform(
            (1, -20, -60, -2), (36, 20, 60, 2), size=(100, 4)
        )
    ]

    assert warning_settings(simulate_recording(radar, targets, n_frames=1), radar) == set()


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_noise_only_recording_causes_one_warning(sampling):
    radar = make_radar(sampling=sampling)
    rng = np.random.default_rng(5)
    frames = [simulate_noise_cube(radar, rng) for _ in range(3)]
    findings = find_by_setting(xr.concat(frames, "frame").assign_attrs(units="W**0.5"), radar)

    assert list(findings) == ["recording"]
    assert findings["recording"].level == "warning"
    assert "noise only" in findings["recording"].value


def test_echo_visible_after_integration_only_is_not_called_noise():
    radar = make_radar(1)
    rng = np.random.default_rng(6)
    cube = simulate_noise_cube(radar, rng).assign_attrs(units="W**0.5")
    tone = np.exp(2j * np.pi * (26 / 256 * np.arange(256) + 13 / 64 * np.arange(64)[:, None]))
    # -24 dB per sample is 18 dB above the noise of all 64 x 256 samples, and 1.5 dB below the
    # scatter of bins in the mean spectrum.
    cube.values[0, :, 0] += 0.063 * tone

    assert find_by_setting(cube, radar) == {}


@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
@pytest.mark.parametrize("n_samples", [32, 200])
def test_burst_measure_of_noise_follows_its_distribution(sampling, n_samples):
    radar = make_radar(1, sampling=sampling, n_samples=n_samples, n_chirps=1000)
    rng = np.random.default_rng(7)
    highest = max(
        float(measure_frame_quality(simulate_noise_cube(radar, rng), radar).burst.max())
        for _ in range(10)
    )

    # The measure exceeds 1 once in 1e12 chirps. Tails fall exponentially with energy, so that 1e4
    # chirps of 256 samples reach (ln 1e4 + ln 1e3) / (ln 1e12 + ln 1e3) = 0.47; few samples
    # deviate. A much lower value means a limit too high for detection.
    assert 0.3 < highest < 0.85


# The converter


def test_counts_clipped_values_exactly():
    radar = make_radar(2)
    cube = simulate_recording(radar, peak=0.9)
    numbers = cube.values.view(np.float32)
    numbers[1, :, 1] = np.clip(numbers[1, :, 1] * 1.5, -1, 1 - STEP)
    clipped = np.count_nonzero((numbers == -1) | (numbers == 1 - STEP))

    finding = find_by_setting(cube, radar)["recording.clipping"]

    assert clipped > 30
    assert finding.level == "warning"
    assert finding.value.startswith(f"{clipped} of {numbers.size} values")
    assert "receiver 1, frame 1;" in finding.value
    assert f"{clipped / numbers[1, :, 1].size:.3%}" in finding.value


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_detects_clipping_below_full_scale(sampling):
    radar = make_radar(2, sampling=sampling)
    # 12 bits within 16-bit words, with ends at 1/16 of full scale.
    cube = simulate_recording(radar, peak=0.07, bits=16)
    numbers = cube.values.view(np.float32)
    np.clip(numbers, -1 / 16, 1 / 16 - STEP, out=numbers)
    clipped = np.count_nonzero((numbers == -1 / 16) | (numbers == 1 / 16 - STEP))

    finding = find_by_setting(cube, radar)["recording.clipping"]

    assert clipped > 100
    assert finding.value.startswith(f"{clipped} of {numbers.size} ")


def test_single_full_scale_value_is_a_note():
    radar = make_radar(1)
    cube = simulate_recording(radar)
    cube.values[0, 3, 0, 100] = -1

    finding = find_by_setting(cube, radar)["recording.clipping"]

    assert finding.level == "note"
    assert finding.value.startswith("1 of ")


@pytest.mark.parametrize("peak", [1.02, 350.0])
def test_numbers_beyond_full_scale_have_no_converter_to_clip(peak):
    radar = make_radar(2, sampling="real")
    cube = simulate_recording(radar)
    cube.values[:] *= peak / abs(cube.values).max()
    cube.values[:, :, 1] += np.float32(peak / 2)

    findings = find_by_setting(cube, radar)

    # The largest value is single. An offset is given in the numbers of the recording.
    assert "recording.clipping" not in findings
    assert "full scale" not in findings["recording.offset"].value


def test_crest_of_low_frequency_echo_is_not_clipping():
    radar = make_radar(1, sampling="real", n_samples=1024)
    # Crests have runs of 8 equal numbers, where several samples stay within a step.
    tone = np.round(500 * np.cos(2 * np.pi * 1.37 * np.arange(1024) / 1024)) / 2048
    samples = np.broadcast_to(tone.astype(np.float32), (1, 64, 1, 1024)).copy()
    cube = label_cube(samples, radar, units="1")

    assert np.count_nonzero(tone == tone.max()) > 10
    assert "recording.clipping" not in find_by_setting(cube, radar)


@pytest.mark.parametrize(("offset", "level"), [(-0.3, "note"), (0.6, "warning")])
def test_measures_offset_of_receiver(offset, level):
    radar = make_radar(3, sampling="real")
    cube = simulate_recording(radar, peak=0.2)
    cube.values[:, :, 2] += np.float32(offset)

    measures, finding = (
        measure_frames(cube, radar),
        find_by_setting(cube, radar)["recording.offset"],
    )

    # The mean of the echoes is far below 1e-3: they have many periods per chirp.
    assert measures["mean"].values[:, 2] == pytest.approx(offset, abs=1e-3)
    assert finding.level == level
    assert f"receiver 2: {measures['mean'].values[:, 2].mean():.4g} of full scale" in finding.value


# The mixer


@pytest.mark.parametrize("velocity", [0.0, 7.0])
@pytest.mark.parametrize(("level_db", "level"), [(-45, "note"), (-25, "note"), (-12, "warning")])
def test_measures_level_of_iq_image(velocity, level_db, level):
    radar = make_radar(2)
    cube = simulate_recording(
        radar, [make_target(6.3, velocity, rcs_m2=1e3), make_target(15, -velocity)]
    )
    cube.values[:, :, 1] += 10 ** (level_db / 20) * np.exp(0.7j) * cube.values[:, :, 1].conj()

    image = measure_frames(cube, radar)["image"].values
    finding = find_by_setting(cube, radar)["recording.iq_image"]

    assert np.isnan(image[:, 0]).all()
    assert 10 * np.log10(image[:, 1]) == pytest.approx(level_db, abs=0.5)
    assert finding.level == level
    assert (
        f"an image of {10 * np.log10(np.median(image[:, 1])):.1f} dB in receiver 1:"
        in finding.value
    )
    # The nearest bin of the window; bins are 0.29 m wide.
    assert float(finding.value.split("at ")[1].split(" m")[0]) == pytest.approx(6.3, abs=0.3)


def test_echo_with_other_velocity_is_not_an_image():
    radar = make_radar(1)
    mirror_m = radar.frame.chirp.max_range_m - 20
    cube = simulate_recording(radar, [make_target(20, 5), make_target(mirror_m, 5, rcs_m2=500.0)])

    # The mirrored beat frequency has an echo 6 dB lower; an image has the opposite velocity.
    assert find_by_setting(cube, radar) == {}


def test_detects_real_samples_with_rotated_chirp_phases():
    radar = make_radar(1)
    cube = simulate_recording(radar)
    phases = np.exp(1j * np.arange(cube.sizes["chirp"]))  # like a calibration of many transmitters
    rotated = cube.copy(data=(cube.values.real * phases[:, None, None]).astype(np.complex64))

    finding = find_by_setting(rotated, radar)["recording.iq"]

    assert finding.level == "warning"
    assert "its own mirror image to 100.00%" in finding.value


def test_detects_exchanged_i_and_q():
    radar = make_radar(1)
    cube = simulate_recording(radar)
    swapped = cube.copy(data=cube.values.imag + 1j * cube.values.real)

    finding = find_by_setting(swapped, radar)["recording.iq"]

    assert finding.level == "warning"
    assert "at negative beat frequencies" in finding.value
    share = float(finding.value.split("%")[0])
    assert share > 99
    assert "recording.iq" not in find_by_setting(cube, radar)


@pytest.mark.parametrize("factor", [1, 1j, np.exp(0.6j)], ids=["I", "Q", "both"])
def test_detects_real_samples_stored_as_complex(factor):
    radar = make_radar(2)
    real = simulate_recording(make_radar(2, sampling="real"))
    cube = real.copy(data=(real.values * factor).astype(np.complex64))

    finding = find_by_setting(cube, radar)["recording.iq"]

    assert finding.level == "warning"
    assert "mirror image to 100.00%" in finding.value
    messages = {1: "the Q part has no signal", 1j: "the I part has no signal"}
    assert messages.get(factor, "proportional") in finding.value


# The receivers


def test_reports_weak_and_stuck_receivers():
    radar = make_radar(4)
    cube = simulate_recording(radar)
    cube.values[:, :, 1] *= 0.01
    cube.values[:, :, 3] = 0.25
    warnings = [
        f.value
        for f in recording_findings(measure_frames(cube, radar), radar)
        if f.level == "warning"
    ]

    assert warnings[0] == "the same number always in receiver 3"
    # Receivers of one scene differ by less than 1 dB; the test removed 40 dB.
    level_db = float(warnings[1].removeprefix("receiver 1 ").split(" dB below")[0])
    assert level_db == pytest.approx(40, abs=1)
    assert len(warnings) == 2


def test_reports_frames_of_temporarily_stuck_receiver():
    radar = make_radar(2)
    cube = simulate_recording(radar, n_frames=4)
    cube.values[1:3, :, 0] = -0.5j

    finding = find_by_setting(cube, radar)["recording.receivers"]

    assert finding.value == "the same number always in receiver 0 of frames 1 to 2"


def test_reports_duplicated_receiver():
    radar = make_radar(4)
    cube = simulate_recording(radar)
    cube.values[:, :, 2] = cube.values[:, :, 0]

    assert find_by_setting(cube, radar)["recording.receivers"].value == (
        "receiver 2 bit-identical to receiver 0"
    )


def test_reports_frames_of_temporarily_weak_and_copied_receivers():
    radar = make_radar(4)
    cube = simulate_recording(radar, n_frames=4)
    cube.values[1:3, :, 0] *= 0.01
    cube.values[3, :, 2] = cube.values[3, :, 1]

    measures = measure_frames(cube, radar)
    values = [f.value for f in recording_findings(measures, radar) if f.level == "warning"]

    assert len(values) == 2
    assert re.fullmatch(
        r"receiver 0 of frames 1 to 2 (39|40|41)\.\d dB below the median of the others", values[0]
    )
    assert values[1] == "receiver 2 of frame 3 bit-identical to receiver 1"
    recorded = RecordingMeasures(measures=measures, radar=radar)
    assert working_receivers(recorded).tolist() == [1, 3]


TARGETS_ALL_AROUND = [
    make_target(4 + 3.1 * n, (-1) ** n * n, azimuth_deg=azimuth, rcs_m2=10.0 * 2**n)
    for n, azimuth in enumerate((-50, -35, -20, -8, 4, 15, 28, 42, 55))
]


@pytest.mark.parametrize(
    ("n_rx", "order"), nightly_except(2, [(4, [0, 2, 1, 3]), (4, [2, 0, 1, 3]), (8, None)])
)
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_detects_exchanged_receivers(n_rx, order, sampling):
    radar = make_radar(n_rx, n_tx=2, sampling=sampling)
    order = order or [0, 1, 6, 3, 4, 5, 2, 7]
    cube = simulate_recording(radar, TARGETS_ALL_AROUND)
    exchanged = cube.copy(data=np.ascontiguousarray(cube.values[:, :, order]))

    finding = find_by_setting(exchanged, radar)["recording.receiver_order"]

    # Recorded receiver i is element order[i] of the line: the physical order is the inverse, or its
    # reverse.
    positions = [order.index(k) for k in range(n_rx)]
    expected_orders = {" ".join(map(str, positions)), " ".join(map(str, positions[::-1]))}
    assert any(f"; {order_text} has " in finding.value for order_text in expected_orders)
    assert finding.level == "warning"
    assert "recording.receiver_order" not in find_by_setting(cube, radar)


def test_indistinguishable_receiver_orders_cause_no_finding():
    radar = make_radar(4)
    narrow_targets = TARGETS_ALL_AROUND[3:5]
    for targets, order in [
        (TARGETS_ALL_AROUND, [3, 2, 1, 0]),  # reversed: angles are mirrored
        (narrow_targets, [0, 2, 1, 3]),  # two directions
        ([], [0, 2, 1, 3]),
    ]:
        cube = simulate_recording(radar, targets)
        exchanged = cube.copy(data=np.ascontiguousarray(cube.values[:, :, order]))
        assert "recording.receiver_order" not in find_by_setting(exchanged, radar)


# Single chirps


def add_bursts(cube, places, *, over_noise_db, length, rng):
    """Add bursts of `length` samples, at the same time in all receivers."""
    noise_w = np.mean(np.abs(np.diff(cube.values, axis=1)) ** 2) / 2
    amplitude = np.sqrt(noise_w * 10 ** (over_noise_db / 10))
    result = cube.copy(deep=True)
    for frame, chirp in places:
        start = rng.integers(40, cube.sizes["sample"] - length)
        burst = amplitude * np.exp(2j * np.pi * rng.random(length))
        if not np.iscomplexobj(result.values):
            burst = np.sqrt(2) * burst.real
        result.values[frame, chirp, :, start : start + length] += burst.astype(result.dtype)
    return result


@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
@pytest.mark.parametrize("n_tx", [1, 2])
@pytest.mark.parametrize("over_noise_db", [15, 60])
def test_locates_bursts_in_exact_chirps(sampling, n_tx, over_noise_db):
    radar = make_radar(2, n_tx=n_tx, sampling=sampling)
    # Static, so that only noise changes.
    echoes = [
        make_target(9.1),
        make_target(21, rcs_m2=0.1),
    ]
    cube = dc.simulate(dc.Scene(targets=echoes), radar, n_frames=3, seed=2)
    places = [(0, 0), (0, 17), (0, 18), (0, 19), (2, 5), (2, 63)]
    rng = np.random.default_rng(8)
    disturbed = add_bursts(cube, places, over_noise_db=over_noise_db, length=20, rng=rng)

    measures, findings = measure_frames(disturbed, radar), find_by_setting(disturbed, radar)

    assert np.argwhere(measures.burst.values > 1).tolist() == [list(place) for place in places]
    value = findings["recording.interference"].value
    assert value.startswith(f"bursts in 6 of {3 * cube.sizes['chirp']} chirps")
    assert value.endswith("chirps 0 and 17 to 19 of frame 0; chirps 5 and 63 of frame 2")
    # 20 of 256 samples; the 16 samples of predictor delay may count at 60 dB, and a third of random
    # samples is below the limit at 15 dB.
    share = measures.burst_share.values[measures.burst.values > 1]
    assert np.all((share > 0.5 * 20 / 256) & (share < 40 / 240))
    assert "recording.chirps" not in findings


def test_locates_bursts_in_a_third_of_the_chirps():
    radar = make_radar(1, n_chirps=128)
    cube, rng = simulate_recording(radar, n_frames=1), np.random.default_rng(9)
    chirps = sorted(rng.choice(128, 42, replace=False).tolist())
    disturbed = add_bursts(cube, [(0, m) for m in chirps], over_noise_db=40, length=12, rng=rng)

    assert np.flatnonzero(measure_frames(disturbed, radar).burst.values[0] > 1).tolist() == chirps


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_reports_frames_of_inverted_first_chirp(sampling):
    radar = make_radar(2, sampling=sampling)
    cube = simulate_recording(radar, [make_target(9.1, 0.5)], n_frames=3)
    cube.values[1:, 0] *= -1  # inverted

    findings = find_by_setting(cube, radar)

    assert list(findings) == ["recording.chirps"]
    assert findings["recording.chirps"].value.endswith("chirp 0 of frames 1 to 2")


def test_reports_zero_chirp_in_noise():
    radar = make_radar(1)
    cube = simulate_noise_cube(radar, np.random.default_rng(10)).assign_attrs(units="W**0.5")
    cube.values[0, 40] = 0

    assert find_by_setting(cube, radar)["recording.chirps"].value.endswith("chirp 40 of frame 0")


# Lost chirps and silence


def test_lost_chirps_are_ignored():
    radar = make_radar(4, n_tx=2)
    cube = simulate_recording(radar)
    gap = np.zeros((2, 128), bool)
    gap[0, [3, 4, 100]] = gap[1] = True
    marked = cube.assign_coords(gap=(("frame", "chirp"), gap))
    marked.values[gap] = 0
    expected = recording_findings(measure_frames(marked, radar), radar)
    marked.values[gap] = 7 + 1j

    assert recording_findings(measure_frames(marked, radar), radar) == expected
    assert [finding for finding in expected if finding.level != "note"] == []


@pytest.mark.parametrize(("number", "description"), [(0, "zero"), (-0.25, "the same number")])
def test_silent_recording_causes_one_finding(number, description):
    radar = make_radar(2)
    samples = np.full((2, 64, 2, 256), number, np.complex64)
    (finding,) = recording_findings(
        measure_frames(label_cube(samples, radar, units="1"), radar), radar
    )

    assert finding.level == "warning"
    assert finding.value.startswith(f"silent in all frames: every sample is {description}")


def test_findings_use_absolute_frame_numbers():
    radar = make_radar(1)
    samples = simulate_recording(radar, n_frames=3).values
    samples[1] = 0
    cube = label_cube(samples, radar, units="1", first_frame=10)

    assert find_by_setting(cube, radar)["recording"].value.startswith("silent in frame 11:")


@pytest.mark.parametrize("scale", [1e-9, 1e12])
def test_findings_do_not_depend_on_sample_scale(scale):
    radar = make_radar(4)
    cube = simulate_recording(radar, TARGETS_ALL_AROUND)
    cube.values[:, 7] *= -1
    cube.values[:] += 0.05 * cube.values.conj()
    cube = cube.assign_attrs(units="W**0.5")
    scaled = cube.copy(data=cube.values * np.float32(scale))

    expected, result = find_by_setting(cube, radar), find_by_setting(scaled, radar)

    assert set(expected) == {"recording.iq_image", "recording.chirps"}
    assert {name: finding.value for name, finding in expected.items()} == {
        name: finding.value for name, finding in result.items()
    }


def test_receiver_beside_one_without_power_causes_no_numerical_warning():
    radar = make_radar(2, n_samples=2, n_chirps=1)
    samples = np.array([[[[1e-6, 0], [3.777893e16, 0]]]], np.complex64)

    findings = recording_findings(
        measure_frames(label_cube(samples, radar, units="1"), radar), radar
    )

    assert all(finding.level in ("note", "warning") for finding in findings)


@given(data=st.data())
def test_accepts_any_finite_samples(data):
    n_frames, n_chirps, n_rx = (data.draw(st.integers(1, maximum)) for maximum in (2, 9, 5))
    n_samples = data.draw(st.sampled_from([2, 3, 7, 16, 17, 33]))
    n_tx = data.draw(st.sampled_from([n for n in (1, 2, 3) if n_chirps % n == 0]))
    sampling = data.draw(st.sampled_from(["complex", "real"]))
    radar = make_radar(
        n_rx, n_tx=n_tx, sampling=sampling, n_samples=n_samples, n_chirps=n_chirps // n_tx
    )
    kind = np.complex64 if sampling == "complex" else np.float32
    shape = (n_frames, n_chirps, n_rx, n_samples)
    finite = st.floats(allow_nan=False, allow_infinity=False, width=32)
    n_parts = 2 if sampling == "complex" else 1
    numbers = hnp.arrays(np.float32, (*shape[:3], n_parts * n_samples), elements=finite)
    samples = data.draw(numbers).view(kind)
    gap = data.draw(hnp.arrays(bool, shape[:2]))
    units = data.draw(st.sampled_from(["1", "W**0.5"]))
    cube = label_cube(samples, radar, units=units)
    cube = cube.assign_coords(gap=(("frame", "chirp"), gap))

    findings = recording_findings(measure_frames(cube, radar), radar)

    assert all(finding.level in ("note", "warning") for finding in findings)
