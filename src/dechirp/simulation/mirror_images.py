"""Multipath echoes off flat mirrors, computed with image antennas.

A path from an antenna to a scatterer via a mirror is as long as the straight path from the image
of the antenna. Outbound and inbound paths are mirrored independently: direct-direct,
mirrored-direct, direct-mirrored, mirrored-mirrored. Patterns apply in the direction in which the
wave leaves or arrives, towards the image of the scatterer.

A path is reflected at most once by the ground and once by a wall. An antenna and its image differ
by a vertical step for the ground and a horizontal one for a wall, from which the mirrors are
recovered: impairments that move antennas need no knowledge of each other.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow, tx_and_rx_amplitude_gains

MIN_MIRROR_DISTANCE_M = 0.1
"""Least distance of a mirror from an antenna: images are 0.2 m away, displaced antennas less."""


class Mirror(NamedTuple):
    """Flat mirror in the coordinates of the radar."""

    normal: np.ndarray
    """(3,), unit vector towards the radar."""
    offset_m: float
    """normal @ p of each point p of the mirror."""

    def signed_distances_m(self, positions_m: np.ndarray) -> np.ndarray:
        """Return the distances of points (n, 3), (n,): positive on the radar's side."""
        return np.asarray(positions_m @ self.normal - self.offset_m)

    def image_positions_m(self, positions_m: np.ndarray) -> np.ndarray:
        """Return the images of points (n, 3), (n, 3)."""
        return positions_m - 2 * self.signed_distances_m(positions_m)[:, None] * self.normal


ReflectionCoefficients = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Amplitude reflection coefficients, (n,), on the paths from the image of an antenna, (3,), to
points, (n, 3); 0 where no path exists."""


def up_vector_in_radar_axes(scene: Scene) -> np.ndarray:
    """Return the unit vector upwards, (3,), in the axes of the radar, constant over time."""
    return np.asarray(scene.ego.axes(np.zeros(1))[0].T @ np.array([0.0, 0.0, 1.0]))


def mid_run_time_s(group: EchoGroup, window: SampleWindow) -> float:
    """Return the middle of the run of chirps of a group, since time zero."""
    return float(
        window.frame_start_s
        + window.chirp_starts_s[group.chirps.start]
        - group.transmission.starts_s[0]
    )


def infer_mirrors_from_image(
    antenna_m: np.ndarray, image_m: np.ndarray, up: np.ndarray
) -> list[Mirror]:
    """Return the mirrors between an antenna, (3,), and its image: horizontal, vertical or both.

    Displacements below `MIN_MIRROR_DISTANCE_M` yield no mirror.
    """
    displacement_m = image_m - antenna_m
    vertical_m = (displacement_m @ up) * up
    mirrors = []
    for step_m in (vertical_m, displacement_m - vertical_m):
        length_m = np.linalg.norm(step_m)
        if length_m > MIN_MIRROR_DISTANCE_M:
            normal = -step_m / length_m
            mirrors.append(Mirror(normal, float(normal @ (antenna_m + step_m / 2))))
    return mirrors


def group_and_reflected_copies(
    group: EchoGroup,
    mirror: Mirror,
    coefficients: ReflectionCoefficients,
    radar: Radar,
    up: np.ndarray,
) -> Iterator[EchoGroup]:
    """Yield a group and its copies, at most three, over the paths that a mirror adds.

    Scatterers are mirrored at their positions in the middle of the run of chirps; those behind the
    mirror are skipped. Paths already mirrored by a mirror of the same orientation stay unchanged.
    """
    yield group
    outbound, inbound = (
        _mirrored_paths_or_none(group, side, mirror, coefficients, radar, up)
        for side in ("tx", "rx")
    )
    for copy in (
        outbound and outbound.apply_to(group),
        inbound and inbound.apply_to(group),
        outbound and inbound and inbound.apply_to(outbound.apply_to(group)),
    ):
        if copy is not None and (has_echo := _mask_of_scatterers_with_echo(copy)).any():
            yield copy.select(has_echo)


class _MirroredPaths(NamedTuple):
    """Mirrored paths between all antennas of a side, tx or rx, and all scatterers of a group."""

    side: str
    antennas_m: np.ndarray
    """(n_antennas, 3), images."""
    gains: np.ndarray
    """(n_antennas, n_scatterers)."""
    coefficients: np.ndarray
    """(n_scatterers,)."""

    def apply_to(self, group: EchoGroup) -> EchoGroup:
        """Return the group over these paths."""
        scatterers, transmission = group.scatterers, group.transmission
        scatterers = scatterers._replace(amplitudes=scatterers.amplitudes * self.coefficients)
        if self.side == "tx":
            scatterers = scatterers._replace(tx_gains=self.gains)
            transmission = transmission._replace(tx_m=self.antennas_m)
        else:
            scatterers = scatterers._replace(rx_gains=self.gains)
            transmission = transmission._replace(rx_m=self.antennas_m)
        return group._replace(scatterers=scatterers, transmission=transmission)


def _mirrored_paths_or_none(
    group: EchoGroup,
    side: str,
    mirror: Mirror,
    coefficients: ReflectionCoefficients,
    radar: Radar,
    up: np.ndarray,
) -> _MirroredPaths | None:
    nominal_m = np.array(getattr(radar.array, f"{side}_m"))
    current_m: np.ndarray = getattr(group.transmission, f"{side}_m")
    previous_mirrors = infer_mirrors_from_image(nominal_m[0], current_m[0], up)
    if any(_is_horizontal(other, up) == _is_horizontal(mirror, up) for other in previous_mirrors):
        return None
    images_m, positions_m = mirror.image_positions_m(current_m), group.scatterers.path_m[0]
    reflection = coefficients(images_m.mean(axis=0), positions_m)
    apparent_m = mirror.image_positions_m(positions_m)
    for other in previous_mirrors:
        apparent_m = other.image_positions_m(apparent_m)
    return _MirroredPaths(
        side,
        images_m,
        tx_and_rx_amplitude_gains(apparent_m, radar)[0 if side == "tx" else 1],
        np.where(mirror.signed_distances_m(positions_m) > 0, reflection, 0.0),
    )


def _is_horizontal(mirror: Mirror, up: np.ndarray) -> bool:
    return bool(abs(mirror.normal @ up) > 0.5)


def _mask_of_scatterers_with_echo(group: EchoGroup) -> np.ndarray:
    """Return which scatterers have an amplitude and gains above 0, (n,)."""
    amplitudes, tx_gains, rx_gains = group.scatterers[1:4]
    return np.asarray((amplitudes != 0) & tx_gains.any(axis=0) & rx_gains.any(axis=0))
