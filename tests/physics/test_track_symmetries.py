"""Symmetries from detections to tracks: turned, mirrored or later, tracks are so too."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.tracking.batch import track
from dechirp.tracking.false_alarms import FalseAlarms
from dechirp.tracking.tracker import Tracker

N_FRAMES, EVERY_S = 12, 0.1
STD = {"range": 0.15, "azimuth": 0.01, "velocity": 0.1}
few = settings(max_examples=5)


def seen(seed: int) -> xr.Dataset:
    """Detections of three targets that go straight on, with errors."""
    rng = np.random.default_rng(seed)
    times_s = np.repeat(np.arange(N_FRAMES) * EVERY_S, 3)
    start, speed = np.array([[30.0, -9], [45, 3], [60, 12]]), rng.uniform(-5, 5, (3, 2))
    x, y = np.tile(start.T, N_FRAMES) + np.tile(speed.T, N_FRAMES) * times_s
    vx, vy = np.tile(speed.T, N_FRAMES)
    range_m = np.hypot(x, y)
    told = {
        "range": range_m,
        "azimuth": np.arctan2(y, x),
        "velocity": (x * vx + y * vy) / range_m,
    }
    told = {name: one + STD[name] * rng.standard_normal(one.size) for name, one in told.items()}
    told |= {f"{name}_std": np.full(x.size, std) for name, std in STD.items()}
    told["frame"] = np.repeat(np.arange(N_FRAMES), 3)
    return xr.Dataset({name: ("detection", one) for name, one in told.items()})


def tracks_of(found: xr.Dataset, later_s: float = 0.0, **settings) -> xr.Dataset:
    tracker = Tracker(false_alarms=FalseAlarms(per_frame=1e-3), **settings)
    return track(found, later_s + np.arange(N_FRAMES) * EVERY_S, tracker)


def turned(tracks: xr.Dataset, matrix: np.ndarray) -> list[np.ndarray]:
    """Places, velocities and covariance of places, in other axes."""
    return [
        np.einsum("ij,jtf->itf", matrix, np.stack([tracks[name].values for name in pair]))
        for pair in (("x", "y"), ("vx", "vy"))
    ]


def agree(found: xr.Dataset, expected: xr.Dataset, matrix: np.ndarray, atol: float) -> None:
    assert found.sizes == expected.sizes and expected.sizes["track"] >= 3
    np.testing.assert_array_equal(found.status, expected.status)
    for one, other in zip(turned(found, np.eye(2)), turned(expected, matrix), strict=True):
        np.testing.assert_allclose(one, other, atol=atol, equal_nan=True)


@few
@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 0.5), st.sampled_from(["nearest", "joint"]))
def test_detections_turned_about_the_radar_turn_the_tracks(seed, angle, association):
    found = seen(seed)
    # Not the unscented one: its points lie along x and y, which moves tracks by up to 9 mm of
    # the 150 mm that a detection is off.
    filters = {"filter": "extended", "association": association}
    here = tracks_of(found, **filters)
    there = tracks_of(found.assign(azimuth=found.azimuth + angle), **filters)
    c, s = np.cos(angle), np.sin(angle)
    # Stone Soup takes derivatives by differences, right to 1e-8.
    agree(there, here, np.array([[c, -s], [s, c]]), atol=1e-4)


@few
@given(st.integers(0, 2**32 - 1))
def test_mirrored_detections_give_mirrored_tracks(seed):
    found = seen(seed)
    there = tracks_of(found.assign(azimuth=-found.azimuth))
    agree(there, tracks_of(found), np.diag([1.0, -1.0]), atol=1e-9)


@pytest.mark.parametrize("later_s", [0.25, 3600.0, 1e6])
def test_tracks_do_not_depend_on_when_the_first_frame_was(later_s):
    found = seen(1)
    # A time of 1e6 s is rounded to 1e-10 s, or to a microsecond on a clock of dates.
    agree(tracks_of(found, later_s), tracks_of(found), np.eye(2), atol=1e-4)
