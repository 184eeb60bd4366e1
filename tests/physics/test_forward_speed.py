"""Speed from few standing objects over many lists, in traffic that outnumbers them in each list."""

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.tracking.forward_speed import ForwardSpeed, forward_speed

LIST_S, SPEED_STD, LATERAL_STD_M = 0.05, 0.05, 0.3


def true_speed(times_s):
    """Return a speed of 15 to 19 m/s, with up to 0.6 m/s^2."""
    return 17 + 2 * np.sin(2 * np.pi * times_s / 21)


def drive(seed, *, duration_s=40.0, posts_s=2.0, gap_s=(0.0, 0.0), lag_s=0.0):
    """Return detections: posts that pass one by one, and five cars that stay."""
    rng = np.random.default_rng(seed)
    times_s = LIST_S * np.arange(round(duration_s / LIST_S))
    way_m = np.concatenate([[0], np.cumsum(true_speed(times_s))[:-1] * LIST_S])
    rows = []

    def add(number, t, x, y, vx):
        range_m, azimuth = np.hypot(x, y), np.arctan2(y, x)
        velocity = vx * np.cos(azimuth) + SPEED_STD * rng.normal(size=t.size)
        azimuth = azimuth + LATERAL_STD_M / range_m * rng.normal()  # one reflection point
        rows.append(np.stack([t, range_m, velocity, azimuth, np.full(t.size, number)]))

    for index, begin_s in enumerate(np.arange(0, duration_s - 1, posts_s)):
        if gap_s[0] <= begin_s < gap_s[1]:
            continue
        t = times_s[(times_s >= begin_s) & (times_s < begin_s + 3)]
        seen_from = np.interp(t[0], times_s, way_m)
        x = 80 - (np.interp(t - lag_s, times_s, way_m) - seen_from)
        add(index % 7, t, x - lag_s * true_speed(t), 6.0, -true_speed(t - lag_s))
    for car in range(5):
        relative = 0.5 * car - 1
        add(10 + car, times_s, 60 + 10 * car + relative * times_s, 3.0 * (car % 2), relative)
    t, range_m, velocity, azimuth, number = np.concatenate(rows, axis=1)
    order = np.argsort(t, kind="stable")
    columns = {
        "time": t,
        "range": range_m,
        "velocity": velocity,
        "azimuth": azimuth,
        "number": number,
        "velocity_std": np.full(t.size, SPEED_STD),
        "azimuth_std": LATERAL_STD_M / range_m,
    }
    return xr.Dataset({name: ("detection", values[order]) for name, values in columns.items()})


def test_few_standing_objects_outvote_the_cars_of_the_same_traffic():
    """At most two posts stand beside five cars; errors agree with the standard errors."""
    squares = []
    for seed in range(6):
        motion = forward_speed(drive(seed), ForwardSpeed(min_objects=1))
        error = motion.speed.values - true_speed(motion.time.values)
        assert np.isfinite(error[4:-4]).all()
        assert np.nanmax(np.abs(error)) < 0.5
        squares.append(np.nanmean((error / motion.speed_std.values) ** 2))
    # About 20 independent seconds in each of six drives: the mean of their squares has a relative
    # standard deviation of sqrt(2 / 120) = 0.13. The assumed tolerance and the coherence of half a
    # second of errors that are independent here make the standard errors too large.
    assert 0.02 < np.mean(squares) < 1.0 + 4 * 0.13


def test_speed_is_unknown_without_standing_objects():
    motion = forward_speed(drive(1, gap_s=(14.0, 22.0)), ForwardSpeed(min_objects=1))
    in_gap = (motion.time.values > 18.5) & (motion.time.values < 20.5)
    assert in_gap.any() and np.isnan(motion.speed.values[in_gap]).all()
    known = np.isfinite(motion.speed.values)
    error = motion.speed.values[known] - true_speed(motion.time.values[known])
    assert np.abs(error).max() < 0.5


def test_fewer_objects_than_required_give_no_speed():
    motion = forward_speed(drive(1), ForwardSpeed(min_objects=6))
    assert np.isnan(motion.speed.values).all() and np.isnan(motion.speed_std.values).all()


def test_lag_of_velocities_is_taken_off():
    """With velocities 0.2 s late, the speed is that of 0.2 s before each list."""
    lag_s = 0.2
    motion = forward_speed(drive(2, lag_s=lag_s), ForwardSpeed(min_objects=1, lag_s=lag_s))
    error = motion.speed.values - true_speed(motion.time.values)
    assert abs(np.nanmean(error)) < 0.03
    assert motion.time.values[0] == pytest.approx(-lag_s)


def test_accepts_one_row_and_rejects_none():
    one = forward_speed(drive(1).isel(detection=slice(0, 1)))
    assert np.isnan(one.speed.values).all()
    with pytest.raises(dc.InvalidSetting, match="0 complete rows.*one row or more"):
        forward_speed(drive(1).isel(detection=slice(0, 0)))
    late = drive(1).isel(detection=slice(0, 2))
    late["time"] = ("detection", np.array([0.0, 1e5]))
    with pytest.raises(dc.InvalidSetting, match="in parts if it is longer"):
        forward_speed(late)
    with pytest.raises(dc.InvalidSetting, match="number"):
        forward_speed(late.drop_vars("number"))


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("lag_s", -0.1),
        ("tolerance_m_per_s", -1.0),
        ("acceleration_std_m_per_s2", 0.0),
        ("jerk_std_m_per_s3", 0.0),
        ("max_speed_m_per_s", 1e4),
        ("min_objects", 0),
    ],
)
def test_settings_reject_impossible_values(setting, value):
    with pytest.raises(dc.InvalidSetting, match=f"ForwardSpeed.{setting}"):
        ForwardSpeed(**{setting: value})
