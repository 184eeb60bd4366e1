"""Phase errors of the sweep: each echo has their difference over its delay."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.simulation import phase_error
from dechirp.simulation.echo_groups import direct_echo_groups, frame_sampling_times
from dechirp.simulation.impairments.sweep_nonlinearity import PolynomialNonlinearity
from dechirp.simulation.simulate import simulate_ideal_echoes
from nightly import nightly, nightly_except


def build_radar(*, sampling="complex", slope=15e12, sample_rate_hz=10e6, n_samples=256, n_tx=1):
    """Build a 77 GHz radar: four chirps sampled after every echo arrived, two receivers."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=slope,
        adc_start_s=3e-6,
        ramp_duration_s=4e-6 + n_samples / sample_rate_hz,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling=sampling,
    )
    tdm = dc.multiplexing.Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp, n_chirps=4, interval_s=chirp.ramp_duration_s + 4e-6, multiplexing=tdm
        ),
        array=dc.Array(
            tx_m=[(0, 0.01 * k, 0) for k in range(n_tx)], rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def build_static_scene(*ranges_m):
    """Build static targets with equal echo powers."""
    return dc.Scene(
        targets=[
            dc.Target(name=f"at {r:g} m", position_m=(r, 0, 0), rcs_m2=(r / 10) ** 4)
            for r in ranges_m
        ]
    )


class Sinusoids(NamedTuple):
    """Sum of sinusoids, a phase error whose frequencies are known."""

    frequency_hz: np.ndarray
    amplitude_rad: np.ndarray
    start_rad: np.ndarray
    """(n_chirps, 1, n_sinusoids)."""

    def angles_rad(self, times_s):
        return 2 * np.pi * np.multiply.outer(times_s, self.frequency_hz) + self.start_rad

    def phase_rad(self, times_s):
        return np.cos(self.angles_rad(times_s)) @ self.amplitude_rad


def passed_band_hz(radar):
    """Return the band that the receiver passes, as wide as the sample rate."""
    rate_hz = radar.frame.chirp.sample_rate_hz
    return (0, rate_hz) if radar.frame.chirp.sampling == "complex" else (-rate_hz / 2, rate_hz / 2)


def draw_sinusoids(rng, scene, radar, *, band_hz, is_steep, rms_rad=3e-5):
    """Draw 200 sinusoids of which no line beside an echo is within six bins of the band's ends."""
    frequency_hz = rng.uniform(0, band_hz, 1000)
    echo_hz = [radar.frame.chirp.beat_frequency_hz(t.position_m[0]) for t in scene.targets]
    line_hz = np.add.outer(echo_hz, [frequency_hz, -frequency_hz])
    distance_hz = np.min(
        [abs(line_hz - end_hz) for end_hz in passed_band_hz(radar)], axis=(0, 1, 2)
    )
    chirp = radar.frame.chirp
    is_apart = distance_hz > 6 * chirp.sample_rate_hz / chirp.n_samples
    frequency_hz = frequency_hz[is_apart][:200]
    sizes = 1 / np.maximum(frequency_hz, band_hz / 500) if is_steep else np.ones(len(frequency_hz))
    sizes *= rms_rad * np.sqrt(2 / np.sum(sizes**2))
    angles = rng.uniform(0, 2 * np.pi, (radar.frame.n_chirps, 1, len(frequency_hz)))
    return Sinusoids(frequency_hz, sizes, angles)


def apply_stage(scene, radar, phase_rad, spread=None):
    """Apply the phase-error stage to the echoes of one frame."""
    window = frame_sampling_times(radar, 0)
    spread = spread or phase_error.find_delay_spread(
        list(direct_echo_groups(scene, radar, 0, None)), window, radar
    )
    wide_window = window.widen(spread.n_before, spread.n_after)
    chirp = radar.frame.chirp
    long_chirp = replace(
        chirp,
        adc_start_s=wide_window.first_sample_s,
        n_samples=wide_window.n_times,
        ramp_duration_s=chirp.ramp_duration_s + spread.n_after / chirp.sample_rate_hz,
    )
    frame = replace(radar.frame, chirp=long_chirp)
    # The longer chirp has a slightly different wavelength, and so a different power.
    echo = simulate_ideal_echoes(scene, replace(radar, frame=frame)).values[0]
    echo *= np.sqrt(chirp.wavelength_m**2 / long_chirp.wavelength_m**2)
    phase_window = spread.phase_sample_window(wide_window)
    return phase_error.apply_phase_error(echo, phase_rad(phase_window.times_s), spread, radar)


def sum_echoes(scene, radar, noise):
    """Sum echoes one by one, each with the lines beside it that are within the passed band.

    A small error of frequency f adds exp(+-2 pi i f t) (1 - exp(-+2 pi i f tau)) i a / 2 to an
    echo.
    """
    angles_rad = noise.angles_rad(frame_sampling_times(radar, 0).times_s)
    low_hz, high_hz = passed_band_hz(radar)
    total = 0
    for target in scene.targets:
        echo = simulate_ideal_echoes(replace(scene, targets=(target,)), radar).values[0]
        for receiver, rx_m in enumerate(radar.array.rx_m):
            back_m = np.linalg.norm(np.array(target.position_m) - rx_m)
            delay_s = (target.position_m[0] + back_m) / SPEED_OF_LIGHT
            echo_hz = radar.frame.chirp.slope_hz_per_s * delay_s
            delayed = 1 - np.exp(-2j * np.pi * noise.frequency_hz * delay_s)
            lines = np.exp(1j * angles_rad) * delayed * noise.amplitude_rad / 2
            above_hz, below_hz = echo_hz + noise.frequency_hz, echo_hz - noise.frequency_hz
            residual_rad = lines @ (above_hz < high_hz) + lines.conj() @ (below_hz >= low_hz)
            echo[:, receiver] *= 1 + 1j * residual_rad
        total = total + echo
    return total


def measure_errors_db(scene, radar, noise, spread=None):
    """Measure errors of the stage relative to the phase-noise power: first, last, inner samples.

    Without the three cells at each end of the passed band, see `remove_band_ends`.
    """
    expected = sum_echoes(scene, radar, noise)
    residue = expected - simulate_ideal_echoes(scene, radar).values[0]
    errors = apply_stage(scene, radar, noise.phase_rad, spread) - expected
    inner_errors = remove_band_ends(errors, radar)
    noise_power = np.mean(abs(residue) ** 2)
    assert np.mean(abs(errors) ** 2) < 2e-4 * noise_power
    error_power = np.mean(abs(inner_errors) ** 2, axis=(0, 1)) / noise_power
    n_end = len(error_power) // 8
    sections = error_power[:n_end], error_power[-n_end:], error_power[n_end:-n_end]
    return np.array([to_decibels(np.mean(section)) for section in sections])


def remove_band_ends(samples, radar):
    """Subtract the sinusoids within three cells of the ends of the passed band, by least squares.

    The band has steep ends. The reference passes a line by its frequency, as if it lasted for ever;
    a finite time spreads it, and what a line spreads over an end of the band is left out there and
    kept here. With these cells errors are at most -38 dB of the phase noise, without them -72 dB if
    echoes fill up to 80 % of the band.
    """
    n = samples.shape[-1]
    frequency = passed_band_hz(radar)[0] / radar.frame.chirp.sample_rate_hz
    frequencies = frequency + np.linspace(-3, 3, 13) / n
    sinusoids = np.exp(2j * np.pi * np.outer(np.arange(n), frequencies))
    basis, _ = np.linalg.qr(sinusoids)
    return samples - (samples @ basis.conj()) @ basis.T


@pytest.mark.parametrize("is_steep", nightly_except(1, [False, True]), ids=["white", "falling"])
@pytest.mark.parametrize("band", nightly_except(1, [0.4, 0.95]))
@pytest.mark.parametrize(
    ("slope", "sample_rate_hz", "ranges_m"),
    nightly_except(
        2,
        [
            (15e12, 10e6, (0.5, 20, 60)),
            (10e12, 20e6, (5, 31.3, 150)),
            (30e12, 10e6, (2, 30)),
            (20e12, 20e6, (130,)),
        ],
    ),
)
def test_echo_phase_error_is_difference_over_delay(slope, sample_rate_hz, ranges_m, band, is_steep):
    # Nonlinear terms are 90 dB below the noise, single precision 85 dB. Lines reach from one end of
    # the band to the other: an aliased line would be an error of -10 to 0 dB.
    radar, scene = (
        build_radar(slope=slope, sample_rate_hz=sample_rate_hz),
        build_static_scene(*ranges_m),
    )
    noise = draw_sinusoids(
        np.random.default_rng(1), scene, radar, band_hz=band * sample_rate_hz, is_steep=is_steep
    )

    first_db, last_db, inner_db = measure_errors_db(scene, radar, noise)

    assert max(first_db, last_db) < -70
    assert inner_db < -80


def test_phase_error_within_band_is_difference_over_delay():
    radar, scene = build_radar(slope=15e12), build_static_scene(30, 50)
    noise = draw_sinusoids(np.random.default_rng(1), scene, radar, band_hz=2e6, is_steep=False)

    first_db, last_db, inner_db = measure_errors_db(scene, radar, noise)

    assert max(first_db, last_db) < -70
    assert inner_db < -80


@pytest.mark.parametrize("is_steep", nightly_except(1, [False, True]), ids=["white", "falling"])
@pytest.mark.parametrize(
    ("slope", "n_samples", "ranges_m"), [(30e12, 512, (0.5, 30, 85)), (20e12, 256, (2, 60, 130))]
)
def test_phase_error_is_approximate_over_most_of_band(slope, n_samples, ranges_m, is_steep):
    # Echoes over 0.85 of the band and an error over 0.95 of it: some lines need echoes from beyond
    # the margins, a quarter of the window at most.
    radar = build_radar(slope=slope, sample_rate_hz=20e6, n_samples=n_samples)
    scene = build_static_scene(*ranges_m)
    noise = draw_sinusoids(np.random.default_rng(1), scene, radar, band_hz=19e6, is_steep=is_steep)

    first_db, last_db, inner_db = measure_errors_db(scene, radar, noise)

    assert max(first_db, last_db) < -38
    assert inner_db < -47


def build_slow_ramp_radar(array=None):
    """Build a radar of two slow ramps: separating delays would need 4400 more samples."""
    radar = build_radar(slope=20.4545e12, sample_rate_hz=300e6, n_samples=2200)
    return replace(
        radar, frame=replace(radar.frame, n_chirps=2), array=array or dc.Array(rx_m=[(0, 0.05, 0)])
    )


@nightly
def test_fast_noise_on_slow_ramp_is_exact_for_one_delay():
    radar, scene = build_slow_ramp_radar(dc.Array()), build_static_scene(50)
    noise = draw_sinusoids(np.random.default_rng(2), scene, radar, band_hz=100e6, is_steep=False)

    assert measure_errors_db(scene, radar, noise).max() < -80


@nightly
def test_leakage_phase_error_is_exact_among_later_echoes():
    # Leakage cancels nearly all fast noise: its residue is far below the uncancelled noise.
    radar = build_slow_ramp_radar()
    leakage, full_scene = build_static_scene(0.1), build_static_scene(0.1, 190)
    noise = draw_sinusoids(np.random.default_rng(3), leakage, radar, band_hz=100e6, is_steep=False)
    window = frame_sampling_times(radar, 0)
    spread = phase_error.find_delay_spread(
        list(direct_echo_groups(full_scene, radar, 0, None)), window, radar
    )

    error_db = measure_errors_db(leakage, radar, noise, spread=spread)

    assert error_db.max() < -25


@nightly
def test_slow_noise_on_slow_ramp_is_exact_for_all_delays():
    radar, scene = build_slow_ramp_radar(), build_static_scene(10, 30, 150)
    # A quarter of the window, times the slope: 37 MHz.
    noise = draw_sinusoids(np.random.default_rng(2), scene, radar, band_hz=15e6, is_steep=False)

    assert measure_errors_db(scene, radar, noise).max() < -80


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.complex128, 1e-12), (np.complex64, 2e-6)])
def test_zero_error_leaves_echoes_unchanged(sampling, dtype, tolerance):
    radar, scene = build_radar(sampling=sampling, n_tx=2), build_static_scene(1, 20, 45)
    zero_error = PolynomialNonlinearity(error_hz=(0.0,))

    with_stage = dc.simulate(scene, radar, impairments=[zero_error], dtype=dtype)
    without_stage = dc.simulate(scene, radar, impairments=(), dtype=dtype)

    assert with_stage.dtype == without_stage.dtype
    np.testing.assert_allclose(
        with_stage, without_stage, rtol=0, atol=tolerance * float(abs(without_stage).max())
    )


def test_carrier_error_rotates_each_echo_by_its_delay():
    radar, ranges_m = build_radar(), (7.0, 40.0)
    error_hz = 300e3
    cubes = [
        dc.simulate(build_static_scene(r), radar, impairments=(), dtype=np.complex128)
        for r in ranges_m
    ]

    cube = dc.simulate(
        build_static_scene(*ranges_m),
        radar,
        impairments=[PolynomialNonlinearity(error_hz=(error_hz,))],
        dtype=np.complex128,
    )

    expected = sum(
        cube_of_target * np.exp(2j * np.pi * error_hz * 2 * r / SPEED_OF_LIGHT)
        for cube_of_target, r in zip(cubes, ranges_m, strict=True)
    )
    # Offset of 1.9 mm of the second receiver: 3e-6 rad. The rest is ringing from the ends.
    assert float(abs(cube - expected).max()) < 1e-3 * float(abs(expected).max())


def test_real_samples_are_real_part_of_complex_samples():
    nonlinearity = [PolynomialNonlinearity(error_hz=(0.0, 0.0, 1e5))]
    radar, scene = build_radar(), build_static_scene(10, 30)

    complex_cube = dc.simulate(scene, radar, impairments=nonlinearity, dtype=np.complex128)
    real_cube = dc.simulate(
        scene, build_radar(sampling="real"), impairments=nonlinearity, dtype=np.complex128
    )

    difference = real_cube.values[0] - np.sqrt(2) * complex_cube.values[0].real
    largest = float(abs(complex_cube).max())
    # Real samples pass half the sample rate on either side of 0, complex ones all above 0: what the
    # error spreads over the ends of these bands differs, by 2e-5 of the largest sample. In the
    # cells from 4 on from the ends it is the sidelobes of that.
    assert abs(difference).max() < 3e-5 * largest
    hann = np.hanning(difference.shape[-1])
    cells = abs(np.fft.rfft(difference * hann)) / hann.sum()
    assert cells[..., 4:-4].max() < 1e-7 * largest


def test_phases_of_all_errors_add():
    radar, scene = build_radar(), build_static_scene(10, 30)
    first_hz, second_hz = (0.0, 2e5), (1e5, 0.0, -1e5)
    sum_hz = tuple(np.add((*first_hz, 0.0), second_hz))

    cube_of_list = dc.simulate(
        scene,
        radar,
        impairments=[PolynomialNonlinearity(error_hz=e) for e in (first_hz, second_hz)],
        dtype=np.complex128,
    )
    cube_of_sum = dc.simulate(
        scene, radar, impairments=[PolynomialNonlinearity(error_hz=sum_hz)], dtype=np.complex128
    )

    np.testing.assert_allclose(
        cube_of_list, cube_of_sum, atol=1e-11 * float(abs(cube_of_sum).max())
    )


def test_empty_scene_gives_zero_samples():
    cube = dc.simulate(
        dc.Scene(targets=()), build_radar(), impairments=[PolynomialNonlinearity(error_hz=(1e5,))]
    )

    assert not cube.values.any()


def test_delay_spread_covers_nearest_to_farthest_echo():
    radar = build_radar()
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(10, 0, 0), velocity_m_per_s=(-30, 0, 0)),
            dc.Target(position_m=(0, 50, 0), velocity_m_per_s=(0, 40, 0)),
        ]
    )
    spread = phase_error.find_delay_spread(
        list(direct_echo_groups(scene, radar, 0, None)), frame_sampling_times(radar, 0), radar
    )
    samples_per_m = 2 / SPEED_OF_LIGHT * radar.frame.chirp.sample_rate_hz

    assert spread.first_delay <= 10 * samples_per_m
    assert spread.mid_delay == pytest.approx(30 * samples_per_m, abs=1)
    # Margin: the movement within the frame.
    assert 50 * samples_per_m <= spread.last_delay <= 50 * samples_per_m + 0.01


def test_margins_are_at_most_half_of_window():
    for slope in (1e9, 1e11, 1e13):
        radar = build_radar(slope=slope, n_samples=128)
        spread = phase_error.find_delay_spread([], frame_sampling_times(radar, 0), radar)
        assert 0 < spread.n_before == spread.n_after <= 32


@pytest.mark.parametrize("n_samples", [2, 3, 9, 40])
@pytest.mark.filterwarnings("ignore:impairments. an oscillator")
@pytest.mark.parametrize("slope", [15e12, 300e12])
def test_few_samples_are_rotated_by_a_delay_of_the_echoes(n_samples, slope):
    radar, error_hz = build_radar(n_samples=n_samples, slope=slope), 3e4
    nonlinearity = PolynomialNonlinearity(error_hz=(error_hz,))
    single_cubes = [
        dc.simulate(build_static_scene(r), radar, impairments=(), dtype=np.complex128)
        for r in (1, 2)
    ]

    cube = dc.simulate(
        build_static_scene(1, 2), radar, impairments=[nonlinearity], dtype=np.complex128
    )

    first, last = np.exp(2j * np.pi * error_hz * np.array([2, 4]) / SPEED_OF_LIGHT)
    # Error of applying the wrong delay to both echoes, times two.
    tolerance = 4 * abs(last - first) * float(abs(single_cubes[0]).max())
    assert float(abs(cube - single_cubes[0] * first - single_cubes[1] * last).max()) < tolerance


def test_warns_of_ramp_too_slow_for_phase_error(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=1e12)
    slow_radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=2))
    noise = dc.impairments.PhaseNoise(offset_hz=[1e5], level_per_hz=[1e-9])
    with pytest.warns(dc.PhysicsWarning, match=r"fs\^2 / S = 100 samples") as warnings:
        dc.simulate(dc.Scene(), slow_radar, impairments=[noise])
    assert len(warnings) == 1
