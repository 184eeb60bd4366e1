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
    targets, boxes_m, clearances_m = scene.blocking_boxes
    if not targets.size:
        return Screens(np.zeros((0, 4), dtype=complex), np.zeros((0, 1, 2)), targets)
    position_m = scene.target_offsets_from_radar_m([time_s], targets)[0]
    heading_rad = np.array(
        [scene.targets[index].headings_at_rad(np.array([time_s]))[0] for index in targets]
    )
    corners_m = boxes_m[:, _CORNER_X, 0] + 1j * boxes_m[:, _CORNER_Y, 1]
    middle_m = position_m[:, 0] + 1j * position_m[:, 1]
    corners_m = corners_m * np.exp(1j * heading_rad)[:, None] + middle_m[:, None]
    bands_m = boxes_m[:, None, :, 2] + position_m[:, 2, None, None]
    screens = Screens(corners_m, bands_m, targets)
    _check_radar_outside(scene, screens, time_s)
    if open_to_road:
        is_standing = np.isneginf(bands_m[:, 0, 0])
        bands_m[is_standing, 0, 0] = (position_m[:, 2] + clearances_m)[is_standing]
    return screens


def _check_radar_outside(scene: Scene, screens: Screens, time_s: float) -> None:
    """Raise if the origin of the radar is inside a screen."""
    sides_m = np.roll(screens.corners_m, -1, axis=1) - screens.corners_m
    # Distance inwards from each side; the corners run to the left.
    lengths_m = np.maximum(abs(sides_m), 1e-12)
    inwards_m = -(screens.corners_m * sides_m.conj()).imag / lengths_m
    low_m, high_m = screens.bands_m[:, 0].T
    is_inside = (inwards_m > _SURFACE_M).all(axis=1) & (low_m < -_SURFACE_M) & (high_m > _SURFACE_M)
    for screen in np.flatnonzero(is_inside):
        raise InvalidSetting(
            f"scene.targets.{scene.names[screens.targets[screen]]}.position",
            value=f"a body around the radar after {format_si(time_s, 's', 4)}",
            expected="a radar outside of the boxes of all bodies",
            fix="move the target or the radar, remove the body that carries the radar, or set"
            " scene.shadowing to false",
        )
