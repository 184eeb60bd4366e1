"""What a run found as the terminal shows it, beside the truth where there is one."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from rich.cells import cell_len
from rich.table import Table

from dechirp.cli.show import table
from dechirp.core.words import NONE, decimals_of, fixed, ratio_db
from dechirp.evaluate.match import match
from dechirp.experiment.run import Result
from dechirp.report import tracked

# What is left out first where the terminal is narrow: the truth before what was measured.
_LEAST = (
    *("true elevation", "SNR", "true azimuth", "true velocity", "true range"),
    *("elevation", "azimuth", "frame"),
)


def detected(result: Result, *, at_most: int, width: int) -> Table:
    """The strongest detections, so many at most, in so many characters: with fewer columns."""
    order = np.argsort(-result.detections.snr.values, kind="stable")
    n_all = order.size
    strongest = result.detections.isel(detection=order[:at_most])
    found, shown = f"{n_all} detection{'' if n_all == 1 else 's'}", min(n_all, at_most)
    if shown < n_all:
        found += f", the {shown} strongest (all of them: detections.csv)"
    columns = _columns(result, strongest)
    for name in _LEAST:
        if _width(columns) > width:
            columns.pop(name, None)
    made = table(found, right=[_heading(name) for name in columns])
    for cells in zip(*columns.values(), strict=True):
        made.add_row(*cells)
    return made


_UNITS = {"range": "m", "velocity": "m/s", "azimuth": "°", "elevation": "°", "SNR": "dB"}


def _heading(name: str) -> str:
    return (
        "true"
        if name.startswith("true ")
        else f"{name}, {_UNITS[name]}"
        if name in _UNITS
        else name
    )


def _width(columns: dict[str, list[str]]) -> int:
    cells = ([_heading(name), *column] for name, column in columns.items())
    return sum(2 + max(map(cell_len, of_one)) for of_one in cells)  # and what parts them


def _columns(result: Result, detections: xr.Dataset) -> dict[str, list[str]]:
    """Cells of each column, from the left; angles only where any was estimated."""
    columns: dict[str, list[str]] = {}
    if result.n_frames > 1:
        columns["frame"] = [str(frame) for frame in detections.frame.values.tolist()]
    target = None if result.truth is None else _targets(result, detections)
    for name in ("range", "velocity", "azimuth", "elevation"):
        is_angle = _UNITS[name] == "°"
        if is_angle and not np.isfinite(detections[name]).any():
            continue
        # Millimetres and hundredths of a degree: more digits are in detections.csv.
        scale, most = (180 / np.pi, 2) if is_angle else (1.0, 3)
        values, stds = detections[name].values * scale, detections[f"{name}_std"].values * scale
        decimals = [min(decimals_of(std), most) for std in stds.tolist()]
        columns[name] = [
            f"{fixed(value, n)} ± {fixed(std, n)}" if np.isfinite(value) else NONE
            for value, std, n in zip(values.tolist(), stds.tolist(), decimals, strict=True)
        ]
        if result.truth is not None and target is not None:
            true = _of_targets(result.truth[name], target, detections.frame.values) * scale
            columns[f"true {name}"] = [
                fixed(one, n) for one, n in zip(true.tolist(), decimals, strict=True)
            ]
    columns["SNR"] = [fixed(ratio_db(snr), 1) for snr in detections.snr.values.tolist()]
    if result.truth is not None and target is not None:
        names = result.truth.target.values
        columns["target"] = [str(names[one]) if one >= 0 else NONE for one in target.tolist()]
    return columns


def _of_targets(of_all: xr.DataArray, target: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Truth of each detection's target in its frame, NaN for those without one."""
    out = np.full(len(target), np.nan)
    has = target >= 0
    places = of_all.indexes["frame"].get_indexer(frame[has])
    out[has] = of_all.transpose("target", "frame").values[target[has], places]
    return out


_OF_TRACKS = {
    "number": "track",
    "frames": "frames",
    "x": "x, m",
    "y": "y, m",
    "vx": "vx, m/s",
    "vy": "vy, m/s",
    "target": "target",
}


def followed(result: Result, *, at_most: int, width: int) -> Iterator[Table | str]:
    """Tracks, so many at most, and what is told of own motion, clusters and tracks."""
    tracks = tracked.rows(result, at_most)
    if tracks and result.tracks is not None:
        n_all = result.tracks.sizes["track"]
        found = f"{n_all} track{'' if n_all == 1 else 's'}, where they end"
        if len(tracks) < n_all:
            found += f": the first {len(tracks)} (all of them: tracks.csv)"
        columns = {head: [row[name] for row in tracks] for name, head in _OF_TRACKS.items()}
        if result.truth is None:
            del columns["target"]
        for name in ("frames", "target"):
            if _width(columns) > width:
                columns.pop(name, None)
        made = table(found, right=columns)
        for cells in zip(*columns.values(), strict=True):
            made.add_row(*cells)
        yield made
    said = " ".join([*tracked.about(result), tracked.summary(result)]).strip()
    if said:
        yield said


def missed(result: Result) -> Iterator[str]:
    """A line for each target that no frame has a detection of."""
    truth = result.truth
    if truth is None:
        return
    hits = set(_targets(result, result.detections).tolist())
    for index, name in enumerate(truth.target.values.tolist()):
        if index not in hits:
            first = truth.isel(target=index, frame=0)
            place = f"{fixed(float(first.range), 1)} m, {fixed(float(first.velocity), 1)} m/s"
            yield f"Not detected: {name}, at {place} in the first frame."


def _targets(result: Result, detections: xr.Dataset) -> np.ndarray:
    assert result.truth is not None
    scene = result.scenario.scene
    return match(detections, result.truth, result.radar, scene).target
