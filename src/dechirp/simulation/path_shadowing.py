"""Shadowing of echoes by bodies and walls, out and back."""

from collections.abc import Sequence

import numpy as np

from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.screens import Screens, screens_of_bodies
from dechirp.scene.shadowing import shadowed_amplitudes
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.two_ray_ground import TwoRayGround
from dechirp.simulation.impairments.wall_multipath import WallMultipath
from dechirp.simulation.mirror_images import (
    Mirror,
    infer_mirrors_from_image,
    mid_run_time_s,
    up_vector_in_radar_axes,
)

# A wall within it of a mirror is that mirror.
_SAME_PLANE_M = 1e-6


def shadow_echoes(
    groups: Sequence[EchoGroup],
    window: SampleWindow,
    scene: Scene,
    radar: Radar,
    paths: Sequence[Propagation],
) -> list[EchoGroup]:
    """Multiply the gains of all antennas by the amplitudes that shadows leave.

    Positions are those in the middle of the run of chirps of each group. A path via a mirror runs
    straight from the image of its antenna: past the images of the screens up to the mirror, and
    past the screens behind it. Only a simulated road opens the gap below vehicles. Groups without
    targets, such as rain, are not shadowed.
    """
    walls = [path for path in paths if isinstance(path, WallMultipath)]
    if not (scene.has_shadows or (walls and scene.shadowing)):
        return list(groups)
    has_road = any(isinstance(path, TwoRayGround) for path in paths)
    shadowed = []
    screens_by_time: dict[float, Screens] = {}
    for group in groups:
        if group.targets is None:
            shadowed.append(group)
            continue
        time_s = mid_run_time_s(group, window)
        if time_s not in screens_by_time:
            bodies = screens_of_bodies(scene, time_s, open_to_road=has_road)
            screens_by_time[time_s] = _add_walls(bodies, walls, scene, time_s)
        shadowed.append(_shadow_group(group, screens_by_time[time_s], scene, time_s, radar))
    return shadowed


def _shadow_group(
    group: EchoGroup, screens: Screens, scene: Scene, time_s: float, radar: Radar
) -> EchoGroup:
    assert group.targets is not None
    rotation = scene.ego.axes(np.array([time_s]))[0].T
    positions_m = group.scatterers.path_m[0] @ rotation
    wavelength_m = radar.frame.chirp.wavelength_m
    tx_m, rx_m = group.transmission.tx_m, group.transmission.rx_m
    up = up_vector_in_radar_axes(scene)
    tx_mirrors, rx_mirrors = (
        [
            Mirror(mirror.normal @ rotation, mirror.offset_m)
            for mirror in infer_mirrors_from_image(np.array(nominal_m[0]), antennas_m[0], up)
        ]
        for nominal_m, antennas_m in ((radar.array.tx_m, tx_m), (radar.array.rx_m, rx_m))
    )
    if tx_mirrors or rx_mirrors:
        sides = [(tx_m, tx_mirrors), (rx_m, rx_mirrors)]
    else:
        sides = [(np.concatenate([tx_m, rx_m]), [])]
    amplitudes = np.concatenate(
        [
            shadowed_amplitudes(
                antennas_m @ rotation, positions_m, group.targets,
                _screens_along_mirrored_path(screens, mirrors), wavelength_m,
            )
            for antennas_m, mirrors in sides
        ]
    )  # fmt: skip
    scatterers = group.scatterers._replace(
        tx_gains=group.scatterers.tx_gains * amplitudes[: len(tx_m)],
        rx_gains=group.scatterers.rx_gains * amplitudes[len(tx_m) :],
    )
    return group._replace(scatterers=scatterers)


def _add_walls(
    screens: Screens, walls: Sequence[WallMultipath], scene: Scene, time_s: float
) -> Screens:
    ends_m = np.array([wall.ends_from_radar_m(scene, time_s) for wall in walls]).reshape(-1, 2)
    return Screens(
        np.concatenate([screens.corners_m, ends_m[:, [0, 1, 1, 0]]]),
        np.concatenate([screens.bands_m, np.tile([-np.inf, np.inf], (len(walls), 1, 1))]),
        np.concatenate([screens.targets, np.full(len(walls), -1)]),
    )


def _screens_along_mirrored_path(screens: Screens, mirrors: Sequence[Mirror]) -> Screens:
    """Return the screens, with their images in all mirrors, along the axes of the scene."""
    for mirror in mirrors:
        if abs(mirror.normal[2]) > 0.5:
            road_m = mirror.offset_m / mirror.normal[2]
            images_m = 2 * road_m - screens.bands_m[:, ::-1, ::-1]
            screens = screens._replace(bands_m=np.concatenate([images_m, screens.bands_m], axis=1))
            continue
        normal = complex(mirror.normal[0], mirror.normal[1])
        distances_m = (screens.corners_m * normal.conjugate()).real - mirror.offset_m
        is_mirror = (abs(distances_m) < _SAME_PLANE_M).all(axis=1)
        is_ahead = (distances_m.mean(axis=1) > 0) & ~is_mirror
        screens, distances_m = screens.select(is_ahead), distances_m[is_ahead]
        images = screens._replace(corners_m=screens.corners_m - 2 * distances_m * normal)
        screens = Screens(*(np.concatenate(pair) for pair in zip(screens, images, strict=True)))
    return screens
