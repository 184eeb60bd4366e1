"""Bounds against Fisher information by brute force, a published case and each other."""

import numpy as np
import pytest

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.theory.bounds import (
    angle_std_rad,
    decoupled_range_std_m,
    frequency_variance,
    monopulse_std_rad,
    noncoherent_effective_snr,
    range_std_m,
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
        range_m = decoupled_range_std_m(
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


@pytest.mark.parametrize(("cycles", "chirp_cycles"), [(11, 5), (20, 3), (17, 12)])
def test_of_half_the_ratio_real_samples_have_the_same_bounds(cycles, chirp_cycles):
    # A cos(phase + w n + v m) in real noise. A whole number of cycles each way, so that the
    # image of the tone changes the bound by 1 / (N M)^2 or so: 1e-6.
    n_samples, n_chirps, amplitude, noise_power = 64, 32, 0.7, 0.02
    n, m = np.arange(n_samples)[:, None], np.arange(n_chirps)
    phase = 0.4 + 2 * np.pi * (cycles * n / n_samples + chirp_cycles * m / n_chirps)
    slope = -amplitude * np.sin(phase)
    jacobian = np.array([np.cos(phase), slope, slope * n, slope * m]).reshape(4, -1)
    found = np.diag(np.linalg.inv(jacobian @ jacobian.T / noise_power))

    echo_power = np.mean((amplitude * np.cos(phase)) ** 2)
    snr = n_samples * n_chirps * echo_power / noise_power / 2
    expected = [frequency_variance(snr=snr, n_points=n) for n in (n_samples, n_chirps)]
    np.testing.assert_allclose(found[2:], expected, rtol=1e-5)


def test_64_samples_by_32_chirps_of_minus_5_decibels_have_the_bounds_of_a_measurement_elsewhere():
    # There 1.510e-3 and 3.092e-3 rad a sample were measured, by maximum likelihood.
    snr = 64 * 32 * from_decibels(-5.0)
    found = [np.sqrt(frequency_variance(snr=snr, n_points=n)) for n in (64, 32)]
    assert found == pytest.approx([1.504e-3, 3.009e-3], abs=5e-7)


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


def test_adding_the_powers_of_channels_costs_their_number_over_the_ratio():
    chi = np.array([1e-3, 1.0, 100.0, 1e6])
    for n in (1, 12):
        raised = frequency_variance(
            snr=noncoherent_effective_snr(snr=chi, n_channels=n), n_points=64
        )
        bound = frequency_variance(snr=chi, n_points=64)
        np.testing.assert_allclose(raised / bound, 1 + n / chi, rtol=1e-12)


def test_bounds_fall_with_points_and_grow_towards_the_line():
    points = [frequency_variance(snr=1.0, n_points=n) for n in (2, 3, 10, 1000, 10**6)]
    assert np.all(np.diff(points) < 0)
    angles = np.linspace(0, 1.57, 100)
    std = angle_std_rad(snr=1.0, positions_m=[0, 1], wavelength_m=2.0, angle_rad=angles)
    assert np.all(np.diff(std) > 0)


RANGE = {"snr": 10.0, "n_samples": 128, "sample_rate_hz": 1e7, "slope_hz_per_s": 2e13}
VELOCITY = {"snr": 10.0, "n_chirps": 64, "interval_s": 35e-6, "wavelength_m": 0.0039}
UNCOUPLED = {
    "range_std_m": 0.01,
    "velocity_std_m_per_s": 0.1,
    "mid_window_frequency_hz": 77e9,
    "slope_hz_per_s": 2e13,
}
ANGLE = {"snr": 10.0, "positions_m": [0.0, 0.002], "wavelength_m": 0.0039, "angle_rad": 0.1}
MONOPULSE = {"snr": 10.0, "beamwidth_rad": 0.02, "slope": 1.6}
POINTS = {"snr": 10.0, "n_points": 64}
SUMMED = {"snr": 10.0, "n_channels": 12}
NOT_POSITIVE = [0.0, -1.0, np.nan, np.inf, [1.0, -1.0]]


@pytest.mark.parametrize(
    ("bound", "call", "name", "wrong"),
    [
        *((frequency_variance, POINTS, "snr", wrong) for wrong in NOT_POSITIVE),
        *((range_std_m, RANGE, "snr", wrong) for wrong in NOT_POSITIVE),
        *((velocity_std_m_per_s, VELOCITY, "snr", wrong) for wrong in NOT_POSITIVE),
        *((angle_std_rad, ANGLE, "snr", wrong) for wrong in NOT_POSITIVE),
        *((monopulse_std_rad, MONOPULSE, "snr", wrong) for wrong in NOT_POSITIVE),
        *((frequency_variance, POINTS, "n_points", n) for n in (1, 0, -4, 2.5, np.nan)),
        *((noncoherent_effective_snr, SUMMED, "snr", wrong) for wrong in NOT_POSITIVE),
        *((noncoherent_effective_snr, SUMMED, "n_channels", n) for n in (0, -1, 1.5)),
        *((range_std_m, RANGE, "n_samples", n) for n in (1, 128.0)),
        *((velocity_std_m_per_s, VELOCITY, "n_chirps", n) for n in (1, "64")),
        *((range_std_m, RANGE, "sample_rate_hz", wrong) for wrong in NOT_POSITIVE),
        *((range_std_m, RANGE, "slope_hz_per_s", wrong) for wrong in NOT_POSITIVE),
        *((velocity_std_m_per_s, VELOCITY, "interval_s", wrong) for wrong in NOT_POSITIVE),
        *((velocity_std_m_per_s, VELOCITY, "wavelength_m", wrong) for wrong in NOT_POSITIVE),
        *((decoupled_range_std_m, UNCOUPLED, "slope_hz_per_s", wrong) for wrong in NOT_POSITIVE),
        (decoupled_range_std_m, UNCOUPLED, "mid_window_frequency_hz", -77e9),
        (decoupled_range_std_m, UNCOUPLED, "range_std_m", -0.01),
        (decoupled_range_std_m, UNCOUPLED, "velocity_std_m_per_s", np.nan),
        *((angle_std_rad, ANGLE, "wavelength_m", wrong) for wrong in NOT_POSITIVE),
        *((angle_std_rad, ANGLE, "angle_rad", wrong) for wrong in (np.pi / 2, -2.0, [0, np.nan])),
        *((angle_std_rad, ANGLE, "positions_m", wrong) for wrong in ([], 0.0, [0.0, np.inf])),
        *((monopulse_std_rad, MONOPULSE, "beamwidth_rad", wrong) for wrong in NOT_POSITIVE),
        *((monopulse_std_rad, MONOPULSE, "slope", wrong) for wrong in NOT_POSITIVE),
    ],
)
def test_a_bound_of_what_cannot_be_is_refused(bound, call, name, wrong):
    bound(**call)
    with pytest.raises(InvalidSetting, match=rf"^{name}: .*; expected .*\."):
        bound(**call | {name: wrong})


def test_no_targets_have_no_bounds_and_the_faintest_have_huge_ones():
    for bound, call in (
        (range_std_m, RANGE),
        (velocity_std_m_per_s, VELOCITY),
        (angle_std_rad, ANGLE),
        (monopulse_std_rad, MONOPULSE),
    ):
        assert bound(**call | {"snr": []}).shape == (0,)
        # The smallest and the largest number that a float can say.
        smallest, largest = 5e-324, np.finfo(float).max
        faint, loud = bound(**call | {"snr": [smallest, largest]})
        assert faint > 1e100
        assert 0 <= loud < 1e-100
    assert decoupled_range_std_m(**UNCOUPLED | {"velocity_std_m_per_s": np.inf}) == np.inf
