"""Ramps that bend: beat frequencies move with the derivative of the error."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.echo_groups import sample_window
from dechirp.simulation.impairments.polynomial_nonlinearity import PolynomialNonlinearity

STILL = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])


def test_a_linear_error_is_another_slope(radar):
    chirp, error_hz = radar.frame.chirp, 500e3
    bent = PolynomialNonlinearity(error_hz=(0.0, error_hz))
    slope = chirp.slope_hz_per_s + error_hz / chirp.ramp_duration_s
    steeper = replace(radar, frame=replace(radar.frame, chirp=replace(chirp, slope_hz_per_s=slope)))

    cube = dc.simulate(STILL, radar, impairments=[bent], dtype=np.complex128)
    expected = dc.simulate(STILL, steeper, impairments=(), dtype=np.complex128)
    # The radar equation takes the wavelength at the middle of the window.
    expected *= chirp.wavelength_m / steeper.frame.chirp.wavelength_m

    # 2 pi x 4.4 kHz x 25.6 us would turn it by 0.7 rad. The rest rings from the ends.
    assert float(abs(cube - expected).max()) < 2e-4 * float(abs(expected).max())


def test_a_parabola_sweeps_the_beat_frequency_by_its_derivative_times_the_delay(radar):
    chirp, error_hz = radar.frame.chirp, 400e3
    bent = PolynomialNonlinearity(error_hz=(0.0, 0.0, error_hz))
    cube = dc.simulate(STILL, radar, impairments=[bent], dtype=np.complex128)
    straight = dc.simulate(STILL, radar, impairments=(), dtype=np.complex128)

    left_rad = np.unwrap(np.angle((cube / straight).values[0, 0, 0]))

    # The derivative 2 e t / T^2 half a delay ago, summed over time: 5 rad in all.
    delay_s = 80 / SPEED_OF_LIGHT
    middle_s = sample_window(radar, 0).times_s - delay_s / 2
    expected_rad = 2 * np.pi * error_hz / chirp.ramp_duration_s**2 * delay_s * middle_s**2
    left_rad -= left_rad[128] - expected_rad[128]
    np.testing.assert_allclose(left_rad, expected_rad, atol=1e-4)


def test_outside_the_ramp_the_error_of_its_ends_holds(radar):
    bent = PolynomialNonlinearity(error_hz=(1e5, 0.0, 2e5))
    ramp_s = radar.frame.chirp.ramp_duration_s
    around = sample_window(radar, 0)._replace(
        first_sample_s=-1e-6, n_times=int((ramp_s + 2e-6) * 1e9)
    )
    around = around._replace(rate_hz=1e9)

    phase_rad = bent.phase_error_rad(around, radar, np.random.default_rng(0))

    frequency_hz = np.diff(phase_rad[0]) * 1e9 / (2 * np.pi)
    np.testing.assert_allclose(frequency_hz[:999], 1e5, rtol=1e-6)
    np.testing.assert_allclose(frequency_hz[-998:], 3e5, rtol=1e-6)
    assert (phase_rad == phase_rad[0]).all()


def test_an_error_beyond_the_band_of_the_samples_warns(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"impairments.polynomial-nonlinearity: .* MHz"):
        PolynomialNonlinearity(error_hz=(0.0, 4e6)).check(STILL, radar)


@pytest.mark.parametrize("error_hz", [(), 1e5, (np.nan,), (0.0, np.inf), (1e15,), "1", [[1e5]]])
def test_what_is_no_polynomial_is_refused(error_hz):
    with pytest.raises(InvalidSetting, match="error_hz"):
        PolynomialNonlinearity(error_hz=error_hz)
