"""Association of detections with targets, and their estimation errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.errors import InvalidSetting
from dechirp.radar.radar import Radar
from dechirp.radar.resolution_cells import alias_doppler_cells, to_resolution_cells
from dechirp.scene.aliasing import (
    RangeVelocity,
    alias_range_velocity,
    apparent_range_and_velocity,
    wrap_about_zero,
)
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.scene.shadowing import scatterer_shadow_gains

GATE_CELLS = 2.0
"""Largest distance of a detection from its target, in resolution cells, on every estimated axis."""

# Scatterers 60 dB below the strongest of their body are hidden, or in a null.
_HIDDEN_RCS_RATIO = 1e-6

# Step of the range derivative: an error of 1e-8 m/s at 100 m, and wheels and rotors hardly turn.
_RANGE_RATE_STEP_S = 1e-6

# Up to this number of pairs of detections and positions, brute force is faster than a tree, which
# takes 40 us a query.
_MAX_BRUTE_FORCE_PAIRS = 2000


class Association(NamedTuple):
    """Target of each detection, -1 for none, and its errors, NaN without a target.

    A body has no single position, so its errors are NaN.
    """

    target: np.ndarray
    range_error_m: np.ndarray
    velocity_error_m_per_s: np.ndarray
    azimuth_error_rad: np.ndarray
    elevation_error_rad: np.ndarray


def associate_detections(
    detections: xr.Dataset, truth: xr.Dataset, radar: Radar, scene: Scene | None = None
) -> Association:
    """Associate each detection with the nearest target of its frame, within two cells on all axes.

    If the ambiguity number of a velocity is unknown, the direction only counts if it confirms a
    target.

    A body of the scene has the positions of its visible scatterers, including moving parts;
    without the scene, that of its origin.

    Raises
    ------
    InvalidSetting
        If a detection is in a frame that the truth does not contain.
    """
    columns = {str(name): column.values for name, column in detections.items()}
    return Associator(truth, radar, scene)(columns)


@dataclass(frozen=True, eq=False)
class Associator:
    """`associate_detections` for many sets of detections with one truth, which is prepared once.

    A trial of one target takes about 60 us, and 2 to 5 ms otherwise.
    """

    truth: xr.Dataset
    radar: Radar
    scene: Scene | None = None
    _frames: dict[int, "_FrameTargets"] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, columns: Mapping[str, np.ndarray]) -> Association:
        """Associate the columns of `processing.detect.detect`, each (n_detections,)."""
        detections = _detection_columns_or_nan(columns)
        frame_index = self._truth_frame_indices(detections.frame)
        target = self._find_nearest_target_indices(detections, frame_index)
        return Association(target, *self._estimation_errors(detections, target, frame_index))

    def nearest_target_indices(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return `Association.target` alone; the errors take as long again."""
        detections = _detection_columns_or_nan(columns)
        return self._find_nearest_target_indices(
            detections, self._truth_frame_indices(detections.frame)
        )

    def _find_nearest_target_indices(
        self, detections: "_Columns", frame_index: np.ndarray
    ) -> np.ndarray:
        target = np.full(len(frame_index), -1)
        for frame in np.unique(frame_index).tolist():
            in_frame = slice(None) if len(self._truth_frame_numbers) == 1 else frame_index == frame
            target[in_frame] = self._cached_target_cells_of_frame(frame).nearest_target_indices(
                _Columns(*(column[in_frame] for column in detections))
            )
        return target

    def _estimation_errors(
        self, detections: "_Columns", target: np.ndarray, frame_index: np.ndarray
    ) -> np.ndarray:
        """Return the errors on all four axes, (4, n), NaN without a point target."""
        expected_values, n_ambiguities = (
            self._expected_detection_values,
            self._n_resolved_ambiguities,
        )
        is_unambiguous = np.isfinite(detections.ambiguity_number)
        range_m, velocity, unaliased_range_m, unaliased_velocity, azimuth, elevation = (
            expected_values.expected[:, target, frame_index]
        )
        velocity_error = np.where(is_unambiguous, unaliased_velocity, velocity)
        velocity_error = detections.velocity - velocity_error
        period = expected_values.span_m_per_s[frame_index] * np.where(
            is_unambiguous, n_ambiguities or 1, 1
        )
        # Velocities resolved across frames of different intervals are not periodic.
        is_periodic = ~is_unambiguous | (n_ambiguities is not None)
        errors = np.stack(
            [
                detections.range - np.where(is_unambiguous, unaliased_range_m, range_m),
                np.where(is_periodic, wrap_about_zero(velocity_error, period), velocity_error),
                detections.azimuth - azimuth,
                detections.elevation - elevation,
            ]
        )
        errors[:, ~expected_values.is_point[target]] = np.nan
        return errors

    @cached_property
    def _truth_frame_numbers(self) -> np.ndarray:
        """Frame numbers of the truth."""
        return np.asarray(self.truth.frame.values)

    @property
    def _n_resolved_ambiguities(self) -> int | None:
        frame = self.radar.frame
        return frame.n_resolvable_ambiguities if frame.n_intervals == 1 else None

    @cached_property
    def _expected_detection_values(self) -> "_ExpectedValues":
        truth = self.truth.transpose("target", "frame")
        is_point = np.ones(truth.sizes["target"] + 1, dtype=bool)
        is_point[-1] = False  # no target
        if self.scene is not None:
            is_point[:-1] = [target.body is None for target in self.scene.targets]
        reported = (
            *apparent_range_and_velocity(truth, self.radar),
            *apparent_range_and_velocity(
                truth, self.radar, n_resolved_spans=self._n_resolved_ambiguities
            ),
            truth.azimuth.values,
            truth.elevation.values,
        )
        expected = np.full((len(reported), *np.add(truth.azimuth.shape, (1, 0))), np.nan)
        expected[:, :-1] = reported
        frames = [
            self.radar.for_frame(number).frame for number in self._truth_frame_numbers.tolist()
        ]
        span = np.array([2 * frame.max_velocity_m_per_s for frame in frames])
        return _ExpectedValues(expected, is_point, span)

    def _truth_frame_indices(self, frame_numbers: np.ndarray) -> np.ndarray:
        """Return the index in the truth of the frame of each detection."""
        order = np.argsort(self._truth_frame_numbers)
        indices = np.searchsorted(self._truth_frame_numbers[order], frame_numbers)
        indices = order[np.minimum(indices, len(order) - 1)]
        unknown = np.flatnonzero(self._truth_frame_numbers[indices] != frame_numbers)
        if unknown.size:
            raise InvalidSetting(
                "detections.frame",
                value=f"{frame_numbers[unknown[0]]:g}",
                expected="a frame of the truth",
                fix="compute the truth of all frames with detections",
            )
        return np.asarray(indices)

    def _cached_target_cells_of_frame(self, frame_index: int) -> "_FrameTargets":
        """Return the target cells of a frame by its index in the truth; cached."""
        if frame_index not in self._frames:
            self._frames[frame_index] = self._target_cells_of_frame(frame_index)
        return self._frames[frame_index]

    def _target_cells_of_frame(self, frame_index: int) -> "_FrameTargets":
        radar = self.radar.for_frame(int(self._truth_frame_numbers[frame_index]))
        if self.scene is not None:
            return _target_cells_of_scene(self.scene, float(self.truth.time[frame_index]), radar)
        range_m, velocity, _, _, azimuth, elevation = self._expected_detection_values.expected[
            :, :-1, frame_index
        ]
        cells = to_resolution_cells(range_m, velocity, azimuth, elevation, radar)
        return _FrameTargets(
            radar, np.arange(len(range_m)), alias_doppler_cells(cells, radar.frame.n_chirps)
        )


class _Columns(NamedTuple):
    """Columns of detections, each (n,); NaN for missing columns."""

    frame: np.ndarray
    range: np.ndarray
    velocity: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    ambiguity_number: np.ndarray


class _ExpectedValues(NamedTuple):
    """Expected values of detections. The last row of targets is that of no target, NaN."""

    expected: np.ndarray
    """(6, targets + 1, frames): range and velocity, aliased, then in all resolvable ambiguities,
    azimuth and elevation.
    """
    is_point: np.ndarray
    """True for point targets, (targets + 1,)."""
    span_m_per_s: np.ndarray
    """Unambiguous velocity span, (frames,)."""


@dataclass(frozen=True, eq=False)
class _FrameTargets:
    """Resolution cells of the targets of one frame."""

    radar: Radar
    """The radar in this frame."""
    owners: np.ndarray
    """Target of each cell position, (n_positions,)."""
    cells: np.ndarray
    """Positions in resolution cells, (n_positions, 4), aliased."""
    _trees: "dict[tuple[bool, ...], scipy.spatial.KDTree]" = field(
        default_factory=dict, init=False, repr=False
    )

    def nearest_target_indices(self, detections: _Columns) -> np.ndarray:
        """Return the target of each detection, -1 for none."""
        angles = detections.azimuth, detections.elevation
        cells = to_resolution_cells(detections.range, detections.velocity, *angles, self.radar)
        cells = alias_doppler_cells(cells, self.radar.frame.n_chirps)
        target = self._nearest_target_indices_within_gate(cells)
        if len(self.radar.array.tx_m) > 1:
            # With simultaneous transmitters, directions depend on the ambiguity number.
            is_unassigned = (target < 0) & np.isnan(detections.ambiguity_number)
            if is_unassigned.any():
                cells[is_unassigned, 2:] = np.nan
                target[is_unassigned] = self._nearest_target_indices_within_gate(
                    cells[is_unassigned]
                )
        return target

    def _nearest_target_indices_within_gate(self, cells: np.ndarray) -> np.ndarray:
        """Return the owner of the nearest position, -1 if none is within two cells."""
        if not len(self.owners):
            return np.full(len(cells), -1)
        if len(cells) * len(self.owners) > _MAX_BRUTE_FORCE_PAIRS:
            return self._nearest_target_indices_by_tree(cells)
        distances = abs(cells[:, None] - self.cells)
        velocity_distance = distances[..., 1]  # velocities are periodic
        np.minimum(
            velocity_distance, self.radar.frame.n_chirps - velocity_distance, out=velocity_distance
        )
        distances[np.isnan(cells)[:, None].repeat(len(self.owners), axis=1)] = 0.0
        farthest = distances.max(axis=-1)
        nearest = farthest.argmin(axis=1)
        is_near = farthest[np.arange(len(cells)), nearest] <= GATE_CELLS
        return np.where(is_near, self.owners[nearest], -1)

    def _nearest_target_indices_by_tree(self, cells: np.ndarray) -> np.ndarray:
        """Search many positions with a tree: a detection may be near 100,000 scatterers."""
        owners = np.full(len(cells), -1)
        is_known = np.isfinite(cells)
        for axes in np.unique(is_known, axis=0):
            has_axes = (is_known == axes).all(axis=1)
            distances, nearest = self._cached_kd_tree(axes).query(
                cells[np.ix_(has_axes, axes)], p=np.inf
            )
            is_near = distances <= GATE_CELLS
            owners[has_axes] = np.where(is_near, self.owners[nearest % len(self.owners)], -1)
        return owners

    def _cached_kd_tree(self, axes: np.ndarray) -> "scipy.spatial.KDTree":
        """Return the search tree of the positions on the given axes; cached."""
        key = tuple(axes.tolist())
        if key not in self._trees:
            periods = np.array([0, self.radar.frame.n_chirps, 0, 0])
            self._trees[key] = scipy.spatial.KDTree(self.cells[:, axes], boxsize=periods[axes])
        return self._trees[key]


def nearest_target_indices(
    columns: Mapping[str, np.ndarray], scene: Scene, radar: Radar
) -> np.ndarray:
    """Return the target of each detection of the first frame of a scene, -1 for none.

    As `Associator` with the scene, without the truth, which takes as long again.
    """
    cells = _target_cells_of_scene(scene, radar.frame.mid_frame_s, radar)
    return cells.nearest_target_indices(_detection_columns_or_nan(columns))


def _target_cells_of_scene(scene: Scene, time_s: float, radar: Radar) -> _FrameTargets:
    """Return the cells of all visible scatterers at one time."""
    motion, positions_m = _scatterer_motion_and_positions_m(scene, np.array([time_s]))
    # Shadows need them, too: 0.4 ms of 2.2 for a walking person and four points.
    scene.latest_value("positions", (time_s,), lambda: positions_m[0])
    is_visible = visible_scatterer_mask(scene, time_s, radar)
    range_m, velocity = alias_range_velocity(
        RangeVelocity(*(values[0, is_visible] for values in motion)), radar
    )
    x, y, z = positions_m[0, is_visible].T
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    cells = to_resolution_cells(range_m, velocity, azimuth, elevation, radar)
    return _FrameTargets(
        radar,
        scene.target_index_of_scatterer[is_visible],
        alias_doppler_cells(cells, radar.frame.n_chirps),
    )


def scatterer_range_and_range_rate(scene: Scene, times_s: ArrayLike) -> RangeVelocity:
    """Return range and range rate of each scatterer at each time, (n_times, n_scatterers)."""
    return _scatterer_motion_and_positions_m(scene, np.asarray(times_s, dtype=float))[0]


def _scatterer_motion_and_positions_m(
    scene: Scene, times_s: np.ndarray
) -> tuple[RangeVelocity, np.ndarray]:
    """Return range and range rate of each scatterer, and its position (n_times, n, 3)."""
    moments_s = np.add.outer([-_RANGE_RATE_STEP_S, 0.0, _RANGE_RATE_STEP_S], times_s)
    positions_m = np.split(scene.scatterer_positions_m(moments_s.ravel()), 3)
    before_m, at_m, after_m = np.linalg.norm(positions_m, axis=-1)
    return RangeVelocity(at_m, (after_m - before_m) / (2 * _RANGE_RATE_STEP_S)), positions_m[1]


def visible_scatterer_mask(scene: Scene, time_s: float, radar: Radar) -> np.ndarray:
    """Return True for scatterers that reflect: not those on the far side of a car, or behind it."""
    wavelength_m = radar.frame.chirp.wavelength_m
    rcs_m2 = scatterer_cross_sections_m2(scene, time_s, wavelength_m)
    strongest_m2 = np.zeros(len(scene.targets))
    np.maximum.at(strongest_m2, scene.target_index_of_scatterer, rcs_m2)
    visible_m2 = rcs_m2 * scatterer_shadow_gains(scene, time_s, wavelength_m)
    return visible_m2 > _HIDDEN_RCS_RATIO * strongest_m2[scene.target_index_of_scatterer]


def _detection_columns_or_nan(columns: Mapping[str, np.ndarray]) -> _Columns:
    """Return the columns of detections, NaN for missing ones."""
    none = np.full(len(columns["range"]), np.nan)
    return _Columns(*(np.asarray(columns.get(name, none)) for name in _Columns._fields))
