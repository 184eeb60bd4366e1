"""A data set of a study: what must hold before it is made, and what workers keep of blocks.

Samples and maps are in shards, which the workers write before their block is handed back. All
that is small goes with the block into the ledger, and becomes columns at the end, see `assembled`.
"""

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.config.texts import dump
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.evaluate.look import Case, Look
from dechirp.experiment.study.case import case_of
from dechirp.experiment.study.items import (
    DETECTED,
    STEP_DB,
    TRUTH,
    Form,
    Item,
    axes_of,
    form_of,
    item_of,
    labels_of,
    packed,
)
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.record import Record
from dechirp.store import data_set as store
from dechirp.store.shards import Shards

NAME = "data.zarr"
CUBE_AXES = ("frame", "chirp", "rx", "sample", "iq")
MAP_AXES = ("frame", "velocity", "range")
_MOST_VALUES = 1000  # of one setting whose shapes are compared before


@dataclass(frozen=True)
class Keeper:
    """What a worker needs to keep the items of a block."""

    folder: Path
    """Of the data set; all workers write to it."""
    keep: tuple[str, ...]
    form: Form
    arrays: tuple[Shards, ...]

    @classmethod
    def of(cls, plan: Plan, out: Path) -> "Keeper":
        """Keeper of a study with results in a folder."""
        form = form_of(_case(plan, 0, 0), plan.study.keep)
        folder = out.absolute() / NAME
        return cls(folder, plan.study.keep, form, tuple(_arrays(plan, form)))

    def block(self, point: int, first: int) -> "Keeping":
        """Begin to keep the trials `first`, `first + 1`, ... of a point."""
        return Keeping(self, point, first)


class Keeping:
    """The items of one block, added one after the other; a shard is held at a time."""

    def __init__(self, keeper: Keeper, point: int, first: int) -> None:
        self._keeper, self._point = keeper, point
        self._firsts = {one.name: first for one in keeper.arrays}
        self._waiting: dict[str, list[np.ndarray]] = {one.name: [] for one in keeper.arrays}
        self._items: list[tuple[Item, Mapping[str, np.ndarray]] | None] = []
        self._labels: tuple[Case, Mapping[str, np.ndarray]] | None = None

    def taken(
        self, case: Case, cube: xr.DataArray | None, look: Look
    ) -> tuple[Item, Mapping[str, np.ndarray]]:
        """Item of a trial and what is known of its targets; raises if it has another form."""
        item = item_of(self._keeper.form, self._keeper.keep, cube, look)
        if self._labels is None or self._labels[0] is not case:
            self._labels = (case, labels_of(case))
        return item, self._labels[1]

    def add(self, taken: tuple[Item, Mapping[str, np.ndarray]] | None) -> None:
        """Keep the next item; none: of a trial that failed, zeros.

        Raises
        ------
        DechirpError
            If a shard cannot be written.
        """
        item = None if taken is None else taken[0]
        for one in self._keeper.arrays:
            numbers = None if item is None else getattr(item, one.name)
            of = self._waiting[one.name]
            of.append(np.zeros(one.shape, np.int16) if numbers is None else numbers)
            if len(of) == one.per_shard:
                self._write(one)
        small = None if taken is None else (taken[0]._replace(cube=None, power=None), taken[1])
        self._items.append(small)

    def end(self, about: Mapping[str, np.ndarray]) -> bytes:
        """Write what waits, and give all that is small, for the ledger; raises as `add`."""
        for one in self._keeper.arrays:
            if self._waiting[one.name]:
                self._write(one)
        form, n = self._keeper.form, len(self._items)
        made = [one for one in self._items if one is not None]
        places = np.flatnonzero([one is not None for one in self._items])
        counts, scales = np.zeros(n, np.int64), np.full(n, np.nan)
        known = np.full((len(TRUTH), n, form.n_frames, len(form.targets)), np.nan)
        for at, (item, labels) in zip(places, made, strict=True):
            counts[at], scales[at] = len(item.detections.get("range", ())), item.scale
            known[:, at] = [labels[name] for name in TRUTH]
        arrays = {
            "made": np.isin(np.arange(n), places),
            "cube_scale": scales,
            "truth": known,
            "count": counts,
            **{f"about/{name}": of for name, of in about.items()},
        }
        for name in DETECTED if made and made[0][0].detections else ():
            rows = [item.detections[name] for item, _ in made]
            arrays[f"rows/{name}"] = np.concatenate(rows)
        return packed(arrays)

    def _write(self, one: Shards) -> None:
        items = np.stack(self._waiting[one.name])
        one.write(self._keeper.folder, self._point, self._firsts[one.name], items)
        self._firsts[one.name] += len(items)
        self._waiting[one.name] = []


def about_point(plan: Plan, point: int) -> dict[str, np.ndarray]:
    """Scenario of a point and its axes, which go with its first block; nothing if it has none."""
    try:
        text = dump(plan.scenario(point)).encode()
        axes = axes_of(_case(plan, point, 0))
    except DechirpError:  # a point that cannot be: each of its trials says so
        return {}
    return {"scenario": np.frombuffer(text, np.uint8), **axes}


def check(plan: Plan) -> None:
    """Raise `InvalidSetting` where a data set cannot be, or is larger than was said.

    Items must have one shape, and take no more than `Study.at_most_bytes`.
    """
    study = plan.study
    _must_be_alike(plan, form_of(_case(plan, 0, 0), study.keep))
    needed = data_bytes(plan)
    if needed > study.at_most_bytes:
        raise InvalidSetting(
            "keep",
            got=f"{in_gigabytes(needed)} in {plan.n_points * study.trials.at_most} items",
            need=f"at most at_most_bytes, {in_gigabytes(study.at_most_bytes)}, before it is packed",
            fix=f"Take fewer trials, or confirm it: at_most_bytes: {needed}.",
        )


def data_bytes(plan: Plan) -> int:
    """Samples and maps of all trials of a study, before they are packed."""
    form = form_of(_case(plan, 0, 0), plan.study.keep)
    return plan.n_points * plan.study.trials.at_most * form.item_bytes


def in_gigabytes(n_bytes: float) -> str:
    """Write a size as 1.2 GB, 340 MB or 2 kB."""
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if n_bytes >= size:
            return f"{n_bytes / size:.3g} {unit}"
    return f"{n_bytes:.0f} B"


def check_disk(plan: Plan, record: Record, out: Path) -> None:
    """Raise `DechirpError` where blocks would not go with the data set, or it has no room.

    Files of counted blocks may have gone, or another study's data set be there.
    """
    keeper = Keeper.of(plan, out)
    blocks = blocks_of(plan, record)
    if store.is_complete(keeper.folder) and not len(blocks):
        raise DechirpError(
            Mistake(
                setting="--out",
                got=f"{keeper.folder}, the data set of a study whose record has gone",
                need="a folder without one, or with its record",
                fix="Name another folder with --out, or remove the data set.",
            )
        )
    must_be_there(keeper, blocks)
    if not store.is_complete(keeper.folder):
        left = plan.n_points * plan.study.trials.at_most - int(blocks[:, 2].sum())
        check_room(left * keeper.form.item_bytes, out)


def check_room(needed_bytes: int, out: Path) -> None:
    """Raise `DechirpError` unless the disk of a folder, which need not be there, has room."""
    there = next(one for one in (out, *out.absolute().parents) if one.is_dir())
    free = shutil.disk_usage(there).free
    if needed_bytes > free:
        raise DechirpError(
            Mistake(
                setting="--out",
                got=f"on a disk with {in_gigabytes(free)} of room",
                need=f"on one with {in_gigabytes(needed_bytes)}, what is left to do before it is"
                " packed",
                fix="Name a folder on another disk, or take fewer trials.",
            )
        )


def _case(plan: Plan, point: int, trial: int) -> Case:
    return case_of(plan.scenario(point, plan.drawn(trial)))


def _arrays(plan: Plan, form: Form) -> Iterator[Shards]:
    trials = plan.study.trials
    size = (plan.n_points, trials.at_most, trials.block)
    if form.cube:
        about = {
            "units": "sqrt(W)",
            "long_name": "samples; times cube_scale of the item, in single precision",
            "convention": "beat = Tx x conj(Rx), receding positive",
        }
        yield Shards("cube", CUBE_AXES[: len(form.cube)], form.cube, *size, about)
    if form.power:
        said = {"units": "dBW", "scale_factor": STEP_DB, "long_name": "power, 10 log10 of 1 W"}
        yield Shards("power", MAP_AXES, form.power, *size, said)


def blocks_of(plan: Plan, record: Record) -> np.ndarray:
    """Point, first trial and number of trials of each block kept, (n_blocks, 3)."""
    trials = plan.study.trials
    points, numbers = record.done().T
    firsts = numbers * trials.block
    return np.stack([points, firsts, np.minimum(trials.block, trials.at_most - firsts)], axis=1)


def must_be_there(keeper: Keeper, blocks: np.ndarray) -> None:
    """Raise `DechirpError` if files of counted blocks have gone."""
    gone = store.missing(keeper.folder, keeper.arrays, blocks)
    if gone:
        raise DechirpError(
            Mistake(
                setting="--out",
                got=f"{keeper.folder} without {gone[0]}"
                + (f" and {len(gone) - 1} more files" if gone[1:] else ""),
                need="with every file of the trials that are counted",
                fix="Bring them back, or name another folder with --out to begin anew.",
            )
        )


def _must_be_alike(plan: Plan, form: Form) -> None:
    """Raise unless each value of each setting, the others at their first, leaves the shapes."""
    for along, axis in enumerate(plan.axes):
        for place in range(1, min(len(axis.texts), _MOST_VALUES)):
            index = np.zeros(len(plan.shape), dtype=int)
            index[along] = place
            point = int(np.ravel_multi_index(tuple(index), plan.shape))
            try:
                found = form_of(_case(plan, point, 0), plan.study.keep)
            except DechirpError:  # a point that cannot be: its trials tell so
                continue
            if found != form:
                raise InvalidSetting(
                    f"vary.{axis.path}",
                    got=f"{axis.labels[place]}, with {_shapes(found)}",
                    need=f"such that all items are alike: {_shapes(form)}",
                    fix="Make a data set of each shape, or keep none of it.",
                )
    if plan.draws_anew:
        first, second = (axes_of(_case(plan, 0, trial)) for trial in (0, 1))
        changed = [name for name in first if not np.array_equal(first[name], second[name])]
        if changed:
            raise InvalidSetting(
                "vary",
                got=f"settings drawn in each trial, which change {changed[0]}",
                need="items of a point with the same axes",
                fix="Draw them with the points: draw: {method: sobol, n: 64}.",
            )


def _shapes(form: Form) -> str:
    said = {"samples": form.cube, "maps": form.power}
    told = [f"{name} {shape}" for name, shape in said.items() if shape]
    return ", ".join([*told, f"{form.n_frames} frames", f"{len(form.targets)} targets"])
