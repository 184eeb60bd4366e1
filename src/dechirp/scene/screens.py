"""Screens that shadow targets: the boxes of bodies, and walls, at one time."""

from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.scene.scene import Scene

# A radar on the bumper of a body is outside of it.
_SURFACE_M = 1e-3

# Low or high x and y of the corners, to the left.
_CORNER_X, _CORNER_Y = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])


class Screens(NamedTuple):
    """Upright prisms, relative to the radar, along the axes of the scene."""

    corners_m: np.ndarray
    """(n, 4) complex: corners of each from above, x + i y, in cyclic order."""
    bands_m: np.ndarray
    """(n, n_bands, 2): lower and upper ends in height, bands from below; may be infinite."""
    targets: np.ndarray
    """(n,): target of each, -1 for walls."""

    @property
    def centres_m(self) -> np.ndarray:
        """Return the centres from above, (n,), complex."""
        return np.asarray(self.corners_m.mean(axis=1))

    @property
    def radii_m(self) -> np.ndarray:
        """Return the distance of the farthest corner from the centre, (n,)."""
        return np.asarray(abs(self.corners_m - self.centres_m[:, None]).max(axis=1, initial=0.0))

    def select(self, indices: np.ndarray) -> "Screens":
        """Return the screens of some indices, or of a mask."""
        return Screens(*(column[indices] for column in self))


def screens_of_bodies(scene: Scene, time_s: float, *, open_to_road: bool = False) -> Screens:
    """Return the boxes of the bodies that shadow, at one time.

    Bodies that stand on the ground reach down without end, since a wave below them would be
    reflected by the road; with `open_to_road`, which requires a simulated road, they end at their
    ground clearance.

    Raises
    ------
    InvalidSetting
        With the name of the target, if the radar is inside a body.
    """
    targets, _, clearances_m = scene.blocking_boxes
    if not targets.size:
        return Screens(np.zeros((0, 4), dtype=complex), np.zeros((0, 1, 2)), targets)
    times_s = np.array([time_s])
    boxes = _box_positions_corners_and_bands_m(scene, times_s)
    _check_radar_outside(scene, times_s, *boxes[1:])
    position_m, corners_m, bands_m = (part[0] for part in boxes)
    if open_to_road:
        is_standing = np.isneginf(bands_m[:, 0])
        bands_m[is_standing, 0] = (position_m[:, 2] + clearances_m)[is_standing]
    return Screens(corners_m, bands_m[:, None], targets)


def check_radar_outside_bodies(scene: Scene, times_s: np.ndarray) -> None:
    """Raise `InvalidSetting`, with the target, if the radar is inside a body at some time."""
    if scene.blocking_boxes.targets.size:
        _, corners_m, bands_m = _box_positions_corners_and_bands_m(scene, times_s)
        _check_radar_outside(scene, times_s, corners_m, bands_m)


def _box_positions_corners_and_bands_m(
    scene: Scene, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boxes of the bodies that shadow, relative to the radar, along axes of the scene.

    Positions of their targets, (n_times, n, 3); corners, (n_times, n, 4) complex; lower and upper
    ends, (n_times, n, 2).
    """
    targets, boxes_m, _ = scene.blocking_boxes
    positions_m = scene.target_offsets_from_radar_m(times_s, targets)
    headings_rad = np.stack(
        [scene.targets[index].headings_at_rad(times_s) for index in targets], axis=-1
    )
    corners_m = boxes_m[:, _CORNER_X, 0] + 1j * boxes_m[:, _CORNER_Y, 1]
    middles_m = positions_m[..., 0] + 1j * positions_m[..., 1]
    corners_m = corners_m * np.exp(1j * headings_rad)[..., None] + middles_m[..., None]
    return positions_m, corners_m, boxes_m[:, :, 2] + positions_m[..., 2, None]


def _check_radar_outside(
    scene: Scene, times_s: np.ndarray, corners_m: np.ndarray, bands_m: np.ndarray
) -> None:
    """Raise if the origin of the radar is inside a box, (n_times, n, 4) and (n_times, n, 2)."""
    sides_m = np.roll(corners_m, -1, axis=-1) - corners_m
    # Distance inwards from each side; the corners run to the left.
    lengths_m = np.maximum(abs(sides_m), 1e-12)
    inwards_m = -(corners_m * sides_m.conj()).imag / lengths_m
    low_m, high_m = bands_m[..., 0], bands_m[..., 1]
    is_inside = (
        (inwards_m > _SURFACE_M).all(axis=-1) & (low_m < -_SURFACE_M) & (high_m > _SURFACE_M)
    )
    for time, box in np.argwhere(is_inside):
        raise InvalidSetting(
            f"scene.targets.{scene.names[scene.blocking_boxes.targets[box]]}.position",
            value=f"a body around the radar after {format_si(times_s[time], 's', 4)}",
            expected="a radar outside of the boxes of all bodies",
            fix="move the target or the radar, remove the body that carries the radar, or set"
            " scene.shadowing to false",
        )
