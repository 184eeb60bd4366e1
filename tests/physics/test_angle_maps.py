"""Power over directions: targets stand where they are, and as strong as they are."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.monopulse import Monopulse
from dechirp.processing.angle.music import Music
from dechirp.processing.simd_beamforming import mirrored_beams, raise_to_beam_power
from dechirp.radar.budget import received_power_w
from noise import noise_cube

HALF_M = 1.95e-3


@pytest.fixture(scope="module")
def base(radar) -> dc.Radar:
    """One transmitter and eight receivers in a row."""
    frame = replace(radar.frame, chirp=replace(radar.frame.chirp, n_samples=128), n_chirps=32)
    return replace(radar, frame=frame, array=row(8))


def row(n_rx: int, tx_m=((0, 0, 0),)) -> dc.Array:
    return dc.Array(tx_m=list(tx_m), rx_m=[(0, k * HALF_M, 0) for k in range(n_rx)])


def at(range_m: float, azimuth: float, velocity: float = 0.0, elevation: float = 0.0) -> dc.Target:
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return dc.Target(
        position_m=tuple(range_m * towards), velocity_m_per_s=tuple(velocity * towards), rcs_m2=10
    )


def frame_of(radar: dc.Radar, *targets: dc.Target, seed: int = 1):
    return dc.simulate(dc.Scene(targets=targets), radar, seed=seed).isel(frame=0)


def top(power) -> tuple[float, float]:
    """Sine of the azimuth, and the range, of the highest cell."""
    where = np.unravel_index(int(power.values.argmax()), power.shape)
    return float(np.sin(power.azimuth[where[0]])), float(power.range[where[1]])


RADARS = {
    "receivers": lambda r: r,
    "real": lambda r: replace(
        r, frame=replace(r.frame, chirp=replace(r.frame.chirp, sampling="real"))
    ),
    "turns": lambda r: shared(r, dc.multiplexing.Tdm(order=[1, 0])),
    "signs": lambda r: shared(r, dc.multiplexing.Bpm(order=[0, 1])),
    "sub-bands": lambda r: shared(r, dc.multiplexing.Ddma(order=[0, 1], n_sub_bands=3)),
    "triangles": lambda r: replace(
        r, frame=replace(r.frame, modulation=dc.modulations.Triangular())
    ),
    "shifted": lambda r: replace(
        r, frame=replace(r.frame, modulation=dc.modulations.FrequencyShiftKeying(step_hz=1e6))
    ),
}


def shared(radar: dc.Radar, code) -> dc.Radar:
    array = row(4, tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0)])
    return replace(radar, array=array, frame=replace(radar.frame, multiplexing=code))


@pytest.mark.parametrize("kind", RADARS)
def test_a_target_stands_at_its_range_and_azimuth_whatever_is_sent(base, kind):
    radar = RADARS[kind](base)
    # Within the velocities of the slowest round, 9 m/s.
    cube = frame_of(radar, at(20.0, 0.4, velocity=6.0))

    power = dc.range_azimuth_map(cube, radar)

    sine, range_m = top(power)
    step = float(np.diff(np.sin(power.azimuth.values))[0])
    assert sine == pytest.approx(np.sin(0.4), abs=0.6 * step)
    # Half a bin, and what range-Doppler coupling leaves in: 0.02 m.
    assert range_m == pytest.approx(20.0, abs=0.5 * float(power.range[1]) + 0.05)


def test_the_power_of_a_beam_is_that_of_the_echo_in_one_element(base):
    chirp = base.frame.chirp
    range_m = 30 * chirp.range_resolution_m
    cube = frame_of(base, at(range_m, 0.0))

    power = dc.range_azimuth_map(cube, base)

    # 45 dB over the noise of a beam; a millimetre off the bin costs nothing.
    expected = received_power_w(base, range_m=range_m, rcs_m2=10)
    assert to_decibels(float(power.max())) == pytest.approx(to_decibels(float(expected)), abs=0.1)
    assert power.attrs["units"] == "W"


def test_noise_alone_is_level_over_directions_and_ranges(base):
    cube = noise_cube(base, np.random.default_rng(5)).isel(frame=0)

    power = dc.range_azimuth_map(cube, base, dc.Chain(doppler_window="rectangular"))

    # The strongest of 32 independent exponentials is 4.06 times their mean, with a standard
    # deviation of 1.27; of some 85 independent ranges by 8 beams the mean is good to 1.2 %.
    chirps, samples, elements = 32, 128, 8
    mean = 1.5 / (chirps * samples * elements)
    strongest = np.sum(1 / np.arange(1, 33))
    assert float(power.mean()) == pytest.approx(strongest * mean, rel=0.07)
    assert power.mean("range").values == pytest.approx(strongest * mean, rel=0.2)


def test_on_a_plane_the_strongest_elevation_counts(base):
    plane = dc.Array(rx_m=[(0, k * HALF_M, j * HALF_M) for k in range(4) for j in range(4)])
    radar = replace(base, array=plane)
    cube = frame_of(radar, at(20.0, -0.3, elevation=0.35))

    power = dc.range_azimuth_map(cube, radar)
    # A sixteenth of a sine is a step of the grid, and beams are read within one.
    assert top(power)[0] == pytest.approx(np.sin(-0.3), abs=1 / 16)

    found = dc.detect(cube.expand_dims("frame"), radar)
    spectrum = dc.angle_spectrum(cube, radar, found, 0)
    up, left = np.unravel_index(int(spectrum.values.argmax()), spectrum.shape)
    assert float(np.sin(spectrum.azimuth[left])) == pytest.approx(np.sin(-0.3), abs=0.6 / 16)
    assert float(np.sin(spectrum.elevation[up])) == pytest.approx(np.sin(0.35), abs=0.6 / 16)


ARRAYS = {
    "an odd line": [(0, k, 0) for k in range(5)],
    "an uneven line": [(0, k, 0) for k in (0, 1, 2.3, 5)],
    "two at one place": [(0, k, 0) for k in (0, 1, 1, 2)],
    "an odd plane": [(0, k, j) for k in range(3) for j in range(3)],
    "a corner": [(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 0, 1), (0, 0, 2)],
    "a bent line": [(1, 0, 0), (0, 1, 0), (0, 2, 0), (1, 3, 0)],
    "no order": [(0.3, 0, 1.7), (1, 1.2, 0), (0, 2.1, 0.4), (2, 0.1, 2)],
}


@pytest.mark.parametrize("shape", ARRAYS)
def test_beams_made_in_mirrored_pairs_are_those_made_one_by_one(shape):
    seen = Aperture(np.array(ARRAYS[shape]) / 2 + 3.0)
    rng = np.random.default_rng(8)
    parts = rng.normal(size=(2, seen.n_elements, 2, 300)).astype(np.float32)
    heard = parts[:, :, 0] + 1j * parts[:, :, 1]
    still = np.ones(heard.shape[:2], np.complex64)

    folded, weights = mirrored_beams(seen)
    power = np.zeros((len(seen.grid.azimuth_rad), 300), np.float32)
    raise_to_beam_power(power, parts, still, folded, weights)

    each = abs(seen.grid.steering.conj() @ heard / seen.n_elements) ** 2
    expected = each.reshape(2, *seen.grid.shape, 300).max(axis=(0, 1))
    assert abs(power - expected).max() < 2e-6 * expected.max()


def test_a_map_needs_no_more_memory_than_three_cubes(base):
    import tracemalloc

    radar = replace(base, frame=replace(base.frame, n_chirps=128))
    cube = noise_cube(radar, np.random.default_rng(6)).isel(frame=0)
    dc.range_azimuth_map(cube, radar)  # tables and compiled code
    tracemalloc.start()
    dc.range_azimuth_map(cube, radar)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Blocks of beams take some 10 MiB, whatever the cube.
    assert peak < 3 * cube.nbytes + 12 * 2**20


@pytest.mark.parametrize(
    ("estimator", "named"),
    [
        (None, "bartlett"),
        (Bartlett(), "bartlett"),
        (Monopulse(), "bartlett"),
        (Music(n_sources=2), "music"),
    ],
    ids=str,
)
def test_the_spectrum_of_a_detection_peaks_where_it_is(base, estimator, named):
    cube = frame_of(base, at(20.0, 0.5), at(32.0, -0.2))
    chain = dc.Chain(angle=estimator)
    found = dc.detect(cube.expand_dims("frame"), base, chain)

    for which in range(found.sizes["detection"]):
        spectrum = dc.angle_spectrum(cube, base, found, which, chain)
        truth = 0.5 if float(found.range[which]) < 26 else -0.2
        highest = float(spectrum.azimuth[int(spectrum.values[0].argmax())])
        assert spectrum.attrs["estimator"] == named
        assert spectrum.sizes["elevation"] == 1
        # Five standard errors at 36 dB an element are 0.1 degrees; steps are 0.5.
        assert highest == pytest.approx(truth, abs=np.radians(0.6))


def test_a_weak_detection_is_seen_without_the_sidelobes_of_a_strong_one(base):
    strong = replace(at(20.0, 0.5), rcs_m2=1e4)
    near_m = 20.0 + 20.5 * base.frame.chirp.range_resolution_m
    cube = frame_of(base, strong, at(near_m, -0.3))
    found = dc.detect(cube.expand_dims("frame"), base)
    weak = int(abs(found.range.values - near_m).argmin())

    spectrum = dc.angle_spectrum(cube, base, found, weak)

    # It is 38 dB stronger: its sidelobe without a window, 36 dB down, covers the weak one.
    azimuth = float(spectrum.azimuth[int(spectrum.values[0].argmax())])
    assert azimuth == pytest.approx(-0.3, abs=np.radians(1.5))
    left = float(spectrum.sel(azimuth=0.5, method="nearest").max())
    assert left < 0.1 * float(spectrum.max())


def test_an_upright_line_has_a_spectrum_over_elevation_and_no_azimuths(base):
    upright = dc.Array(rx_m=[(0, 0, k * HALF_M) for k in range(8)])
    radar = replace(base, array=upright)
    cube = frame_of(radar, at(20.0, 0.0, elevation=0.2))
    found = dc.detect(cube.expand_dims("frame"), radar)

    spectrum = dc.angle_spectrum(cube, radar, found, 0)

    assert spectrum.sizes["azimuth"] == 1
    highest = float(spectrum.elevation[int(spectrum.values[:, 0].argmax())])
    assert highest == pytest.approx(0.2, abs=np.radians(0.6))
    with pytest.raises(
        dc.InvalidSetting, match=r"radar.array: a vertical linear array.*angle_spectrum"
    ):
        dc.range_azimuth_map(cube, radar)


def test_a_calibration_puts_targets_where_they_are(base):
    rng = np.random.default_rng(7)
    gain = np.exp(2j * np.pi * rng.uniform(size=8)) * rng.uniform(0.7, 1.4, 8)
    cube = frame_of(base, at(20.0, 0.3))
    crooked = cube.copy(data=(cube.values * gain[:, None]).astype(np.complex64))
    calibration = dc.Calibration(
        elements=[(0, k) for k in range(8)], gain=[(one.real, one.imag) for one in 1 / gain]
    )
    radar = replace(base, calibration=calibration)

    plain, mended = (dc.range_azimuth_map(crooked, one) for one in (base, radar))

    assert top(mended)[0] == pytest.approx(np.sin(0.3), abs=0.02)
    assert float(mended.max()) > 2 * float(plain.max())
