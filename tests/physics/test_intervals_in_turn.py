"""Frames whose intervals differ: what is sampled, and how velocities unfold by comparing them."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binom

import dechirp as dc
from dechirp.process.intervals import unfolded
from dechirp.radar.accuracy import standard_errors
from dechirp.scene.folding import Place, folded

INTERVALS_S = (31e-6, 35e-6, 38e-6)


def in_turn(radar, *intervals_s, n_chirps=32, period_s=10e-3):
    frame = replace(radar.frame, n_chirps=n_chirps, interval_s=intervals_s, period_s=period_s)
    return replace(radar, frame=frame, array=dc.Array())


def ahead(range_m, velocity, rcs_m2=1.0):
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)


def measured(radar, range_m, velocity, snr, n_frames, rng, is_found=1.0):
    """Detections of targets (n,) at constant velocities, with errors at the bound."""
    rows = []
    for number in range(n_frames):
        one = radar.at(number)
        time_s = radar.frame.start_s(number) + one.frame.mid_frame_s
        at = folded(Place(range_m + velocity * time_s, velocity), one)
        kept = rng.random(len(range_m)) < is_found
        std = [np.full(kept.sum(), float(of)) for of in standard_errors(one.frame, snr=snr)]
        rows.append(
            {
                "frame": np.full(kept.sum(), number),
                "time": np.full(kept.sum(), time_s),
                "range": at.range_m[kept] + std[0] * rng.standard_normal(kept.sum()),
                "velocity": at.velocity_m_per_s[kept] + std[1] * rng.standard_normal(kept.sum()),
                "range_std": std[0],
                "velocity_std": std[1],
                **{
                    f"{name}{of}": np.zeros(kept.sum())
                    for name in ("azimuth", "elevation")
                    for of in ("", "_std")
                },
                "fold": np.full(kept.sum(), np.nan),
                "fold_confidence": np.full(kept.sum(), np.nan),
                "truth": velocity[kept],
            }
        )
    return xr.Dataset(
        {name: ("detection", np.concatenate([row[name] for row in rows])) for name in rows[0]}
    )


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
        alone = dc.simulate(later, radar.at(number), **options)
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
    assert np.all(found.fold_confidence >= 0.99)
    expected = [round(velocity / (2 * radar.at(k).frame.max_velocity_m_per_s)) for k in range(3)]
    assert found.fold.values.tolist() == expected
    # Five standard errors; within a frame fast ones walk through half of a range cell.
    assert np.all(abs(found.velocity - truth.velocity.values) < 6 * found.velocity_std)
    assert np.all(abs(found.range - truth.range.values) < 6 * found.range_std)


def test_at_20_db_folds_are_right_and_confidence_is_honest(radar):
    radar = in_turn(radar, *INTERVALS_S)
    rng = np.random.default_rng(2)
    wrong = certain = certainly_wrong = trials = 0
    for _ in range(60):
        n = 12
        targets = rng.uniform(5, 70, n), rng.uniform(-80, 80, n)
        given = measured(radar, *targets, 100.0, 6, rng, is_found=0.9)
        made = unfolded(given, radar)
        # A span is 50 m/s and more; errors are below 1.
        off = abs(made.velocity - given.truth).values > 10
        sure = made.fold_confidence.values >= 0.99
        assert np.array_equal(sure, np.isfinite(made.fold.values))
        trials, certain = trials + len(off), certain + sure.sum()
        certainly_wrong += (off & sure).sum()
        wrong += (off & sure).sum()
    # As asked: 1 % and 2 %; what is not certain is marked.
    assert binom.sf(wrong - 1, trials, 0.01) > 1e-6
    assert binom.sf(certainly_wrong - 1, certain, 0.02) > 1e-6
    assert certain > 0.95 * trials


def test_confidence_is_how_often_crowded_and_fading_targets_are_right(radar):
    radar = in_turn(radar, 31e-6, 35e-6)
    rng = np.random.default_rng(3)
    said, right = [], []
    for _ in range(40):
        # Within 4 m, so that remainders of others lie where a wrong fold says.
        n = 30
        targets = rng.uniform(20, 24, n), rng.uniform(-80, 80, n)
        given = measured(radar, *targets, 30.0, 2, rng, is_found=0.9)
        made = unfolded(given, radar)
        said.append(made.fold_confidence.values)
        # Which fold it would have told: below 0.99 velocities stay as they were.
        right.append(abs(made.velocity - given.truth).values < 10)
    said, right = np.concatenate(said), np.concatenate(right)
    sure = said >= 0.99
    assert 0.1 < sure.mean() < 0.95  # it is hard
    assert binom.sf((~right & sure).sum() - 1, sure.sum(), 0.02) > 1e-6


def test_one_frame_alone_and_equal_intervals_tell_no_fold(radar):
    rng = np.random.default_rng(4)
    radar = in_turn(radar, *INTERVALS_S)
    made = unfolded(measured(radar, np.array([20.0]), np.array([40.0]), 1000.0, 1, rng), radar)
    assert np.isnan(made.fold.values).all()
    assert made.fold_confidence.item() < 0.2  # 31, 35 or 38 folds
    given = measured(radar, np.array([20.0]), np.array([40.0]), 1000.0, 1, rng)
    assert unfolded(given, radar).velocity.item() == pytest.approx(given.velocity.item())


@pytest.mark.parametrize(
    ("interval_s", "where", "need"),
    [
        ((35e-6,), "Frame.interval_s", "two or more"),
        ((), "Frame.interval_s", "two or more"),
        ((35e-6, 29e-6), "Frame.interval_s.1", "duration of the ramp"),
        ((35e-6, "40 us"), "Frame.interval_s.1", "finite number"),
    ],
)
def test_lists_that_cannot_be_are_refused(radar, interval_s, where, need):
    with pytest.raises(dc.InvalidSetting, match=need) as error:
        replace(radar.frame, interval_s=interval_s)
    assert error.value.mistakes[0].setting == where


def test_what_is_about_one_frame_asks_which(radar):
    radar = in_turn(radar, 31e-6, 35e-6)
    cube = dc.simulate(dc.Scene(), radar, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"radar\.at"):
        dc.power_map(cube.isel(frame=0), radar, dc.Chain(angle=None))
    assert dc.power_map(cube.isel(frame=1), radar.at(1), dc.Chain(angle=None)).shape == (32, 256)
    with pytest.raises(dc.InvalidSetting, match="one profile"):
        dc.ti_cfg_text(radar, device="xwr1843")


@pytest.mark.parametrize(
    ("intervals_s", "n_frames", "says"),
    [((31e-6, 31e-6), 4, "all 31 us"), ((31e-6, 35e-6), 1, "2 intervals for 1 frames")],
)
def test_intervals_from_which_nothing_is_gained_are_told(radar, intervals_s, n_frames, says):
    with pytest.warns(dc.PhysicsWarning, match=says):
        dc.simulate(dc.Scene(), in_turn(radar, *intervals_s), n_frames=n_frames)


def test_a_frame_that_is_too_short_for_one_of_its_intervals_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match="time the chirps take"):
        replace(radar.frame, interval_s=(31e-6, 80e-6), period_s=128 * 40e-6)
