"""Assembly of a data set after all trials: its shards, and columns from the ledger."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.experiments.study.data_set import (
    CUBE_AXES,
    MAP_AXES,
    DataSetWriter,
    check_shard_files_exist,
    trial_ranges_of_saved_blocks,
)
from dechirp.experiments.study.data_set_items import (
    DETECTION_COLUMNS,
    TRUTH_COLUMNS,
    ItemShapes,
    arrays_from_compressed_bytes,
    class_name_per_target,
)
from dechirp.experiments.study.dumping import dump_study_as_yaml
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.plan import Plan
from dechirp.results import data_set as store
from dechirp.results.data_set import TrialColumn

COORDINATES: Mapping[str, tuple[tuple[str, ...], str, str]] = {
    "frame_time": (("frame",), "s", "middle of the frame, to which the truth refers"),
    "chirp_time": (("frame", "chirp"), "s", "start of the chirp, since the start of its frame"),
    "sample_time": (("sample",), "s", "time of the sample, since the start of the ramp"),
    "velocity_bins": (("frame", "velocity"), "m/s", "velocity of each row of a map"),
    "range_bins": (("range",), "m", "range of each column of a map"),
}
"""Dimensions, units and descriptions of the coordinates of items, of each point."""


def assemble_data_set(plan: Plan, ledger: LedgerReader, out: Path) -> Path:
    """Assemble the data set of all trials of a ledger unless it exists, and return its folder.

    Raises
    ------
    DechirpError
        If files of it are missing, or it cannot be written.
    """
    writer = DataSetWriter.from_plan(plan, out)
    if store.is_data_set_complete(writer.folder):
        return writer.folder
    blocks = trial_ranges_of_saved_blocks(plan, ledger)
    check_shard_files_exist(writer, blocks)

    def fill(new_store: store.Store) -> None:
        _write_truth_and_detection_columns(new_store, plan, writer.shapes, ledger)

    store.finalise_data_set(
        writer.folder,
        writer.arrays,
        blocks,
        tables=_metadata_datasets_by_group(plan, writer.shapes, ledger),
        add_columns=fill,
    )
    return writer.folder


def _metadata_datasets_by_group(
    plan: Plan, shapes: ItemShapes, ledger: LedgerReader
) -> dict[str, xr.Dataset]:
    """Return the tables beside the items: coordinates, scenario, settings, targets."""
    study, n = plan.study, plan.n_points
    scenarios, axes = [""] * n, {name: np.empty(0) for name in COORDINATES}
    for point, _, content in ledger.iter_packed_items(block_number=0):
        arrays = arrays_from_compressed_bytes(content)
        if "about/scenario" not in arrays:
            continue
        scenarios[point] = arrays["about/scenario"].tobytes().decode()
        for name in COORDINATES:
            values = arrays[f"about/{name}"]
            if not axes[name].size:
                axes[name] = np.full((n, *values.shape), np.nan)
            axes[name][point] = values
    coordinates = {
        name: xr.Variable(("point", *dims), axes[name], {"units": units, "long_name": words})
        for name, (dims, units, words) in COORDINATES.items()
        if axes[name].size and set(dims) <= _item_dimension_names(shapes)
    }
    attributes = {
        store.MARK: store.FORMAT_VERSION,
        "dechirp": str(import_module("dechirp").__version__),
        "name": study.name,
        "seed": study.seed,
        "keep": list(study.keep),
        "study": dump_study_as_yaml(study),
    }
    scenario = xr.Variable("point", scenarios, {"long_name": "scenario of the point, YAML"})
    scene = study.scenario.scene
    assert scene is not None
    targets = {"target": list(shapes.targets), "class": ("target", class_name_per_target(scene))}
    return {
        "": xr.Dataset({**coordinates, "scenario": scenario}, attrs=attributes),
        "settings": xr.Dataset(dict(_iter_varied_setting_variables(plan))),
        "truth": xr.Dataset(coords=targets),
    }


def _item_dimension_names(shapes: ItemShapes) -> set[str]:
    cube = set(CUBE_AXES[1:]) if shapes.cube else set()
    return {"frame", *cube, *(MAP_AXES if shapes.power else ())}


def _iter_varied_setting_variables(plan: Plan) -> Iterator[tuple[str, xr.Variable]]:
    """Yield the varied settings: over the points, or over the trials where drawn in each."""
    units = {axis.path: axis.unit for axis in plan.study.vary}
    paths = [path for path, _ in plan.setting_texts_of_point(0)]
    labels = [plan.setting_labels_of_point(point) for point in range(plan.n_points)]
    numbers = [plan.numeric_settings_of_point(point) for point in range(plan.n_points)]
    for column, path in enumerate(paths):
        column_numbers = [row[column] for row in numbers]
        values = (
            [row[column][1] for row in labels]
            if None in column_numbers
            else np.array(column_numbers, dtype=float)
        )
        yield (
            _setting_path_as_array_name(path),
            xr.Variable("point", values, {"units": units[path], "path": path}),
        )
    if plan.has_settings_drawn_per_trial:
        draws = np.array(
            [
                plan.drawn_setting_numbers_of_trial(trial)
                for trial in range(plan.study.trials.at_most)
            ]
        )
        for column, axis in enumerate(plan.random_settings):
            attributes = {"units": axis.unit, "path": axis.path}
            yield (
                _setting_path_as_array_name(axis.path),
                xr.Variable("trial", draws[:, column], attributes),
            )


def _setting_path_as_array_name(setting_path: str) -> str:
    """Convert a path to the name of an array, which must not contain folders."""
    return setting_path.replace("/", "-")


def _write_truth_and_detection_columns(
    new_store: store.Store, plan: Plan, shapes: ItemShapes, ledger: LedgerReader
) -> None:
    """Write the small arrays of all items from the ledger, in order."""
    has_rows = "detections" in plan.study.keep
    truth_dims, shape = ("frame", "target"), (shapes.n_frames, len(shapes.targets))
    columns = [TrialColumn("made", "bool", attributes={"long_name": "whether there is this item"})]
    if shapes.cube:
        attributes = {"units": "W**0.5", "long_name": "size of a step of the samples"}
        columns.append(
            TrialColumn("cube_scale", "float64", fill_value=np.nan, attributes=attributes)
        )
    for name, (units, words) in TRUTH_COLUMNS.items():
        attributes = {"units": units, "long_name": words}
        columns.append(
            TrialColumn(f"truth/{name}", "float64", truth_dims, shape, np.nan, attributes)
        )
    if has_rows:
        for name, words in (("start", "first row of the item"), ("stop", "the row after its last")):
            attributes = {"long_name": words}
            columns.append(TrialColumn(f"detections/{name}", "int64", attributes=attributes))
    table = store.TrialColumns(new_store, columns, plan.n_points, plan.study.trials.at_most)
    rows = (
        store.DetectionRows(new_store, "detections", _detection_column_definitions())
        if has_rows
        else None
    )
    for point, number, content in ledger.iter_packed_items():
        arrays = arrays_from_compressed_bytes(content)
        values = {"made": arrays["made"]}
        if shapes.cube:
            values["cube_scale"] = arrays["cube_scale"]
        values |= {
            f"truth/{name}": truth
            for name, truth in zip(TRUTH_COLUMNS, arrays["truth"], strict=True)
        }
        if rows is not None:
            stops = rows.n_rows + np.cumsum(arrays["count"])
            values["detections/start"] = stops - arrays["count"]
            values["detections/stop"] = stops
            if "rows/range" in arrays:
                rows.append_rows({name: arrays[f"rows/{name}"] for name in DETECTION_COLUMNS})
        table.buffer_trial_values(point, number * plan.study.trials.block, values)
    table.flush()
    if rows is not None:
        rows.flush()


def _detection_column_definitions() -> dict[str, TrialColumn]:
    kinds = {"frame": "int64", "target": "int64"}
    return {
        name: TrialColumn(
            name,
            kinds.get(name, "float64"),
            attributes={"units": units, "long_name": words},
        )
        for name, (units, words) in DETECTION_COLUMNS.items()
    }
