"""Results of studies: dataset, rows and Parquet files against the sums of trials."""

import csv
from functools import reduce
from operator import getitem

import numpy as np
import pytest
import xarray as xr

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.experiments.study.results import (
    StudyResult,
    iter_trial_numbers_and_sums,
    write_points_table,
    write_trials_table,
)
from dechirp.experiments.study.study import SweptSetting
from dechirp.results.parquet import read_parquet, write_parquet
from dechirp.results.table_files import write_table
from dechirp.theory import confidence_intervals
from sample_studies import (
    DISTANCE,
    OFFSET,
    RCS,
    SCORES,
    WINDOW,
    HitProbability,
    make_layout,
    make_points,
    make_result,
    make_study,
    random_sums,
)


def compute_proportions(point_sums):
    """Compute the proportion of hits of the first target from the sums."""
    return np.array([np.nansum(sums[:, 0]) / np.nansum(sums[:, 1]) for sums in point_sums])


def test_grid_of_lists_has_one_dimension_per_list_in_study_order():
    study_result, point_sums = make_result(RCS, WINDOW, DISTANCE, n_trials=20)

    dataset = study_result.dataset

    pd = dataset["detection_probability"]
    assert pd.dims == (RCS.path, WINDOW.path, DISTANCE.path)
    assert np.array_equal(pd.values.ravel(), compute_proportions(point_sums))
    assert dataset[RCS.path].values.tolist() == list(RCS.numbers)
    assert dataset[RCS.path].attrs["units"] == "dBsm"
    assert dataset[WINDOW.path].values.tolist() == ["hann", "rectangular"]
    selection = {RCS.path: 10.0, WINDOW.path: "rectangular", DISTANCE.path: 80.0}
    expected_settings = {
        (RCS.path, "10 dBsm"),
        (WINDOW.path, "rectangular"),
        (DISTANCE.path, "80 m"),
    }
    (point,) = (
        p for p, settings in enumerate(study_result.settings) if expected_settings == set(settings)
    )
    assert float(pd.sel(selection)) == compute_proportions(point_sums)[point]
    assert dataset["range_rmse"].attrs["units"] == "m"
    assert dataset["detection_probability_low"].dims == pd.dims


def test_dataset_places_points_by_settings_and_not_by_number():
    study_result, _ = make_result(RCS, WINDOW, n_trials=20)
    transposed_result, _ = make_result(WINDOW, RCS, n_trials=20)

    # Settings define the position of a point, not its number.
    assert transposed_result.dataset["trials"].dims == (WINDOW.path, RCS.path)
    theories = [
        grid_result.dataset["detection_probability_theory"]
        for grid_result in (study_result, transposed_result)
    ]
    xr.testing.assert_allclose(theories[0], theories[1].transpose(*theories[0].dims))


def test_random_settings_are_coordinates_along_draw():
    study_result, point_sums = make_result(OFFSET, n_draws=16, n_trials=30)

    dataset = study_result.dataset

    assert dataset["detection_probability"].dims == ("draw",)
    assert dataset[OFFSET.path].dims == ("draw",)
    assert dataset[OFFSET.path].attrs["units"] == "m"
    assert np.array_equal(dataset["detection_probability"], compute_proportions(point_sums))
    assert dataset[OFFSET.path].values.tolist() == [numbers[0] for numbers in study_result.numbers]


def test_draws_shared_by_all_points_have_dimension_draw_alone():
    study_result, point_sums = make_result(WINDOW, OFFSET, n_draws=8, n_trials=10)

    dataset = study_result.dataset

    assert dataset["detection_probability"].dims == (WINDOW.path, "draw")
    assert dataset[OFFSET.path].dims == ("draw",)
    assert np.array_equal(
        dataset["detection_probability"].values.ravel(), compute_proportions(point_sums)
    )


def test_targets_have_a_dimension_and_total_adds_their_trials():
    study_result, point_sums = make_result(RCS, targets=("car", "truck"))

    by_target = study_result.dataset["detection_probability_by_target"]

    assert by_target.dims == (RCS.path, "target")
    assert by_target["target"].values.tolist() == ["car", "truck"]
    assert np.array_equal(by_target.sel(target="car"), compute_proportions(point_sums))
    # Both targets have the same number of attempts, so the total is their mean.
    total = study_result.dataset["detection_probability"]
    np.testing.assert_allclose(total, by_target.mean("target"), rtol=1e-12)
    assert "false_alarm_probability_by_target" not in study_result.dataset


def test_study_of_one_point_has_no_dimension():
    study_result, point_sums = make_result()

    assert study_result.dataset["detection_probability"].dims == ()
    assert (
        float(study_result.dataset["detection_probability"]) == compute_proportions(point_sums)[0]
    )
    assert study_result.points_as_dicts[0]["trials"] == 200


def test_row_contains_settings_values_intervals_and_theory():
    study_result, point_sums = make_result(
        RCS, failed=[(2, 5, "ValueError: no"), (2, 9, "ValueError: no")]
    )

    row = study_result.points_as_dicts[2]

    assert row[RCS.path] == "0 dBsm"
    assert (row["trials"], row["failures"]) == (200, 2)
    hits = int(np.nansum(point_sums[2][:, 0]))
    low, high = confidence_intervals.binomial_interval(hits, 198, confidence=0.95)
    score = row["detection_probability"]
    assert (score["value"], score["low"], score["high"]) == (hits / 198, low, high)
    assert score["low"] < score["theory"] < score["high"]
    assert "targets" not in score


def test_rows_of_several_targets_contain_each_target():
    study_result, _ = make_result(RCS, targets=("car", "truck"))

    score = study_result.points_as_dicts[-1]["range_rmse"]

    assert set(score["targets"]) == {"car", "truck"}
    assert score["targets"]["truck"]["value"] > score["targets"]["car"]["value"]
    assert score["theory"] == pytest.approx(
        np.mean([target["theory"] for target in score["targets"].values()])
    )


def test_point_whose_trials_all_failed_has_no_value():
    study_result, _ = make_result(
        RCS, n_trials=3, failed=[(0, trial, "ValueError: no") for trial in range(3)]
    )

    assert study_result.points_as_dicts[0]["detection_probability"]["value"] is None
    assert np.isnan(study_result.dataset["detection_probability"].values[0])
    assert np.isfinite(study_result.dataset["detection_probability"].values[1:]).all()


def test_hundred_thousand_points_become_one_dataset():
    """Identical sums, so that only the conversion is tested."""
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
    grid_points = make_points(axes)
    values = np.zeros((n * n, 2, 4))
    values[:, :, 0] = np.arange(n * n)[:, None]
    study_result = StudyResult(
        study=make_study(*axes, scores=(HitProbability(),), at_most_points=200_000),
        layout=make_layout(scores=(HitProbability(),)),
        settings=tuple(settings for settings, _ in grid_points),
        numbers=tuple(numbers for _, numbers in grid_points),
        trials=np.full(n * n, 10),
        estimates={"detection_probability": values},
    )

    settings = {axes[0].path: 300.0, axes[1].path: 7.0}
    assert float(study_result.dataset["detection_probability"].sel(settings)) == 300 * n + 7


def test_points_in_parquet_equal_rows(tmp_path):
    study_result, _ = make_result(
        RCS, WINDOW, targets=("car", "truck"), failed=[(3, 1, "ValueError: no")]
    )

    write_points_table(study_result, tmp_path / "points.parquet", metadata={"seed": "7"})

    table = read_parquet(tmp_path / "points.parquet")
    rows = study_result.points_as_dicts
    assert table["point"].tolist() == list(range(14))
    assert table[f"{RCS.path}_dBsm"].tolist() == [numbers[0] for numbers in study_result.numbers]
    assert table[WINDOW.path].tolist() == [row[WINDOW.path] for row in rows]
    assert table["failures"].tolist() == [row["failures"] for row in rows]
    # Column names are keys of rows joined by dots.
    for column in (
        "range_rmse.value",
        "range_rmse.targets.truck.high",
        "false_alarm_probability.theory",
    ):
        assert table[column].tolist() == [reduce(getitem, column.split("."), row) for row in rows]


def test_trials_in_parquet_reproduce_estimates(tmp_path):
    study_result, point_sums = make_result(
        RCS, targets=("car", "truck"), failed=[(3, 1, "ValueError: no")]
    )
    score_layout = make_layout(targets=("car", "truck"))

    trial_rows = ((point, np.arange(len(sums)), sums) for point, sums in enumerate(point_sums))
    write_trials_table(score_layout, trial_rows, tmp_path / "trials.parquet", metadata={})

    table = read_parquet(tmp_path / "trials.parquet")
    assert table["failed"].sum() == 1
    assert table["trial"][table["failed"]].tolist() == [1]
    for point in range(study_result.n_points):
        rows = (table["point"] == point) & ~table["failed"]
        hits, attempts = (table[f"detection_probability.truck.{k}"][rows].sum() for k in (0, 1))
        by_target = study_result.points_as_dicts[point]["detection_probability"]["targets"]
        assert hits / attempts == by_target["truck"]["value"]
    assert table["false_alarm_probability.1"][0] == 1000
    # Failed trials are NaN, all others identical to the bit.
    columns = [table[name] for name in list(table)[3:]]
    np.testing.assert_array_equal(np.stack(columns, axis=1), np.concatenate(point_sums))


def test_trial_numbers_skip_missing_blocks():
    class Record:
        """Ledger with blocks of ten trials; the second block of point 0 is missing."""

        def saved_point_and_block_numbers(self):
            return np.array([[0, 0], [0, 2], [3, 0]])

        def iter_trial_sums_by_point(self):
            yield 0, np.zeros((20, 2))
            yield 3, np.ones((10, 2))

        def trial_numbers_of_point(self, point):
            assert point == 0
            return np.r_[0:10, 20:30]

    point_trials = [
        (point, trials.tolist()) for point, trials, _ in iter_trial_numbers_and_sums(Record())
    ]

    assert point_trials == [(0, [*range(10), *range(20, 30)]), (3, list(range(10)))]


def test_table_that_cannot_be_finished_leaves_old_one(tmp_path):
    path = tmp_path / "points.parquet"
    write_parquet(path, {"a": "DOUBLE"}, [{"a": np.array([1.0])}])

    def iter_failing_columns():
        yield {"a": np.array([2.0])}
        raise OSError(28, "No space left on device")

    with pytest.raises(DechirpError, match="No space left"):
        write_parquet(path, {"a": "DOUBLE"}, iter_failing_columns())

    assert read_parquet(path)["a"].tolist() == [1.0]
    assert [file.name for file in tmp_path.iterdir()] == ["points.parquet"]


@pytest.mark.parametrize("name", ["folder", "absent/points.parquet"])
def test_rejects_table_path_that_cannot_be_written(tmp_path, name):
    (tmp_path / "folder").mkdir()

    with pytest.raises(DechirpError, match="not writable"):
        write_parquet(tmp_path / name, {"a": "DOUBLE"}, [{"a": np.array([1.0])}])


def test_rejects_file_that_is_not_parquet(tmp_path):
    (tmp_path / "points.parquet").write_text("point,pd\n")

    with pytest.raises(RecordingError, match="need|Parquet"):
        read_parquet(tmp_path / "points.parquet")


def test_parquet_preserves_names_numbers_and_text(tmp_path):
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


def test_csv_and_parquet_tables_are_equal(tmp_path):
    columns = {"car": "DOUBLE", "Car": "DOUBLE", "a,b": "VARCHAR", "yes": "BOOLEAN", "n": "BIGINT"}
    rng = np.random.default_rng(5)
    pieces = [
        {
            "car": rng.standard_normal(50) * 10.0 ** rng.integers(-300, 300, 50),
            "Car": np.where(rng.random(50) < 0.5, np.nan, -np.inf),
            "a,b": np.array(['it\'s "so"', None] * 25, dtype=object),
            "yes": rng.random(50) < 0.5,
            "n": rng.integers(-(2**62), 2**62, 50),
        }
        for _ in range(2)
    ]
    for suffix in (".csv", ".parquet"):
        write_table(tmp_path / f"table{suffix}", columns, iter(pieces))
        write_table(tmp_path / f"empty{suffix}", columns, [])

    parquet = read_parquet(tmp_path / "table.parquet")
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == list(parquet) == ["car", "Car_2", "a,b", "yes", "n"]
    table = dict(zip(header, zip(*rows, strict=True), strict=True))
    for name in ("car", "Car_2"):
        numbers = [float(text or "nan") for text in table[name]]
        np.testing.assert_array_equal(numbers, parquet[name])
    assert table["a,b"] == tuple(text or "" for text in parquet["a,b"])
    assert table["yes"] == tuple(map(str, parquet["yes"]))
    assert table["n"] == tuple(map(str, parquet["n"]))
    assert (tmp_path / "empty.csv").read_text().rstrip("\n") == 'car,Car_2,"a,b",yes,n'


def test_sums_of_scores_are_separate():
    rng = np.random.default_rng(0)
    trial_sums = random_sums(rng, 0.5, 0.1, 50, n_targets=2)
    score_layout = make_layout(targets=("car", "truck"))

    assert score_layout.n_columns == trial_sums.shape[1] == 2 * 2 + 2 * 1 + 2
    assert np.array_equal(
        score_layout.select_score_sums(trial_sums, "range_rmse", "truck")[:, 0], trial_sums[:, 5]
    )
    assert len(SCORES) == len(score_layout.scores)
