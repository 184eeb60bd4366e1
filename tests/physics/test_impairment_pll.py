"""Swept PLL: residual tuning error and settling after flyback."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, step

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.echo_groups import frame_sampling_times
from dechirp.simulation.impairments.pll import Pll
from nightly import nightly_except

STATIC_SCENE = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])
STEP_S = 10e-9


def error_transfer_function(pll):
    """Return numerator and denominator of the error transfer function."""
    natural = 2 * np.pi * pll.natural_frequency_hz
    return [1, 0, 0], [1, 2 * pll.damping * natural, natural**2]


def tuning_error_hz(pll, radar, times_s):
    """Return the deviation of the free VCO from a linear ramp, its gain integrated numerically."""
    chirp = radar.frame.chirp
    voltage = np.linspace(0, 1, 20001)
    gain = np.polynomial.Polynomial([1, *pll.gain_change])(voltage)
    frequency = np.concatenate([[0], np.cumsum(gain[1:] + gain[:-1])])
    error_hz = chirp.ramp_bandwidth_hz * (frequency / frequency[-1] - voltage)
    return np.interp(times_s / chirp.ramp_duration_s, voltage, error_hz)


@pytest.mark.parametrize("damping", nightly_except((0.7071, 3.0), [0.3, 0.7071, 1.0, 3.0]))
@pytest.mark.parametrize("gain_change", [(), (-0.3, 0.1)])
def test_frequency_error_includes_settling_from_previous_chirps(radar, damping, gain_change):
    pll = Pll(natural_frequency_hz=250e3, damping=damping, gain_change=gain_change)
    chirp, interval_s = radar.frame.chirp, radar.frame.interval_s
    n_chirps = 4
    time_s = np.arange(0, n_chirps * interval_s, STEP_S)
    number = np.floor(time_s / interval_s + 1e-9)
    time_in_chirp_s = time_s - number * interval_s
    is_sweep = time_in_chirp_s < chirp.ramp_duration_s - STEP_S / 2
    # The reference enters without its jumps; each jump enters as a separate step.
    swept_hz = np.where(is_sweep, chirp.slope_hz_per_s * time_in_chirp_s, chirp.ramp_bandwidth_hz)
    swept_hz += number * chirp.ramp_bandwidth_hz
    curve_hz = np.where(is_sweep, tuning_error_hz(pll, radar, time_in_chirp_s), 0.0)
    _, expected_hz, _ = lsim(error_transfer_function(pll), curve_hz - swept_hz, time_s)
    for m in range(n_chirps):
        is_after_jump = time_s >= m * interval_s + chirp.ramp_duration_s - STEP_S / 2
        _, settling = step(error_transfer_function(pll), T=np.arange(is_after_jump.sum()) * STEP_S)
        expected_hz[is_after_jump] += chirp.ramp_bandwidth_hz * settling

    is_last_sweep = (number == n_chirps - 1) & is_sweep

    # Steps of 10 ns cause errors of a few hertz of 600 MHz.
    result_hz = pll.frequency_error_hz(time_in_chirp_s[is_last_sweep], radar)
    np.testing.assert_allclose(result_hz, expected_hz[is_last_sweep], atol=100.0)


@pytest.mark.parametrize("damping", [0.3, 1.0, 3.0])
def test_phase_error_is_integral_of_frequency_error(radar, damping):
    pll = Pll(natural_frequency_hz=250e3, damping=damping, gain_change=(-0.3, 0.1))
    times_s = np.linspace(0, 30e-6, 30001)

    frequency_hz = pll.frequency_error_hz(times_s, radar)

    summed = np.cumsum(frequency_hz[1:] + frequency_hz[:-1]) / 2 * 1e-9
    np.testing.assert_allclose(pll.phase_error_cycles(times_s, radar)[1:], summed, atol=1e-4)


def test_faster_loop_reduces_tuning_curve_error(radar):
    # The settled error is the second derivative of the curve over the squared natural frequency.
    times_s = np.linspace(20e-6, 28e-6, 9)
    for natural_frequency_hz in (0.5e6, 1e6):
        pll = Pll(natural_frequency_hz=natural_frequency_hz, gain_change=(-0.4,))
        natural = 2 * np.pi * natural_frequency_hz
        # f = B (u - 0.2 u^2) / 0.8, u = t / T.
        expected_hz = -0.5 * 600e6 / (30e-6 * natural) ** 2
        np.testing.assert_allclose(pll.frequency_error_hz(times_s, radar), expected_hz, rtol=1e-3)


def test_pause_and_late_adc_start_reduce_settling_error(radar):
    residuals_hz = []
    for interval_s, adc_start_s in [(31e-6, 0.5e-6), (31e-6, 4e-6), (45e-6, 4e-6)]:
        chirp = replace(radar.frame.chirp, adc_start_s=adc_start_s)
        frame = replace(radar.frame, interval_s=interval_s, chirp=chirp)
        times_s = adc_start_s + np.arange(256) / 10e6
        pll = Pll(natural_frequency_hz=300e3)
        residuals_hz.append(abs(pll.frequency_error_hz(times_s, replace(radar, frame=frame))).max())

    assert residuals_hz[0] > 10 * residuals_hz[1] > 10 * residuals_hz[2]


def test_echo_phase_follows_residual_loop_error(radar):
    pll = Pll(natural_frequency_hz=0.6e6, gain_change=(-0.3, 0.1))
    cube = dc.simulate(STATIC_SCENE, radar, impairments=[pll], dtype=np.complex128)
    clean = dc.simulate(STATIC_SCENE, radar, impairments=(), dtype=np.complex128)

    delay_s = 80 / SPEED_OF_LIGHT
    times_s = frame_sampling_times(radar, 0).times_s
    residual_cycles = pll.phase_error_cycles(times_s, radar) - pll.phase_error_cycles(
        times_s - delay_s, radar
    )
    expected = clean.values[0, :, 0] * np.exp(2j * np.pi * residual_cycles)

    # The first samples are 0.3 us after an error of several megahertz.
    relative_error = abs(cube.values[0, :, 0] - expected) / abs(expected).max()
    assert relative_error[:, :16].max() < 1e-2
    assert relative_error[:, 16:].max() < 1e-3


def test_warns_of_unsettled_loop(radar):
    back_to_back = replace(radar.frame, interval_s=30e-6)
    with pytest.warns(dc.PhysicsWarning, match="impairments.pll: frequency errors up to"):
        Pll(natural_frequency_hz=100e3).check(STATIC_SCENE, replace(radar, frame=back_to_back))


def test_rejects_loop_slower_than_ramp(radar):
    with pytest.raises(InvalidSetting, match=r"natural_frequency: 1 kHz; expected"):
        Pll(natural_frequency_hz=1e3).check(STATIC_SCENE, radar)


@pytest.mark.parametrize(
    ("field", "invalid_value"),
    [
        ("natural_frequency_hz", 0.0),
        ("natural_frequency_hz", np.nan),
        ("damping", -1.0),
        ("gain_change", (np.nan,)),
        ("gain_change", (-1.2,)),
        ("gain_change", 0.3),
        ("gain_change", [[0.3]]),
    ],
)
def test_rejects_invalid_loop(field, invalid_value):
    with pytest.raises(InvalidSetting, match=field):
        Pll(**{"natural_frequency_hz": 1e5, field: invalid_value})
