"""Frames whose intervals differ: what is sampled, and how velocities unfold by comparing them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.processing.direction_finding import element_snapshots
from dechirp.processing.velocity_ambiguity import by_frame_intervals
from dechirp.processing.velocity_ambiguity.by_frame_intervals import FrameEstimates
from dechirp.processing.velocity_ambiguity.hypotheses import AmbiguityHypotheses, unresolved
from dechirp.radar.estimation_bounds import crlb_standard_errors
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity
from dechirp.scene.scene_warnings import scene_findings

INTERVALS_S = (31e-6, 35e-6, 38e-6)


def in_turn(radar, *intervals_s, n_chirps=32, period_s=10e-3):
    frame = replace(radar.frame, n_chirps=n_chirps, interval_s=intervals_s, period_s=period_s)
    return replace(radar, frame=frame, array=dc.Array())


def ahead(range_m, velocity, rcs_m2=1.0):
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)


def measured(radar, range_m, velocity, snr, n_frames, rng, is_found=1.0):
    """What frames alone tell of targets (n,) at constant velocities, with errors at the bound.

    And the folds in which they are.
    """
    frames, folds = [], []
    for number in range(n_frames):
        one = radar.for_frame(number)
        time_s = radar.frame.frame_start_s(number) + one.frame.mid_frame_s
        truth = RangeVelocity(range_m + velocity * time_s, velocity)
        at = alias_range_velocity(truth, one)
        kept = rng.random(len(range_m)) < is_found
        std = [np.full(kept.sum(), float(of)) for of in crlb_standard_errors(one.frame, snr=snr)]
        frames.append(
            FrameEstimates(
                number,
                time_s,
                at.range_m[kept] + std[0] * rng.standard_normal(kept.sum()),
                at.velocity_m_per_s[kept] + std[1] * rng.standard_normal(kept.sum()),
                *std,
                unresolved(kept.sum()),
            )
        )
        span = 2 * one.frame.max_velocity_m_per_s
        off = (velocity[kept] - frames[-1].velocity_m_per_s) / span
        folds.append(np.round(off))
    return frames, folds


def test_each_frame_is_that_of_a_radar_with_its_interval(radar):
    radar = in_turn(radar, *INTERVALS_S, period_s=None)
    scene = dc.Scene(targets=[ahead(20, 5)])
    options = {"impairments": (), "dtype": np.complex128}
    cube = dc.simulate(scene, radar, n_frames=4, **options)

    starts_s = 32 * np.array([0, 31e-6, 66e-6, 104e-6])
    assert cube.frame.values == pytest.approx(starts_s, abs=1e-15)
    assert dc.truth(scene, radar, n_frames=4).time.values == pytest.approx(
        starts_s + 31 / 2 * np.array([31e-6, 35e-6, 38e-6, 31e-6]) + 14.75e-6
    )
    for number in range(4):
        later = dc.Scene(targets=[ahead(20 + 5 * starts_s[number], 5)])
        alone = dc.simulate(later, radar.for_frame(number), **options)
        own = cube.isel(frame=number)
        # Positions are rounded at 20 m in double precision, 1e-11 rad of phase.
        np.testing.assert_allclose(
            own, alone.isel(frame=0), rtol=0, atol=1e-9 * abs(alone.values).max()
        )
        np.testing.assert_allclose(own.chirp_time, alone.chirp)
    assert cube.chirp.values.tolist() == list(range(32))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")  # it folds within each
@pytest.mark.parametrize("velocity", [-150.0, -40.0, 5.0, 33.0, 90.0])
def test_a_velocity_beyond_the_span_of_each_frame_is_told(radar, velocity):
    radar = in_turn(radar, *INTERVALS_S)
    scene = dc.Scene(targets=[ahead(30, velocity)])
    cube = dc.simulate(scene, radar, n_frames=3, seed=1)
    found, truth = dc.detect(cube, radar), dc.truth(scene, radar, n_frames=3).isel(target=0)

    assert found.frame.values.tolist() == [0, 1, 2]
    assert np.all(found.ambiguity_confidence >= 0.99)
    expected = [
        round(velocity / (2 * radar.for_frame(k).frame.max_velocity_m_per_s)) for k in range(3)
    ]
    assert found.ambiguity_number.values.tolist() == expected
    # Five standard errors; within a frame fast ones walk through half of a range cell.
    assert np.all(abs(found.velocity - truth.velocity.values) < 6 * found.velocity_std)
    assert np.all(abs(found.range - truth.range.values) < 6 * found.range_std)


def decided(radar, spread, snr, n_frames, n_trials, rng):
    """Of crowds at ranges and velocities that `spread` draws: trials, certain and wrong folds."""
    trials = certain = wrong = 0
    for _ in range(n_trials):
        frames, truth = measured(radar, *spread(), snr, n_frames, rng, is_found=0.9)
        for told, true in zip(
            by_frame_intervals.ambiguity_probabilities(frames, radar.frame), truth, strict=True
        ):
            sure = told.confidence >= 0.99
            assert np.array_equal(sure, np.isfinite(told.certain_number))
            trials, certain = trials + len(true), certain + sure.sum()
            wrong += (told.certain_number[sure] != true[sure]).sum()
    return trials, certain, wrong


def test_at_20_db_folds_are_right_and_confidence_is_honest(radar):
    radar, rng = in_turn(radar, *INTERVALS_S), np.random.default_rng(2)
    trials, certain, wrong = decided(
        radar, lambda: (rng.uniform(5, 70, 12), rng.uniform(-80, 80, 12)), 100.0, 6, 60, rng
    )
    # As asked: 1 % and 2 %; what is not certain is marked.
    assert binom.sf(wrong - 1, trials, 0.01) > 1e-6
    assert binom.sf(wrong - 1, certain, 0.02) > 1e-6
    assert certain > 0.95 * trials


def test_confidence_is_how_often_crowded_and_fading_targets_are_right(radar):
    radar, rng = in_turn(radar, 31e-6, 35e-6), np.random.default_rng(3)
    # Within 4 m, so that remainders of others lie where a wrong fold says.
    trials, certain, wrong = decided(
        radar, lambda: (rng.uniform(20, 24, 30), rng.uniform(-80, 80, 30)), 30.0, 2, 40, rng
    )
    assert 0.1 < certain / trials < 0.95  # it is hard
    assert binom.sf(wrong - 1, certain, 0.02) > 1e-6


def test_one_frame_alone_and_equal_intervals_tell_no_fold(radar):
    rng = np.random.default_rng(4)
    radar = in_turn(radar, *INTERVALS_S)
    frames, _ = measured(radar, np.array([20.0]), np.array([40.0]), 1000.0, 1, rng)
    (told,) = by_frame_intervals.ambiguity_probabilities(frames, radar.frame)
    assert np.isnan(told.certain_number).all()
    assert told.confidence.item() < 0.2  # 31, 35 or 38 folds


@pytest.mark.parametrize(
    ("interval_s", "where", "expected"),
    [
        ((35e-6,), "Frame.interval_s", "two or more"),
        ((), "Frame.interval_s", "two or more"),
        ((35e-6, 29e-6), "Frame.interval_s.1", "duration of the ramp"),
        ((35e-6, "40 us"), "Frame.interval_s.1", "finite number"),
    ],
)
def test_lists_that_cannot_be_are_refused(radar, interval_s, where, expected):
    with pytest.raises(dc.InvalidSetting, match=expected) as error:
        replace(radar.frame, interval_s=interval_s)
    assert error.value.mistakes[0].setting == where


def test_what_is_about_one_frame_asks_which(radar):
    radar = in_turn(radar, 31e-6, 35e-6)
    cube = dc.simulate(dc.Scene(), radar, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"radar\.for_frame"):
        dc.power_map(cube.isel(frame=0), radar, dc.Chain(angle=None))
    assert dc.power_map(cube.isel(frame=1), radar.for_frame(1), dc.Chain(angle=None)).shape == (
        32,
        256,
    )
    with pytest.raises(dc.InvalidSetting, match="one profile"):
        format_ti_cfg(radar, device="xwr1843")


@pytest.mark.parametrize(
    ("intervals_s", "n_frames", "says"),
    [((31e-6, 31e-6), 4, "all 31 us"), ((31e-6, 35e-6), 1, "2 intervals for 1 frames")],
)
def test_intervals_from_which_nothing_is_gained_are_told(radar, intervals_s, n_frames, says):
    with pytest.warns(dc.PhysicsWarning, match=says):
        dc.simulate(dc.Scene(), in_turn(radar, *intervals_s), n_frames=n_frames)


def test_a_frame_that_is_too_short_for_one_of_its_intervals_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match="duration of the chirps"):
        replace(radar.frame, interval_s=(31e-6, 80e-6), period_s=128 * 40e-6)


SHARED = {
    "turns": {"multiplexing": dc.multiplexing.Tdm(order=(0, 1, 2))},
    "one": {},
    "steps": {"modulation": dc.modulations.FrequencyShiftKeying(step_hz=3e6)},
    "pauses": {"modulation": dc.modulations.Staggered(pauses_s=(0, 5e-6))},
    "triangles": {"modulation": dc.modulations.Triangular()},
}


def row_in_turn(radar, *, multiplexing=None, modulation=None):
    half_m = radar.frame.chirp.wavelength_m / 2
    tx_m = [(0, 4 * half_m * k, 0) for k in range(1 if multiplexing is None else 3)]
    frame = replace(
        in_turn(radar, *INTERVALS_S, period_s=20e-3).frame,
        multiplexing=multiplexing,
        modulation=modulation,
    )
    array = dc.Array(tx_m=tx_m, rx_m=[(0, half_m * k, 0) for k in range(4)])
    return replace(radar, frame=frame, array=array)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")  # it folds within each
@pytest.mark.parametrize("how", SHARED)
@pytest.mark.parametrize("velocity", [-60.0, 33.0, 75.0])
def test_directions_are_those_of_the_fold_that_frames_agree_on(radar, how, velocity):
    """Up to four folds of three transmitters away, where one frame tells the nearest three."""
    radar = row_in_turn(radar, **SHARED[how])
    azimuth = np.radians(-20)
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    target = dc.Target(
        position_m=tuple(20 * towards), velocity_m_per_s=tuple(velocity * towards), rcs_m2=10
    )
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, n_frames=3, seed=2)
    found, truth = dc.detect(cube, radar), dc.truth(scene, radar, n_frames=3).isel(target=0)

    assert found.frame.values.tolist() == [0, 1, 2]
    assert np.all(found.ambiguity_confidence >= 0.99)
    # Six standard errors; the bend of the wave and the walk within a frame add 0.05 degrees.
    assert np.all(abs(found.azimuth - azimuth) < 6 * found.azimuth_std + np.radians(0.05))
    assert np.all(abs(found.velocity - truth.velocity.values) < 6 * found.velocity_std)
    assert np.all(abs(found.range - truth.range.values) < 6 * found.range_std + 2e-4)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("how", SHARED)
def test_one_frame_tells_what_it_would_of_a_radar_with_its_interval_alone(radar, how):
    """Three transmitters in turn tell one fold, two ramps another: 12 m/s, left of boresight."""
    radar = row_in_turn(radar, **SHARED[how])
    azimuth = np.radians(20)
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    target = dc.Target(
        position_m=tuple(20 * towards), velocity_m_per_s=tuple(12 * towards), rcs_m2=10
    )
    cube = dc.simulate(dc.Scene(targets=[target]), radar, n_frames=1, seed=1)
    found = dc.detect(cube, radar)
    assert found.identical(dc.detect(cube, radar.for_frame(0)))
    assert abs(found.azimuth.item() - azimuth) < 6 * found.azimuth_std.item() + np.radians(0.05)
    assert abs(found.velocity.item() - 12) < 6 * found.velocity_std.item()


@pytest.mark.parametrize(
    ("how", "n_frames", "velocity", "level", "says"),
    [
        ("one", 1, 40.0, "warning", "expect the aliased velocity"),
        ("one", 2, 40.0, "note", "frames of other intervals tell velocities up to"),
        ("turns", 1, 12.0, "note", "by how they turn against each other"),
        ("turns", 1, 40.0, "warning", "expect the aliased velocity"),
        ("pauses", 1, 20.0, None, ""),
        ("triangles", 1, 20.0, None, ""),
    ],
)
def test_of_a_velocity_that_folds_is_told_what_becomes_of_it(
    radar, how, n_frames, velocity, level, says
):
    """Of 31 us; three transmitters in turn tell 31.4 m/s, one 31.4 m/s without a fold."""
    radar = row_in_turn(radar, **SHARED[how])
    found = scene_findings(dc.Scene(targets=[ahead(20, velocity)]), radar, n_frames=n_frames)
    told = [one for one in found if one.setting.endswith("velocity")]

    assert [one.level for one in told] == ([] if level is None else [level])
    assert all(says in one.fix for one in told)


def test_what_one_frame_half_knows_counts(radar):
    """Nine in ten for one of three folds of the slots are nine in ten for all that turn alike."""
    rng = np.random.default_rng(5)
    radar = row_in_turn(radar, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)))
    (given,), _ = measured(radar, np.array([20.0]), np.array([2.0]), 300.0, 1, rng)
    half = given._replace(
        hypotheses=AmbiguityHypotheses(np.array([[0.05, 0.9, 0.05]]), np.array([[-1.0, 0.0, 1.0]]))
    )
    (told,) = by_frame_intervals.ambiguity_probabilities([half], radar.frame)

    alike = told.number[0] % 3 == 0
    # Of 31 folds, 11 turn alike and 20 otherwise: 0.908.
    assert told.probability[0, alike].sum() == pytest.approx(0.9, abs=0.01)
    assert np.isnan(told.certain_number).all()


def test_receivers_before_one_transmitter_are_not_turned_by_a_fold(radar):
    """Slots half a cycle apart would cancel if a wrong fold were taken off."""
    radar = row_in_turn(radar, modulation=dc.modulations.Staggered(pauses_s=(0, 5e-6))).for_frame(0)
    rng = np.random.default_rng(6)
    heard = np.exp(1j * np.array([0.0, 1.1, 2.2, 3.3]))
    slots = np.exp(1j * rng.uniform(-np.pi, np.pi, (50, 2, 1)))
    noise = rng.standard_normal((2, 50, 8)) * 1e-3
    given = (slots * heard).reshape(50, 8) + noise[0] + 1j * noise[1]
    doppler_hz = rng.uniform(-1e5, 1e5, 50)
    seen, of_noise = element_snapshots(given, doppler_hz, np.full(50, 2e-6), radar)

    alike = seen[:, 0] / seen[:, :1, 0] * heard[0]
    # The mean of two slots: sqrt(2) of 1e-3, and the first element's own, five times and a half.
    assert np.all(abs(alike - heard) < 0.011)
    assert of_noise == pytest.approx(1e-6)
