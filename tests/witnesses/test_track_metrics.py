"""Track metrics against definitions, published numbers and Stone Soup."""

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
from dechirp.evaluation.track_metrics import (
    gospa,
    mean_nees_interval,
    nees,
    ospa_m,
    track_identities,
)

CASES = json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]
NOW = datetime(2000, 1, 1)
SIZES = [(0, 1), (1, 0), (1, 1), (2, 4), (5, 3), (6, 6)]


def draw_points(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 10, (n, 2))


def make_states(points_m: np.ndarray) -> list[State]:
    return [State(point[:, None], timestamp=NOW) for point in points_m]


def test_gospa_matches_published_case():
    [case] = [case for case in CASES if case["quantity"] == "gospa"]
    inputs = case["inputs"]

    result = gospa(
        np.array(inputs["X"])[:, None],
        np.array(inputs["Y"])[:, None],
        cutoff_m=inputs["c"],
        order=inputs["p"],
        alpha=inputs["alpha"],
    )

    assert result.error_m == pytest.approx(case["expected"], rel=case["tol_rel"])
    assert (result.n_missed, result.n_false) == (0, 1)
    assert result.localisation == pytest.approx(1.0)


@pytest.mark.parametrize(("n", "m"), SIZES)
@pytest.mark.parametrize("order", [1, 2])
def test_gospa_and_ospa_match_stone_soup(n, m, order):
    rng = np.random.default_rng([n, m, order])
    estimate, truth = draw_points(n, rng), draw_points(m, rng)
    states = make_states(estimate), make_states(truth)

    stone_soup_result, _ = GOSPAMetric(c=3.0, p=order).compute_gospa_metric(*states)
    result = gospa(estimate, truth, cutoff_m=3.0, order=order)
    assert result.error_m == pytest.approx(stone_soup_result.value["distance"], rel=1e-12)
    # Stone Soup returns costs, half of c^p for each missed or false point.
    assert result.n_missed * 3.0**order / 2 == pytest.approx(stone_soup_result.value["missed"])
    assert result.n_false * 3.0**order / 2 == pytest.approx(stone_soup_result.value["false"])
    assert result.localisation == pytest.approx(stone_soup_result.value["localisation"], abs=1e-12)

    distance = OSPAMetric(c=3.0, p=order).compute_OSPA_distance(*states).value
    assert ospa_m(estimate, truth, cutoff_m=3.0, order=order) == pytest.approx(distance, rel=1e-12)


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_ospa_is_minimum_over_all_assignments(n, m):
    rng = np.random.default_rng([n, m])
    few, many = sorted((draw_points(n, rng), draw_points(m, rng)), key=len)
    sums = [
        sum(min(3.0, np.hypot(*(few[i] - many[j]))) ** 2 for i, j in enumerate(assignment))
        for assignment in permutations(range(len(many)), len(few))
    ]
    minimum = np.sqrt((min(sums) + 3.0**2 * (len(many) - len(few))) / len(many))

    assert ospa_m(few, many, cutoff_m=3.0, order=2) == pytest.approx(minimum, rel=1e-12)
    assert ospa_m(many, few, cutoff_m=3.0, order=2) == pytest.approx(minimum, rel=1e-12)


def test_ospa_matches_closed_forms():
    truth = np.array([[0.0, 0], [50, 0], [0, 50], [50, 50]])
    shifted_points = np.add(truth, [0.3, 0.4])
    # Schuhmacher, Vo and Vo 2008: all points shifted by d; n - m of n missed; no estimates.
    assert ospa_m(shifted_points, truth, cutoff_m=10) == pytest.approx(0.5)
    assert ospa_m(truth[:3], truth, cutoff_m=10, order=2) == pytest.approx(10 * np.sqrt(1 / 4))
    assert ospa_m(np.zeros((0, 2)), truth, cutoff_m=10) == 10
    assert ospa_m(np.zeros((0, 2)), np.zeros((0, 2)), cutoff_m=10) == 0
    # The order of the points has no effect; for large p OSPA tends to the largest distance.
    assert ospa_m(shifted_points[::-1], truth, cutoff_m=10) == pytest.approx(0.5)
    one_shifted_point = np.add(truth, [[0, 0], [0, 0], [0, 0], [0, 2.0]])
    assert ospa_m(one_shifted_point, truth, cutoff_m=10, order=100) == pytest.approx(2 * 4**-0.01)


set_of_points = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=0, max_size=4
).map(lambda rows: np.array(rows).reshape(-1, 2))


@given(a=set_of_points, b=set_of_points, c=set_of_points, order=st.sampled_from([1, 2, 3.5]))
def test_ospa_and_gospa_are_metrics(a, b, c, order):
    for distance in (
        lambda x, y: ospa_m(x, y, cutoff_m=5, order=order),
        lambda x, y: gospa(x, y, cutoff_m=5, order=order).error_m,
        lambda x, y: gospa(x, y, cutoff_m=5, order=order, alpha=1).error_m,
    ):
        assert distance(a, a) == 0
        assert distance(a, b) == pytest.approx(distance(b, a), rel=1e-9, abs=1e-9)
        assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


@pytest.mark.parametrize("metric", [gospa, ospa_m])
@pytest.mark.parametrize("points", [3.0, [1.0, 2.0]])
def test_points_without_rows_are_refused_beside_an_empty_set(metric, points):
    for estimate_m, truth_m in ((points, []), ([], points)):
        with pytest.raises(InvalidSetting, match="a row for each point"):
            metric(estimate_m, truth_m, cutoff_m=5)


def test_gospa_counts_missed_and_false_separately():
    truth = np.array([[0.0, 0], [50, 0]])
    estimate = np.array([[1.0, 0], [100, 0], [0, 100]])

    result = gospa(estimate, truth, cutoff_m=8)

    assert (result.n_missed, result.n_false) == (1, 2)
    assert result.error_m == pytest.approx(np.sqrt(1 + 3 * 8**2 / 2))


def test_nees_follows_chi_square():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4))
    errors = rng.normal(size=(20_000, 4)) @ root.T
    covariances = np.broadcast_to(root @ root.T, (20_000, 4, 4))

    values = nees(errors, covariances)

    low, high = mean_nees_interval(4, 20_000, outside_probability=1e-6)
    assert low < values.mean() < high
    # Errors of 2 and 3 standard deviations.
    assert nees([2.0, 6.0], [[1, 0], [0, 4]]) == pytest.approx(4 + 9)
    # One matrix for all errors.
    assert nees([[2.0, 6.0], [1.0, 0.0]], [[1, 0], [0, 4]]) == pytest.approx([4 + 9, 1])


def test_mean_nees_interval_matches_published_example():
    # Bar-Shalom, Li, Kirubarajan 2001, 5.4.2: two states, 95 %, for one run and for fifty.
    assert mean_nees_interval(2, 1, outside_probability=0.05) == pytest.approx(
        (0.05, 7.38), abs=0.005
    )
    # 74.2 and 129.6 are the quantiles of chi-square with 100 degrees of freedom.
    assert mean_nees_interval(2, 50, outside_probability=0.05) == pytest.approx(
        (74.2 / 50, 129.6 / 50), abs=1e-3
    )


def make_targets(x, y=0.0) -> xr.Dataset:
    """Make a dataset of target positions (n, n_frames)."""
    x = np.array(x, float)
    return xr.Dataset(
        {"x": (("target", "frame"), x), "y": (("target", "frame"), np.broadcast_to(y, x.shape))},
        coords={"frame": np.arange(x.shape[1])},
    )


def make_tracks(x, y=0.0, status="confirmed") -> xr.Dataset:
    """Make tracks at positions (n, n_frames) with a status wherever the position is finite."""
    tracks = make_targets(x, y).rename(target="track")
    statuses = np.where(np.isfinite(tracks.x.values), status, "")
    return tracks.assign(status=(("track", "frame"), statuses))


def test_tracks_that_follow_their_targets_have_no_losses_or_swaps():
    x = np.array([[0.0, 1, 2, 3], [10, 11, 12, 13]])

    identities = track_identities(make_tracks(x + 0.2), make_targets(x), cutoff_m=1)

    assert identities.holder.values.tolist() == [[0] * 4, [1] * 4]
    assert (
        not identities.n_lost.any()
        and not identities.n_swaps.any()
        and not identities.n_false.any()
    )


def test_tracks_that_meet_and_part_are_not_swapped():
    # At the third frame each track is nearer to the other's target.
    targets = [[0.0, 2, 3.9, 6, 8], [8, 6, 4.1, 2, 0]]
    tracks = [[0.0, 2, 4.2, 6, 8], [8, 6, 3.8, 2, 0]]

    identities = track_identities(make_tracks(tracks), make_targets(targets), cutoff_m=1)

    assert identities.n_swaps.values.tolist() == [0, 0]
    assert identities.n_lost.values.tolist() == [0, 0]


def test_tracks_that_turn_back_at_crossing_targets_are_swapped():
    targets = [[0.0, 2, 4, 6, 8], [8, 6, 4, 2, 0]]
    tracks = [[0.0, 2, 4, 2, 0], [8, 6, 4, 6, 8]]

    identities = track_identities(make_tracks(tracks), make_targets(targets), cutoff_m=1)

    assert identities.n_swaps.values.tolist() == [1, 1]
    assert identities.n_lost.values.tolist() == [0, 0]


def test_lost_targets_and_false_tracks_are_counted_per_frame():
    nan = np.nan
    targets = [[0.0, 0, 0, 0, 0, 0], [50, 50, 50, nan, nan, nan]]
    tracks = [[nan, 0, 9, 0, nan, nan], [90, 90, nan, nan, nan, 0], [50, 50, 50, 50, nan, nan]]

    identities = track_identities(make_tracks(tracks), make_targets(targets), cutoff_m=1)

    assert identities.first_held.values.tolist() == [1, 0]
    assert identities.n_lost.values.tolist() == [2, 0]  # a target that left the scene is not lost
    assert identities.n_swaps.values.tolist() == [1, 0]
    assert identities.n_false.values.tolist() == [1, 1, 1, 1, 0, 0]
    tentative = track_identities(
        make_tracks(tracks, status="tentative"), make_targets(targets), cutoff_m=1
    )
    assert tentative.first_held.values.tolist() == [-1, -1]


def test_targets_without_tracks_are_never_held():
    identities = track_identities(
        make_tracks(np.zeros((0, 3))), make_targets(np.zeros((2, 3))), cutoff_m=1
    )

    assert identities.first_held.values.tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ospa_m([[0, 0]], [[0, 0]], cutoff_m=0), "cutoff_m: 0"),
        (lambda: ospa_m([[0, 0]], [[0, 0]], cutoff_m=1, order=0.5), "order: 0.5"),
        (lambda: gospa([[0, np.nan]], [[0, 0]], cutoff_m=1), "estimate_m: nan"),
        (lambda: gospa([[0, 0, 0]], [[0, 0]], cutoff_m=1), "a row for each point"),
        (lambda: gospa([[0, 0]], [[0, 0]], cutoff_m=1, alpha=3), "alpha: 3"),
        (lambda: nees([0, 0], [[1, 0]]), "n by n matrix"),
        (lambda: nees([1.0, 1], [[1, 1], [1, 1]]), "positive definite"),
        (lambda: mean_nees_interval(2, 0, outside_probability=0.05), "n_independent: 0"),
        (
            lambda: track_identities(
                make_tracks(np.zeros((1, 3))), make_targets(np.zeros((1, 4))), cutoff_m=1
            ),
            "other frames",
        ),
    ],
)
def test_rejects_invalid_arguments(call, message):
    with pytest.raises(InvalidSetting, match=message):
        call()
