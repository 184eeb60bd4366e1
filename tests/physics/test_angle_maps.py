"""Range-azimuth maps and angle spectra: positions, power, memory and calibration."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.monopulse import Monopulse
from dechirp.processing.angle.music import Music
from dechirp.processing.simd_beamforming import mirrored_beam_weights, raise_to_largest_beam_power
from dechirp.radar.budget import received_power_w
from nightly import nightly
from noise_cubes import simulate_noise_cube

HALF_M = 1.95e-3


@pytest.fixture(scope="module")
def eight_channel_radar(radar) -> dc.Radar:
    """Return a radar with one transmitter and a line of eight receivers."""
    frame = replace(radar.frame, chirp=replace(radar.frame.chirp, n_samples=128), n_chirps=32)
    return replace(radar, frame=frame, array=uniform_linear_array(8))


def uniform_linear_array(n_rx: int, tx_m=((0, 0, 0),)) -> dc.Array:
    return dc.Array(tx_m=list(tx_m), rx_m=[(0, k * HALF_M, 0) for k in range(n_rx)])


def make_target(
    range_m: float, azimuth: float, velocity: float = 0.0, elevation: float = 0.0
) -> dc.Target:
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return dc.Target(
        position_m=tuple(range_m * direction),
        velocity_m_per_s=tuple(velocity * direction),
        rcs_m2=10,
    )


def simulate_frame(radar: dc.Radar, *targets: dc.Target, seed: int = 1):
    return dc.simulate(dc.Scene(targets=targets), radar, seed=seed).isel(frame=0)


def find_peak(power) -> tuple[float, float]:
    """Return the sine of the azimuth and the range of the highest cell."""
    index = np.unravel_index(int(power.values.argmax()), power.shape)
    return float(np.sin(power.azimuth[index[0]])), float(power.range[index[1]])


RADAR_VARIANTS = {
    "simo": lambda r: r,
    "real": lambda r: replace(
        r, frame=replace(r.frame, chirp=replace(r.frame.chirp, sampling="real"))
    ),
    "tdm": lambda r: add_transmitter(r, dc.multiplexing.Tdm(order=[1, 0])),
    "bpm": lambda r: add_transmitter(r, dc.multiplexing.Bpm(order=[0, 1])),
    "ddma": lambda r: add_transmitter(r, dc.multiplexing.Ddma(order=[0, 1], n_sub_bands=3)),
    "triangular": lambda r: replace(
        r, frame=replace(r.frame, modulation=dc.modulations.Triangular())
    ),
    "fsk": lambda r: replace(
        r, frame=replace(r.frame, modulation=dc.modulations.FrequencyShiftKeying(step_hz=1e6))
    ),
}


def add_transmitter(radar: dc.Radar, code) -> dc.Radar:
    array = uniform_linear_array(4, tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0)])
    return replace(radar, array=array, frame=replace(radar.frame, multiplexing=code))


@pytest.mark.parametrize("variant", RADAR_VARIANTS)
def test_map_peaks_at_target_range_and_azimuth_for_every_waveform(eight_channel_radar, variant):
    radar = RADAR_VARIANTS[variant](eight_channel_radar)
    # The velocity stays within the smallest unambiguous limit of the waveforms, 9 m/s.
    cube = simulate_frame(radar, make_target(20.0, 0.4, velocity=6.0))

    power = dc.range_azimuth_map(cube, radar)

    sine, range_m = find_peak(power)
    grid_step = float(np.diff(np.sin(power.azimuth.values))[0])
    assert sine == pytest.approx(np.sin(0.4), abs=0.6 * grid_step)
    # Half a bin, and the residual range-Doppler coupling of 0.02 m.
    assert range_m == pytest.approx(20.0, abs=0.5 * float(power.range[1]) + 0.05)


def test_beam_power_equals_echo_power_of_one_element(eight_channel_radar):
    chirp = eight_channel_radar.frame.chirp
    range_m = 30 * chirp.range_resolution_m
    cube = simulate_frame(eight_channel_radar, make_target(range_m, 0.0))

    power = dc.range_azimuth_map(cube, eight_channel_radar)

    # The echo is 45 dB above the noise of a beam; a millimetre off the bin costs nothing.
    expected = received_power_w(eight_channel_radar, range_m=range_m, rcs_m2=10)
    assert to_decibels(float(power.max())) == pytest.approx(to_decibels(float(expected)), abs=0.1)
    assert power.attrs["units"] == "W"


def test_noise_map_is_flat_over_azimuth_and_range(eight_channel_radar):
    cube = simulate_noise_cube(eight_channel_radar, np.random.default_rng(5)).isel(frame=0)

    power = dc.range_azimuth_map(cube, eight_channel_radar, dc.Chain(doppler_window="rectangular"))

    # The maximum of 32 independent exponentials is 4.06 times their mean, with a standard deviation
    # of 1.27; some 85 independent ranges by 8 beams determine the mean to 1.2 %.
    chirps, samples, elements = 32, 128, 8
    mean = 1.5 / (chirps * samples * elements)
    strongest = np.sum(1 / np.arange(1, 33))
    assert float(power.mean()) == pytest.approx(strongest * mean, rel=0.07)
    assert power.mean("range").values == pytest.approx(strongest * mean, rel=0.2)


@nightly
def test_planar_array_map_keeps_strongest_elevation(eight_channel_radar):
    planar_array = dc.Array(rx_m=[(0, k * HALF_M, j * HALF_M) for k in range(4) for j in range(4)])
    radar = replace(eight_channel_radar, array=planar_array)
    cube = simulate_frame(radar, make_target(20.0, -0.3, elevation=0.35))

    power = dc.range_azimuth_map(cube, radar)
    # The grid step is 1/16 in sine, and beams are exact within one step.
    assert find_peak(power)[0] == pytest.approx(np.sin(-0.3), abs=1 / 16)

    detections = dc.detect(cube.expand_dims("frame"), radar)
    spectrum = dc.angle_spectrum(cube, radar, detections, 0)
    elevation_index, azimuth_index = np.unravel_index(int(spectrum.values.argmax()), spectrum.shape)
    assert float(np.sin(spectrum.azimuth[azimuth_index])) == pytest.approx(
        np.sin(-0.3), abs=0.6 / 16
    )
    assert float(np.sin(spectrum.elevation[elevation_index])) == pytest.approx(
        np.sin(0.35), abs=0.6 / 16
    )


ARRAYS = {
    "odd line": [(0, k, 0) for k in range(5)],
    "nonuniform line": [(0, k, 0) for k in (0, 1, 2.3, 5)],
    "coincident elements": [(0, k, 0) for k in (0, 1, 1, 2)],
    "odd plane": [(0, k, j) for k in range(3) for j in range(3)],
    "corner": [(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 0, 1), (0, 0, 2)],
    "bent line": [(1, 0, 0), (0, 1, 0), (0, 2, 0), (1, 3, 0)],
    "irregular": [(0.3, 0, 1.7), (1, 1.2, 0), (0, 2.1, 0.4), (2, 0.1, 2)],
}


@pytest.mark.parametrize("shape", ARRAYS)
def test_mirrored_beam_pairs_equal_individual_beams(shape):
    aperture = Aperture(np.array(ARRAYS[shape]) / 2 + 3.0)
    rng = np.random.default_rng(8)
    parts = rng.normal(size=(2, aperture.n_elements, 2, 300)).astype(np.float32)
    snapshots = parts[:, :, 0] + 1j * parts[:, :, 1]
    doppler_correction = np.ones(snapshots.shape[:2], np.complex64)

    mirrored, weights = mirrored_beam_weights(aperture)
    power = np.zeros((len(aperture.direction_grid.azimuth_rad), 300), np.float32)
    raise_to_largest_beam_power(power, parts, doppler_correction, mirrored, weights)

    beam_power = abs(aperture.direction_grid.steering.conj() @ snapshots / aperture.n_elements) ** 2
    expected = beam_power.reshape(2, *aperture.direction_grid.shape, 300).max(axis=(0, 1))
    assert abs(power - expected).max() < 2e-6 * expected.max()


def test_map_memory_stays_below_three_cubes(eight_channel_radar):
    import tracemalloc

    radar = replace(eight_channel_radar, frame=replace(eight_channel_radar.frame, n_chirps=128))
    cube = simulate_noise_cube(radar, np.random.default_rng(6)).isel(frame=0)
    dc.range_azimuth_map(cube, radar)  # fill tables and compile code
    tracemalloc.start()
    dc.range_azimuth_map(cube, radar)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Blocks of beams take some 10 MiB for any cube.
    assert peak < 3 * cube.nbytes + 12 * 2**20


@pytest.mark.parametrize(
    ("estimator", "estimator_name"),
    [
        (None, "bartlett"),
        (Bartlett(), "bartlett"),
        (Monopulse(), "bartlett"),
        (Music(n_sources=2), "music"),
    ],
    ids=str,
)
def test_angle_spectrum_peaks_at_detected_target(eight_channel_radar, estimator, estimator_name):
    cube = simulate_frame(eight_channel_radar, make_target(20.0, 0.5), make_target(32.0, -0.2))
    chain = dc.Chain(angle=estimator)
    detections = dc.detect(cube.expand_dims("frame"), eight_channel_radar, chain)

    for index in range(detections.sizes["detection"]):
        spectrum = dc.angle_spectrum(cube, eight_channel_radar, detections, index, chain)
        truth = 0.5 if float(detections.range[index]) < 26 else -0.2
        peak_azimuth = float(spectrum.azimuth[int(spectrum.values[0].argmax())])
        assert spectrum.attrs["estimator"] == estimator_name
        assert spectrum.sizes["elevation"] == 1
        # Five standard errors at 36 dB per element are 0.1 degrees; grid steps are 0.5 degrees.
        assert peak_azimuth == pytest.approx(truth, abs=np.radians(0.6))


def test_angle_spectrum_excludes_sidelobes_of_stronger_detection(eight_channel_radar):
    strong_target = replace(make_target(20.0, 0.5), rcs_m2=1e4)
    near_m = 20.0 + 20.5 * eight_channel_radar.frame.chirp.range_resolution_m
    cube = simulate_frame(eight_channel_radar, strong_target, make_target(near_m, -0.3))
    detections = dc.detect(cube.expand_dims("frame"), eight_channel_radar)
    weak_index = int(abs(detections.range.values - near_m).argmin())

    spectrum = dc.angle_spectrum(cube, eight_channel_radar, detections, weak_index)

    # The strong echo is 38 dB above the weak one: its sidelobe without a window, at -36 dB, masks
    # it.
    azimuth = float(spectrum.azimuth[int(spectrum.values[0].argmax())])
    assert azimuth == pytest.approx(-0.3, abs=np.radians(1.5))
    residual_power = float(spectrum.sel(azimuth=0.5, method="nearest").max())
    assert residual_power < 0.1 * float(spectrum.max())


def test_vertical_array_has_elevation_spectrum_and_no_azimuth_map(eight_channel_radar):
    vertical_array = dc.Array(rx_m=[(0, 0, k * HALF_M) for k in range(8)])
    radar = replace(eight_channel_radar, array=vertical_array)
    cube = simulate_frame(radar, make_target(20.0, 0.0, elevation=0.2))
    detections = dc.detect(cube.expand_dims("frame"), radar)

    spectrum = dc.angle_spectrum(cube, radar, detections, 0)

    assert spectrum.sizes["azimuth"] == 1
    peak_elevation = float(spectrum.elevation[int(spectrum.values[:, 0].argmax())])
    assert peak_elevation == pytest.approx(0.2, abs=np.radians(0.6))
    with pytest.raises(
        dc.InvalidSetting, match=r"radar.array: a vertical linear array.*angle_spectrum"
    ):
        dc.range_azimuth_map(cube, radar)


def test_map_applies_calibration(eight_channel_radar):
    rng = np.random.default_rng(7)
    gain = np.exp(2j * np.pi * rng.uniform(size=8)) * rng.uniform(0.7, 1.4, 8)
    cube = simulate_frame(eight_channel_radar, make_target(20.0, 0.3))
    uncalibrated_cube = cube.copy(data=(cube.values * gain[:, None]).astype(np.complex64))
    calibration = dc.Calibration(
        elements=[(0, k) for k in range(8)],
        gain=[(factor.real, factor.imag) for factor in 1 / gain],
    )
    radar = replace(eight_channel_radar, calibration=calibration)

    uncalibrated_map, calibrated_map = (
        dc.range_azimuth_map(uncalibrated_cube, r) for r in (eight_channel_radar, radar)
    )

    assert find_peak(calibrated_map)[0] == pytest.approx(np.sin(0.3), abs=0.02)
    assert float(calibrated_map.max()) > 2 * float(uncalibrated_map.max())
