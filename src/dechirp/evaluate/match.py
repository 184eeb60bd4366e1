"""Detections beside the truth: which belongs to which, and how far off it is."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from dechirp.core.errors import InvalidSetting
from dechirp.radar.cells import in_cells, in_one_fold
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, folded, seen, wrapped
from dechirp.scene.rcs import cross_sections_m2
from dechirp.scene.scene import Scene

CELLS = 2.0
"""A detection is its target's within two resolution cells on every estimated axis."""

# What reflects 60 dB less than the strongest of its body is hidden, or in a null.
_HIDDEN = 1e-6

# Ranges are differenced over it: 1e-8 m/s off at 100 m, and wheels and rotors do not turn.
_MOMENT_S = 1e-6

# Pairs of a detection and a place whose distances are all taken: up to as many a tree, which is
# made once but asked in 40 us, is slower.
_FEW_PAIRS = 2000

_AXES = ("range", "velocity", "azimuth", "elevation")


class Match(NamedTuple):
    """For each detection: its target, -1 for none, and its errors, NaN where there is none.

    A body has no one place to be off from: NaN.
    """

    target: np.ndarray
    range_error_m: np.ndarray
    velocity_error_m_per_s: np.ndarray
    azimuth_error_rad: np.ndarray
    elevation_error_rad: np.ndarray


def match(
    detections: xr.Dataset, truth: xr.Dataset, radar: Radar, scene: Scene | None = None
) -> Match:
    """Give each detection to the nearest target of its frame, within two cells on every axis.

    Where the fold of a velocity is not known its direction counts only if there is a target in it.

    A body of the scene is where its scatterers are, on parts that move as well, the hidden ones
    left out; without the scene it is where its origin is.

    Raises
    ------
    InvalidSetting
        If there are detections in a frame that the truth has not.
    """
    columns = {str(name): column.values for name, column in detections.items()}
    return Matcher(truth, radar, scene)(columns)


@dataclass(frozen=True, eq=False)
class Matcher:
    """`match` for many sets of detections beside one truth, which is made ready once.

    A trial of one target takes some 60 us so, and 2 to 5 ms otherwise.
    """

    truth: xr.Dataset
    radar: Radar
    scene: Scene | None = None
    _frames: dict[int, "_Frame"] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, columns: Mapping[str, np.ndarray]) -> Match:
        """Match the columns of `process.detect.detect`, each (n_detections,)."""
        found = _columns(columns)
        at = self._places_of(found.frame)
        target = self._nearest(found, at)
        return Match(target, *self._errors(found, target, at))

    def targets(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """`Match.target` by itself: how far off they are takes as long again."""
        found = _columns(columns)
        return self._nearest(found, self._places_of(found.frame))

    def _nearest(self, found: "_Columns", at: np.ndarray) -> np.ndarray:
        target = np.full(len(at), -1)
        for frame in np.unique(at).tolist():
            own = slice(None) if len(self._numbers) == 1 else at == frame
            target[own] = self._frame(frame).nearest(_Columns(*(each[own] for each in found)))
        return target

    def _errors(self, found: "_Columns", target: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Of all four axes, (4, n), NaN where there is no place to be off from."""
        known, n_folds = self._known, self._n_folds
        is_unfolded = np.isfinite(found.fold)
        range_m, velocity, unfolded_m, unfolded, azimuth, elevation = known.expected[:, target, at]
        off = np.where(is_unfolded, unfolded, velocity)
        off = found.velocity - off
        within = known.span_m_per_s[at] * np.where(is_unfolded, n_folds or 1, 1)
        # What frames of all intervals tell together does not go round.
        goes_round = ~is_unfolded | (n_folds is not None)
        errors = np.stack(
            [
                found.range - np.where(is_unfolded, unfolded_m, range_m),
                np.where(goes_round, wrapped(off, within), off),
                found.azimuth - azimuth,
                found.elevation - elevation,
            ]
        )
        errors[:, ~known.has_place[target]] = np.nan
        return errors

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Of the frames of the truth."""
        return np.asarray(self.truth.frame.values)

    @property
    def _n_folds(self) -> int | None:
        frame = self.radar.frame
        return frame.n_folds if frame.n_intervals == 1 else None

    @cached_property
    def _known(self) -> "_Known":
        truth = self.truth.transpose("target", "frame")
        has_place = np.ones(truth.sizes["target"] + 1, dtype=bool)
        has_place[-1] = False  # that of no target
        if self.scene is not None:
            has_place[:-1] = [target.body is None for target in self.scene.targets]
        reported = (
            *seen(truth, self.radar),
            *seen(truth, self.radar, folds=self._n_folds),
            truth.azimuth.values,
            truth.elevation.values,
        )
        expected = np.full((len(reported), *np.add(truth.azimuth.shape, (1, 0))), np.nan)
        expected[:, :-1] = reported
        frames = [self.radar.at(number).frame for number in self._numbers.tolist()]
        span = np.array([2 * frame.max_velocity_m_per_s for frame in frames])
        return _Known(expected, has_place, span)

    def _places_of(self, numbers: np.ndarray) -> np.ndarray:
        """Place in the truth of the frame of each detection."""
        order = np.argsort(self._numbers)
        at = np.searchsorted(self._numbers[order], numbers)
        at = order[np.minimum(at, len(order) - 1)]
        wrong = np.flatnonzero(self._numbers[at] != numbers)
        if wrong.size:
            raise InvalidSetting(
                "detections.frame",
                got=f"{numbers[wrong[0]]:g}",
                need="a frame of the truth",
                fix="Make the truth of as many frames as were detected in.",
            )
        return np.asarray(at)

    def _frame(self, at: int) -> "_Frame":
        """Where targets are looked for in a frame, its place in the truth; made when asked."""
        if at not in self._frames:
            self._frames[at] = self._prepared(at)
        return self._frames[at]

    def _prepared(self, at: int) -> "_Frame":
        one = self.radar.at(int(self._numbers[at]))
        if self.scene is None:
            range_m, velocity, _, _, azimuth, elevation = self._known.expected[:, :-1, at]
            owners = np.arange(len(range_m))
        else:
            shown = visible(self.scene, float(self.truth.time[at]), self.radar)
            owners, time_s = self.scene.owners[shown], self.truth.time.values[at : at + 1]
            moving = scatterers(self.scene, time_s)
            range_m, velocity = folded(Place(*(of[0, shown] for of in moving)), one)
            x, y, z = self.scene.positions_m(time_s)[0, shown].T
            azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
        n_chirps = one.frame.n_chirps
        places = in_one_fold(in_cells(range_m, velocity, azimuth, elevation, one), n_chirps)
        return _Frame(one, owners, places)


class _Columns(NamedTuple):
    """Of detections, each (n,); NaN where there is no such column."""

    frame: np.ndarray
    range: np.ndarray
    velocity: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    fold: np.ndarray


class _Known(NamedTuple):
    """What detections are expected to say. The last row of targets is that of none, NaN."""

    expected: np.ndarray
    """(6, targets + 1, frames): range and velocity, folded, then in all folds that are told,
    azimuth and elevation."""
    has_place: np.ndarray
    """Whether it is a point, (targets + 1,)."""
    span_m_per_s: np.ndarray
    """Of unambiguous velocities, (frames,)."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """Places of one frame that detections are looked for about."""

    radar: Radar
    """As it is in the frame."""
    owners: np.ndarray
    """Target of each place, (n_places,)."""
    places: np.ndarray
    """In resolution cells, (n_places, 4), of one fold."""
    _trees: dict[tuple[bool, ...], KDTree] = field(default_factory=dict, init=False, repr=False)

    def nearest(self, found: _Columns) -> np.ndarray:
        """Target of each detection, -1 for none."""
        angles = found.azimuth, found.elevation
        cells = in_cells(found.range, found.velocity, *angles, self.radar)
        cells = in_one_fold(cells, self.radar.frame.n_chirps)
        target = self._owners_of(cells)
        if len(self.radar.array.tx_m) > 1:
            # Transmitters that share chirps tell directions with the fold.
            again = (target < 0) & np.isnan(found.fold)
            if again.any():
                cells[again, 2:] = np.nan
                target[again] = self._owners_of(cells[again])
        return target

    def _owners_of(self, cells: np.ndarray) -> np.ndarray:
        """Owner of the place nearest to each, -1 where none is within two cells."""
        if not len(self.owners):
            return np.full(len(cells), -1)
        if len(cells) * len(self.owners) > _FEW_PAIRS:
            return self._by_tree(cells)
        apart = abs(cells[:, None] - self.places)
        around = apart[..., 1]  # velocities go round
        np.minimum(around, self.radar.frame.n_chirps - around, out=around)
        apart[np.isnan(cells)[:, None].repeat(len(self.owners), axis=1)] = 0.0
        farthest = apart.max(axis=-1)
        nearest = farthest.argmin(axis=1)
        is_near = farthest[np.arange(len(cells)), nearest] <= CELLS
        return np.where(is_near, self.owners[nearest], -1)

    def _by_tree(self, cells: np.ndarray) -> np.ndarray:
        """The same for many: a detection may have 100,000 scatterers about it."""
        out = np.full(len(cells), -1)
        known = np.isfinite(cells)
        for axes in np.unique(known, axis=0):
            own = (known == axes).all(axis=1)
            apart, nearest = self._tree(axes).query(cells[np.ix_(own, axes)], p=np.inf)
            is_near = apart <= CELLS
            out[own] = np.where(is_near, self.owners[nearest % len(self.owners)], -1)
        return out

    def _tree(self, axes: np.ndarray) -> KDTree:
        """Of the places on those axes."""
        key = tuple(axes.tolist())
        if key not in self._trees:
            around = np.array([0, self.radar.frame.n_chirps, 0, 0])
            self._trees[key] = KDTree(self.places[:, axes], boxsize=around[axes])
        return self._trees[key]


def scatterers(scene: Scene, times_s: ArrayLike) -> Place:
    """Range of each scatterer at each time and its rate of change, (n_times, n_scatterers)."""
    times_s = np.asarray(times_s, dtype=float)
    moments_s = np.add.outer([-_MOMENT_S, 0.0, _MOMENT_S], times_s)
    ranges_m = np.linalg.norm(scene.positions_m(moments_s.ravel()), axis=-1)
    before_m, at_m, after_m = ranges_m.reshape(*moments_s.shape, -1)
    return Place(at_m, (after_m - before_m) / (2 * _MOMENT_S))


def visible(scene: Scene, time_s: float, radar: Radar) -> np.ndarray:
    """Whether each scatterer sends something back: not those on the far side of a car."""
    rcs_m2 = cross_sections_m2(scene, time_s, radar.frame.chirp.wavelength_m)
    strongest_m2 = np.zeros(len(scene.targets))
    np.maximum.at(strongest_m2, scene.owners, rcs_m2)
    return rcs_m2 > _HIDDEN * strongest_m2[scene.owners]


def _columns(columns: Mapping[str, np.ndarray]) -> _Columns:
    """Columns of detections, NaN where there is none."""
    none = np.full(len(columns["range"]), np.nan)
    return _Columns(*(np.asarray(columns.get(name, none)) for name in _Columns._fields))
