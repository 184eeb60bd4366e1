"""Data set of a study: checks before it is created, and the items that workers write.

Samples and maps are in shards, which the workers write before they return their block. Small
arrays go with the block into the ledger, and become columns at the end, see `data_set_assembly`.
"""

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.config.dumping import dump_yaml
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.experiments.study.data_set_items import (
    DETECTION_COLUMNS,
    STEP_DB,
    TRUTH_COLUMNS,
    Item,
    ItemShapes,
    arrays_to_compressed_bytes,
    item_axis_coordinates,
    kept_item_shapes,
    make_item_of_trial,
    truth_per_frame_and_target,
)
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.results import data_set as store
from dechirp.results.shards import ShardedArray

DATA_SET_NAME = "data.zarr"
CUBE_AXES = ("frame", "chirp", "rx", "sample", "iq")
MAP_AXES = ("frame", "velocity", "range")
_MAX_COMPARED_VALUES = 1000  # of one setting, to compare in shape


@dataclass(frozen=True)
class DataSetWriter:
    """Layout and folder of a data set, with which a worker writes the items of a block."""

    folder: Path
    """Folder of the data set; all workers write to it."""
    keep: tuple[str, ...]
    shapes: ItemShapes
    arrays: tuple[ShardedArray, ...]

    @classmethod
    def from_plan(cls, plan: Plan, out: Path) -> "DataSetWriter":
        """Create the writer of a study with results in a folder."""
        form = kept_item_shapes(_trial_context(plan, 0, 0), plan.study.keep)
        folder = out.absolute() / DATA_SET_NAME
        return cls(folder, plan.study.keep, form, tuple(_define_cube_and_map_arrays(plan, form)))

    def create_block_writer(self, point: int, first_trial: int) -> "BlockWriter":
        """Begin to write the trials `first_trial`, `first + 1`, ... of a point."""
        return BlockWriter(self, point, first_trial)


class BlockWriter:
    """Writer of the items of one block in order; it holds one shard at a time."""

    def __init__(self, writer: DataSetWriter, point: int, first: int) -> None:
        self._writer, self._point = writer, point
        self._firsts = {array.name: first for array in writer.arrays}
        self._waiting: dict[str, list[np.ndarray]] = {array.name: [] for array in writer.arrays}
        self._items: list[tuple[Item, Mapping[str, np.ndarray]] | None] = []
        self._labels: tuple[TrialContext, Mapping[str, np.ndarray]] | None = None

    def make_item_and_truth(
        self, context: TrialContext, cube: xr.DataArray | None, result: TrialResult
    ) -> tuple[Item, Mapping[str, np.ndarray]]:
        """Return the item of a trial and the truth of its targets; raise if its shapes differ."""
        item = make_item_of_trial(self._writer.shapes, self._writer.keep, cube, result)
        if self._labels is None or self._labels[0] is not context:
            self._labels = (context, truth_per_frame_and_target(context))
        return item, self._labels[1]

    def append_item_or_zeros(
        self, item_and_truth: tuple[Item, Mapping[str, np.ndarray]] | None
    ) -> None:
        """Add the next item; None, for a failed trial, adds zeros.

        Raises
        ------
        DechirpError
            If a shard cannot be written.
        """
        item = None if item_and_truth is None else item_and_truth[0]
        for array in self._writer.arrays:
            numbers = None if item is None else getattr(item, array.name)
            waiting = self._waiting[array.name]
            waiting.append(np.zeros(array.shape, np.int16) if numbers is None else numbers)
            if len(waiting) == array.trials_per_shard:
                self._write_buffered_shard(array)
        small = (
            None
            if item_and_truth is None
            else (item_and_truth[0]._replace(cube=None, power=None), item_and_truth[1])
        )
        self._items.append(small)

    def write_last_shard_and_pack_arrays(self, point_metadata: Mapping[str, np.ndarray]) -> bytes:
        """Write the last shard, and return the small arrays as compressed bytes.

        Raises as `append_item_or_zeros`.
        """
        for array in self._writer.arrays:
            if self._waiting[array.name]:
                self._write_buffered_shard(array)
        form, n = self._writer.shapes, len(self._items)
        valid_items = [item for item in self._items if item is not None]
        valid_indices = np.flatnonzero([item is not None for item in self._items])
        counts, scales = np.zeros(n, np.int64), np.full(n, np.nan)
        truth = np.full((len(TRUTH_COLUMNS), n, form.n_frames, len(form.targets)), np.nan)
        for index, (item, labels) in zip(valid_indices, valid_items, strict=True):
            counts[index], scales[index] = len(item.detections.get("range", ())), item.scale
            truth[:, index] = [labels[name] for name in TRUTH_COLUMNS]
        arrays = {
            "made": np.isin(np.arange(n), valid_indices),
            "cube_scale": scales,
            "truth": truth,
            "count": counts,
            **{f"about/{name}": values for name, values in point_metadata.items()},
        }
        for name in DETECTION_COLUMNS if valid_items and valid_items[0][0].detections else ():
            rows = [item.detections[name] for item, _ in valid_items]
            arrays[f"rows/{name}"] = np.concatenate(rows)
        return arrays_to_compressed_bytes(arrays)

    def _write_buffered_shard(self, array: ShardedArray) -> None:
        items = np.stack(self._waiting[array.name])
        array.write_shard(self._writer.folder, self._point, self._firsts[array.name], items)
        self._firsts[array.name] += len(items)
        self._waiting[array.name] = []


def point_scenario_and_coordinates(plan: Plan, point: int) -> dict[str, np.ndarray]:
    """Return scenario and coordinates of a point, stored with its first block; empty if invalid."""
    try:
        text = dump_yaml(plan.scenario_of_point(point)).encode()
        axes = item_axis_coordinates(_trial_context(plan, point, 0))
    except DechirpError:  # an invalid point: its trials report it
        return {}
    return {"scenario": np.frombuffer(text, np.uint8), **axes}


def check_item_shapes_and_total_size(plan: Plan) -> None:
    """Raise `InvalidSetting` if items differ in shape, or a data set exceeds its size limit.

    The limit is `Study.at_most_bytes`.
    """
    study = plan.study
    _check_varied_settings_keep_item_shapes(
        plan, kept_item_shapes(_trial_context(plan, 0, 0), study.keep)
    )
    needed = uncompressed_data_set_bytes(plan)
    if needed > study.at_most_bytes:
        raise InvalidSetting(
            "keep",
            value=f"{format_bytes(needed)} in {plan.n_points * study.trials.at_most} items",
            expected=f"at most {format_bytes(study.at_most_bytes)} before compression",
            fix=f"take fewer trials, or confirm it: at_most_bytes: {needed}",
        )


def uncompressed_data_set_bytes(plan: Plan) -> int:
    """Return the size of samples and maps of all trials of a study, before compression."""
    form = kept_item_shapes(_trial_context(plan, 0, 0), plan.study.keep)
    return plan.n_points * plan.study.trials.at_most * form.uncompressed_item_bytes


def format_bytes(n_bytes: float) -> str:
    """Format a size as 1.2 GB, 340 MB or 2 kB."""
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if n_bytes >= size:
            return f"{n_bytes / size:.3g} {unit}"
    return f"{n_bytes:.0f} B"


def check_saved_files_and_disk_space(plan: Plan, ledger: LedgerReader, out: Path) -> None:
    """Raise `DechirpError` if saved blocks do not match the data set, or the disk lacks space.

    Files of saved blocks may be missing, or the data set may belong to another study.
    """
    writer = DataSetWriter.from_plan(plan, out)
    blocks = trial_ranges_of_saved_blocks(plan, ledger)
    if store.is_data_set_complete(writer.folder) and not len(blocks):
        raise DechirpError(
            Mistake(
                setting="--out",
                value=f"{writer.folder}, the data set of a study whose ledger is missing",
                expected="a folder without a data set, or with its ledger",
                fix="name another folder with --out, or remove the data set",
            )
        )
    check_shard_files_exist(writer, blocks)
    if not store.is_data_set_complete(writer.folder):
        n_missing = plan.n_points * plan.study.trials.at_most - int(blocks[:, 2].sum())
        check_disk_space(n_missing * writer.shapes.uncompressed_item_bytes, out)


def check_disk_space(needed_bytes: int, out: Path) -> None:
    """Raise `DechirpError` if the disk of a folder, which need not exist yet, lacks space."""
    existing_folder = next(folder for folder in (out, *out.absolute().parents) if folder.is_dir())
    free = shutil.disk_usage(existing_folder).free
    if needed_bytes > free:
        raise DechirpError(
            Mistake(
                setting="--out",
                value=f"on a disk with {format_bytes(free)} of free space",
                expected=f"at least {format_bytes(needed_bytes)} for the remaining items",
                fix="name a folder on another disk, or take fewer trials",
            )
        )


def _trial_context(plan: Plan, point: int, trial: int) -> TrialContext:
    return build_trial_context(
        plan.scenario_of_point(point, plan.drawn_setting_texts_of_trial(trial))
    )


def _define_cube_and_map_arrays(plan: Plan, shapes: ItemShapes) -> Iterator[ShardedArray]:
    trials = plan.study.trials
    size = (plan.n_points, trials.at_most, trials.block)
    if shapes.cube:
        cube_attributes = {
            "units": "W**0.5",
            "long_name": "samples; times cube_scale of the item, in single precision",
            "convention": "beat = Tx x conj(Rx), receding positive",
        }
        yield ShardedArray(
            "cube", CUBE_AXES[: len(shapes.cube)], shapes.cube, *size, cube_attributes
        )
    if shapes.power:
        power_attributes = {
            "units": "dBW",
            "scale_factor": STEP_DB,
            "long_name": "power, 10 log10 of 1 W",
        }
        yield ShardedArray("power", MAP_AXES, shapes.power, *size, power_attributes)


def trial_ranges_of_saved_blocks(plan: Plan, ledger: LedgerReader) -> np.ndarray:
    """Return point, first trial and number of trials of each saved block, (n_blocks, 3)."""
    trials = plan.study.trials
    points, numbers = ledger.saved_point_and_block_numbers().T
    firsts = numbers * trials.block
    return np.stack([points, firsts, np.minimum(trials.block, trials.at_most - firsts)], axis=1)


def check_shard_files_exist(writer: DataSetWriter, saved_trial_ranges: np.ndarray) -> None:
    """Raise `DechirpError` if files of saved blocks are missing."""
    gone = store.missing_shard_files(writer.folder, writer.arrays, saved_trial_ranges)
    if gone:
        raise DechirpError(
            Mistake(
                setting="--out",
                value=f"{writer.folder} without {gone[0]}"
                + (f" and {len(gone) - 1} more files" if gone[1:] else ""),
                expected="a folder with every file of the saved trials",
                fix="bring them back, or name another folder with --out to begin anew",
            )
        )


def _check_varied_settings_keep_item_shapes(plan: Plan, expected_shapes: ItemShapes) -> None:
    """Raise unless each value of each setting, the others at their first, keeps the shapes."""
    for axis_index, axis in enumerate(plan.swept_settings):
        for place in range(1, min(len(axis.texts), _MAX_COMPARED_VALUES)):
            index = np.zeros(len(plan.grid_shape), dtype=int)
            index[axis_index] = place
            point = int(np.ravel_multi_index(tuple(index), plan.grid_shape))
            try:
                shapes = kept_item_shapes(_trial_context(plan, point, 0), plan.study.keep)
            except DechirpError:  # an invalid point: its trials report it
                continue
            if shapes != expected_shapes:
                raise InvalidSetting(
                    f"vary.{axis.path}",
                    value=f"{axis.labels[place]}, with {_item_shapes_as_text(shapes)}",
                    expected="the same shapes as at the first point:"
                    f" {_item_shapes_as_text(expected_shapes)}",
                    fix="make a data set of each shape, or keep none of it",
                )
    if plan.has_settings_drawn_per_trial:
        first, second = (item_axis_coordinates(_trial_context(plan, 0, trial)) for trial in (0, 1))
        changed = [name for name in first if not np.array_equal(first[name], second[name])]
        if changed:
            raise InvalidSetting(
                "vary",
                value=f"settings drawn in each trial, which change {changed[0]}",
                expected="items of a point with the same axes",
                fix="draw them with the points: draw: {method: sobol, n: 64}",
            )


def _item_shapes_as_text(shapes: ItemShapes) -> str:
    array_shapes = {"samples": shapes.cube, "maps": shapes.power}
    texts = [f"{name} {shape}" for name, shape in array_shapes.items() if shape]
    return ", ".join([*texts, f"{shapes.n_frames} frames", f"{len(shapes.targets)} targets"])
