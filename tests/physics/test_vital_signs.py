"""Vital signs: arc fit, rates against their bounds, and the false-alarm rate of empty rooms."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
import xarray as xr

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.arc_fit import fit_arc
from dechirp.processing.periodicity import (
    find_line,
    join_bases,
    rate_interval_hz,
    sinusoids,
    slow_functions,
)
from dechirp.processing.slow_time import displacement_spectrum, range_traces
from dechirp.processing.vital_signs import VitalSigns, chest_displacement, measure_vital_signs
from nightly import nightly, nightly_except

WAVELENGTH_M = 5e-3
TIMES_S = np.arange(400) / 20
BREATHING_HZ, HEART_HZ = 0.287, 1.31
OFFSET = 2 - 1.5j


def white_noise(rng, n_values):
    return rng.normal(size=(n_values, 2)) @ np.array([1, 1j]) / np.sqrt(2)


def chest_m(times_s=TIMES_S, *, breathing_m=1.5e-3, heart_m=0.0, heart_hz=HEART_HZ, phase=0.0):
    breath = 2 * np.pi * BREATHING_HZ * times_s + phase
    return breathing_m * np.sin(breath) + heart_m * np.sin(2 * np.pi * heart_hz * times_s)


def trace_of(displacement_m, *, snr=np.inf, seed=0, times_s=TIMES_S):
    """Return the I/Q values of an echo of amplitude 1 beside a static offset."""
    values = OFFSET + np.exp(4j * np.pi / WAVELENGTH_M * displacement_m)
    values = values + white_noise(np.random.default_rng(seed), len(times_s)) / np.sqrt(snr)
    return xr.DataArray(
        values, dims="time", coords={"time": times_s}, attrs={"wavelength_m": WAVELENGTH_M}
    )


def test_arc_fit_covariance_matches_errors():
    rng = np.random.default_rng(1)
    angles = np.linspace(-1, 1, 200)
    squares = []
    for _ in range(200):
        arc = fit_arc(OFFSET + 3 * np.exp(1j * angles) + 0.05 * white_noise(rng, 200))
        error = arc.centre - OFFSET
        errors = np.array([error.real, error.imag, arc.radius - 3])
        squares.append(errors @ np.linalg.solve(np.array(arc.covariance), errors))
        assert arc.noise_std == pytest.approx(0.05 / np.sqrt(2), rel=0.3)  # 6 times 1/sqrt(400)
    # Chi-squared of three degrees of freedom: mean 3, standard error sqrt(6 / 200); six of them.
    assert np.mean(squares) == pytest.approx(3, abs=6 * np.sqrt(6 / 200))


def test_arc_fit_is_exact_without_noise():
    arc = fit_arc(OFFSET + 3 * np.exp(1j * np.linspace(0, 0.5, 20)))
    assert abs(arc.centre - OFFSET) < 1e-9 and arc.radius == pytest.approx(3, abs=1e-9)


def test_points_on_a_line_have_no_radius():
    arc = fit_arc(np.linspace(0, 1, 20) * (1 + 2j))
    assert not arc.radius_std < 0.1 * arc.radius


@pytest.mark.parametrize("values", [np.ones(10) + 0j, np.arange(3) + 0j, np.full(9, np.nan + 0j)])
def test_arc_fit_rejects_values_without_arc(values):
    with pytest.raises(dc.InvalidSetting, match="values: .*expected four or more finite"):
        fit_arc(values)


@nightly
def test_rates_reach_cramer_rao_bound_and_intervals_cover():
    snr, breathing_m, heart_m, n_trials = 1000.0, 1.5e-3, 0.2e-3, 30
    errors_hz = {"breathing": [], "heart": []}
    n_covered = dict.fromkeys(errors_hz, 0)
    for seed in range(n_trials):
        moved_m = chest_m(breathing_m=breathing_m, heart_m=heart_m, phase=seed)
        vital = measure_vital_signs(trace_of(moved_m, snr=snr, seed=seed)).isel(window=0)
        for sign, true_hz in (("breathing", BREATHING_HZ), ("heart", HEART_HZ)):
            errors_hz[sign].append(float(vital[f"{sign}_rate"]) - true_hz)
            n_covered[sign] += bool(
                vital[f"{sign}_rate_low"] <= true_hz <= vital[f"{sign}_rate_high"]
            )
    noise_m = WAVELENGTH_M / (4 * np.pi) / np.sqrt(2 * snr)
    n = len(TIMES_S)
    for sign, amplitude_m in (("breathing", breathing_m), ("heart", heart_m)):
        bound_hz = np.sqrt(24 * noise_m**2 / (amplitude_m**2 * n * (n**2 - 1)))
        bound_hz /= 2 * np.pi * (TIMES_S[1] - TIMES_S[0])
        rmse_hz = np.sqrt(np.mean(np.square(errors_hz[sign])))
        # The root of 30 squares has a standard error of 13 %; the trend, the arc and the other
        # rate cost up to 20 % of the bound of a sinusoid alone.
        assert 0.5 < rmse_hz / bound_hz < 1.7, sign
        assert n_covered[sign] >= scipy.stats.binom.ppf(1e-7, n_trials, 0.95), sign
        assert float(vital[f"{sign}_amplitude"]) == pytest.approx(amplitude_m, rel=0.03)


@nightly
@pytest.mark.parametrize("jitter", [0.1, 0.05])
def test_intervals_cover_mean_rate_of_irregular_breathing(jitter):
    """Breaths of independent length: the phase is a random walk, D = jitter^2 f in cycles."""
    n_trials, duration_s = 30, np.ptp(TIMES_S)
    errors_hz, half_widths_hz, n_covered = [], [], 0
    for seed in range(n_trials):
        rng = np.random.default_rng(seed)
        ends_s = np.cumsum(1 + jitter * rng.normal(size=40)) / BREATHING_HZ
        cycles = np.interp(TIMES_S, ends_s - rng.uniform(2, 6) / BREATHING_HZ, np.arange(40))
        mean_rate_hz = (cycles[-1] - cycles[0]) / duration_s
        moved_m = 1.5e-3 * np.sin(2 * np.pi * cycles)
        vital = measure_vital_signs(trace_of(moved_m, snr=1e3, seed=seed)).isel(window=0)
        low_hz, high_hz = float(vital.breathing_rate_low), float(vital.breathing_rate_high)
        errors_hz.append(float(vital.breathing_rate) - mean_rate_hz)
        half_widths_hz.append((high_hz - low_hz) / 2)
        n_covered += low_hz <= mean_rate_hz <= high_hz
    std_hz = jitter * np.sqrt(BREATHING_HZ / (5 * duration_s))
    # The root of 30 squares has a standard error of 13 %; of few breaths, some are cut.
    assert np.sqrt(np.mean(np.square(errors_hz))) == pytest.approx(std_hz, rel=0.5)
    assert n_covered >= scipy.stats.binom.ppf(1e-3, n_trials, 0.95)
    # Student's quantile of three degrees of freedom is 3.2.
    assert np.median(half_widths_hz) < 4 * std_hz


@pytest.mark.parametrize(
    ("jitter", "noise_std"), nightly_except(1, [(0.0, 0.1), (0.03, 0.1), (0.005, 0.3)])
)
def test_intervals_of_steady_and_irregular_hearts_beside_harmonics_of_breathing(jitter, noise_std):
    """Neither too narrow for periods of independent length, nor far from the bound without them."""
    times_s, duration_s, ratios, n_covered = TIMES_S - TIMES_S.mean(), np.ptp(TIMES_S), [], 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        breathing_hz, heart_hz = rng.uniform(0.2, 0.35), rng.uniform(0.9, 1.8)
        harmonics_hz = breathing_hz * np.arange(1, int(2.5 / breathing_hz) + 1)
        half_hz = 1 / duration_s + 0.002
        if np.min(abs(harmonics_hz - heart_hz)) < half_hz + 0.005:
            continue  # not searched
        ends_s = np.cumsum(1 + jitter * rng.normal(size=100)) / heart_hz
        beats = np.interp(TIMES_S + ends_s[2] + rng.uniform() / heart_hz, ends_s, np.arange(100))
        movement = np.sin(2 * np.pi * beats) + noise_std * rng.normal(size=400)
        basis = join_bases(slow_functions(times_s, 0.05), sinusoids(times_s, harmonics_hz))
        excluded_hz = tuple((rate - half_hz, rate + half_hz) for rate in harmonics_hz.tolist())
        line = find_line(
            movement[:, None], times_s, (0.8, 2.5), basis=basis, excluded_hz=excluded_hz
        )
        low_hz, high_hz = rate_interval_hz(line, 0.95)
        mean_rate_hz = (beats[-1] - beats[0]) / duration_s
        n_covered += low_hz <= mean_rate_hz <= high_hz
        bound_hz = np.sqrt(24 / 400) * noise_std / (2 * np.pi * duration_s)
        # Periods add D / (5 T) with D = jitter^2 heart_hz.
        std_hz = np.hypot(bound_hz, jitter * np.sqrt(heart_hz / (5 * duration_s)))
        ratios.append((high_hz - low_hz) / 2 / (1.96 * std_hz))
    assert n_covered >= scipy.stats.binom.ppf(1e-3, len(ratios), 0.95)
    # One to three functions: sqrt(1 + 0.66 (12.7 / 1.96)^2) = 5.4 with one, 2.3 with three.
    assert np.median(ratios) < 5.4


@nightly
def test_empty_room_has_no_vital_signs():
    """Noise with static echoes: each probability holds, also for the strongest of many cells."""
    n_trials, probabilities = 30, {"breathing": [], "heart": []}
    for seed in range(n_trials):
        rng = np.random.default_rng(seed)
        values = OFFSET * (seed % 2) + white_noise(rng, 400 * 4).reshape(400, 4)
        trace = xr.DataArray(
            values, dims=("time", "range"), coords={"time": TIMES_S, "range": [0.5, 1, 1.5, 2]}
        )
        vital = measure_vital_signs(trace).isel(window=0)
        for sign, of_sign in probabilities.items():
            of_sign.append(float(vital[f"{sign}_false_alarm_probability"]))
            assert np.isnan(vital[f"{sign}_rate"]) == (of_sign[-1] > 0.01)
    for of_sign in probabilities.values():
        for level in (0.5, 0.1, 0.01):
            at_most = scipy.stats.binom.isf(1e-7, n_trials, level)
            assert np.sum(np.array(of_sign) < level) <= at_most


@nightly
@pytest.mark.parametrize(
    ("n_cells", "white", "first", "n_trials"),
    [(1, 0.0, 8, 60), (3, 0.0, 7, 60), (20, 0.0, 8, 60), (1, 3.0, 9, 60), (20, 3.0, 9, 200)],
)
def test_random_walks_have_no_vital_signs(n_cells, white, first, n_trials):
    """Slow noise of an empty room: its principal components and leaked trends are no lines.

    A random walk beside white noise of 3 times its steps has the slope of white noise from 1 Hz on.
    """
    rng = np.random.default_rng(first)
    probabilities = {"breathing": [], "heart": []}
    for _ in range(n_trials):
        steps = rng.normal(size=(400, n_cells, 2)) @ np.array([1, 1j])
        noise = rng.normal(size=(400, n_cells, 2)) @ np.array([1, 1j])
        trace = xr.DataArray(
            5 + np.cumsum(steps, axis=0) + white * noise,
            dims=("time", "range"),
            coords={"time": TIMES_S, "range": np.linspace(0.4, 1.4, n_cells)},
        )
        vital = measure_vital_signs(trace).isel(window=0)
        for sign, of_sign in probabilities.items():
            of_sign.append(float(vital[f"{sign}_false_alarm_probability"]))
    for of_sign in probabilities.values():
        for level in (0.2, 0.05, 0.01):
            at_most = scipy.stats.binom.isf(1e-3, n_trials, level)
            assert np.sum(np.array(of_sign) < level) <= at_most


def rate_of_harmonics(energies, fundamental_hz, *, noise_std, seed):
    """Return the rate that is found in I and Q with harmonics of these relative energies."""
    rng = np.random.default_rng(seed)
    orders, times_s = np.arange(1, len(energies) + 1), TIMES_S - TIMES_S.mean()
    phases = rng.uniform(0, 2 * np.pi, (len(energies), 2))
    turns = 2 * np.pi * fundamental_hz * orders[:, None] * times_s[:, None, None] + phases
    movement = np.einsum("k,tkc->tc", np.sqrt(energies), np.sin(turns))
    movement += noise_std * rng.normal(size=movement.shape)
    basis = slow_functions(times_s, 0.05)
    line = find_line(movement, times_s, (0.1, 0.7), basis=basis, max_harmonics=6)
    assert line.false_alarm_probability < 1e-2
    return line.frequency_hz


@pytest.mark.parametrize("seed", [3, 6, 9])
def test_weak_odd_harmonics_do_not_halve_the_rate(seed):
    """Alternate breaths differ a little: in noise, both the rate and its half are significant."""
    rate_hz = rate_of_harmonics([6, 12, 3, 15, 0, 6], 0.1425, noise_std=5.0 * 8**0.5, seed=seed)
    # The bound 24 s^2 / ((2 pi)^2 sum(k^2 A^2) T^2 N), with energies 12 and 15 in I and in Q, is
    # 2.3 mHz; six times it.
    assert rate_hz == pytest.approx(0.285, abs=0.014)


@pytest.mark.parametrize("noise_std", [0.1, 2.5])
def test_strong_even_harmonics_do_not_double_the_rate(noise_std):
    rate_hz = rate_of_harmonics([1, 1.44, 0.36, 0.64], 0.25, noise_std=noise_std, seed=0)
    assert rate_hz == pytest.approx(0.25, abs=0.01)


@nightly
def test_harmonics_of_breathing_are_no_heart_rate():
    for seed in range(5):
        breath = np.sin(2 * np.pi * BREATHING_HZ * TIMES_S + seed)
        moved_m = 2e-3 * np.maximum(breath, -0.3)  # inhales briefly: harmonics up to the heart
        vital = measure_vital_signs(trace_of(moved_m, snr=1e4, seed=seed)).isel(window=0)
        assert float(vital.breathing_rate) == pytest.approx(BREATHING_HZ, abs=1e-3)
        assert np.isnan(vital.heart_rate)
        hidden_m = chest_m(heart_m=0.2e-3, heart_hz=4 * BREATHING_HZ)
        vital = measure_vital_signs(trace_of(hidden_m, snr=1e4, seed=seed)).isel(window=0)
        assert not abs(float(vital.heart_rate) - 4 * BREATHING_HZ) < 0.05


def pulses_m(times_s, rate_hz, rng):
    """Return the displacement of heart beats: pulses of 0.1 s, with a rebound, 2 % irregular."""
    starts_s = np.cumsum(1 + 0.02 * rng.normal(size=100)) / rate_hz - rng.uniform(1, 2) / rate_hz
    from_start_s = times_s[:, None] - starts_s
    pulses = np.exp(-((from_start_s / 0.1) ** 2) / 2)
    rebounds = np.exp(-(((from_start_s - 0.25) / 0.12) ** 2) / 2)
    return 0.1e-3 * np.sum(pulses - 0.4 * rebounds, axis=1)


@pytest.mark.parametrize("seed", nightly_except(2, range(8)))
def test_heart_of_short_pulses_has_its_own_rate(seed):
    """At 60 a minute beside 21.6 breaths, the second harmonic is the strongest line."""
    rng = np.random.default_rng(seed)
    times_s = np.arange(600) / 20
    breath_m = 1e-3 * np.sin(2 * np.pi * (0.36 * times_s + rng.uniform()))
    moved_m = breath_m + pulses_m(times_s, 1.0, rng)
    trace = trace_of(moved_m, snr=1e3, seed=seed, times_s=times_s)
    vital = measure_vital_signs(trace, VitalSigns(window_s=30.0)).isel(window=0)
    # Irregular by 2 %: 0.02 sqrt(1 / (5 * 30)) = 1.6 mHz, and 1.7 mHz of the mean of 30 periods
    # before the window; six of both and the resolution of breathing's third harmonic.
    assert float(vital.heart_rate) == pytest.approx(1.0, abs=0.03)


@nightly
@pytest.mark.parametrize("rate_hz", [1.81, 2.03])
def test_heart_without_odd_harmonics_is_not_halved(rate_hz):
    """Noise has a line at the half with the false-alarm probability of 1 %."""
    n_trials, rates_hz = 30, []
    for seed in range(n_trials):
        moved_m = chest_m(heart_m=0.2e-3, heart_hz=rate_hz, phase=seed)
        rates_hz.append(measure_vital_signs(trace_of(moved_m, snr=1e3, seed=seed)).heart_rate[0])
    n_wrong = np.sum(np.abs(np.array(rates_hz) - rate_hz) > 0.01)
    assert n_wrong <= scipy.stats.binom.isf(1e-7, n_trials, 0.01)


def test_uneven_times_and_lost_values():
    rng = np.random.default_rng(4)
    times_s = TIMES_S + rng.uniform(-0.02, 0.02, 400)
    trace = trace_of(chest_m(times_s, heart_m=0.2e-3), snr=1e3, times_s=times_s)
    trace[100:130] = 0
    vital = measure_vital_signs(trace).isel(window=0)
    assert abs(float(vital.breathing_rate) - BREATHING_HZ) < 1e-3
    assert abs(float(vital.heart_rate) - HEART_HZ) < 3e-3  # six times the bound of 0.5 mHz


def test_displacement_of_short_frames_has_even_times_and_its_amplitude():
    # Two values 12.5 ms apart in each frame of 100 ms, recorded up to 30 ms late.
    rng = np.random.default_rng(4)
    frame_s = 0.1 * np.arange(300) + 0.03 * rng.random(300)
    times_s = (frame_s[:, None] + [0, 12.5e-3]).ravel()
    trace = trace_of(chest_m(times_s), snr=1e4, times_s=times_s)

    displacement = chest_displacement(trace)

    assert np.ptp(np.diff(displacement.time)) < 1e-9
    spectrum = displacement_spectrum(displacement)
    peak = spectrum.isel(frequency=int(np.argmax(spectrum.values)))
    assert float(peak.frequency) == pytest.approx(BREATHING_HZ, abs=1 / 30)
    # Between bins, a Hann window loses at most 1.4 dB; the slow motion that is removed, 1 dB.
    assert 1.5e-3 * 10 ** (-2.4 / 20) < float(peak) < 1.5e-3 * 1.02


@nightly
def test_windows_follow_change_of_rate_and_place():
    times_s = np.arange(1200) / 20
    rates_hz = np.where(times_s < 30, 0.25, 0.4)
    moved_m = 1.5e-3 * np.sin(2 * np.pi * np.cumsum(rates_hz) / 20)
    phasors = trace_of(moved_m, snr=1e3, times_s=times_s).values
    first = times_s < 30
    values = np.stack([np.where(first, phasors, OFFSET), np.where(first, OFFSET, phasors)], axis=1)
    trace = xr.DataArray(
        values, dims=("time", "range"), coords={"time": times_s, "range": [0.8, 1.6]}
    )
    vital = measure_vital_signs(trace)
    np.testing.assert_allclose(vital.time, [9.975, 19.975, 29.975, 39.975, 49.975])
    np.testing.assert_allclose(vital.breathing_rate[[0, -1]], [0.25, 0.4], atol=2e-3)
    np.testing.assert_allclose(vital.range[[0, -1]], [0.8, 1.6])
    assert np.isnan(vital.breathing_amplitude).all()  # no wavelength


def test_windows_that_contradict_each_other_are_not_measurable():
    times_s = np.arange(0, 80, 0.05)
    rate_hz = np.where((times_s >= 30) & (times_s < 50), 0.6, 0.25)
    displacement = 1.5e-3 * np.sin(2 * np.pi * np.cumsum(rate_hz) * 0.05)

    rates_hz = measure_vital_signs(trace_of(displacement, snr=1e3, times_s=times_s)).breathing_rate

    # Windows from 0, 10, ... s: that from 30 s is at 0.6 Hz, and those half in it contradict.
    assert rates_hz.values[[0, 1]] == pytest.approx(0.25, abs=0.01)
    assert np.isnan(rates_hz.values[3])
    assert rates_hz.values[[5, 6]] == pytest.approx(0.25, abs=0.01)


def test_full_turns_of_several_echoes_are_measured_in_i_and_q():
    echo = np.exp(4j * np.pi / WAVELENGTH_M * chest_m(breathing_m=3e-3))
    trace = trace_of(np.zeros(400)).copy(data=OFFSET + echo + 0.4 * echo**2)
    vital = measure_vital_signs(trace).isel(window=0)
    assert float(vital.breathing_rate) == pytest.approx(BREATHING_HZ, abs=2e-3)


@pytest.mark.parametrize(("seed", "moved_m"), [(2, 1e-3), (5, 1e-3), (7, 3e-3), (2, 5e-3)])
def test_unequal_breaths_give_no_part_of_the_rate(seed, moved_m):
    """Parts of a body in neighbouring cells follow breaths by different shares.

    Breaths differ by 15 % in depth and by 5 % in length. Before, a third and a quarter of the rate
    were reported, since six of their harmonics describe each breath by itself.
    """
    rng = np.random.default_rng(seed)
    ends_s = np.cumsum(1 + 0.05 * rng.normal(size=40)) / rng.uniform(0.25, 0.45)
    cycles = np.interp(TIMES_S + ends_s[2], ends_s, np.arange(40))
    depths = 1 + 0.15 * rng.normal(size=40)
    breath_m = moved_m * np.sin(np.pi * cycles) ** 2 * depths[cycles.astype(int)]
    ranges_m = np.linspace(0.4, 1, 11)
    values = np.zeros((400, 11), complex)
    for share in (1, 0.6, 0.25):
        part = rng.uniform(0.3, 1) * np.exp(4j * np.pi / WAVELENGTH_M * share * breath_m)
        part *= np.exp(2j * np.pi * rng.uniform())
        values += part[:, None] * np.exp(-(((ranges_m - rng.uniform(0.6, 0.8)) / 0.08) ** 2))
    values += 3 * white_noise(rng, 11) + 0.05 * white_noise(rng, values.size).reshape(values.shape)
    trace = xr.DataArray(
        values,
        dims=("time", "range"),
        coords={"time": TIMES_S, "range": ranges_m},
        attrs={"wavelength_m": WAVELENGTH_M},
    )

    rate_hz = float(measure_vital_signs(trace).breathing_rate[0])

    assert rate_hz == pytest.approx((cycles[-1] - cycles[0]) / np.ptp(TIMES_S), abs=1 / 60)


@nightly
def test_breathing_of_a_body_in_several_noisy_cells_is_measured_together():
    """Five cells, each with an energy of breathing over noise of z = 7 in expectation.

    Of one cell such a line has a false-alarm probability above 1 %: B T of 24 independent
    frequencies times exp(-7). Of five it has exp(-35) times the fourth power of 35 over 4!.
    """
    amplitude = np.sqrt(4 * 7 / len(TIMES_S))  # z = N A^2 / 4 for noise of 1 in I and in Q
    n_alone = n_together = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=(400, 5)) + 1j * rng.normal(size=(400, 5))
        ways = np.exp(2j * np.pi * rng.random(5))
        values = 5 + noise + amplitude * np.outer(np.sin(2 * np.pi * 0.3 * TIMES_S), ways)
        trace = xr.DataArray(
            values,
            dims=("time", "range"),
            coords={"time": TIMES_S, "range": np.linspace(0.5, 1, 5)},
        )
        rate_hz = measure_vital_signs(trace).breathing_rate[0]
        n_together += abs(float(rate_hz) - 0.3) < 0.01
        n_alone += abs(float(measure_vital_signs(trace[:, :1]).breathing_rate[0]) - 0.3) < 0.01
    assert n_alone <= 2
    assert n_together >= 5


CHIRP = dc.Chirp(
    start_frequency_hz=58e9,
    slope_hz_per_s=170e12,
    ramp_duration_s=32e-6,
    sample_rate_hz=2e6,
    n_samples=64,
    sampling="real",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=4, interval_s=1e-3, period_s=0.05),
    array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0), (0, 0.0025, 0)]),
    hardware=dc.Hardware(transmit_power_w=1e-3, antenna_gain=4, noise_factor=16),
)


def oscillating_chest(n_frames=400):
    chest = dc.bodies.Points(
        scatterers=(
            dc.bodies.Scatterer(
                position_m=(0, 0, 0),
                rcs_m2=0.01,
                oscillation=dc.bodies.Oscillation(amplitude_m=(1.5e-3, 0, 0), frequency_hz=0.287),
            ),
        )
    )
    wall = dc.Target(position_m=(0.8, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[dc.Target(position_m=(0.6, 0, 0), body=chest), wall])
    return dc.simulate(scene, RADAR, n_frames=n_frames, seed=3)


def test_simulated_chest_in_its_range_cell():
    cube = oscillating_chest()
    traces = range_traces(cube, RADAR, (0.2, 3.0))
    assert traces.dims == ("time", "range", "channel") and traces.sizes["time"] == 400
    vital = measure_vital_signs(traces).isel(window=0)
    assert abs(float(vital.range) - 0.6) <= CHIRP.range_resolution_m
    assert float(vital.breathing_rate) == pytest.approx(0.287, abs=1e-3)
    assert float(vital.breathing_amplitude) == pytest.approx(1.5e-3, rel=0.03)


@nightly
def test_simulated_rooms_without_a_person_have_no_vital_signs():
    """All probabilities together are those of noise (Fisher's method).

    Minus twice the sum of the logarithms of n uniform probabilities has 2 n degrees of freedom. It
    exceeds its limit by chance in 5e-7, and one room of a probability below 3e-12 always does.
    """
    n_rooms, probabilities = 6, {"breathing": [], "heart": []}
    for seed in range(n_rooms):
        rng = np.random.default_rng(seed)
        furniture = [
            dc.Target(
                position_m=(rng.uniform(0.3, 0.8), rng.uniform(-0.2, 0.2), 0),
                rcs_m2=10 ** rng.uniform(-3, 0),
            )
            for _ in range(rng.integers(1, 7))
        ]
        cube = dc.simulate(dc.Scene(targets=furniture), RADAR, n_frames=400, seed=seed)
        vital = measure_vital_signs(range_traces(cube, RADAR, (0.2, 3.0))).isel(window=0)
        for sign, of_sign in probabilities.items():
            of_sign.append(float(vital[f"{sign}_false_alarm_probability"]))
            assert np.isnan(vital[f"{sign}_rate"]) == (of_sign[-1] > 0.01)
    at_most = scipy.stats.binom.isf(5e-7, n_rooms, 0.01)
    for sign, of_sign in probabilities.items():
        assert np.sum(np.array(of_sign) <= 0.01) <= at_most, sign
        total = -2 * np.sum(np.log(of_sign))
        assert total < scipy.stats.chi2.isf(5e-7, 2 * n_rooms), (sign, of_sign)


def test_range_traces_match_slow_time_at_each_row():
    cube = oscillating_chest(n_frames=3)
    traces = range_traces(cube, RADAR, (0.5, 0.7))
    assert traces.attrs["wavelength_m"] == pytest.approx(
        SPEED_OF_LIGHT / CHIRP.mean_sampled_frequency_hz
    )
    for row in traces.range.values:
        trace = dc.slow_time.frame_means(dc.slow_time.slow_time(cube, RADAR, row))
        np.testing.assert_allclose(traces.time, trace.time, rtol=1e-12)
        magnitudes = abs(traces.sel(range=row).values)
        # single precision of the samples and of the transform
        np.testing.assert_allclose(magnitudes, abs(trace.values), rtol=1e-3, atol=1e-12)


def test_long_frames_are_averaged_over_20_ms():
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=50, period_s=0.1))
    cube = xr.DataArray(
        np.ones((2, 50, 2, 64), np.float32), dims=("frame", "chirp", "rx", "sample")
    )
    traces = range_traces(cube, radar, (0.0, 1.0))
    np.testing.assert_allclose(np.diff(traces.time)[:2], [0.02, 0.015])
    assert traces.sizes["time"] == 6


@pytest.mark.parametrize("range_m", [(3.0, 1.0), (1.0,), (50.0, 60.0), (np.nan, 1.0), "near"])
def test_range_traces_reject_interval_without_rows(range_m):
    cube = xr.DataArray(np.ones((1, 4, 2, 64), np.float32), dims=("frame", "chirp", "rx", "sample"))
    with pytest.raises(dc.InvalidSetting, match="range_m"):
        range_traces(cube, RADAR, range_m)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("range_m", (3.0, 1.0)),
        ("breathing_hz", (0.0, 0.7)),
        ("heart_hz", (0.5, 2.0)),
        ("window_s", 10.0),
        ("window_s", -1.0),
        ("step_s", 0.0),
        ("confidence", 1.0),
        ("false_alarm_probability", 0.0),
    ],
)
def test_settings_reject_impossible_values(setting, value):
    with pytest.raises(dc.InvalidSetting, match=f"VitalSigns.{setting}"):
        VitalSigns(**{setting: value})


def test_traces_that_cannot_be_measured_are_rejected():
    trace = trace_of(chest_m(), snr=100)
    for wrong, message in (
        (trace.real, "trace: .*expected complex values over time"),
        (trace.drop_vars("time"), "times that do not decrease"),
        (trace[::-1], "times that do not decrease"),
        (trace.where(trace.time > 1), "not finite.* leave out the times"),
        (trace[:150], "7.45 s long; expected 10 s or more"),
        (trace[::20], "1 values a second; expected 1.4 or more"),
        (trace.expand_dims(range=[9.0]), "VitalSigns.range_m: 0.2 to 3 m"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            measure_vital_signs(wrong)


def test_windows_in_a_gap_are_not_measurable():
    times_s = np.concatenate([np.arange(0, 30, 0.05), np.arange(90, 130, 0.05)])
    trace = trace_of(chest_m(times_s), snr=1e3, times_s=times_s).expand_dims(range=[1.0], axis=1)

    vital = measure_vital_signs(trace)

    # Windows of 20 s start every 10 s: those from 30 to 70 s contain no value.
    in_gap = (vital.time.values > 39) & (vital.time.values < 91)
    assert in_gap.sum() == 5
    assert (np.isnan(vital.breathing_rate) == in_gap).all()
    assert (np.isnan(vital.range) == in_gap).all()
    assert (vital.breathing_false_alarm_probability[in_gap] == 1).all()
    assert vital.breathing_rate.values[~in_gap] == pytest.approx(BREATHING_HZ, abs=0.01)


def test_slow_values_have_no_heart_rate():
    trace = trace_of(chest_m(breathing_m=0.5e-3), snr=1e3)[::10]
    vital = measure_vital_signs(trace).isel(window=0)
    assert float(vital.breathing_rate) == pytest.approx(BREATHING_HZ, abs=0.01)
    assert np.isnan(vital.heart_rate)
