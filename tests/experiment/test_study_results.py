"""Results of studies: the dataset, rows and Parquet files say what the sums say."""

from functools import reduce
from operator import getitem

import numpy as np
import pytest
import xarray as xr

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.experiments.study.results import (
    StudyResult,
    iter_trial_sums,
    write_points,
    write_trials,
)
from dechirp.experiments.study.study import SweptSetting
from dechirp.results.parquet import read_parquet, write_parquet
from dechirp.theory import confidence_intervals
from study_made import (
    DISTANCE,
    OFFSET,
    RCS,
    SCORES,
    WINDOW,
    Share,
    layout,
    points,
    result,
    study,
    sums,
)


def shares(kept):
    """Share of hits of the first target, straight from the sums."""
    return np.array([np.nansum(of[:, 0]) / np.nansum(of[:, 1]) for of in kept])


def test_a_grid_of_lists_is_a_dimension_each_in_the_order_of_the_study():
    found, kept = result(RCS, WINDOW, DISTANCE, n_trials=20)

    dataset = found.dataset

    pd = dataset["detection_probability"]
    assert pd.dims == (RCS.path, WINDOW.path, DISTANCE.path)
    assert np.array_equal(pd.values.ravel(), shares(kept))
    assert dataset[RCS.path].values.tolist() == list(RCS.numbers)
    assert dataset[RCS.path].attrs["units"] == "dBsm"
    assert dataset[WINDOW.path].values.tolist() == ["hann", "rectangular"]
    at = {RCS.path: 10.0, WINDOW.path: "rectangular", DISTANCE.path: 80.0}
    wanted = {(RCS.path, "10 dBsm"), (WINDOW.path, "rectangular"), (DISTANCE.path, "80 m")}
    (point,) = (p for p, of in enumerate(found.settings) if wanted == set(of))
    assert float(pd.sel(at)) == shares(kept)[point]
    assert dataset["range_rmse"].attrs["units"] == "m"
    assert dataset["detection_probability_low"].dims == pd.dims


def test_points_may_come_in_any_order_of_the_grid():
    found, _ = result(RCS, WINDOW, n_trials=20)
    turned, _ = result(WINDOW, RCS, n_trials=20)

    # The settings say where a point belongs, not its number.
    assert turned.dataset["trials"].dims == (WINDOW.path, RCS.path)
    both = [one.dataset["detection_probability_theory"] for one in (found, turned)]
    xr.testing.assert_allclose(both[0], both[1].transpose(*both[0].dims))


def test_drawn_settings_are_coordinates_along_draw():
    found, kept = result(OFFSET, n_draws=16, n_trials=30)

    dataset = found.dataset

    assert dataset["detection_probability"].dims == ("draw",)
    assert dataset[OFFSET.path].dims == ("draw",)
    assert dataset[OFFSET.path].attrs["units"] == "m"
    assert np.array_equal(dataset["detection_probability"], shares(kept))
    assert dataset[OFFSET.path].values.tolist() == [of[0] for of in found.numbers]


def test_draws_that_all_points_of_a_list_share_stand_along_draw_alone():
    found, kept = result(WINDOW, OFFSET, n_draws=8, n_trials=10)

    dataset = found.dataset

    assert dataset["detection_probability"].dims == (WINDOW.path, "draw")
    assert dataset[OFFSET.path].dims == ("draw",)
    assert np.array_equal(dataset["detection_probability"].values.ravel(), shares(kept))


def test_several_targets_have_a_dimension_and_the_whole_adds_their_trials():
    found, kept = result(RCS, targets=("car", "truck"))

    by_target = found.dataset["detection_probability_by_target"]

    assert by_target.dims == (RCS.path, "target")
    assert by_target["target"].values.tolist() == ["car", "truck"]
    assert np.array_equal(by_target.sel(target="car"), shares(kept))
    # As many looks at each target: the whole is the mean of both.
    whole = found.dataset["detection_probability"]
    np.testing.assert_allclose(whole, by_target.mean("target"), rtol=1e-12)
    assert "false_alarm_probability_by_target" not in found.dataset


def test_a_study_of_one_point_has_no_dimension():
    found, kept = result()

    assert found.dataset["detection_probability"].dims == ()
    assert float(found.dataset["detection_probability"]) == shares(kept)[0]
    assert found.rows[0]["trials"] == 200


def test_a_row_has_settings_and_of_each_score_its_value_interval_and_theory():
    found, kept = result(RCS, failed=[(2, 5, "ValueError: no"), (2, 9, "ValueError: no")])

    row = found.rows[2]

    assert row[RCS.path] == "0 dBsm"
    assert (row["trials"], row["failures"]) == (200, 2)
    hits = int(np.nansum(kept[2][:, 0]))
    low, high = confidence_intervals.binomial_interval(hits, 198, confidence=0.95)
    said = row["detection_probability"]
    assert (said["value"], said["low"], said["high"]) == (hits / 198, low, high)
    assert said["low"] < said["theory"] < said["high"]
    assert "targets" not in said


def test_rows_of_several_targets_tell_each():
    found, _ = result(RCS, targets=("car", "truck"))

    said = found.rows[-1]["range_rmse"]

    assert set(said["targets"]) == {"car", "truck"}
    assert said["targets"]["truck"]["value"] > said["targets"]["car"]["value"]
    assert said["theory"] == pytest.approx(
        np.mean([one["theory"] for one in said["targets"].values()])
    )


def test_a_point_whose_trials_all_failed_tells_nothing():
    found, _ = result(RCS, n_trials=3, failed=[(0, trial, "ValueError: no") for trial in range(3)])

    assert found.rows[0]["detection_probability"]["value"] is None
    assert np.isnan(found.dataset["detection_probability"].values[0])
    assert np.isfinite(found.dataset["detection_probability"].values[1:]).all()


def test_hundred_thousand_points_become_one_dataset():
    """Of sums that are alike, so that the machinery is what is tried."""
    n = 317
    axes = [
        SweptSetting(
            path=f"scene.targets.car.position.{k}",
            texts=tuple(f"{x} m" for x in range(n)),
            numbers=tuple(map(float, range(n))),
            unit="m",
        )
        for k in range(2)
    ]
    known = points(axes)
    values = np.zeros((n * n, 2, 4))
    values[:, :, 0] = np.arange(n * n)[:, None]
    found = StudyResult(
        study=study(*axes, scores=(Share(),), at_most_points=200_000),
        layout=layout(scores=(Share(),)),
        settings=tuple(at for at, _ in known),
        numbers=tuple(numbers for _, numbers in known),
        trials=np.full(n * n, 10),
        estimates={"detection_probability": values},
    )

    at = {axes[0].path: 300.0, axes[1].path: 7.0}
    assert float(found.dataset["detection_probability"].sel(at)) == 300 * n + 7


def test_points_read_back_from_parquet_equal_the_rows(tmp_path):
    found, _ = result(RCS, WINDOW, targets=("car", "truck"), failed=[(3, 1, "ValueError: no")])

    write_points(found, tmp_path / "points.parquet", metadata={"seed": "7"})

    table = read_parquet(tmp_path / "points.parquet")
    rows = found.rows
    assert table["point"].tolist() == list(range(14))
    assert table[f"{RCS.path}_dBsm"].tolist() == [of[0] for of in found.numbers]
    assert table[WINDOW.path].tolist() == [row[WINDOW.path] for row in rows]
    assert table["failures"].tolist() == [row["failures"] for row in rows]
    # Columns are the keys of rows, joined by dots.
    for column in (
        "range_rmse.value",
        "range_rmse.targets.truck.high",
        "false_alarm_probability.theory",
    ):
        assert table[column].tolist() == [reduce(getitem, column.split("."), row) for row in rows]


def test_estimates_can_be_made_again_from_the_trials_in_parquet(tmp_path):
    found, kept = result(RCS, targets=("car", "truck"), failed=[(3, 1, "ValueError: no")])
    made = layout(targets=("car", "truck"))

    given = ((point, np.arange(len(of)), of) for point, of in enumerate(kept))
    write_trials(made, given, tmp_path / "trials.parquet", metadata={})

    table = read_parquet(tmp_path / "trials.parquet")
    assert table["failed"].sum() == 1
    assert table["trial"][table["failed"]].tolist() == [1]
    for point in range(found.n_points):
        own = (table["point"] == point) & ~table["failed"]
        hits, looks = (table[f"detection_probability.truck.{k}"][own].sum() for k in (0, 1))
        assert (
            hits / looks == found.rows[point]["detection_probability"]["targets"]["truck"]["value"]
        )
    assert table["false_alarm_probability.1"][0] == 1000
    # Bit by bit, those that failed as NaN.
    columns = [table[name] for name in list(table)[3:]]
    np.testing.assert_array_equal(np.stack(columns, axis=1), np.concatenate(kept))


def test_trials_between_which_some_are_missing_keep_their_numbers():
    class Record:
        """Blocks of ten trials: of point 0 the second is not there yet."""

        def finished_blocks(self):
            return np.array([[0, 0], [0, 2], [3, 0]])

        def iter_point_sums(self):
            yield 0, np.zeros((20, 2))
            yield 3, np.ones((10, 2))

        def trial_numbers(self, point):
            assert point == 0
            return np.r_[0:10, 20:30]

    found = [(point, trials.tolist()) for point, trials, _ in iter_trial_sums(Record())]

    assert found == [(0, [*range(10), *range(20, 30)]), (3, list(range(10)))]


def test_a_table_that_cannot_be_finished_leaves_the_old_one(tmp_path):
    path = tmp_path / "points.parquet"
    write_parquet(path, {"a": "DOUBLE"}, [{"a": np.array([1.0])}])

    def breaks():
        yield {"a": np.array([2.0])}
        raise OSError(28, "No space left on device")

    with pytest.raises(DechirpError, match="No space left"):
        write_parquet(path, {"a": "DOUBLE"}, breaks())

    assert read_parquet(path)["a"].tolist() == [1.0]
    assert [file.name for file in tmp_path.iterdir()] == ["points.parquet"]


@pytest.mark.parametrize("name", ["folder", "absent/points.parquet"])
def test_a_table_that_has_no_place_is_refused(tmp_path, name):
    (tmp_path / "folder").mkdir()

    with pytest.raises(DechirpError, match="not writable"):
        write_parquet(tmp_path / name, {"a": "DOUBLE"}, [{"a": np.array([1.0])}])


def test_what_is_no_parquet_is_named(tmp_path):
    (tmp_path / "points.parquet").write_text("point,pd\n")

    with pytest.raises(RecordingError, match="need|Parquet"):
        read_parquet(tmp_path / "points.parquet")


def test_a_table_keeps_names_numbers_and_words_as_they_are(tmp_path):
    columns = {"car": "DOUBLE", "Car": "DOUBLE", 'a "b" c': "VARCHAR", "yes": "BOOLEAN"}
    rows = {
        "car": np.array([np.nan, 1e-300]),
        "Car": np.array([np.inf, -0.0]),
        'a "b" c': np.array(["it's", None], dtype=object),
        "yes": np.array([True, False]),
    }

    write_parquet(tmp_path / "[x]*.parquet", columns, [rows], metadata={"it's": "a 'word'"})

    table = read_parquet(tmp_path / "[x]*.parquet")
    assert list(table) == ["car", "Car_2", 'a "b" c', "yes"]
    np.testing.assert_array_equal(table["car"], rows["car"])
    np.testing.assert_array_equal(table["Car_2"], rows["Car"])
    assert table['a "b" c'].tolist() == ["it's", None]
    assert table["yes"].tolist() == [True, False]


def test_sums_of_one_score_do_not_touch_another():
    rng = np.random.default_rng(0)
    of = sums(rng, 0.5, 0.1, 50, n_targets=2)
    made = layout(targets=("car", "truck"))

    assert made.n_columns == of.shape[1] == 2 * 2 + 2 * 1 + 2
    assert np.array_equal(made.score_sums(of, "range_rmse", "truck")[:, 0], of[:, 5])
    assert len(SCORES) == len(made.scores)
