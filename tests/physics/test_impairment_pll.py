"""A swept loop: what it leaves of the tuning curve, and how it settles after the jump back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, step

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.echo_groups import sample_window
from dechirp.simulation.impairments.pll import Pll

STILL = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])
STEP_S = 10e-9


def loop_of(pll):
    """Numerator and denominator of the error transfer function."""
    natural = 2 * np.pi * pll.natural_frequency_hz
    return [1, 0, 0], [1, 2 * pll.damping * natural, natural**2]


def tuned_hz(pll, radar, within_s):
    """What the VCO alone is off a linear ramp, its gain summed numerically."""
    chirp = radar.frame.chirp
    voltage = np.linspace(0, 1, 20001)
    gain = np.polynomial.Polynomial([1, *pll.gain_change])(voltage)
    frequency = np.concatenate([[0], np.cumsum(gain[1:] + gain[:-1])])
    off = chirp.ramp_bandwidth_hz * (frequency / frequency[-1] - voltage)
    return np.interp(within_s / chirp.ramp_duration_s, voltage, off)


@pytest.mark.parametrize("damping", [0.3, 0.7071, 1.0, 3.0])
@pytest.mark.parametrize("gain_change", [(), (-0.3, 0.1)])
def test_the_loop_filters_what_three_chirps_before_did(radar, damping, gain_change):
    pll = Pll(natural_frequency_hz=250e3, damping=damping, gain_change=gain_change)
    chirp, interval_s = radar.frame.chirp, radar.frame.interval_s
    n_chirps = 4
    time_s = np.arange(0, n_chirps * interval_s, STEP_S)
    number = np.floor(time_s / interval_s + 1e-9)
    since_s = time_s - number * interval_s
    sweeps = since_s < chirp.ramp_duration_s - STEP_S / 2
    # The reference without its jumps goes in as it is, each jump as a step of its own.
    swept_hz = np.where(sweeps, chirp.slope_hz_per_s * since_s, chirp.ramp_bandwidth_hz)
    swept_hz += number * chirp.ramp_bandwidth_hz
    curve_hz = np.where(sweeps, tuned_hz(pll, radar, since_s), 0.0)
    _, expected_hz, _ = lsim(loop_of(pll), curve_hz - swept_hz, time_s)
    for m in range(n_chirps):
        after = time_s >= m * interval_s + chirp.ramp_duration_s - STEP_S / 2
        _, settling = step(loop_of(pll), T=np.arange(after.sum()) * STEP_S)
        expected_hz[after] += chirp.ramp_bandwidth_hz * settling

    last = (number == n_chirps - 1) & sweeps

    # 600 MHz are swept; the steps of 10 ns err by a few hertz.
    found_hz = pll.frequency_error_hz(since_s[last], radar)
    np.testing.assert_allclose(found_hz, expected_hz[last], atol=100.0)


@pytest.mark.parametrize("damping", [0.3, 1.0, 3.0])
def test_cycles_are_the_sum_of_the_frequency(radar, damping):
    pll = Pll(natural_frequency_hz=250e3, damping=damping, gain_change=(-0.3, 0.1))
    times_s = np.linspace(0, 30e-6, 30001)

    frequency_hz = pll.frequency_error_hz(times_s, radar)

    summed = np.cumsum(frequency_hz[1:] + frequency_hz[:-1]) / 2 * 1e-9
    np.testing.assert_allclose(pll.phase_error_cycles(times_s, radar)[1:], summed, atol=1e-4)


def test_a_faster_loop_leaves_less_of_the_tuning_curve(radar):
    # Settled, the loop leaves the curve's second derivative over the natural frequency squared.
    times_s = np.linspace(20e-6, 28e-6, 9)
    for natural_frequency_hz in (0.5e6, 1e6):
        pll = Pll(natural_frequency_hz=natural_frequency_hz, gain_change=(-0.4,))
        natural = 2 * np.pi * natural_frequency_hz
        # f = B (u - 0.2 u^2) / 0.8, u = t / T.
        expected_hz = -0.5 * 600e6 / (30e-6 * natural) ** 2
        np.testing.assert_allclose(pll.frequency_error_hz(times_s, radar), expected_hz, rtol=1e-3)


def test_a_pause_and_a_late_start_let_the_loop_settle(radar):
    left_hz = []
    for interval_s, adc_start_s in [(31e-6, 0.5e-6), (31e-6, 4e-6), (45e-6, 4e-6)]:
        chirp = replace(radar.frame.chirp, adc_start_s=adc_start_s)
        frame = replace(radar.frame, interval_s=interval_s, chirp=chirp)
        times_s = adc_start_s + np.arange(256) / 10e6
        pll = Pll(natural_frequency_hz=300e3)
        left_hz.append(abs(pll.frequency_error_hz(times_s, replace(radar, frame=frame))).max())

    assert left_hz[0] > 10 * left_hz[1] > 10 * left_hz[2]


def test_echoes_have_the_phase_that_the_loop_leaves(radar):
    pll = Pll(natural_frequency_hz=0.6e6, gain_change=(-0.3, 0.1))
    cube = dc.simulate(STILL, radar, impairments=[pll], dtype=np.complex128)
    clean = dc.simulate(STILL, radar, impairments=(), dtype=np.complex128)

    delay_s = 80 / SPEED_OF_LIGHT
    times_s = sample_window(radar, 0).times_s
    left = pll.phase_error_cycles(times_s, radar) - pll.phase_error_cycles(times_s - delay_s, radar)
    expected = clean.values[0, :, 0] * np.exp(2j * np.pi * left)

    # The first samples are 0.3 us after an error of megahertz.
    off = abs(cube.values[0, :, 0] - expected) / abs(expected).max()
    assert off[:, :16].max() < 1e-2
    assert off[:, 16:].max() < 1e-3


def test_a_loop_that_has_not_settled_warns(radar):
    back_to_back = replace(radar.frame, interval_s=30e-6)
    with pytest.warns(dc.PhysicsWarning, match="impairments.pll: frequency errors up to"):
        Pll(natural_frequency_hz=100e3).check(STILL, replace(radar, frame=back_to_back))


def test_a_loop_slower_than_the_ramp_is_refused(radar):
    with pytest.raises(InvalidSetting, match=r"natural_frequency: 1000 Hz; expected"):
        Pll(natural_frequency_hz=1e3).check(STILL, radar)


@pytest.mark.parametrize(
    ("field", "wrong"),
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
def test_what_is_no_loop_is_refused(field, wrong):
    with pytest.raises(InvalidSetting, match=field):
        Pll(**{"natural_frequency_hz": 1e5, field: wrong})
