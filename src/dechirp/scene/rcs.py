"""How much scatterers reflect on average, seen from where the radar is."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from dechirp.scene.rotations import about_z, into
from dechirp.scene.scene import Scene


def cross_sections_m2(scene: Scene, time_s: float) -> np.ndarray:
    """Mean cross section of each scatterer at one time, (n_scatterers,), m^2.

    Where it depends on aspect, the radar's origin is what looks: seen from the target,
    the antennas are taken to be near each other, as for the radar equation.
    """
    found = scene.fixed_rcs_m2.copy()
    for target, over_time_m2 in _over_aspect(scene, np.array([time_s])):
        found[np.searchsorted(scene.owners, target)] = over_time_m2[0]  # a point
    return found


def target_cross_sections_m2(scene: Scene, times_s: ArrayLike) -> np.ndarray:
    """Mean cross section of each target, of all its scatterers, (n_times, n_targets), m^2."""
    times_s = np.asarray(times_s, dtype=float)
    sums_m2 = np.bincount(scene.owners, scene.fixed_rcs_m2, minlength=len(scene.targets))
    found = np.tile(sums_m2, (len(times_s), 1))
    for target, over_time_m2 in _over_aspect(scene, times_s):
        found[:, target] = over_time_m2
    return found


def _over_aspect(scene: Scene, times_s: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Targets whose cross section depends on aspect, and theirs at each time, (n_times,)."""
    for place in scene.over_aspect:
        target = scene.targets[place]
        assert target.rcs_table is not None
        to_radar_m = -scene.from_radar_m(times_s, np.array([place]))
        axes = about_z(target.headings_at_rad(times_s))
        x, y, z = into(axes, to_radar_m)[:, 0].T
        yield place, target.rcs_table.seen_from_m2(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
