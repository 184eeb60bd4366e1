"""Polynomial ramp nonlinearity: beat phase, behaviour outside the ramp and rejected settings."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.echo_groups import frame_sampling_times
from dechirp.simulation.impairments.sweep_nonlinearity import PolynomialNonlinearity

STATIC_SCENE = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])


def test_linear_error_equals_change_of_slope(radar):
    chirp, error_hz = radar.frame.chirp, 500e3
    nonlinearity = PolynomialNonlinearity(error_hz=(0.0, error_hz))
    slope = chirp.slope_hz_per_s + error_hz / chirp.ramp_duration_s
    steeper_radar = replace(
        radar, frame=replace(radar.frame, chirp=replace(chirp, slope_hz_per_s=slope))
    )

    cube = dc.simulate(STATIC_SCENE, radar, impairments=[nonlinearity], dtype=np.complex128)
    expected = dc.simulate(STATIC_SCENE, steeper_radar, impairments=(), dtype=np.complex128)
    # The radar equation uses the wavelength at mid window.
    expected *= chirp.wavelength_m / steeper_radar.frame.chirp.wavelength_m

    # Without the error the phase differs by 2 pi x 4.4 kHz x 25.6 us = 0.7 rad. The rest is ringing
    # at the ends.
    assert float(abs(cube - expected).max()) < 2e-4 * float(abs(expected).max())


def test_quadratic_error_sweeps_beat_frequency(radar):
    chirp, error_hz = radar.frame.chirp, 400e3
    nonlinearity = PolynomialNonlinearity(error_hz=(0.0, 0.0, error_hz))
    cube = dc.simulate(STATIC_SCENE, radar, impairments=[nonlinearity], dtype=np.complex128)
    clean = dc.simulate(STATIC_SCENE, radar, impairments=(), dtype=np.complex128)

    residual_rad = np.unwrap(np.angle((cube / clean).values[0, 0, 0]))

    # The derivative 2 e t / T^2, half a delay earlier, is integrated over time: 5 rad in total.
    delay_s = 80 / SPEED_OF_LIGHT
    middle_s = frame_sampling_times(radar, 0).times_s - delay_s / 2
    expected_rad = 2 * np.pi * error_hz / chirp.ramp_duration_s**2 * delay_s * middle_s**2
    residual_rad -= residual_rad[128] - expected_rad[128]
    np.testing.assert_allclose(residual_rad, expected_rad, atol=1e-4)


def test_error_is_constant_outside_ramp(radar):
    nonlinearity = PolynomialNonlinearity(error_hz=(1e5, 0.0, 2e5))
    ramp_s = radar.frame.chirp.ramp_duration_s
    extended_window = frame_sampling_times(radar, 0)._replace(
        first_sample_s=-1e-6, n_times=int((ramp_s + 2e-6) * 1e9)
    )
    extended_window = extended_window._replace(rate_hz=1e9)

    phase_rad = nonlinearity.phase_error_rad(extended_window, radar, np.random.default_rng(0))

    frequency_hz = np.diff(phase_rad[0]) * 1e9 / (2 * np.pi)
    np.testing.assert_allclose(frequency_hz[:999], 1e5, rtol=1e-6)
    np.testing.assert_allclose(frequency_hz[-998:], 3e5, rtol=1e-6)
    assert (phase_rad == phase_rad[0]).all()


def test_warns_of_error_above_sample_bandwidth(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"impairments.polynomial-nonlinearity: .* MHz"):
        PolynomialNonlinearity(error_hz=(0.0, 4e6)).check(STATIC_SCENE, radar)


@pytest.mark.parametrize("error_hz", [(), 1e5, (np.nan,), (0.0, np.inf), (1e15,), "1", [[1e5]]])
def test_rejects_invalid_polynomial(error_hz):
    with pytest.raises(InvalidSetting, match="error_hz"):
        PolynomialNonlinearity(error_hz=error_hz)
