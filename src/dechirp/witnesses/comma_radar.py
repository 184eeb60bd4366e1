"""Toyota's radar on CAN, recorded and decoded by comma, and the speed of the car."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import xarray as xr

from dechirp.results.object_lists.can_frames import CanFrame
from dechirp.results.object_lists.can_mapping import read_vendor_layout
from dechirp.results.object_lists.measured_detections import objects_to_detections
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list
from dechirp.tracking.forward_speed import ForwardSpeed, forward_speed
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_DBC = "toyota_adas.dbc"
_CAMERA_M = 2.7  # from the radar forward to comma's camera, in their ranges
_FIRST_IDENTIFIER = 528
_LATENCY_S = 0.1  # of the radar's tracks behind the speed of the car
_WANTED_M_PER_S = 0.05
_STANDING_M_PER_S = 0.5  # largest radial velocity beyond that of the car's speed
_LONGEST_GAP_S, _LONGEST_STEP_M, _MIN_LISTS = 0.3, 5.0, 5  # of one object
_TRAFFIC = (
    "none or one object stands in 734 of 1,200 lists, and 2 to 4 otherwise. The radial velocity of"
    " each has a bias of its own, which differs by {bias:.3f} m/s RMS between {n} objects. Neither"
    " a second constant nor another lag, ranges instead of velocities or the car's own speed to"
    " select the standing objects help; the guide shows the figures"
)


class CommaRadar(Witness):
    """All objects, and the own speed from standing ones."""

    folder: ClassVar[str] = "comma2k19_radar"
    source: ClassVar[str] = "commaai/comma2k19 4c7f1a6, by toyota_adas.dbc of commaai/opendbc"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare every object; raise `FileNotFoundError` without opendbc's DBC."""
        objects = assemble_vendor_list(
            _read_frames(folder), read_vendor_layout(_find_dbc(folder), "toyota-adas")
        )
        values, times_s = np.load(folder / "radar_value.npy"), np.load(folder / "radar_t.npy")
        yield Comparison(
            quantity="objects in 60 s",
            theirs=len(values),
            ours=objects.sizes["object"],
            unit="1",
            tolerance=0,
            basis="equal",
        )
        yield from _compare_objects(objects, values, times_s)
        yield from _compare_speeds(objects, folder)


def _compare_objects(
    objects: xr.Dataset, values: np.ndarray, times_s: np.ndarray
) -> Iterator[Comparison]:
    cycle = np.searchsorted(objects["cycle_time"].values, times_s, side="right") - 1
    theirs = values[np.lexsort((values[:, 5], cycle))]
    ours = objects.isel(object=np.lexsort((objects["number"].values, objects["frame"].values)))
    x, y, vx, vy = (ours[name].values for name in ("x", "y", "vx", "vy"))
    columns = {
        "number, as identifier of the message": (5, ours["number"].values + _FIRST_IDENTIFIER, "1"),
        "x, after 2.7 m to the camera": (0, x + _CAMERA_M, "m"),
        "y": (1, y, "m"),
        "range rate": (2, (vx * x + vy * y) / np.hypot(x, y), "m/s"),
    }
    for quantity, (column, numbers, unit) in columns.items():
        if len(numbers) == len(theirs):
            yield compare_arrays(
                f"{quantity} of all objects, the pair farthest apart",
                theirs[:, column],
                numbers,
                unit=unit,
                absolute=1e-9,
                basis="rounding; a step of the signals is 0.04 m or 0.025 m/s",
            )


def _compare_speeds(objects: xr.Dataset, folder: Path) -> Iterator[Comparison]:
    car_times_s = np.load(folder / "speed_t.npy")
    car_speeds = np.load(folder / "speed_value.npy")[:, 0]
    detections = objects_to_detections(
        objects, range_std_m=0.1, velocity_std_m_per_s=0.05, lateral_std_m=0.3
    )
    residual = velocities_beyond_car(detections, folder)
    standing = np.abs(residual) < _STANDING_M_PER_S
    biases = [residual[rows].mean() for rows in standing_object_rows(detections, standing)]
    traffic = _TRAFFIC.format(bias=np.std(biases), n=len(biases))
    yield Comparison(
        quantity="mean radial velocity of standing objects beyond that of the car's speed",
        theirs=0.0,
        ours=float(residual[standing].mean()),
        unit="m/s",
        tolerance=0.15,
        basis="found with comma's values, objects within 0.5 m/s",
    )
    motion = forward_speed(detections, ForwardSpeed(lag_s=_LATENCY_S))
    is_known = np.isfinite(motion["speed"].values)
    std = motion["speed_std"].values[is_known]
    car = np.interp(motion["time"].values[is_known], car_times_s, car_speeds)
    error = motion["speed"].values[is_known] - car
    is_precise = std <= _WANTED_M_PER_S
    for title, rows, cause in (
        (f"its standard error is at most {_WANTED_M_PER_S} m/s", is_precise, ""),
        ("two objects or more stand", np.ones_like(is_precise), traffic),
    ):
        yield Comparison(
            quantity=f"RMSE of the own speed, radar alone, where {title}: {rows.sum()} of"
            f" {is_known.size} times",
            theirs=0.0,
            ours=_rms(error[rows]),
            unit="m/s",
            tolerance=_WANTED_M_PER_S,
            basis="wanted, after one constant: 0.1 s of latency",
            cause=cause,
        )
    yield Comparison(
        quantity="RMS of these errors over their standard errors",
        theirs=1.0,
        ours=_rms(error / std),
        unit="1",
        tolerance=0.25,
        basis="three standard errors for 78 times, errors alike for a second",
        relation="at most",
        answer="own",
    )


def velocities_beyond_car(detections: xr.Dataset, folder: Path) -> np.ndarray:
    """Return measured radial velocities less those that the car's speed gives standing objects."""
    car_times_s = np.load(folder / "speed_t.npy")
    car_speeds = np.load(folder / "speed_value.npy")[:, 0]
    forward = np.interp(detections["time"].values - _LATENCY_S, car_times_s, car_speeds)
    residual: np.ndarray = detections["velocity"].values + forward * np.cos(
        detections["azimuth"].values
    )
    return residual


def standing_object_rows(detections: xr.Dataset, is_standing: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each standing object that is in five lists or more.

    Its number is constant, and its times and ranges have no larger steps than 0.3 s and 5 m.
    """
    numbers, times_s, ranges_m = (detections[name].values for name in ("number", "time", "range"))
    objects: list[np.ndarray] = []
    for number in np.unique(numbers):
        rows = np.flatnonzero(is_standing & (numbers == number))
        rows = rows[np.argsort(times_s[rows])]
        is_new = np.diff(times_s[rows]) > _LONGEST_GAP_S
        is_new |= np.abs(np.diff(ranges_m[rows])) > _LONGEST_STEP_M
        objects += np.split(rows, np.flatnonzero(is_new) + 1)
    return [rows for rows in objects if len(rows) >= _MIN_LISTS]


def _rms(numbers: np.ndarray) -> float:
    return float(np.sqrt(np.mean(numbers**2))) if numbers.size else np.nan


def _read_frames(folder: Path) -> list[CanFrame]:
    """Return the track messages; text arrays of NumPy lack the zeros at the end."""
    identifiers, data, times_s = (
        np.load(folder / f"raw_can_{name}.npy") for name in ("address", "data", "t")
    )
    rows = np.flatnonzero((identifiers >= _FIRST_IDENTIFIER) & (identifiers < 544))
    return [
        CanFrame(
            float(times_s[row]), int(identifiers[row]), False, bytes(data[row]).ljust(8, b"\0")
        )
        for row in rows.tolist()
    ]


def _find_dbc(folder: Path) -> Path:
    """Return the DBC beside the recordings or in an installed opendbc."""
    places = [folder / _DBC, folder.parent / "car_dbc" / _DBC]
    package = importlib.util.find_spec("opendbc")
    for location in (package.submodule_search_locations or ()) if package else ():
        places.append(Path(location) / "dbc" / _DBC)
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"{_DBC} (pip install opendbc, or copy it to the folder car_dbc)")
