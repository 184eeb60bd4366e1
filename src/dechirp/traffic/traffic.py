"""Traffic: positions, headings and velocities of all objects over time, read from a file."""

from collections import Counter
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import check_free_memory
from dechirp.core.text import format_number, join_names
from dechirp.core.values import frozen_dataclass
from dechirp.traffic.base import CutTrafficError, ObjectState, TrafficFormat
from dechirp.traffic.heading_check import find_wrong_headings
from dechirp.traffic.object_steps import (
    count_bridged_rows,
    find_gaps,
    join_times_s,
    typical_steps_s,
)
from dechirp.traffic.overlaps import OVERLAP_FIX, find_overlaps
from dechirp.traffic.trajectory_csv import missing_columns
from dechirp.traffic.trajectory_sets import recognise_foreign_xml

_UNITS = {
    "x": "m",
    "y": "m",
    "z": "m",
    "heading": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "length": "m",
    "width": "m",
    "height": "m",
}
_OVER_TIME = ("x", "y", "z", "heading", "vx", "vy")
_SIZES = ("length", "width", "height")
MOVES_M_PER_S = 0.5  # faster than the jitter of recorded positions at rest
FASTEST_M_PER_S = 100.0
"""360 km/h: an object that is faster between two steps jumps."""
SAME_SIZE_M = 0.1
"""Sizes of recorded objects differ by centimetres from step to step."""
# Map coordinates and Unix times are below; squares of larger numbers lose the metre.
_LARGEST_TIME_S, _LARGEST_POSITION_M = 1e12, 1e9
_LARGEST_HEADING_RAD, _LARGEST_SPEED_M_PER_S = 1e4, 1e4


@frozen_dataclass
class Traffic:
    """Objects of a traffic file over time, with the findings on it."""

    path: Path
    format: str
    host: int | None
    """Id of the vehicle that the file is about."""
    objects: xr.Dataset
    """Columns over (object, time): `x y z` (m), `heading` (rad), `vx vy` (m/s), NaN where an object
    is absent; over object: `id`, `kind`, `is_stationary`, `is_velocity_derived` (from positions),
    and `length width height` (m), NaN if unknown."""
    findings: tuple[Finding, ...]


@check_argument_types
def open_traffic(path: str | Path) -> Traffic:
    """Read the true motion of all objects in a traffic file.

    Parameters
    ----------
    path : str or Path
        ASAM OSI trace of `SensorView` or `GroundTruth` (.osi, .mcap, .txth), CommonRoad scenario
        (.xml), or trajectories as CSV with the columns time, id, class, x, y, heading, length,
        width, height and optionally z, vx, vy, in SI units.

    Returns
    -------
    Traffic
        Velocities that are missing, or zero although the object moves, come from the positions;
        findings name such objects, ids that reappear, jumps, objects that overlap, and objects that
        change their class or size, of which the first counts. Up to three missing rows of an object
        are bridged, with a note. Of a file that is cut short, what precedes the cut is read, with a
        finding.

    Raises
    ------
    RecordingError
        If there is no such file, its format is unknown, it is damaged, or it contains impossible
        values: an object twice at one time, a size that is not positive, a position without number.
    NotEnoughMemory
        If objects times steps do not fit into the free memory.

    References
    ----------
    ASAM OSI 3.8, osi_groundtruth.proto. M. Althoff, M. Koschi, S. Manzinger, "CommonRoad", IEEE
    Intelligent Vehicles Symposium 2017.
    """
    file = Path(path)
    if not file.is_file():
        raise RecordingError(
            file,
            value="a folder" if file.is_dir() else "no such file",
            expected="a traffic file",
            fix="check its name",
        )
    kind = recognise_traffic(file)
    if kind is None and (layout := recognise_foreign_xml(file)) is not None:
        raise RecordingError(
            file,
            value=f"{layout.name} as XML",
            expected="a CSV with the columns time, id, class, x, y, heading, length, width, height",
            fix="convert it to CSV with tools/xml/xml2csv.py of SUMO, and then the columns:"
            f" {layout.conversion}",
        )
    if kind is None:
        raise RecordingError(
            file,
            value=_describe_unknown_file(file),
            expected=" or ".join(_format_classes()),
            fix="convert it to a CSV with the columns time, id, class, x, y, heading, length,"
            " width, height; read SensorData, the object list of a sensor, with"
            " dechirp.object_lists.read_objects",
        )
    reader = _format_classes()[kind]()
    states, reading_findings = _read_states_up_to_cut(file, reader)
    objects = _build_objects(file, states)
    completed, findings = _complete_velocities(objects)
    return Traffic(
        path=file,
        format=kind,
        host=reader.read_host(file),
        objects=completed,
        findings=(
            *reading_findings,
            *reader.read_findings(file),
            *_change_findings(states, completed),
            *findings,
            *_velocity_unit_findings(completed),
            *_stationary_findings(completed),
            *_find_surprising_motion(completed),
            *find_wrong_headings(completed),
        ),
    )


def _describe_unknown_file(path: Path) -> str:
    """Return what a file of no format lacks, as far as its ending tells its format."""
    if not path.stat().st_size:
        return "an empty file (0 bytes)"
    if path.suffix.lower() == ".xml":
        return "XML without the element commonRoad at its start"
    if path.suffix.lower() == ".csv":
        return f"a CSV without the columns {join_names(missing_columns(path))}"
    return "an unknown format"


def recognise_traffic(path: Path) -> str | None:
    """Return the kind of the format that recognises a file, None if it is no traffic file."""
    try:
        if not path.is_file():
            return None
    except OSError:  # a name that the system refuses
        return None
    return next((kind for kind, cls in _format_classes().items() if cls.recognises(path)), None)


def _format_classes() -> "dict[str, type[TrafficFormat]]":
    return cast("dict[str, type[TrafficFormat]]", TrafficFormat.members())


def _read_states_up_to_cut(
    path: Path, reader: TrafficFormat
) -> tuple[list[ObjectState], list[Finding]]:
    """Read all states, of a file that is cut short those before the cut, and say so."""
    states: list[ObjectState] = []
    findings = []
    try:
        states.extend(reader.read_states(path))
    except CutTrafficError as error:
        if not states:
            raise
        mistake = error.mistakes[0]
        findings.append(
            Finding(
                level="warning",
                setting="traffic.path",
                value=f"the file is cut short at {mistake.value}; {len(states)} states up to"
                f" {states[-1].time_s:g} s, the last of object {states[-1].id}, are read",
                expected="a complete file",
                fix=mistake.fix,
            )
        )
    last_s: dict[int, float] = {}
    back: dict[int, str] = {}
    for state in states:
        if state.time_s < last_s.get(state.id, state.time_s):
            back.setdefault(state.id, f"object {state.id} at {state.time_s:g} s")
        last_s[state.id] = state.time_s
    if back:
        findings.append(
            Finding(
                level="note",
                setting="traffic.time",
                value=f"times of {format_count_with_noun(len(back), 'object')} go back: "
                f"{join_names(list(back.values()), at_most=4)}",
                expected="times that ascend",
                fix="nothing to do: the states are sorted by time",
            )
        )
    return states, findings


def _build_objects(path: Path, rows: list[ObjectState]) -> xr.Dataset:
    if not rows:
        raise RecordingError(
            path,
            value="no object",
            expected="objects with positions",
            fix="give a file with traffic, no map alone; read SensorData, the object list of a"
            " sensor, with dechirp.object_lists.read_objects",
        )
    for row in rows:
        check_state(path, row)
    times_s, at_time = join_times_s(np.array([row.time_s for row in rows]))
    ids = list(dict.fromkeys(row.id for row in rows))
    check_free_memory(
        f"{len(ids)} objects at {len(times_s)} times",
        needed_bytes=8.0 * len(_OVER_TIME) * len(ids) * len(times_s),
        fix="split the file",
    )
    object_index = {number: index for index, number in enumerate(ids)}
    at_object = np.array([object_index[row.id] for row in rows])
    n_rows_of_cell = np.zeros((len(ids), len(times_s)), int)
    np.add.at(n_rows_of_cell, (at_object, at_time), 1)
    if n_rows_of_cell.max() > 1:
        number, time = (int(index) for index in np.argwhere(n_rows_of_cell > 1)[0])
        raise RecordingError(
            path,
            value=f"object {ids[number]} twice at {times_s[time]:g} s",
            expected="one state of an object at a time",
            fix="give each object its own id",
        )
    names = (*_OVER_TIME, *_SIZES)
    columns = dict(
        zip(names, np.array([row[3 : 3 + len(names)] for row in rows], float).T, strict=True)
    )
    is_stationary = np.zeros(len(ids), bool)
    is_stationary[at_object[[row.is_stationary for row in rows]]] = True
    variables: dict[str, tuple[Any, ...]] = {}
    for name in _OVER_TIME:
        cells = np.full((len(ids), len(times_s)), np.nan)
        cells[at_object, at_time] = columns[name]
        cells[is_stationary] = _continue_states(
            cells[is_stationary], n_rows_of_cell[is_stationary] > 0
        )
        variables[name] = (("object", "time"), cells, {"units": _UNITS[name]})
    for name in _SIZES:
        sizes = np.full(len(ids), np.nan)
        known = np.flatnonzero(np.isfinite(columns[name]))[::-1]
        sizes[at_object[known]] = columns[name][known]  # the first one is assigned last
        variables[name] = ("object", sizes, {"units": _UNITS[name]})
    variables["is_stationary"] = ("object", is_stationary)
    kinds = {row.id: row.kind for row in reversed(rows)}
    return xr.Dataset(
        variables,
        coords={
            "id": ("object", ids),
            "kind": ("object", [kinds[number] for number in ids]),
            "time": ("time", times_s, {"units": "s"}),
        },
    )


def _continue_states(cells: np.ndarray, has_row: np.ndarray) -> np.ndarray:
    """Return values over time, (n, n_times), of the last row, and of the first before it."""
    steps = np.arange(has_row.shape[1])
    last = np.maximum.accumulate(np.where(has_row, steps, -1), axis=1)
    last = np.where(last < 0, has_row.argmax(axis=1)[:, None], last)
    return np.take_along_axis(cells, last, axis=1)


def check_state(path: object, row: ObjectState) -> None:
    """Raise `RecordingError` for a state with impossible numbers; `path` is for the error."""
    place = f"object {row.id} at {row.time_s:g} s"
    if not np.all(np.isfinite((row.time_s, row.x_m, row.y_m))):
        raise RecordingError(
            path,
            value=f"{place}: x {row.x_m}, y {row.y_m}",
            expected="finite times and positions",
            fix="leave out times at which an object is absent",
        )
    if abs(row.id) >= 2**63:
        raise RecordingError(
            path, value=place, expected="ids below 2^63", fix="number the objects anew"
        )
    for name, unit, largest, numbers in (
        ("time", "s", _LARGEST_TIME_S, (row.time_s,)),
        ("position", "m", _LARGEST_POSITION_M, (row.x_m, row.y_m, row.z_m)),
        ("heading", "rad", _LARGEST_HEADING_RAD, (row.heading_rad,)),
        ("velocity", "m/s", _LARGEST_SPEED_M_PER_S, (row.vx_m_per_s, row.vy_m_per_s)),
    ):
        if any(abs(number) > largest for number in numbers):  # false for NaN, which is unknown
            raise RecordingError(
                path,
                value=f"{place}: {name} {', '.join(f'{number:g}' for number in numbers)} {unit}",
                expected=f"at most {largest:g} {unit}",
                fix="correct it, or leave it out",
            )
    for name in ("length_m", "width_m", "height_m"):
        size_m = getattr(row, name)
        if size_m <= 0 or np.isinf(size_m):
            raise RecordingError(
                path,
                value=f"{place}: {name.removesuffix('_m')} {size_m:g} m",
                expected="sizes above 0",
                fix="correct the size, or leave it out for that of its class",
            )


def _complete_velocities(objects: xr.Dataset) -> tuple[xr.Dataset, tuple[Finding, ...]]:
    """Take velocities from positions where they are missing, or zero of an object that moves."""
    times_s = objects["time"].values
    velocities = {"vx": objects["vx"].values.copy(), "vy": objects["vy"].values.copy()}
    is_derived = np.zeros(objects.sizes["object"], bool)
    completed = []
    for index, number in enumerate(objects["id"].values.tolist()):
        present = np.flatnonzero(np.isfinite(objects["x"].values[index]))
        if present.size < 2:
            continue
        stated = np.hypot(velocities["vx"][index, present], velocities["vy"][index, present])
        positions = np.stack([objects[name].values[index, present] for name in ("x", "y")])
        derived, speeds = _derive_velocities(times_s[present], positions)
        moves = bool(np.any(speeds > MOVES_M_PER_S))
        is_missing = np.isnan(stated)
        if moves and not np.any(stated > 0):
            is_missing[:] = True
        is_derived[index] = is_missing.all()
        is_missing &= np.isfinite(derived[0])
        for name, of_positions in zip(("vx", "vy"), derived, strict=True):
            velocities[name][index, present[is_missing]] = of_positions[is_missing]
        if moves and is_missing.any():
            first_s = times_s[present[int(is_missing.argmax())]]
            # The median: one row with a wrong time or position has a multiple of the speed.
            speed = float(np.median(speeds[speeds > MOVES_M_PER_S]))
            completed.append((speed, number, first_s))
    changed = objects.assign(
        {
            name: (("object", "time"), values, {"units": "m/s"})
            for name, values in velocities.items()
        }
        | {"is_velocity_derived": ("object", is_derived)}
    )
    if not completed:
        return changed, ()
    fastest_first = [
        f"{number} from {format_number(first_s)} s ({format_number(speed, 3)} m/s)"
        for speed, number, first_s in sorted(completed, key=lambda row: -round(row[0], 3))
    ]
    return changed, (
        Finding(
            level="note",
            setting="traffic.velocity",
            value=f"velocities of {format_count_with_noun(len(completed), 'object')} are missing,"
            f" or zero although they move: {join_names(fastest_first, at_most=4)}",
            expected="velocities in the file",
            fix="nothing to do: differences of positions replace them",
        ),
    )


def _derive_velocities(
    times_s: np.ndarray, positions_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities of positions, (2, n), and the speeds between them, without jumps.

    A single position between two jumps has no velocity, NaN.
    """
    speeds = step_speeds_m_per_s(times_s, *positions_m)
    is_jump = speeds > FASTEST_M_PER_S
    velocities = np.full(positions_m.shape, np.nan)
    for run in np.split(np.arange(len(times_s)), np.flatnonzero(is_jump) + 1):
        if run.size > 1:
            velocities[:, run] = np.gradient(positions_m[:, run], times_s[run], axis=1)
    return velocities, speeds[~is_jump]


def _velocity_unit_findings(objects: xr.Dataset) -> list[Finding]:
    """Return a warning if stated speeds are 3.6 times those of the positions: km/h."""
    ratios = []
    for index in range(objects.sizes["object"]):
        present = np.flatnonzero(np.isfinite(objects["x"].values[index]))
        if present.size < 2:
            continue
        x_m, y_m, vx, vy = (objects[name].values[index, present] for name in ("x", "y", "vx", "vy"))
        speeds = step_speeds_m_per_s(objects["time"].values[present], x_m, y_m)
        stated = np.hypot(vx, vy)
        means = (stated[1:] + stated[:-1]) / 2
        ratios.append((means / np.where(speeds > MOVES_M_PER_S, speeds, np.nan)).ravel())
    known = np.concatenate(ratios) if ratios else np.empty(0)
    known = known[np.isfinite(known)]
    ratio = float(np.median(known)) if known.size else np.nan
    if not abs(ratio / 3.6 - 1) < 0.05:
        return []
    return [
        Finding(
            level="warning",
            setting="traffic.velocity",
            value=f"velocities are {format_number(ratio, 2)} times the changes of positions",
            expected="velocities in m/s",
            fix="divide them by 3.6 if they are km/h, or leave them out",
        )
    ]


def _change_findings(rows: list[ObjectState], objects: xr.Dataset) -> list[Finding]:
    """Return a warning on objects whose class or size changes; none without any."""
    index_of_id = {number: index for index, number in enumerate(objects["id"].values.tolist())}
    at_object = np.array([index_of_id[row.id] for row in rows])
    changes = []
    for name, unit in (("kind", ""), *((size, " m") for size in _SIZES)):
        values = np.array([getattr(row, f"{name}_m" if unit else name) for row in rows])
        firsts = objects[name].values[at_object]
        # False for NaN, which is unknown.
        is_change = abs(values - firsts) > SAME_SIZE_M if unit else values != firsts
        for row in np.flatnonzero(is_change).tolist():
            what = f"{name if unit else 'class'} {firsts[row]}{unit}, then {values[row]}{unit}"
            changes.append((row, what))
    if not changes:
        return []
    first_changes = {
        rows[row].id: f"object {rows[row].id} at {format_number(rows[row].time_s)} s ({what})"
        for row, what in sorted(changes, reverse=True)
    }
    return [
        Finding(
            level="warning",
            setting="traffic.size",
            value=f"class or size of {format_count_with_noun(len(first_changes), 'object')}"
            f" changes: {join_names(list(first_changes.values())[::-1], at_most=4)}",
            expected="one class and one size for each object",
            fix="check these rows; the first class and size of each object are used",
        )
    ]


def _stationary_findings(objects: xr.Dataset) -> tuple[Finding, ...]:
    """Return a note with the numbers of stationary objects by kind; none without any."""
    kinds = objects["kind"].values[objects["is_stationary"].values].tolist()
    if not kinds:
        return ()
    counts = [f"{count} {kind}" for kind, count in sorted(Counter(kinds).items())]
    return (
        Finding(
            level="note",
            setting="traffic.stationary",
            value=f"{format_count_with_noun(len(kinds), 'stationary object')}:"
            f" {join_names(counts)}",
            expected="boxes with the classes of the guide, present in all frames",
            fix="nothing to do: they reflect and shadow, and are no objects of the scores",
        ),
    )


def _find_surprising_motion(objects: xr.Dataset) -> list[Finding]:
    """Return findings on missing rows, gaps, jumps, and objects that overlap."""
    ids, times_s = objects["id"].values, objects["time"].values
    x, y = objects["x"].values, objects["y"].values
    gaps, jumps, bridged = [], [], []
    n_bridged = 0
    steps_s = typical_steps_s(objects)
    for index, number in enumerate(ids.tolist()):
        present = np.flatnonzero(np.isfinite(x[index]))
        is_gap = find_gaps(times_s, present, steps_s[index])
        if np.any(is_gap):
            first = present[np.argmax(is_gap) + 1]
            gaps.append(f"object {number} at {format_number(times_s[first])} s")
        speeds = step_speeds_m_per_s(times_s[present], x[index, present], y[index, present])
        if np.any(speeds > FASTEST_M_PER_S):
            first = present[int(np.argmax(speeds > FASTEST_M_PER_S)) + 1]
            jumps.append(
                f"object {number} at {format_number(times_s[first])} s"
                f" ({format_number(speeds.max(), 3)} m/s)"
            )
        n_missing = count_bridged_rows(times_s, present, steps_s[index])
        n_missing[speeds > FASTEST_M_PER_S] = 0
        if n_missing.any() and not objects["is_stationary"].values[index]:
            n_bridged += int(n_missing.sum())
            first = present[int(np.argmax(n_missing > 0))]
            bridged.append(f"object {number} after {format_number(times_s[first])} s")
    findings = []
    if bridged:
        findings.append(
            Finding(
                level="note",
                setting="traffic.time",
                value=f"bridged {format_count_with_noun(n_bridged, 'missing row')} of"
                f" {format_count_with_noun(len(bridged), 'object')}:"
                f" {join_names(bridged, at_most=4)}",
                expected="a row in each step of an object",
                fix="nothing to do: paths continue over up to three missing rows",
            )
        )
    if gaps:
        findings.append(
            Finding(
                level="note",
                setting="traffic.id",
                value=f"gaps in the rows of {format_count_with_noun(len(gaps), 'object')}:"
                f" {join_names(gaps, at_most=4)}",
                expected="objects that stay until they leave",
                fix="check that both are one object; its path through the gap is unknown",
            )
        )
    if jumps:
        findings.append(
            Finding(
                level="warning",
                setting="traffic.position",
                value=f"jumps of {format_count_with_noun(len(jumps), 'object')}:"
                f" {join_names(jumps, at_most=4)}",
                expected=f"at most {FASTEST_M_PER_S:g} m/s between steps",
                fix="give the object behind the jump another id",
            )
        )
    overlaps = [
        f"{ids[pair.first]} and {ids[pair.second]} at {format_number(pair.time_s)} s,"
        f" by {pair.depth_m:.1f} m"
        for pair in find_overlaps(objects)
    ]
    if overlaps:
        findings.append(
            Finding(
                level="warning",
                setting="traffic.position",
                value=f"objects overlap: {join_names(overlaps, at_most=4)}",
                expected="objects apart",
                fix=OVERLAP_FIX,
            )
        )
    return findings


def step_speeds_m_per_s(times_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Return the speed of one object between its steps, all present, from the positions, (n-1,)."""
    return np.asarray(np.hypot(np.diff(x_m), np.diff(y_m)) / np.diff(times_s))
