"""Shifts in time, range and velocity: of samples, of scenes, and of what is found."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.spectrum import Transform, mean_power
from small_radars import WINDOWS, chain, echoes, scenes, small

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few = settings(max_examples=8)


@few
@given(
    st.integers(0, 2**32 - 1), st.sampled_from(WINDOWS), st.integers(-40, 40), st.integers(-40, 40)
)
def test_turning_the_samples_moves_the_map_round(seed, window, rows, columns):
    """A beat of k cycles a chirp moves it by k rows, a turn of q a frame by q columns."""
    rng = np.random.default_rng(seed)
    n_chirps, n_samples, padded = 32, 96, 2
    samples = rng.standard_normal((n_chirps, 2, n_samples, 2)) @ (1, 1j)
    turned = samples * np.exp(2j * np.pi * rows * np.arange(n_samples) / n_samples)
    turned *= np.exp(2j * np.pi * columns * np.arange(n_chirps) / n_chirps)[:, None, None]
    fast, slow = (
        Transform(window=window, n_points=n, n_bins=padded * n) for n in (n_samples, n_chirps)
    )
    here, there = (
        mean_power(one.astype(np.complex64), "complex", fast, slow) for one in (samples, turned)
    )
    moved = np.roll(here, (padded * columns, padded * rows), axis=(0, 1))
    assert abs(there - moved).max() < 40 * EPS * here.max()


@few
@given(
    st.floats(0.2, 0.6),
    st.integers(1, 8),
    st.sampled_from(["complex", "real"]),
    st.sampled_from(WINDOWS),
)
def test_a_target_one_range_cell_farther_is_one_row_higher(at, cells, sampling, window):
    radar = small(sampling)
    chirp = radar.frame.chirp
    bin_m = float(chirp.range_bins_m(chirp.n_samples)[1])
    row = round(at * chirp.max_range_m / bin_m)
    tops = []
    for k in (row, row + cells):
        scene = dc.Scene(targets=[dc.Target(position_m=(k * bin_m, 0, 0))])
        cube = dc.simulate(scene, radar, impairments=()).isel(frame=0)
        power = dc.power_map(cube, radar, chain(window))
        tops.append(np.unravel_index(int(np.argmax(power.values)), power.shape))
    (slow, fast), (slow_2, fast_2) = tops
    assert slow == slow_2 == radar.frame.n_chirps // 2
    assert (fast, fast_2) == (row, row + cells)


@few
@given(st.floats(0.2, 0.8), st.floats(-0.05, 0.05), st.sampled_from(["complex", "real"]))
def test_the_phase_of_an_echo_is_that_of_its_delay_at_mid_window(at, further_m, sampling):
    radar = small(sampling, n_rx=1)
    chirp = radar.frame.chirp
    mid_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * (
        chirp.adc_start_s + (chirp.n_samples - 1) / 2 / chirp.sample_rate_hz
    )
    phases, cycles = [], []
    for range_m in (at * chirp.max_range_m, at * chirp.max_range_m + further_m):
        scene = dc.Scene(targets=[dc.Target(position_m=(range_m, 0, 0))])
        cube = dc.simulate(scene, radar, impairments=())
        trace = dc.slow_time.slow_time(cube, radar, range_m, window="blackman-harris")
        phases.append(np.angle(complex(trace.values[0, 0])))
        delay_s = 2 * range_m / SPEED_OF_LIGHT
        # tau (f - S tau / 2): the residual video phase belongs to it.
        cycles.append(delay_s * (mid_hz - chirp.slope_hz_per_s * delay_s / 2))
    turn = 2 * np.pi * (cycles[1] - cycles[0])
    off = (phases[1] - phases[0] - turn + np.pi) % (2 * np.pi) - np.pi
    # Of real samples the image, 29 rows away or more, leaks -92 dB.
    assert abs(off) < (1e-5 if sampling == "complex" else 1e-4)


@few
@given(scenes(), st.integers(1, 50))
def test_a_frame_taken_later_is_that_of_a_scene_that_moved_on(seen, number):
    radar, scene = seen
    at_s = number * radar.frame.period_s
    moved = [
        replace(t, position_m=tuple(np.add(t.position_m, np.multiply(at_s, t.velocity_m_per_s))))
        for t in scene.targets
    ]
    ego = dc.Ego(position_m=(at_s * 3.0, -at_s, 0), velocity_m_per_s=(3, -1, 0))
    driven = replace(scene, ego=dc.Ego(velocity_m_per_s=(3, -1, 0)))
    late = echoes(driven, radar, n_frames=number + 1)[number]
    now = echoes(dc.Scene(targets=moved, ego=ego), radar)[0]
    # 60 m are rounded to 7e-15 m, 5e-11 of a turn, some times over.
    np.testing.assert_allclose(late, now, rtol=0, atol=1e-8 * abs(now).max())


@settings(max_examples=15)
@given(scenes(n_most=1), st.integers(0, 2**32 - 1), st.sampled_from(WINDOWS))
def test_a_target_is_detected_where_the_truth_has_it(seen, seed, window):
    radar, scene = seen
    scene = dc.Scene(targets=[replace(one, rcs_m2=100.0) for one in scene.targets])
    found = dc.detect(dc.simulate(scene, radar, seed=seed), radar, chain(window))
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    one = found.isel(detection=int(np.argmax(found.snr.values)))
    # The image of a real tone draws it by some thousandths of a cell.
    frame, chirp = radar.frame, radar.frame.chirp
    drawn = 0.01 if chirp.sampling == "real" else 0.0
    cells = {
        "range": float(chirp.range_bins_m(chirp.n_samples)[1]),
        "velocity": 2 * frame.max_velocity_m_per_s / frame.n_chirps,
        "azimuth": 0.3,
    }
    for name, cell in cells.items():
        # Six standard errors: by chance once in 5e8 numbers.
        off = float(one[name]) - float(truth[name])
        assert abs(off) < 6 * float(one[f"{name}_std"]) + drawn * cell, name
