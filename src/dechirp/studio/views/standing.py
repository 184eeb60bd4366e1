"""Where the targets of a scene stand, seen from above by the radar."""

from typing import NamedTuple

import numpy as np

from dechirp.report.places import in_bodies
from dechirp.scene.rotations import into
from dechirp.scene.scene import Scene

_MOST_POINTS = 400


class Standing(NamedTuple):
    """Targets at one time, x and y in coordinates of the radar."""

    names: tuple[str, ...]
    places_m: np.ndarray
    """(n_targets, 2)"""
    velocities_m_per_s: np.ndarray
    """(n_targets, 2), over ground."""
    points_m: np.ndarray
    """(n, 2): scatterers of bodies, which tell their outline; of many, some."""


def standing(scene: Scene, time_s: float) -> Standing:
    """Where targets are, where they go, and what bodies look like."""
    at_s = np.array([time_s])
    own = into(scene.ego.axes(at_s), scene.ego.velocities_m_per_s(at_s)[:, None])
    bodies = in_bodies(scene, _MOST_POINTS)
    return Standing(
        names=scene.names,
        places_m=scene.target_positions_m(at_s)[0, :, :2],
        velocities_m_per_s=(scene.target_velocities_m_per_s(at_s) + own)[0, :, :2],
        points_m=scene.positions_m(at_s)[0, bodies, :2] if len(bodies) else np.empty((0, 2)),
    )
