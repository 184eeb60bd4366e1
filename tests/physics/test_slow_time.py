"""Slow time: displacement far below the range cell, measured from the phase of a cell."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.slow_time import (
    displacement,
    displacement_spectrum,
    frame_means,
    range_track,
    slow_time,
    strongest_oscillation,
)

CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    adc_start_s=5e-6,
    ramp_duration_s=60e-6,
    sample_rate_hz=5e6,
    n_samples=128,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=256, interval_s=1e-3),
    array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0), (0, 0.002, 0)]),
)
WAVELENGTH_M = SPEED_OF_LIGHT / CHIRP.mean_sampled_frequency_hz


def chirp_times_s(radar=RADAR):
    frame = radar.frame
    return np.arange(frame.n_chirps) * frame.interval_s + frame.chirp.mid_window_s


def simulate_cube(range_m, radar=RADAR, *, amplitude=1.0, noise=0.0, seed=0):
    """Simulate the beat of a target at given ranges (chirp,) in closed form, with white noise."""
    chirp = radar.frame.chirp
    n = np.arange(chirp.n_samples)
    transmit_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * (
        chirp.adc_start_s + n / chirp.sample_rate_hz
    )
    phase = 4 * np.pi / SPEED_OF_LIGHT * np.multiply.outer(range_m, transmit_hz)
    rng = np.random.default_rng(seed)
    shape = (len(range_m), radar.array.n_rx, chirp.n_samples)
    if chirp.sampling == "complex":
        wave = amplitude * np.exp(1j * phase)[:, None] * np.ones(shape)
        gaussian = rng.normal(size=(2, *shape)) * noise / np.sqrt(2)
        samples = (wave + gaussian[0] + 1j * gaussian[1]).astype(np.complex64)
    else:
        wave = np.sqrt(2) * amplitude * np.cos(phase)[:, None] * np.ones(shape)
        samples = (wave + rng.normal(size=shape) * noise).astype(np.float32)
    return xr.DataArray(samples[None], dims=("frame", "chirp", "rx", "sample"))


def vibrating_range_m(amplitude_m, frequency_hz, middle_m=6.03):
    return middle_m + amplitude_m * np.sin(2 * np.pi * frequency_hz * chirp_times_s())


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_phase_measures_movement_of_micrometres(sampling):
    radar = replace(RADAR, frame=replace(RADAR.frame, chirp=replace(CHIRP, sampling=sampling)))
    range_m = vibrating_range_m(5e-6, 30.0)
    movement = displacement(slow_time(simulate_cube(range_m, radar), radar, 6.0), radar)
    # 1e-8 m is 3e-5 rad: single precision, and the mirror image of real samples
    np.testing.assert_allclose(movement.values[:, 0], range_m - range_m[0], atol=1e-8)
    np.testing.assert_allclose(movement.time.values, chirp_times_s(), atol=1e-12)
    assert movement.attrs["units"] == "m"


def test_trace_has_echo_amplitude_and_receding_is_positive():
    range_m = np.linspace(6.0, 6.05, 256)  # 0.2 mm per chirp, of at most 0.97 mm
    trace = slow_time(simulate_cube(range_m, amplitude=0.5), RADAR, range_m)
    np.testing.assert_allclose(abs(trace.values), 0.5, rtol=1e-5)
    movement = displacement(trace, RADAR)
    np.testing.assert_allclose(movement.values[:, 1], range_m - range_m[0], atol=2e-7)


def test_displacement_noise_matches_theory():
    noise = 1.0
    cube = simulate_cube(np.full(256, 6.0), noise=noise, seed=3)
    movement = displacement(slow_time(cube, RADAR, 6.0), RADAR).values
    snr = CHIRP.n_samples / (1.5 * noise**2)  # a Hann window costs 1.5
    theory_m = WAVELENGTH_M / (4 * np.pi * np.sqrt(2 * snr))
    measured_m = np.std(movement, axis=0)
    # 256 values: 4.4 % standard error; five of them, and a second-order term of 1 %
    np.testing.assert_allclose(measured_m, theory_m, rtol=0.23)


def test_range_track_across_cells_gives_same_displacement():
    range_m = 4.0 + 1.5e-4 * np.arange(256)  # 4 cm, a fifth of a cell of 0.195 m
    cube = simulate_cube(range_m, noise=0.05, seed=4)
    track = range_track(cube, RADAR, (3.0, 6.0))
    # standard error of one chirp: c / 2S fs sqrt(6 / snr / N) / 2 pi is 3.4 mm at 26 dB, 2 rx
    assert float(abs(track - range_m).max()) < 6 * 3.4e-3
    movement = displacement(slow_time(cube, RADAR, track.values), RADAR)
    fixed_movement = displacement(slow_time(cube, RADAR, 4.02), RADAR)
    np.testing.assert_allclose(movement.values, fixed_movement.values, atol=6 * 2.2e-6)


def test_oscillation_is_measured_between_bins():
    # 41.37 Hz: 10.59 bins of 3.9 Hz
    movement = displacement(
        slow_time(simulate_cube(vibrating_range_m(2e-6, 41.37)), RADAR, 6.0), RADAR
    )
    line = strongest_oscillation(displacement_spectrum(movement), (10.0, 400.0))
    # the image of the line at -41 Hz, 21 bins away, is 1e-4 of it under a Hann window
    np.testing.assert_allclose(line.frequency.values, 41.37, atol=0.004)
    np.testing.assert_allclose(line.amplitude.values, 2e-6, rtol=1e-3)
    assert (line.floor < 0.01 * line.amplitude).all()


def test_linear_movement_gives_no_oscillation():
    range_m = 6.0 + 1e-3 * chirp_times_s()
    spectrum = displacement_spectrum(
        displacement(slow_time(simulate_cube(range_m), RADAR, 6.0), RADAR), window="rectangular"
    )
    assert float(spectrum.max()) < 1e-8


def test_frame_means_give_one_value_per_frame():
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=16, period_s=0.1))
    cubes = [simulate_cube(np.full(16, 6.0), radar, noise=1.0, seed=seed) for seed in range(64)]
    cube = xr.concat(cubes, "frame")
    chirp_trace = slow_time(cube, radar, 6.0)
    trace = frame_means(chirp_trace)
    assert trace.dims == ("time", "channel") and trace.sizes["time"] == 64
    np.testing.assert_allclose(np.diff(trace.time.values), 0.1, rtol=1e-9)
    first_s = float(trace.time[0])
    assert first_s == pytest.approx(7.5 * 1e-3 + CHIRP.mid_window_s, abs=1e-12)
    # the same sums in another order
    np.testing.assert_allclose(
        trace.values, chirp_trace.values.reshape(64, 16, 2).mean(axis=1), rtol=1e-4, atol=1e-6
    )
    assert displacement_spectrum(displacement(trace, radar)).sizes["frequency"] == 33


def test_warns_of_steps_near_half_a_cycle():
    range_m = 6.0 + 0.24 * WAVELENGTH_M * np.arange(256)
    with pytest.warns(dc.PhysicsWarning, match="3/8 of a cycle in 100%"):
        displacement(slow_time(simulate_cube(range_m), RADAR, range_m), RADAR)


@pytest.mark.parametrize("range_m", [-1.0, 1e4, np.nan, [1.0, 2.0], np.ones((2, 2)), "far", None])
def test_rejects_ranges_outside_range_rows(range_m):
    with pytest.raises(dc.InvalidSetting, match="range_m"):
        slow_time(simulate_cube(np.full(256, 6.0)), RADAR, range_m)


@pytest.mark.parametrize("range_m", [(5.0, 5.001), (7.0, 3.0), (1.0,), (np.nan, 3.0), "near"])
def test_rejects_range_interval_without_rows(range_m):
    with pytest.raises(dc.InvalidSetting, match="range_m"):
        range_track(simulate_cube(np.full(256, 6.0)), RADAR, range_m)


def test_displacement_over_many_cycles_is_exact():
    range_m = 1.0 + np.linspace(0, 20, 60_000)  # 10,300 cycles, 0.33 mm from value to value
    phasors = np.exp(4j * np.pi / WAVELENGTH_M * range_m).astype(np.complex64)
    trace = xr.DataArray(phasors, dims="time", coords={"time": 1e-3 * np.arange(60_000)})
    movement = displacement(trace, RADAR)
    # single precision of the samples: 1e-7 rad of 0.15 mm each
    np.testing.assert_allclose(movement.values, range_m - range_m[0], atol=1e-9)


def test_oscillation_keeps_frequency_in_partial_spectrum():
    movement = displacement(
        slow_time(simulate_cube(vibrating_range_m(2e-6, 41.37)), RADAR, 6.0), RADAR
    )
    spectrum = displacement_spectrum(movement)
    partial = strongest_oscillation(spectrum.sel(frequency=slice(20, 200)), (25.0, 100.0))
    xr.testing.assert_allclose(partial, strongest_oscillation(spectrum, (25.0, 100.0)))


def test_oscillation_outside_interval_is_ignored():
    """The line of 2 um at 41.37 Hz has tenths of its amplitude in bins above 43 Hz."""
    movement = displacement(
        slow_time(simulate_cube(vibrating_range_m(2e-6, 41.37)), RADAR, 6.0), RADAR
    )
    spectrum = displacement_spectrum(movement)
    # Sidelobes of a Hann window fall by 18 dB per octave: 3e-3 at five bins.
    line = strongest_oscillation(spectrum, (43.0, 200.0))
    assert (line.amplitude < 1e-2 * 2e-6).all()
    flank = strongest_oscillation(spectrum, (43.0, 56.0))
    assert np.isnan(flank.frequency).all() and np.isnan(flank.amplitude).all()


def test_rejects_results_of_wrong_processing_step():
    trace = slow_time(simulate_cube(vibrating_range_m(2e-6, 40.0)), RADAR, 6.0)
    movement = displacement(trace, RADAR)
    with pytest.raises(
        dc.InvalidSetting, match="trace: an array of .* expected a complex trace over time"
    ):
        displacement(movement, RADAR)
    with pytest.raises(dc.InvalidSetting, match="what slow_time or frame_means returns"):
        displacement(trace.isel(time=0), RADAR)
    with pytest.raises(dc.InvalidSetting, match="what displacement returns"):
        displacement_spectrum(trace)
    mean = displacement_spectrum(movement).mean("channel", keep_attrs=False)
    with pytest.raises(dc.InvalidSetting, match="keep_attrs"):
        strongest_oscillation(mean, (10.0, 400.0))


def test_oscillation_at_uneven_times_keeps_frequency_and_amplitude():
    """Frames timed by a computer: 10 a second, each up to 0.3 of a period early or late.

    An eighth of the rate, the highest frequency of the statement, is 1.25 Hz. Taken at equal
    times, 1 mm would lose (2 pi 1.25 Hz 17 ms)^2 / 2 = 0.9 % and spread into noise of 0.14 mm.
    """
    rng = np.random.default_rng(4)
    times_s = 0.1 * (np.arange(300) + rng.uniform(-0.3, 0.3, 300))
    for frequency_hz in (0.3, 1.25):
        values_m = 1e-3 * np.sin(2 * np.pi * frequency_hz * times_s)
        movement = xr.DataArray(values_m, dims="time", coords={"time": times_s})
        line = strongest_oscillation(displacement_spectrum(movement), (0.1, 3.0))
        assert line.frequency.item() == pytest.approx(frequency_hz, abs=2e-3)
        assert line.amplitude.item() == pytest.approx(1e-3, rel=1e-2)
        assert line.floor.item() < 1e-5


def test_rejects_uneven_times_and_narrow_intervals():
    movement = displacement(
        slow_time(simulate_cube(vibrating_range_m(2e-6, 40.0)), RADAR, 6.0), RADAR
    )
    gapped_movement = movement.isel(time=np.r_[0:100, 140:256])
    with pytest.raises(dc.InvalidSetting, match="frame_means"):
        displacement_spectrum(gapped_movement)
    with pytest.raises(dc.InvalidSetting, match="four or more"):
        displacement_spectrum(movement.isel(time=slice(3)))
    with pytest.raises(dc.InvalidSetting, match="frequency_hz"):
        strongest_oscillation(displacement_spectrum(movement), (40.0, 41.0))


def test_rejects_cube_of_another_radar():
    with pytest.raises(dc.InvalidSetting, match="cube"):
        slow_time(simulate_cube(np.full(256, 6.0)).isel(rx=[0]), RADAR, 6.0)


def test_rejects_samples_that_are_not_finite():
    cube = simulate_cube(np.full(256, 6.0))
    cube[0, 17, 0, 3] = np.nan
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        slow_time(cube, RADAR, 6.0)
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        range_track(cube, RADAR, (4.0, 8.0))


def test_warns_of_lost_chirps_and_keeps_neighbouring_movement():
    range_m = vibrating_range_m(5e-6, 40.0)
    cube = simulate_cube(range_m, noise=1e-3)
    cube[0, 100:105] = 0  # readers fill lost chirps with zeros

    with pytest.warns(dc.PhysicsWarning, match="0 in 10 of 512 values"):
        movement = displacement(slow_time(cube, RADAR, 6.03), RADAR)

    # Noise of 1e-3 of the echo in a sample is 0.02 um in a trace under a Hann window; linear
    # interpolation over 6 ms of the wave errs by at most 5 um (1 - cos(2 pi 40 Hz 3 ms)).
    error = movement.values[:, 0] - (range_m - range_m[0])
    assert abs(np.delete(error, range(100, 105))).max() < 0.3e-6
    assert abs(error).max() < 1.7e-6
