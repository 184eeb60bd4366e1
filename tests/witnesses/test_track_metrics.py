"""Metrics of tracks against definitions, published numbers and Stone Soup."""

import json
from datetime import datetime
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.types.state import State

from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.identity import track_identities
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.ospa import ospa_m

CASES = json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]
NOW = datetime(2000, 1, 1)
SIZES = [(0, 1), (1, 0), (1, 1), (2, 4), (5, 3), (6, 6)]


def points(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 10, (n, 2))


def as_states(points_m: np.ndarray) -> list[State]:
    return [State(point[:, None], timestamp=NOW) for point in points_m]


def test_gospa_of_the_published_case():
    [case] = [case for case in CASES if case["quantity"] == "gospa"]
    told = case["inputs"]

    found = gospa(
        np.array(told["X"])[:, None],
        np.array(told["Y"])[:, None],
        cutoff_m=told["c"],
        order=told["p"],
        alpha=told["alpha"],
    )

    assert found.error_m == pytest.approx(case["expected"], rel=case["tol_rel"])
    assert (found.n_missed, found.n_false) == (0, 1)
    assert found.localisation == pytest.approx(1.0)


@pytest.mark.parametrize(("n", "m"), SIZES)
@pytest.mark.parametrize("order", [1, 2])
def test_gospa_and_ospa_are_those_of_stone_soup(n, m, order):
    rng = np.random.default_rng([n, m, order])
    found, truth = points(n, rng), points(m, rng)
    states = as_states(found), as_states(truth)

    theirs, _ = GOSPAMetric(c=3.0, p=order).compute_gospa_metric(*states)
    ours = gospa(found, truth, cutoff_m=3.0, order=order)
    assert ours.error_m == pytest.approx(theirs.value["distance"], rel=1e-12)
    # Theirs are costs, half of c^p for each.
    assert ours.n_missed * 3.0**order / 2 == pytest.approx(theirs.value["missed"])
    assert ours.n_false * 3.0**order / 2 == pytest.approx(theirs.value["false"])
    assert ours.localisation == pytest.approx(theirs.value["localisation"], abs=1e-12)

    distance = OSPAMetric(c=3.0, p=order).compute_OSPA_distance(*states).value
    assert ospa_m(found, truth, cutoff_m=3.0, order=order) == pytest.approx(distance, rel=1e-12)


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_ospa_is_the_least_over_all_assignments(n, m):
    rng = np.random.default_rng([n, m])
    few, many = sorted((points(n, rng), points(m, rng)), key=len)
    sums = [
        sum(min(3.0, np.hypot(*(few[i] - many[j]))) ** 2 for i, j in enumerate(chosen))
        for chosen in permutations(range(len(many)), len(few))
    ]
    least = np.sqrt((min(sums) + 3.0**2 * (len(many) - len(few))) / len(many))

    assert ospa_m(few, many, cutoff_m=3.0, order=2) == pytest.approx(least, rel=1e-12)
    assert ospa_m(many, few, cutoff_m=3.0, order=2) == pytest.approx(least, rel=1e-12)


def test_ospa_of_closed_forms():
    truth = np.array([[0.0, 0], [50, 0], [0, 50], [50, 50]])
    moved = np.add(truth, [0.3, 0.4])
    # Schuhmacher, Vo and Vo 2008: all off by d; n - m of n missed; nothing found.
    assert ospa_m(moved, truth, cutoff_m=10) == pytest.approx(0.5)
    assert ospa_m(truth[:3], truth, cutoff_m=10, order=2) == pytest.approx(10 * np.sqrt(1 / 4))
    assert ospa_m(np.zeros((0, 2)), truth, cutoff_m=10) == 10
    assert ospa_m(np.zeros((0, 2)), np.zeros((0, 2)), cutoff_m=10) == 0
    # The order in which points are told is no matter, and large orders tend to the largest.
    assert ospa_m(moved[::-1], truth, cutoff_m=10) == pytest.approx(0.5)
    one_off = np.add(truth, [[0, 0], [0, 0], [0, 0], [0, 2.0]])
    assert ospa_m(one_off, truth, cutoff_m=10, order=100) == pytest.approx(2 * 4**-0.01)


set_of_points = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=0, max_size=4
).map(lambda rows: np.array(rows).reshape(-1, 2))


@given(a=set_of_points, b=set_of_points, c=set_of_points, order=st.sampled_from([1, 2, 3.5]))
def test_both_are_metrics(a, b, c, order):
    for distance in (
        lambda x, y: ospa_m(x, y, cutoff_m=5, order=order),
        lambda x, y: gospa(x, y, cutoff_m=5, order=order).error_m,
        lambda x, y: gospa(x, y, cutoff_m=5, order=order, alpha=1).error_m,
    ):
        assert distance(a, a) == 0
        assert distance(a, b) == pytest.approx(distance(b, a), rel=1e-9, abs=1e-9)
        assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


def test_gospa_counts_what_is_missed_and_what_is_false_apart():
    truth = np.array([[0.0, 0], [50, 0]])
    found = np.array([[1.0, 0], [100, 0], [0, 100]])

    told = gospa(found, truth, cutoff_m=8)

    assert (told.n_missed, told.n_false) == (1, 2)
    assert told.error_m == pytest.approx(np.sqrt(1 + 3 * 8**2 / 2))


def test_nees_has_the_mean_and_the_interval_of_chi_square():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4))
    errors = rng.normal(size=(20_000, 4)) @ root.T
    spread = np.broadcast_to(root @ root.T, (20_000, 4, 4))

    found = nees(errors, spread)

    low, high = mean_nees_interval(4, 20_000, outside_probability=1e-6)
    assert low < found.mean() < high
    # By hand: errors of 2 and 3 standard deviations.
    assert nees([2.0, 6.0], [[1, 0], [0, 4]]) == pytest.approx(4 + 9)


def test_the_interval_is_that_of_the_published_example():
    # Bar-Shalom, Li, Kirubarajan 2001, 5.4.2: two states, 95 %: of one run, and of fifty.
    assert mean_nees_interval(2, 1, outside_probability=0.05) == pytest.approx(
        (0.05, 7.38), abs=0.005
    )
    # 74.2 and 129.6 are the points of chi-square with 100 degrees.
    assert mean_nees_interval(2, 50, outside_probability=0.05) == pytest.approx(
        (74.2 / 50, 129.6 / 50), abs=1e-3
    )


def moving(x, y=0.0) -> xr.Dataset:
    """Positions (n, n_frames) of targets."""
    x = np.array(x, float)
    return xr.Dataset(
        {"x": (("target", "frame"), x), "y": (("target", "frame"), np.broadcast_to(y, x.shape))},
        coords={"frame": np.arange(x.shape[1])},
    )


def following(x, y=0.0, status="confirmed") -> xr.Dataset:
    """Tracks at positions (n, n_frames), confirmed where they are."""
    tracks = moving(x, y).rename(target="track")
    said = np.where(np.isfinite(tracks.x.values), status, "")
    return tracks.assign(status=(("track", "frame"), said))


def test_tracks_that_stay_with_their_targets_lose_and_swap_nothing():
    x = np.array([[0.0, 1, 2, 3], [10, 11, 12, 13]])

    told = track_identities(following(x + 0.2), moving(x), cutoff_m=1)

    assert told.holder.values.tolist() == [[0] * 4, [1] * 4]
    assert not told.n_lost.any() and not told.n_swaps.any() and not told.n_false.any()


def test_tracks_that_meet_and_part_are_not_swapped_by_the_moment():
    # At the third frame each track is nearer to the other's target.
    targets = [[0.0, 2, 3.9, 6, 8], [8, 6, 4.1, 2, 0]]
    tracks = [[0.0, 2, 4.2, 6, 8], [8, 6, 3.8, 2, 0]]

    told = track_identities(following(tracks), moving(targets), cutoff_m=1)

    assert told.n_swaps.values.tolist() == [0, 0]
    assert told.n_lost.values.tolist() == [0, 0]


def test_tracks_that_turn_back_where_targets_pass_each_other_are_swapped():
    targets = [[0.0, 2, 4, 6, 8], [8, 6, 4, 2, 0]]
    tracks = [[0.0, 2, 4, 2, 0], [8, 6, 4, 6, 8]]

    told = track_identities(following(tracks), moving(targets), cutoff_m=1)

    assert told.n_swaps.values.tolist() == [1, 1]
    assert told.n_lost.values.tolist() == [0, 0]


def test_lost_targets_and_false_tracks_are_counted_by_frame():
    nan = np.nan
    targets = [[0.0, 0, 0, 0, 0, 0], [50, 50, 50, nan, nan, nan]]
    tracks = [[nan, 0, 9, 0, nan, nan], [90, 90, nan, nan, nan, 0], [50, 50, 50, 50, nan, nan]]

    told = track_identities(following(tracks), moving(targets), cutoff_m=1)

    assert told.first_held.values.tolist() == [1, 0]
    assert told.n_lost.values.tolist() == [2, 0]  # a target that left is not lost
    assert told.n_swaps.values.tolist() == [1, 0]
    assert told.n_false.values.tolist() == [1, 1, 1, 1, 0, 0]
    tentative = track_identities(following(tracks, status="tentative"), moving(targets), cutoff_m=1)
    assert tentative.first_held.values.tolist() == [-1, -1]


def test_no_tracks_hold_nobody():
    told = track_identities(following(np.zeros((0, 3))), moving(np.zeros((2, 3))), cutoff_m=1)

    assert told.first_held.values.tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ospa_m([[0, 0]], [[0, 0]], cutoff_m=0), "cutoff_m is 0"),
        (lambda: ospa_m([[0, 0]], [[0, 0]], cutoff_m=1, order=0.5), "order is 0.5"),
        (lambda: gospa([[0, np.nan]], [[0, 0]], cutoff_m=1), "found_m is nan"),
        (lambda: gospa([[0, 0, 0]], [[0, 0]], cutoff_m=1), "a row for each point"),
        (lambda: gospa([[0, 0]], [[0, 0]], cutoff_m=1, alpha=3), "alpha is 3"),
        (lambda: nees([0, 0], [[1, 0]]), "n by n matrix"),
        (lambda: nees([1.0, 1], [[1, 1], [1, 1]]), "positive definite"),
        (lambda: mean_nees_interval(2, 0, outside_probability=0.05), "n_independent is 0"),
        (
            lambda: track_identities(
                following(np.zeros((1, 3))), moving(np.zeros((1, 4))), cutoff_m=1
            ),
            "other frames",
        ),
    ],
)
def test_what_cannot_be_judged_is_refused(call, message):
    with pytest.raises(InvalidSetting, match=message):
        call()
