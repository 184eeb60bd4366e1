"""Bounds against Fisher information by brute force, a published case and each other."""

import numpy as np
import pytest

from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.theory.bounds import (
    angle_std_rad,
    frequency_variance,
    monopulse_std_rad,
    range_std_m,
    uncoupled_range_std_m,
    velocity_std_m_per_s,
)

# A small radar whose every sample can be written down.
N_SAMPLES, N_CHIRPS = 12, 9
SLOPE, SAMPLE_RATE, INTERVAL_S, MID_HZ = 20e12, 10e6, 35e-6, 77e9
WAVELENGTH_M = SPEED_OF_LIGHT / MID_HZ
UNEVEN_M = np.array([0.0, 0.5, 1.7, 4.0, 4.5]) * WAVELENGTH_M


def samples(amplitude, phase, range_m, velocity, angle, coupled):
    """Echo of one target, (sample, chirp, element)."""
    n = np.arange(N_SAMPLES)[:, None, None] / SAMPLE_RATE
    m = np.arange(N_CHIRPS)[:, None] * INTERVAL_S
    doppler_hz = 2 * velocity * MID_HZ / SPEED_OF_LIGHT
    beat_hz = 2 * SLOPE * range_m / SPEED_OF_LIGHT + (doppler_hz if coupled else 0.0)
    cycles = beat_hz * n + doppler_hz * m + UNEVEN_M * np.sin(angle) / WAVELENGTH_M
    return amplitude * np.exp(1j * (phase + 2 * np.pi * cycles))


def standard_errors(at, noise_power, coupled):
    """From the inverse of the Fisher information 2 Re(J^H J) / noise power."""
    steps = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-5])
    jacobian = []
    for i, step in enumerate(steps):
        ahead, behind = np.array(at, float), np.array(at, float)
        ahead[i] += step
        behind[i] -= step
        change = samples(*ahead, coupled) - samples(*behind, coupled)
        jacobian.append(change.ravel() / (2 * step))
    jacobian = np.array(jacobian)
    information = 2 * np.real(jacobian.conj() @ jacobian.T) / noise_power
    return np.sqrt(np.diag(np.linalg.inv(information)))


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.5, -1.2])
def test_no_unbiased_estimate_of_range_velocity_and_angle_can_do_better(angle, coupled):
    amplitude, noise_power = 0.7, 0.02
    found = standard_errors([amplitude, 0.4, 30.0, -8.0, angle], noise_power, coupled)

    in_element = amplitude**2 / noise_power * N_SAMPLES * N_CHIRPS
    snr = in_element * UNEVEN_M.size
    velocity = velocity_std_m_per_s(
        snr=snr, n_chirps=N_CHIRPS, interval_s=INTERVAL_S, wavelength_m=WAVELENGTH_M
    )
    range_m = range_std_m(
        snr=snr, n_samples=N_SAMPLES, sample_rate_hz=SAMPLE_RATE, slope_hz_per_s=SLOPE
    )
    if coupled:
        range_m = uncoupled_range_std_m(
            range_std_m=range_m,
            velocity_std_m_per_s=velocity,
            mid_window_frequency_hz=MID_HZ,
            slope_hz_per_s=SLOPE,
        )
    bearing = angle_std_rad(
        snr=in_element, positions_m=UNEVEN_M, wavelength_m=WAVELENGTH_M, angle_rad=angle
    )
    # Central differences of the samples, and of the steps they are taken at: 1e-6 or so.
    np.testing.assert_allclose(found[2:], [range_m, velocity, bearing], rtol=2e-6)


def test_a_uniform_line_of_sixteen_elements_knows_an_angle_as_published():
    # 18 dB an element, half a wavelength apart, 20 degrees.
    line = {"positions_m": 0.5 * np.arange(16), "wavelength_m": 1.0}
    found = angle_std_rad(snr=from_decibels(18.0), angle_rad=np.deg2rad(20.0), **line)
    assert np.rad2deg(found) == pytest.approx(0.09369846731547442, rel=1e-9)


@pytest.mark.parametrize("n", [2, 3, 16, 1000])
@pytest.mark.parametrize("spacing", [0.5, 0.7, 2.0])
def test_a_uniform_line_measures_the_frequency_of_its_phases(n, spacing):
    # Phase from element to element is 2 pi d / lambda sin(theta).
    snr, angle = 30.0, 0.3
    of_phase = np.sqrt(frequency_variance(snr=n * snr, n_points=n))
    expected = of_phase / (2 * np.pi * spacing * np.cos(angle))
    positions_m = 0.004 * spacing * np.arange(n)
    found = angle_std_rad(snr=snr, positions_m=positions_m, wavelength_m=0.004, angle_rad=angle)
    assert found == pytest.approx(expected, rel=1e-12)


def test_where_the_line_lies_and_in_which_order_changes_nothing():
    line = np.array([0.0, 0.5, 1.7, 4.0])
    at = {"snr": 10.0, "wavelength_m": 1.0, "angle_rad": 0.2}
    first = angle_std_rad(positions_m=line, **at)
    assert angle_std_rad(positions_m=100.0 - line, **at) == pytest.approx(first, rel=1e-12)


def test_elements_in_one_place_tell_no_angle():
    for positions_m in ([0.0], [0.3, 0.3, 0.3]):
        assert np.isinf(
            angle_std_rad(snr=10.0, positions_m=positions_m, wavelength_m=1.0, angle_rad=0.1)
        )


def test_monopulse_with_slope_1_6_reaches_the_bound_of_a_uniform_line():
    # A long uniform line has a half-power width of 0.8859 wavelengths over its length.
    n, snr = 400, 0.5
    bound = angle_std_rad(snr=snr, positions_m=0.5 * np.arange(n), wavelength_m=1.0, angle_rad=0.0)
    found = monopulse_std_rad(snr=n * snr, beamwidth_rad=0.8859 / (0.5 * n))
    # The best slope is 1.607.
    assert found == pytest.approx(bound, rel=0.006)
    steeper = monopulse_std_rad(snr=n * snr, beamwidth_rad=0.8859 / (0.5 * n), slope=3.2)
    assert steeper == pytest.approx(found / 2)


@pytest.mark.parametrize("n", [2, 128, 10_000, 10**9])
def test_bounds_are_finite_and_fall_as_the_root_of_the_ratio_from_minus_30_to_90_decibels(n):
    snr = from_decibels(np.linspace(-30, 90, 121))
    count = min(n, 10_000)
    for std in (
        range_std_m(snr=snr, n_samples=n, sample_rate_hz=3e8, slope_hz_per_s=2e13),
        velocity_std_m_per_s(snr=snr, n_chirps=n, interval_s=7e-6, wavelength_m=0.0039),
        angle_std_rad(
            snr=snr, positions_m=0.002 * np.arange(count), wavelength_m=0.0039, angle_rad=1.5
        ),
        monopulse_std_rad(snr=snr, beamwidth_rad=1 / n),
    ):
        assert np.all(np.isfinite(std))
        assert np.all(std > 0)
        np.testing.assert_allclose(std[:-10] / std[10:], np.sqrt(10), rtol=1e-9)


def test_bounds_fall_with_points_and_grow_towards_the_line():
    points = [frequency_variance(snr=1.0, n_points=n) for n in (2, 3, 10, 1000, 10**6)]
    assert np.all(np.diff(points) < 0)
    angles = np.linspace(0, 1.57, 100)
    std = angle_std_rad(snr=1.0, positions_m=[0, 1], wavelength_m=2.0, angle_rad=angles)
    assert np.all(np.diff(std) > 0)
