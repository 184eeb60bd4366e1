"""Positions of the targets of a scene in coordinates of the radar."""

from typing import NamedTuple

import numpy as np

from dechirp.report.figures.common import choose_body_scatterers
from dechirp.scene.rotations import to_local_axes
from dechirp.scene.scene import Scene

_MAX_POINTS = 400


class TargetPositions(NamedTuple):
    """Positions and velocities of targets at one time, in coordinates of the radar."""

    names: tuple[str, ...]
    positions_m: np.ndarray
    """(n_targets, 2)"""
    velocities_m_per_s: np.ndarray
    """(n_targets, 2), over ground."""
    scatterers_m: np.ndarray
    """(n, 2): scatterers that outline the bodies; a subset if there are many."""


def target_positions(scene: Scene, time_s: float) -> TargetPositions:
    """Return positions and velocities of targets, and scatterers of bodies."""
    at_s = np.array([time_s])
    own = to_local_axes(scene.ego.axes(at_s), scene.ego.velocities_m_per_s(at_s)[:, None])
    bodies = choose_body_scatterers(scene, _MAX_POINTS)
    return TargetPositions(
        names=scene.names,
        positions_m=scene.target_positions_m(at_s)[0, :, :2],
        velocities_m_per_s=(scene.target_velocities_m_per_s(at_s) + own)[0, :, :2],
        scatterers_m=scene.positions_m(at_s)[0, bodies, :2] if len(bodies) else np.empty((0, 2)),
    )
