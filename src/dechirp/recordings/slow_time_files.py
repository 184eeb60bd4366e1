"""Slow-time files: I/Q values of range cells over time, without chirps.

Two layouts are recognised by content.

* HDF5 of Acconeer's Exploration Tool for the sensor A121: frames of complex sweeps, one value for
  each distance. Times are the ticks of the server, distances follow from the sensor's settings.
* Text (CSV) with named columns of I and Q, and their times in seconds.

References
----------
Acconeer, A121 data sheet and documentation of the Exploration Tool (carrier 60.5 GHz, distances in
steps of `base_step_length_m`, ticks).
"""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.compiled_kernels import kernel
from dechirp.core.errors import RecordingError, quote_for_message
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.recordings.arrays.hdf5_datasets import (
    EXPECTED,
    dataset_to_lazy_array,
    find_dataset_following_links,
    open_hdf5,
)
from dechirp.recordings.arrays.lazy_array import convert_parser_errors

__all__ = ["read_slow_time"]


def __dir__() -> list[str]:
    return __all__


_INT16_PAIRS = np.dtype([("real", "<i2"), ("imag", "<i2")])
_ACCONEER_CARRIER_HZ = 60.5e9
_ENTRY = "sessions/session_0/group_0/entry_0"
_MAX_TEXT_BYTES = 2**20
_MAX_HEADING_BYTES = 2**16
_LAYOUTS = "HDF5 of Acconeer's A121, or CSV with a heading that names columns of I, Q and time"


@check_argument_types
def read_slow_time(path: str | Path, *, wavelength_m: float | None = None) -> xr.DataArray:
    """Read the slow-time values of a file that contains no chirps.

    Parameters
    ----------
    path : path
        HDF5 of Acconeer's A121, or CSV. The heading of a CSV file names a column I (also `[I]`,
        `in-phase`, `real`), a column Q (`[Q]`, `quadrature`, `imag`) and a time in seconds (`t`,
        `time`). Where each signal has columns `..._x` and `..._y`, `..._x` is its time.
    wavelength_m : float, optional
        Of the carrier, for displacements; for HDF5 of Acconeer 60.5 GHz by default.

    Returns
    -------
    DataArray (time,) or (time, range), complex
        Sweeps of a frame are averaged. The attribute `wavelength_m` is missing if it is unknown.

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
    """Read the first sensor of the first session."""
    with convert_parser_errors(path, f"{EXPECTED} of Acconeer's A121"), open_hdf5(path) as file:
        frames = find_dataset_following_links(path, file, f"{_ENTRY}/result/frame")
        ticks = find_dataset_following_links(path, file, f"{_ENTRY}/result/tick")
        if frames is None or ticks is None or frames.dtype.names != ("real", "imag"):
            raise RecordingError(
                path,
                value=f"an HDF5 file without {_ENTRY}/result with complex frames",
                expected="a file that Acconeer's Exploration Tool wrote with an A121",
                fix="open other HDF5 files with dechirp.open and name their axes",
            )
        metadata = _read_json(file, f"{_ENTRY}/metadata")
        server = _read_json(file, "server_info")
        sensor = int(file[f"{_ENTRY}/sensor_id"][()])
        group = _read_json(file, "sessions/session_0/session_config")["groups"][0]
        ranges_m = _acconeer_ranges_m(group[str(sensor)], float(metadata["base_step_length_m"]))
        ticks_per_second = float(server["ticks_per_second"])
        if frames.ndim != 3 or frames.shape[2] != len(ranges_m) or 0 in frames.shape:
            raise ValueError(f"frames of shape {frames.shape}, and {len(ranges_m)} distances")
        if ticks.shape != frames.shape[:1] or not ticks_per_second > 0:
            raise ValueError(f"{ticks.shape} ticks for {frames.shape[0]} frames")
        whole = tuple(slice(0, size) for size in frames.shape)
        parts = dataset_to_lazy_array(path, file, frames).read(whole)
        times_s = np.asarray(ticks[()], float) / ticks_per_second
    values = _mean_of_sweeps(parts)
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


def _mean_of_sweeps(parts: np.ndarray) -> np.ndarray:
    if parts.dtype == _INT16_PAIRS:
        means = np.empty((parts.shape[0], 2 * parts.shape[2]))
        _average_codes(np.ascontiguousarray(parts).view("<i2"), means)
        return means.view(np.complex128)
    if parts.dtype.names:
        real, imaginary = (parts[name].mean(axis=1, dtype=np.float64) for name in ("real", "imag"))
        return real + 1j * imaginary
    if not np.iscomplexobj(parts):
        return parts[..., 0].mean(axis=1) + 1j * parts[..., 1].mean(axis=1)
    return parts.mean(axis=1)


def _read_json(file: Any, name: str) -> Any:
    """Return a JSON text that a dataset contains."""
    dataset = file[name]
    if dataset.shape != () or dataset.dtype.kind not in "OS":
        raise TypeError(f"{name} is no text")
    text = dataset[()]
    if len(text) > _MAX_TEXT_BYTES:
        raise ValueError(f"{name} has {len(text)} bytes")
    return json.loads(text)


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
    with convert_parser_errors(path, _LAYOUTS):
        with path.open("rb") as file:
            heading = file.readline(_MAX_HEADING_BYTES).decode("utf-8-sig")
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
    return _label_trace(table[:, 1] + 1j * table[:, 2], table[:, 0])


_ROLES = {
    "I": re.compile(r"(?:.*[^a-z])?(?:i|in-?phase|re|real)(?:[^a-z].*)?", re.IGNORECASE),
    "Q": re.compile(r"(?:.*[^a-z])?(?:q|quadrature|im|imag)(?:[^a-z].*)?", re.IGNORECASE),
}
_TIME = re.compile(r"(?:t|time|timestamp)(?:[^a-z].*)?", re.IGNORECASE)


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
        values.astype(np.complex128),
        dims=tuple(coordinates),
        coords=coordinates,
        attrs={"units": "1", "long_name": "amplitude"}
        | ({} if wavelength_m is None else {"wavelength_m": wavelength_m}),
    )
