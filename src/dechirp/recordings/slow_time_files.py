"""Slow-time files: I/Q values of range cells over time, without chirps.

Two layouts are recognised by content.

* HDF5 of Acconeer's Exploration Tool. Of the sensor A121, frames of complex sweeps, one value for
  each distance. Times are the ticks of the server, distances follow from the sensor's settings.
  Versions before 6 have one `session`, later ones any number of `sessions`. Of the sensor A111, the
  complex sweeps of the service IQ; its other services contain no phases.
* Text (CSV) with named columns of I and Q, and their times in seconds.

References
----------
Acconeer, A121 data sheet and documentation of the Exploration Tool (carrier 60.5 GHz, distances in
steps of `base_step_length_m`, ticks); A111 data sheet (carrier 60.5 GHz).
"""

import csv
import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.compiled_kernels import kernel
from dechirp.core.errors import RecordingError, quote_for_message
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.recordings.arrays.hdf5_datasets import (
    EXPECTED,
    dataset_to_lazy_array,
    find_dataset_following_links,
    open_hdf5,
)
from dechirp.recordings.arrays.hdf5_text import read_scalar_text
from dechirp.recordings.arrays.lazy_array import LazyArray, convert_parser_errors

__all__ = ["read_slow_time"]


def __dir__() -> list[str]:
    return __all__


_INT16_PAIRS = np.dtype([("real", "<i2"), ("imag", "<i2")])
_ACCONEER_CARRIER_HZ = 60.5e9
_ENTRY = re.compile(r"(?:sessions/session_(\d+)|session)/group_(\d+)/entry_(\d+)")
_MAX_SESSIONS = 1000
_MAX_TEXT_BYTES = 2**20
_MAX_HEADING_BYTES = 2**16
_BLOCK_BYTES = 2**22
_LAYOUTS = (
    "HDF5 of Acconeer's A121 or of the IQ service of its A111, or CSV with a heading that names"
    " columns of I, Q and time"
)


@check_argument_types
def read_slow_time(path: str | Path, *, wavelength_m: float | None = None) -> xr.DataArray:
    """Read the slow-time values of a file that contains no chirps.

    Parameters
    ----------
    path : path
        HDF5 of Acconeer's A121, or of the IQ service of its A111, or CSV. The heading of a CSV file
        names a column I (also `[I]`, `in-phase`, `real`), a column Q (`[Q]`, `quadrature`, `imag`)
        and a time (`t`, `time`) in seconds or in the unit of its name (`time_ms`). Where each
        signal has columns `..._x` and `..._y`, `..._x` is its time.
    wavelength_m : float, optional
        Of the carrier, for displacements; for HDF5 of Acconeer 60.5 GHz by default.

    Returns
    -------
    DataArray (time,) or (time, range), complex
        Sweeps of a frame are averaged. The attribute `wavelength_m` is missing if it is unknown.
        Of several sessions or sensors in a file, the one with most frames, with a warning.

    Raises
    ------
    RecordingError
        If the file has neither layout, or is damaged.
    """
    path = Path(path)
    if wavelength_m is not None:
        check_number("wavelength_m", wavelength_m, above=0.0)
    if not path.is_file():
        raise RecordingError(
            path, value="no file", expected=_LAYOUTS, fix="give the path of a slow-time file"
        )
    with path.open("rb") as file:
        is_hdf5 = file.read(8) == b"\x89HDF\r\n\x1a\n"
    trace = _read_acconeer(path) if is_hdf5 else _read_columns(path)
    if wavelength_m is not None:
        trace.attrs["wavelength_m"] = float(wavelength_m)
    return trace


def _read_acconeer(path: Path) -> xr.DataArray:
    """Read an HDF5 file of the A121 or the A111."""
    with convert_parser_errors(path, f"{EXPECTED} of Acconeer's A121"), open_hdf5(path) as file:
        if "mode" in file and "sensor_config_dump" in file:
            return _read_a111(path, file)
        entries = _frames_of_entries(path, file)
        if not entries:
            raise RecordingError(
                path,
                value="an HDF5 file without sessions/session_0/group_0/entry_0/result with complex"
                " frames",
                expected="a file that Acconeer's Exploration Tool wrote with an A121, or with an"
                " A111 and the service IQ",
                fix="open other HDF5 files with dechirp.open and name their axes",
            )
        entry = max(entries, key=lambda name: len(entries[name]))
        trace = _read_entry(path, file, entry, entries[entry])
    if len(entries) > 1:
        _warn_of_other_entries(path, entry, {name: len(frames) for name, frames in entries.items()})
    return trace


def _frames_of_entries(path: Path, file: Any) -> dict[str, Any]:
    """Return the frames of each sensor in each group of each session, in order."""
    sessions = (
        [f"sessions/session_{n}" for n in range(min(len(file["sessions"]), _MAX_SESSIONS))]
        if "sessions" in file
        else ["session"]
    )
    names = [
        f"{session}/{group}/{entry}"
        for session in sessions
        if session in file
        for group in file[session]
        if group.startswith("group_")
        for entry in file[f"{session}/{group}"]
        if entry.startswith("entry_")
    ]
    found = {
        name: find_dataset_following_links(path, file, f"{name}/result/frame")
        for name in names
        if _ENTRY.fullmatch(name)
    }
    return {
        name: frames
        for name, frames in found.items()
        if frames is not None and frames.dtype.names == ("real", "imag") and frames.ndim == 3
    }


def _read_entry(path: Path, file: Any, entry: str, frames: Any) -> xr.DataArray:
    """Read one sensor of one session."""
    session, group_name, _ = entry.rsplit("/", 2)
    ticks = find_dataset_following_links(path, file, f"{entry}/result/tick")
    metadata = _read_json(file, f"{entry}/metadata")
    server = _read_json(file, "server_info")
    sensor = int(file[f"{entry}/sensor_id"][()])
    groups = _read_json(file, f"{session}/session_config")["groups"]
    group = groups[int(group_name.removeprefix("group_"))]
    ranges_m = _acconeer_ranges_m(group[str(sensor)], float(metadata["base_step_length_m"]))
    ticks_per_second = float(server["ticks_per_second"])
    if frames.shape[2] != len(ranges_m) or 0 in frames.shape:
        raise ValueError(f"frames of shape {frames.shape}, and {len(ranges_m)} distances")
    if ticks is None or ticks.shape != frames.shape[:1] or not ticks_per_second > 0:
        raise ValueError(f"no tick for each of {frames.shape[0]} frames")
    return _label_trace(
        _mean_of_sweeps(dataset_to_lazy_array(path, file, frames)),
        np.asarray(ticks[()], float) / ticks_per_second,
        ranges_m=ranges_m,
        wavelength_m=SPEED_OF_LIGHT / _ACCONEER_CARRIER_HZ,
    )


def _warn_of_other_entries(path: Path, entry: str, n_frames: dict[str, int]) -> None:
    others = [f"{name} with {n}" for name, n in n_frames.items() if name != entry]
    shown = ", ".join(others[:3]) + (f" and {len(others) - 3} more" if len(others) > 3 else "")
    finding = Finding(
        level="warning",
        setting="recording",
        value=f"{path.name} contains {len(n_frames)} sessions or sensors; {entry} with"
        f" {n_frames[entry]} frames was read, not {shown}",
        expected="one session of one sensor",
        fix="no action needed for the longest one; record the others in files of their own",
    )
    warnings.warn(PhysicsWarning(finding), stacklevel=5)


def _read_a111(path: Path, file: Any) -> xr.DataArray:
    """Read the first sensor of the service IQ."""
    mode = _read_text(file, "mode")[:20].decode("utf-8", "replace")
    if mode != "iq":
        raise RecordingError(
            path,
            value=f"the service {quote_for_message(mode)} of Acconeer's A111, without I and Q",
            expected="the service iq, whose phases show movements",
            fix="record with the service IQ",
        )
    sweeps = find_dataset_following_links(path, file, "data")
    if sweeps is None or sweeps.ndim != 3 or sweeps.dtype.kind != "c" or 0 in sweeps.shape:
        raise ValueError("no complex data (sweep, sensor, distance)")
    session = _read_json(file, "session_info")
    start_m, length_m = float(session["range_start_m"]), float(session["range_length_m"])
    ranges_m = np.linspace(start_m, start_m + length_m, sweeps.shape[2])
    if not np.isfinite(ranges_m).all():
        raise ValueError("distances that are not finite")
    if "sample_times" in file:
        times_s = np.asarray(file["sample_times"][()], float)
    else:
        rate_hz = float(_read_json(file, "sensor_config_dump")["update_rate"])
        times_s = np.arange(len(sweeps)) / rate_hz
    if times_s.shape != sweeps.shape[:1] or not np.isfinite(times_s).all():
        raise ValueError(f"{times_s.shape} times for {sweeps.shape[0]} sweeps")
    n_sensors = sweeps.shape[1]
    whole = (slice(0, len(sweeps)), slice(0, 1), slice(0, sweeps.shape[2]))
    values = dataset_to_lazy_array(path, file, sweeps).read(whole)[:, 0]
    if n_sensors > 1:
        _warn_of_other_entries(
            path, "sensor 1", {f"sensor {n + 1}": len(values) for n in range(n_sensors)}
        )
    return _label_trace(
        values, times_s, ranges_m=ranges_m, wavelength_m=SPEED_OF_LIGHT / _ACCONEER_CARRIER_HZ
    )


def _average_codes_in_numpy(codes: np.ndarray, means: np.ndarray) -> None:
    means[:] = codes.sum(axis=1, dtype=np.int64) / codes.shape[1]


@kernel(plain=_average_codes_in_numpy)
def _average_codes(codes: np.ndarray, means: np.ndarray) -> None:
    """Fill (frame, value) with the means of codes (frame, sweep, value): an eighth of the time."""
    n_frames, n_sweeps, n_values = codes.shape
    sums = np.empty(n_values, np.int64)
    for frame in range(n_frames):
        sums[:] = 0
        for sweep in range(n_sweeps):
            for n in range(n_values):
                sums[n] += codes[frame, sweep, n]
        for n in range(n_values):
            means[frame, n] = sums[n] / n_sweeps


def _mean_of_sweeps(frames: LazyArray) -> np.ndarray:
    """Return the means (frame, value) of the sweeps of each frame, block by block.

    Blocks of 4 MB keep the sweeps of a file out of memory, and take no longer than one array.
    """
    n_frames, n_sweeps, n_values = frames.shape
    means = np.empty((n_frames, n_values), np.complex128)
    n_block = max(_BLOCK_BYTES // (n_sweeps * n_values * frames.dtype.itemsize), 1)
    for first in range(0, n_frames, n_block):
        frame_slice = slice(first, min(first + n_block, n_frames))
        block = frames.read((frame_slice, slice(0, n_sweeps), slice(0, n_values)))
        if block.dtype == _INT16_PAIRS:
            codes = np.ascontiguousarray(block).view("<i2")
            _average_codes(codes, means[frame_slice].view(np.float64))
        else:
            for part, name in ((means.real, "real"), (means.imag, "imag")):
                part[frame_slice] = block[name].mean(axis=1, dtype=np.float64)
    return means


def _read_json(file: Any, name: str) -> Any:
    """Return a JSON text that a dataset contains."""
    return json.loads(_read_text(file, name))


def _read_text(file: Any, name: str) -> bytes:
    with Path(file.filename).open("rb") as stream:
        return read_scalar_text(stream, file[name], max_bytes=_MAX_TEXT_BYTES)


def _acconeer_ranges_m(sensor: dict[str, Any], base_step_m: float) -> np.ndarray:
    """Return the distance of each value of a sweep."""
    points = [
        int(part["start_point"]) + int(part["step_length"]) * np.arange(int(part["num_points"]))
        for part in sensor["subsweeps"]
        if 0 < int(part["num_points"]) <= 2**16
    ]
    ranges_m = base_step_m * np.concatenate(points)
    if not np.isfinite(ranges_m).all():
        raise ValueError("distances that are not finite")
    return ranges_m


def _read_columns(path: Path) -> xr.DataArray:
    """Read a CSV file with named columns."""
    if path.stat().st_size == 0:
        raise RecordingError(
            path, value="an empty file", expected=_LAYOUTS, fix="copy or record it again"
        )
    with convert_parser_errors(path, _LAYOUTS):
        with path.open("rb") as file:
            heading = file.readline(_MAX_HEADING_BYTES).decode("utf-8-sig")
        heading = heading.removeprefix("#")  # as numpy.savetxt writes it
        separator = next((mark for mark in ",;\t" if mark in heading), ",")
        names = next(csv.reader([heading], delimiter=separator), [])
        chosen = [_find_column(path, names, pattern, role) for role, pattern in _ROLES.items()]
        time_column = _find_time_column(path, names, chosen[0])
        table = np.loadtxt(
            path,
            delimiter=separator,
            skiprows=1,
            usecols=[time_column, *chosen],
            ndmin=2,
            encoding="utf-8-sig",
        )
    is_valid = np.isfinite(table).all() and len(table) > 1 and (np.diff(table[:, 0]) >= 0).all()
    if not is_valid:
        raise RecordingError(
            path,
            value=f"{len(table)} lines with numbers that are not finite, or times that decrease",
            expected="two lines or more of finite numbers, in the order of their times",
            fix="remove incomplete lines, and sort them by time",
        )
    times_s = table[:, 0] * _unit_of_time_s(names[time_column])
    return _label_trace(table[:, 1] + 1j * table[:, 2], times_s)


_ROLES = {
    "I": re.compile(r"(?:.*[^a-z])?(?:i|in-?phase|re|real)(?:[^a-z].*)?", re.IGNORECASE),
    "Q": re.compile(r"(?:.*[^a-z])?(?:q|quadrature|im|imag)(?:[^a-z].*)?", re.IGNORECASE),
}
_TIME = re.compile(r"(?:t|time|timestamp)(?:[^a-z].*)?", re.IGNORECASE)
_UNIT = re.compile(r"[^a-z](m|u|\u00b5|\u03bc|n)(?:s|sec)\W*$", re.IGNORECASE)
_UNITS_S = {"m": 1e-3, "u": 1e-6, "\u00b5": 1e-6, "\u03bc": 1e-6, "n": 1e-9}


def _find_column(path: Path, names: list[str], pattern: re.Pattern[str], role: str) -> int:
    """Return the only column of a role; of a pair `_x`, `_y` the second."""
    found = [
        index
        for index, name in enumerate(names)
        if pattern.fullmatch(name.strip()) and not name.strip().endswith("_x")
    ]
    if len(found) != 1:
        shown = ", ".join(quote_for_message(name) for name in names[:8])
        raise RecordingError(
            path,
            value=f"{len(found)} columns for {role} in the heading {shown or 'of no names'}",
            expected=_LAYOUTS,
            fix="name the columns time, I and Q in the first line",
        )
    return found[0]


def _find_time_column(path: Path, names: list[str], of_signal: int) -> int:
    """Return the column of the times of a signal."""
    signal = names[of_signal].strip()
    for index, name in enumerate(names):
        if signal.endswith("_y") and name.strip() == f"{signal[:-2]}_x":
            return index
    return _find_column(path, names, _TIME, "time")


def _unit_of_time_s(name: str) -> float:
    """Return the unit at the end of a heading, such as `time_ms` or `t [us]`; seconds without."""
    unit = _UNIT.search(name.strip())
    return 1.0 if unit is None else _UNITS_S[unit.group(1).lower()]


def _label_trace(
    values: np.ndarray,
    times_s: np.ndarray,
    *,
    ranges_m: np.ndarray | None = None,
    wavelength_m: float | None = None,
) -> xr.DataArray:
    coordinates = {"time": xr.Variable("time", times_s, {"units": "s", "long_name": "time"})}
    if ranges_m is not None:
        coordinates["range"] = xr.Variable("range", ranges_m, {"units": "m", "long_name": "range"})
    return xr.DataArray(
        values.astype(np.complex128, copy=False),
        dims=tuple(coordinates),
        coords=coordinates,
        attrs={"units": "1", "long_name": "amplitude"}
        | ({} if wavelength_m is None else {"wavelength_m": wavelength_m}),
    )
