"""Errors of directions due to phases of channels without calibration."""

from dataclasses import replace

import numpy as np
import pytest
from test_angle_motion_compensation import HALF_M, make_mimo_radar, make_target

import dechirp as dc
from dechirp.processing.angle.fft import Fft
from dechirp.processing.direction_finding import checked_direction_aperture, estimate_sources

LINE_OF_12 = dc.Array(rx_m=tuple((0.0, n * HALF_M, 0.0) for n in range(12)))


def make_amplitudes(radar, azimuth_rad, antenna_phases_rad, noise_power, rng):
    """Return amplitudes of the elements, (n, 12), in noise; phases (n, n_tx + n_rx)."""
    n_tx = len(radar.array.tx_m)
    n_rx = len(radar.array.rx_m)
    of_transmitters = np.repeat(antenna_phases_rad[:, :n_tx], n_rx, axis=1)
    of_receivers = np.tile(antenna_phases_rad[:, n_tx:], (1, n_tx))
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    echoes = aperture.steering_vectors(azimuth_rad) * np.exp(1j * (of_transmitters + of_receivers))
    noise = rng.normal(size=(*echoes.shape, 2)) @ [1, 1j] * np.sqrt(noise_power / 2)[..., None]
    return echoes + noise


def estimate_azimuths(radar, amplitudes, noise_power):
    """Return azimuths and standard errors of targets at rest."""
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    still = np.zeros(len(amplitudes))
    sources = estimate_sources(amplitudes, still, noise_power, radar, Fft(), aperture)
    return sources.azimuth_rad, sources.azimuth_std_rad


def make_radar(radar, n_tx):
    if n_tx == 1:
        return replace(radar, array=LINE_OF_12)
    return make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))


@pytest.mark.parametrize("n_tx", [1, 3])
@pytest.mark.parametrize("phase_std_deg", [5, 20])
def test_stated_errors_contain_phases_of_channels(radar, n_tx, phase_std_deg):
    radar, rng, n_trials = make_radar(radar, n_tx), np.random.default_rng(3), 1200
    azimuth = rng.uniform(-1, 1, n_trials)
    phases = np.radians(phase_std_deg) * rng.normal(size=(n_trials, n_tx + 12 // n_tx))
    noise = np.full(n_trials, 1e-4)  # 40 dB in an element
    amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)

    # One by one: the channels of each trial are others.
    estimates = [estimate_azimuths(radar, amplitudes[[i]], noise[[i]]) for i in range(n_trials)]

    found, std = np.squeeze(estimates).T
    # Student's distribution with ten degrees of freedom (n_tx 1) has squares of variance 5, with
    # four a heavy tail: the mean of 1,200 varies by 0.07 or more. Without the channels it is 150.
    assert 0.6 < np.mean(((found - azimuth) / std) ** 2) < 1.3


@pytest.mark.parametrize("n_tx", [1, 3])
def test_exact_arrays_keep_the_errors_of_noise(radar, n_tx):
    radar, rng, n_trials = make_radar(radar, n_tx), np.random.default_rng(4), 6000
    azimuth = rng.uniform(-1, 1, n_trials)
    noise = np.full(n_trials, 1e-3)
    phases = np.zeros((n_trials, n_tx + 12 // n_tx))
    amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)

    found, std = estimate_azimuths(radar, amplitudes, noise)

    # The mean of 6,000 squares varies by 1.8 %, five times which is 9 %.
    assert np.mean(((found - azimuth) / std) ** 2) == pytest.approx(0.99, abs=0.09)


def test_weak_echoes_have_the_errors_that_strong_ones_show(radar):
    radar, rng, n_trials = make_radar(radar, 1), np.random.default_rng(5), 1200
    noise = np.array([1e-4, 1e-2])  # 40 and 20 dB in an element
    squares = []
    for _ in range(n_trials):
        azimuth = rng.uniform(-1, 1, 2)
        phases = np.tile(np.radians(5) * rng.normal(size=13), (2, 1))
        amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)
        found, std = estimate_azimuths(radar, amplitudes, noise)
        squares.append(((found[1] - azimuth[1]) / std[1]) ** 2)

    # Noise of 4 degrees hides phases of 5 degrees: from the weak echo alone the mean is 1.6.
    assert 0.6 < np.mean(squares) < 1.3


@pytest.mark.parametrize("phase_std_rad", [0.0, 0.2])
def test_finding_recommends_to_calibrate_arrays_with_phases_of_their_own(radar, phase_std_rad):
    mismatch = dc.impairments.ChannelMismatch(phase_std_rad=phase_std_rad)
    scenario = dc.Scenario(
        radar=make_radar(radar, 1),
        scene=dc.Scene(targets=[make_target(-20, 3)]),
        impairments=(dc.impairments.ThermalNoise(), mismatch),
    )

    result = dc.run(scenario)

    findings = [str(finding) for finding in result.findings if "calibrate" in str(finding)]
    if phase_std_rad == 0:
        assert findings == []
    else:
        (finding,) = findings
        assert "phases of the channels differ" in finding
        assert "dechirp calibrate REFLECTOR --azimuth ANGLE" in finding
