"""Functional tests of TI's group tracker, gtrack: points and reference tracks of six scenes."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import xarray as xr

from dechirp.tracking.groups import track_groups
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_INTERVAL_S = 0.4
_POSITION_LIMIT_M, _SINE_LIMIT_M, _VELOCITY_LIMIT_M_PER_S = 0.76, 0.47, 3.33
_SINE_TESTS = (3, 4)
_BASIS = "limit of TI's test for each coordinate"


class TiGtrack(Witness):
    """Number, position and velocity of tracks in TI's tests, with the default settings."""

    folder: ClassVar[str] = "ti_gtrack"
    source: ClassVar[str] = "TI mmWave SDK 1.2, functional test of gtrack"
    licence: ClassVar[str] = "BSD-3-Clause"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the track nearest to each reference, in every frame."""
        for test, frames in enumerate(_read_tests(folder / "gtracker_testdata.dat")):
            tracks = track_groups(_to_points(frames), np.arange(len(frames)) * _INTERVAL_S)
            name = f"test {test}"
            counts = np.isfinite(tracks.x.values).sum(axis=0)
            references = [reference for _, reference in frames]
            yield compare_arrays(
                f"{name}, tracks in {len(frames)} frames",
                [len(reference) for reference in references],
                counts,
                unit="1",
                basis="the same number",
            )
            theirs, ours = _pair_states(references, tracks)
            limit_m = _SINE_LIMIT_M if test in _SINE_TESTS else _POSITION_LIMIT_M
            for quantity, columns, unit, limit in (
                ("position", slice(0, 2), "m", limit_m),
                ("velocity", slice(2, 4), "m/s", _VELOCITY_LIMIT_M_PER_S),
            ):
                yield compare_arrays(
                    f"{name}, {quantity} farthest from its reference",
                    theirs[:, columns],
                    ours[:, columns],
                    unit=unit,
                    basis=_BASIS,
                    absolute=limit,
                )


def _read_tests(path: Path) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """Return points (n, 3) and reference states (n, 4) of the frames of all tests.

    Points are range, angle to the right of the y axis, and range rate; states are x, y, vx, vy.
    """
    lines = iter(path.read_text("ascii").split())
    n_tests, n_frames = int(next(lines)), int(next(lines))

    def read_rows(n_rows: int, n_columns: int) -> np.ndarray:
        rows = [next(lines).split(",") for _ in range(n_rows)]
        return np.array(rows, float).reshape(n_rows, n_columns)

    def read_frame() -> tuple[np.ndarray, np.ndarray]:
        points = read_rows(int(next(lines).removeprefix("NUM=")), 3)
        return points, read_rows(int(next(lines)), 4)

    return [[read_frame() for _ in range(n_frames)] for _ in range(n_tests)]


def _to_points(frames: list[tuple[np.ndarray, np.ndarray]]) -> xr.Dataset:
    """Return the points of all frames in the axes of TI's x and y."""
    range_m, angle, velocity = np.concatenate([points for points, _ in frames]).T
    columns = {
        "frame": np.repeat(np.arange(len(frames)), [len(points) for points, _ in frames]),
        "range": range_m,
        "azimuth": np.pi / 2 - angle,
        "velocity": velocity,
    }
    return xr.Dataset({name: ("detection", column) for name, column in columns.items()})


def _pair_states(references: list[np.ndarray], tracks: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return each reference and the state of the nearest track, (n, 4); NaN without a track."""
    names = ("x", "y", "vx", "vy")
    states = np.stack([tracks[name].values for name in names], axis=-1)
    states = np.concatenate([states, np.full((1, *states.shape[1:]), np.nan)])
    ours = []
    for frame, reference in enumerate(references):
        offset = states[:, frame, None, :2] - reference[:, :2]
        distance = np.nan_to_num(np.hypot(offset[..., 0], offset[..., 1]), nan=np.inf)
        ours.append(states[distance.argmin(axis=0), frame])
    return np.concatenate(references), np.concatenate(ours)
