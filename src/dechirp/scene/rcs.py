"""How much scatterers reflect on average, seen from where the radar is."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.errors import InvalidSetting
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.rotations import about_z, into
from dechirp.scene.scene import Scene


def cross_sections_m2(scene: Scene, time_s: float, wavelength_m: float) -> np.ndarray:
    """Mean cross section of each scatterer at one time, (n_scatterers,), m^2.

    Where it depends on aspect, the radar's origin is what looks: seen from the target,
    the antennas are taken to be near each other, as for the radar equation.
    """
    found = scene.fixed_rcs_m2.copy()
    for target, over_time_m2 in _over_aspect(scene, np.array([time_s]), wavelength_m):
        found[scene.owners == target] = over_time_m2[0]
    return found


def target_cross_sections_m2(scene: Scene, times_s: ArrayLike, wavelength_m: float) -> np.ndarray:
    """Mean cross section of each target, of all its scatterers, (n_times, n_targets), m^2."""
    times_s = np.asarray(times_s, dtype=float)
    sums_m2 = np.bincount(scene.owners, scene.fixed_rcs_m2, minlength=len(scene.targets))
    found = np.tile(sums_m2, (len(times_s), 1))
    for target, over_time_m2 in _over_aspect(scene, times_s, wavelength_m):
        found[:, target] = over_time_m2.sum(axis=1)
    return found


def _over_aspect(
    scene: Scene, times_s: np.ndarray, wavelength_m: float
) -> Iterator[tuple[int, np.ndarray]]:
    """Targets whose cross section depends on aspect; of their scatterers, (n_times, n)."""
    for place in scene.over_aspect:
        target = scene.targets[place]
        to_radar_m = -scene.from_radar_m(times_s, np.array([place]))
        axes = about_z(target.headings_at_rad(times_s))
        radar_m = into(axes, to_radar_m)[:, 0]
        if target.rcs_table is None:
            assert isinstance(target.body, AspectBody)
            yield place, _seen_from_m2(scene, place, target.body, radar_m, wavelength_m)
        else:
            x, y, z = radar_m.T
            seen_m2 = target.rcs_table.seen_from_m2(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
            yield place, seen_m2[:, None]


def _seen_from_m2(
    scene: Scene, place: int, body: AspectBody, radar_m: np.ndarray, wavelength_m: float
) -> np.ndarray:
    name = scene.names[place]
    try:
        found_m2 = body.seen_from_m2(radar_m, wavelength_m)
    except InvalidSetting as error:
        raise _of_target(name, error) from None
    shape = (len(radar_m), body.n_scatterers())
    if found_m2.shape != shape or not (np.isfinite(found_m2) & (found_m2 >= 0)).all():
        raise InvalidSetting(
            f"scene.targets.{name}.body",
            got="cross sections that are negative or not finite"
            if found_m2.shape == shape
            else f"cross sections of the shape {found_m2.shape}",
            need=f"finite cross sections of 0 or more, of the shape {shape}",
            fix="Correct what the body gives.",
        )
    return found_m2


def _of_target(name: str, error: InvalidSetting) -> InvalidSetting:
    """The same mistake under the path of its setting: bodies do not know their targets."""
    (mistake,) = error.mistakes
    owner, _, field = mistake.setting.partition(".")
    inner = {"Target": "", "Rays": "body.rays."}.get(owner, "body.")
    path = f"scene.targets.{name}.{inner}{field.removesuffix('_m')}"
    return InvalidSetting(path, got=mistake.got, need=mistake.need, fix=mistake.fix)
