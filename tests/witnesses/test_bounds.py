"""Cramer-Rao bounds against numerical Fisher information, a published case and each other."""

import numpy as np
import pytest

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.theory.bounds import (
    crlb_angle,
    crlb_range,
    crlb_velocity,
    decoupled_range_std_m,
    frequency_variance,
    monopulse_std_rad,
    noncoherent_effective_snr,
)

# Small radar whose samples are all computed explicitly.
N_SAMPLES, N_CHIRPS = 12, 9
SLOPE, SAMPLE_RATE, INTERVAL_S, MID_HZ = 20e12, 10e6, 35e-6, 77e9
WAVELENGTH_M = SPEED_OF_LIGHT / MID_HZ
UNEVEN_M = np.array([0.0, 0.5, 1.7, 4.0, 4.5]) * WAVELENGTH_M


def simulate_samples(amplitude, phase, range_m, velocity, angle, coupled):
    """Simulate the echo of one target, (sample, chirp, element)."""
    n = np.arange(N_SAMPLES)[:, None, None] / SAMPLE_RATE
    m = np.arange(N_CHIRPS)[:, None] * INTERVAL_S
    doppler_hz = 2 * velocity * MID_HZ / SPEED_OF_LIGHT
    beat_hz = 2 * SLOPE * range_m / SPEED_OF_LIGHT + (doppler_hz if coupled else 0.0)
    cycles = beat_hz * n + doppler_hz * m + UNEVEN_M * np.sin(angle) / WAVELENGTH_M
    return amplitude * np.exp(1j * (phase + 2 * np.pi * cycles))


def compute_standard_errors(parameters, noise_power, coupled):
    """Compute standard errors by inverting the Fisher information 2 Re(J^H J) / noise power."""
    steps = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-5])
    jacobian = []
    for i, step in enumerate(steps):
        upper, lower = np.array(parameters, float), np.array(parameters, float)
        upper[i] += step
        lower[i] -= step
        change = simulate_samples(*upper, coupled) - simulate_samples(*lower, coupled)
        jacobian.append(change.ravel() / (2 * step))
    jacobian = np.array(jacobian)
    information = 2 * np.real(jacobian.conj() @ jacobian.T) / noise_power
    return np.sqrt(np.diag(np.linalg.inv(information)))


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.5, -1.2])
def test_bounds_match_inverse_fisher_information(angle, coupled):
    amplitude, noise_power = 0.7, 0.02
    std = compute_standard_errors([amplitude, 0.4, 30.0, -8.0, angle], noise_power, coupled)

    element_snr = amplitude**2 / noise_power * N_SAMPLES * N_CHIRPS
    snr = element_snr * UNEVEN_M.size
    velocity_std = crlb_velocity(
        snr=snr, n_chirps=N_CHIRPS, interval_s=INTERVAL_S, wavelength_m=WAVELENGTH_M
    )
    range_std = crlb_range(
        snr=snr, n_samples=N_SAMPLES, sample_rate_hz=SAMPLE_RATE, slope_hz_per_s=SLOPE
    )
    if coupled:
        range_std = decoupled_range_std_m(
            range_std_m=range_std,
            velocity_std_m_per_s=velocity_std,
            mid_window_frequency_hz=MID_HZ,
            slope_hz_per_s=SLOPE,
        )
    angle_std = crlb_angle(
        snr=element_snr, positions_m=UNEVEN_M, wavelength_m=WAVELENGTH_M, angle_rad=angle
    )
    # Error of the central differences: about 1e-6.
    np.testing.assert_allclose(std[2:], [range_std, velocity_std, angle_std], rtol=2e-6)


@pytest.mark.parametrize(("cycles", "chirp_cycles"), [(11, 5), (20, 3), (17, 12)])
def test_real_samples_have_bounds_of_half_the_snr(cycles, chirp_cycles):
    # A cos(phase + w n + v m) in real noise. An integer number of cycles along both axes, so that
    # the image of the tone changes the bound by about 1 / (N M)^2: 1e-6.
    n_samples, n_chirps, amplitude, noise_power = 64, 32, 0.7, 0.02
    n, m = np.arange(n_samples)[:, None], np.arange(n_chirps)
    phase = 0.4 + 2 * np.pi * (cycles * n / n_samples + chirp_cycles * m / n_chirps)
    slope = -amplitude * np.sin(phase)
    jacobian = np.array([np.cos(phase), slope, slope * n, slope * m]).reshape(4, -1)
    variances = np.diag(np.linalg.inv(jacobian @ jacobian.T / noise_power))

    echo_power = np.mean((amplitude * np.cos(phase)) ** 2)
    snr = n_samples * n_chirps * echo_power / noise_power / 2
    expected = [frequency_variance(snr=snr, n_points=n) for n in (n_samples, n_chirps)]
    np.testing.assert_allclose(variances[2:], expected, rtol=1e-5)


def test_frequency_bounds_match_published_maximum_likelihood_errors():
    # 64 samples by 32 chirps at -5 dB. The published maximum-likelihood errors are 1.510e-3 and
    # 3.092e-3 rad per sample.
    snr = 64 * 32 * from_decibels(-5.0)
    std = [np.sqrt(frequency_variance(snr=snr, n_points=n)) for n in (64, 32)]
    assert std == pytest.approx([1.504e-3, 3.009e-3], abs=5e-7)


def test_angle_bound_of_16_element_array_matches_published_value():
    # 18 dB per element, half-wavelength spacing, 20 degrees.
    array = {"positions_m": 0.5 * np.arange(16), "wavelength_m": 1.0}
    std_rad = crlb_angle(snr=from_decibels(18.0), angle_rad=np.deg2rad(20.0), **array)
    assert np.rad2deg(std_rad) == pytest.approx(0.09369846731547442, rel=1e-9)


@pytest.mark.parametrize("n", [2, 3, 16, 1000])
@pytest.mark.parametrize("spacing", [0.5, 0.7, 2.0])
def test_angle_bound_of_uniform_array_follows_frequency_bound(n, spacing):
    # Phase from element to element is 2 pi d / lambda sin(theta).
    snr, angle = 30.0, 0.3
    phase_std = np.sqrt(frequency_variance(snr=n * snr, n_points=n))
    expected = phase_std / (2 * np.pi * spacing * np.cos(angle))
    positions_m = 0.004 * spacing * np.arange(n)
    std = crlb_angle(snr=snr, positions_m=positions_m, wavelength_m=0.004, angle_rad=angle)
    assert std == pytest.approx(expected, rel=1e-12)


def test_angle_bound_does_not_depend_on_array_position_or_order():
    positions_m = np.array([0.0, 0.5, 1.7, 4.0])
    settings = {"snr": 10.0, "wavelength_m": 1.0, "angle_rad": 0.2}
    std = crlb_angle(positions_m=positions_m, **settings)
    assert crlb_angle(positions_m=100.0 - positions_m, **settings) == pytest.approx(std, rel=1e-12)


def test_coincident_elements_have_infinite_angle_bound():
    for positions_m in ([0.0], [0.3, 0.3, 0.3]):
        assert np.isinf(
            crlb_angle(snr=10.0, positions_m=positions_m, wavelength_m=1.0, angle_rad=0.1)
        )


def test_monopulse_with_slope_1_6_reaches_bound_of_uniform_array():
    # The half-power width of a long uniform array is 0.8859 wavelengths over its length.
    n, snr = 400, 0.5
    bound = crlb_angle(snr=snr, positions_m=0.5 * np.arange(n), wavelength_m=1.0, angle_rad=0.0)
    std = monopulse_std_rad(snr=n * snr, beamwidth_rad=0.8859 / (0.5 * n))
    # The best slope is 1.607.
    assert std == pytest.approx(bound, rel=0.006)
    steep_slope_std = monopulse_std_rad(snr=n * snr, beamwidth_rad=0.8859 / (0.5 * n), slope=3.2)
    assert steep_slope_std == pytest.approx(std / 2)


@pytest.mark.parametrize("n", [2, 128, 10_000, 10**9])
def test_bounds_fall_with_root_of_snr_from_minus_30_to_90_db(n):
    snr = from_decibels(np.linspace(-30, 90, 121))
    count = min(n, 10_000)
    for std in (
        crlb_range(snr=snr, n_samples=n, sample_rate_hz=3e8, slope_hz_per_s=2e13),
        crlb_velocity(snr=snr, n_chirps=n, interval_s=7e-6, wavelength_m=0.0039),
        crlb_angle(
            snr=snr, positions_m=0.002 * np.arange(count), wavelength_m=0.0039, angle_rad=1.5
        ),
        monopulse_std_rad(snr=snr, beamwidth_rad=1 / n),
    ):
        assert np.all(np.isfinite(std))
        assert np.all(std > 0)
        np.testing.assert_allclose(std[:-10] / std[10:], np.sqrt(10), rtol=1e-9)


def test_noncoherent_integration_raises_variance_by_channels_over_snr():
    chi = np.array([1e-3, 1.0, 100.0, 1e6])
    for n in (1, 12):
        noncoherent_variance = frequency_variance(
            snr=noncoherent_effective_snr(snr=chi, n_channels=n), n_points=64
        )
        coherent_variance = frequency_variance(snr=chi, n_points=64)
        np.testing.assert_allclose(
            noncoherent_variance / coherent_variance, 1 + n / chi, rtol=1e-12
        )


def test_bounds_fall_with_points_and_grow_towards_endfire():
    variances = [frequency_variance(snr=1.0, n_points=n) for n in (2, 3, 10, 1000, 10**6)]
    assert np.all(np.diff(variances) < 0)
    angles = np.linspace(0, 1.57, 100)
    std = crlb_angle(snr=1.0, positions_m=[0, 1], wavelength_m=2.0, angle_rad=angles)
    assert np.all(np.diff(std) > 0)


RANGE = {"snr": 10.0, "n_samples": 128, "sample_rate_hz": 1e7, "slope_hz_per_s": 2e13}
VELOCITY = {"snr": 10.0, "n_chirps": 64, "interval_s": 35e-6, "wavelength_m": 0.0039}
DECOUPLED_RANGE = {
    "range_std_m": 0.01,
    "velocity_std_m_per_s": 0.1,
    "mid_window_frequency_hz": 77e9,
    "slope_hz_per_s": 2e13,
}
ANGLE = {"snr": 10.0, "positions_m": [0.0, 0.002], "wavelength_m": 0.0039, "angle_rad": 0.1}
MONOPULSE = {"snr": 10.0, "beamwidth_rad": 0.02, "slope": 1.6}
POINTS = {"snr": 10.0, "n_points": 64}
NONCOHERENT_SUM = {"snr": 10.0, "n_channels": 12}
NON_POSITIVE_VALUES = [0.0, -1.0, np.nan, np.inf, [1.0, -1.0]]


@pytest.mark.parametrize(
    ("bound", "valid_settings", "name", "invalid_value"),
    [
        *((frequency_variance, POINTS, "snr", value) for value in NON_POSITIVE_VALUES),
        *((crlb_range, RANGE, "snr", value) for value in NON_POSITIVE_VALUES),
        *((crlb_velocity, VELOCITY, "snr", value) for value in NON_POSITIVE_VALUES),
        *((crlb_angle, ANGLE, "snr", value) for value in NON_POSITIVE_VALUES),
        *((monopulse_std_rad, MONOPULSE, "snr", value) for value in NON_POSITIVE_VALUES),
        *((frequency_variance, POINTS, "n_points", n) for n in (1, 0, -4, 2.5, np.nan)),
        *(
            (noncoherent_effective_snr, NONCOHERENT_SUM, "snr", value)
            for value in NON_POSITIVE_VALUES
        ),
        *((noncoherent_effective_snr, NONCOHERENT_SUM, "n_channels", n) for n in (0, -1, 1.5)),
        *((crlb_range, RANGE, "n_samples", n) for n in (1, 128.0)),
        *((crlb_velocity, VELOCITY, "n_chirps", n) for n in (1, "64")),
        *((crlb_range, RANGE, "sample_rate_hz", value) for value in NON_POSITIVE_VALUES),
        *((crlb_range, RANGE, "slope_hz_per_s", value) for value in NON_POSITIVE_VALUES),
        *((crlb_velocity, VELOCITY, "interval_s", value) for value in NON_POSITIVE_VALUES),
        *((crlb_velocity, VELOCITY, "wavelength_m", value) for value in NON_POSITIVE_VALUES),
        *(
            (decoupled_range_std_m, DECOUPLED_RANGE, "slope_hz_per_s", value)
            for value in NON_POSITIVE_VALUES
        ),
        (decoupled_range_std_m, DECOUPLED_RANGE, "mid_window_frequency_hz", -77e9),
        (decoupled_range_std_m, DECOUPLED_RANGE, "range_std_m", -0.01),
        (decoupled_range_std_m, DECOUPLED_RANGE, "velocity_std_m_per_s", np.nan),
        *((crlb_angle, ANGLE, "wavelength_m", value) for value in NON_POSITIVE_VALUES),
        *((crlb_angle, ANGLE, "angle_rad", value) for value in (np.pi / 2, -2.0, [0, np.nan])),
        *((crlb_angle, ANGLE, "positions_m", value) for value in ([], 0.0, [0.0, np.inf])),
        *((monopulse_std_rad, MONOPULSE, "beamwidth_rad", value) for value in NON_POSITIVE_VALUES),
        *((monopulse_std_rad, MONOPULSE, "slope", value) for value in NON_POSITIVE_VALUES),
    ],
)
def test_rejects_invalid_setting_by_name(bound, valid_settings, name, invalid_value):
    bound(**valid_settings)
    with pytest.raises(InvalidSetting, match=rf"^{name}: .*; expected .*; ."):
        bound(**valid_settings | {name: invalid_value})


def test_bounds_are_huge_for_tiny_snr():
    for bound, settings in (
        (crlb_range, RANGE),
        (crlb_velocity, VELOCITY),
        (crlb_angle, ANGLE),
        (monopulse_std_rad, MONOPULSE),
    ):
        # Smallest and largest positive float.
        smallest, largest = 5e-324, np.finfo(float).max
        weak_std, strong_std = bound(**settings | {"snr": [smallest, largest]})
        assert weak_std > 1e100
        assert 0 <= strong_std < 1e-100
    assert decoupled_range_std_m(**DECOUPLED_RANGE | {"velocity_std_m_per_s": np.inf}) == np.inf
