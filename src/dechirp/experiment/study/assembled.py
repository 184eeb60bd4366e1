"""A data set when all trials are done: shards, and columns of what the ledger has beside them."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.experiment.study.data_set import (
    CUBE_AXES,
    MAP_AXES,
    Keeper,
    blocks_of,
    must_be_there,
)
from dechirp.experiment.study.items import DETECTED, TRUTH, Form, classes_of, unpacked
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.record import Record
from dechirp.experiment.study.text import study_text
from dechirp.store import data_set as store
from dechirp.store.data_set import Column

AXES: Mapping[str, tuple[tuple[str, ...], str, str]] = {
    "frame_time": (("frame",), "s", "middle of the frame, to which the truth refers"),
    "chirp_time": (("frame", "chirp"), "s", "start of the chirp, since the start of its frame"),
    "sample_time": (("sample",), "s", "time of the sample, since the start of the ramp"),
    "velocity_bins": (("frame", "velocity"), "m/s", "velocity of each row of a map"),
    "range_bins": (("range",), "m", "range of each column of a map"),
}
"""Axes, units and words of the coordinates of items, of each point."""


def complete(plan: Plan, record: Record, out: Path) -> Path:
    """Make the data set of all trials of a record, unless it is there; give its folder.

    Raises
    ------
    DechirpError
        If files of it have gone, or it cannot be written.
    """
    keeper = Keeper.of(plan, out)
    if store.is_complete(keeper.folder):
        return keeper.folder
    blocks = blocks_of(plan, record)
    must_be_there(keeper, blocks)

    def fill(made: store.Store) -> None:
        _fill(made, plan, keeper.form, record)

    store.complete(
        keeper.folder,
        keeper.arrays,
        blocks,
        about=_about(plan, keeper.form, record),
        fill=fill,
    )
    return keeper.folder


def _about(plan: Plan, form: Form, record: Record) -> dict[str, xr.Dataset]:
    """Tables that stand beside the items: axes and scenario of each point, settings, targets."""
    study, n = plan.study, plan.n_points
    scenarios, axes = [""] * n, {name: np.empty(0) for name in AXES}
    for point, _, content in record.items(number=0):
        kept = unpacked(content)
        if "about/scenario" not in kept:
            continue
        scenarios[point] = kept["about/scenario"].tobytes().decode()
        for name in AXES:
            of = kept[f"about/{name}"]
            if not axes[name].size:
                axes[name] = np.full((n, *of.shape), np.nan)
            axes[name][point] = of
    wanted = {
        name: xr.Variable(("point", *dims), axes[name], {"units": units, "long_name": words})
        for name, (dims, units, words) in AXES.items()
        if axes[name].size and set(dims) <= _dims_of(form)
    }
    attributes = {
        "dechirp_data_set": store.FORMAT_VERSION,
        "dechirp": str(import_module("dechirp").__version__),
        "name": study.name,
        "seed": study.seed,
        "keep": list(study.keep),
        "study": study_text(study),
    }
    scenario = xr.Variable("point", scenarios, {"long_name": "scenario of the point, YAML"})
    scene = study.scenario.scene
    assert scene is not None
    targets = {"target": list(form.targets), "class": ("target", classes_of(scene))}
    return {
        "": xr.Dataset({**wanted, "scenario": scenario}, attrs=attributes),
        "settings": xr.Dataset(dict(_settings(plan))),
        "truth": xr.Dataset(coords=targets),
    }


def _dims_of(form: Form) -> set[str]:
    cube = set(CUBE_AXES[1:]) if form.cube else set()
    return {"frame", *cube, *(MAP_AXES if form.power else ())}


def _settings(plan: Plan) -> Iterator[tuple[str, xr.Variable]]:
    """What varies: over the points, or over the trials where it is drawn in each."""
    units = {axis.path: axis.unit for axis in plan.study.vary}
    paths = [path for path, _ in plan.settings(0)]
    labels = [plan.labels(point) for point in range(plan.n_points)]
    numbers = [plan.numbers(point) for point in range(plan.n_points)]
    for at, path in enumerate(paths):
        known = [of[at] for of in numbers]
        values = [of[at][1] for of in labels] if None in known else np.array(known, dtype=float)
        yield _named(path), xr.Variable("point", values, {"units": units[path], "path": path})
    if plan.draws_anew:
        drawn = np.array([plan.numbers_drawn(trial) for trial in range(plan.study.trials.at_most)])
        for at, axis in enumerate(plan.drawn_axes):
            said = {"units": axis.unit, "path": axis.path}
            yield _named(axis.path), xr.Variable("trial", drawn[:, at], said)


def _named(path: str) -> str:
    """Path as the name of an array, which lies in no folder of its own."""
    return path.replace("/", "-")


def _fill(made: store.Store, plan: Plan, form: Form, record: Record) -> None:
    """Write all that the ledger has of the items, in their order."""
    has_rows = "detections" in plan.study.keep
    over, shape = ("frame", "target"), (form.n_frames, len(form.targets))
    columns = [Column("made", "bool", attributes={"long_name": "whether there is this item"})]
    if form.cube:
        said = {"units": "sqrt(W)", "long_name": "size of a step of the samples"}
        columns.append(Column("cube_scale", "float64", fill=np.nan, attributes=said))
    for name, (units, words) in TRUTH.items():
        said = {"units": units, "long_name": words}
        columns.append(Column(f"truth/{name}", "float64", over, shape, np.nan, said))
    if has_rows:
        for name, words in (("start", "first row of the item"), ("stop", "the row after its last")):
            said = {"long_name": words}
            columns.append(Column(f"detections/{name}", "int64", attributes=said))
    table = store.Columns(made, columns, plan.n_points, plan.study.trials.at_most)
    rows = store.Rows(made, "detections", _rows()) if has_rows else None
    for point, number, content in record.items():
        kept = unpacked(content)
        values = {"made": kept["made"]}
        if form.cube:
            values["cube_scale"] = kept["cube_scale"]
        values |= {f"truth/{name}": of for name, of in zip(TRUTH, kept["truth"], strict=True)}
        if rows is not None:
            stops = rows.n + np.cumsum(kept["count"])
            values["detections/start"] = stops - kept["count"]
            values["detections/stop"] = stops
            if "rows/range" in kept:
                rows.put({name: kept[f"rows/{name}"] for name in DETECTED})
        table.put(point, number * plan.study.trials.block, values)
    table.end()
    if rows is not None:
        rows.end()


def _rows() -> dict[str, Column]:
    kinds = {"frame": "int64", "target": "int64"}
    return {
        name: Column(
            name,
            kinds.get(name, "float64"),
            attributes={"units": units, "long_name": words},
        )
        for name, (units, words) in DETECTED.items()
    }
