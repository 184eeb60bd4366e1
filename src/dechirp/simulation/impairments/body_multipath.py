"""Body multipath: ghost targets by reflection off the flat sides of trucks, walls and rails."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.screens import screens_of_bodies
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.two_ray_ground import fresnel_coefficients
from dechirp.simulation.mirror_images import (
    MIN_MIRROR_DISTANCE_M,
    Mirror,
    group_and_reflected_copies,
    mid_run_time_s,
    up_vector_in_radar_axes,
)

_METAL = 1e6  # of the permittivity: reflects 99.6 % of the power at normal incidence
# Times within a run of chirps at which mirrors are placed, in halves of the run; terms of the fit.
_NODES = np.array([-1.0, -0.5, 0.5, 1.0])
_N_TERMS = 3
_N_NEWTON_STEPS = 4
# Square of the sum of the unit vectors of both paths, from which one displacement stands for the
# motion of the image; below, the target is within 8 degrees of the line from mirror to radar.
_MIN_SQUARE = 0.02
_DERIVATIVE_STEP_S = 1e-4


class _Face(NamedTuple):
    """Flat vertical side of a body, in the coordinates of the radar at one time."""

    target: int
    mirror: Mirror
    start_m: np.ndarray
    """(3,): one end; its height does not count."""
    along: np.ndarray
    """(3,): unit vector to the other end."""
    length_m: float
    band_m: np.ndarray
    """(2,): lower and upper end, along `up`."""
    up: np.ndarray
    permittivity: float

    def coefficients(self, image_m: np.ndarray, positions_m: np.ndarray) -> np.ndarray:
        """Return the coefficients of paths from an image, (3,), to points, (n, 3)."""
        behind_m = -self.mirror.signed_distances_m(image_m[None])
        ahead_m = np.maximum(self.mirror.signed_distances_m(positions_m), 0.0)
        path_m = positions_m - image_m
        points_m = image_m + (behind_m / (behind_m + ahead_m))[:, None] * path_m
        along_m, height_m = (points_m - self.start_m) @ self.along, points_m @ self.up
        is_on_face = (along_m >= 0) & (along_m <= self.length_m)
        is_on_face &= (height_m >= self.band_m[0]) & (height_m <= self.band_m[1])
        sines = abs(path_m @ self.mirror.normal) / np.linalg.norm(path_m, axis=-1)
        # The field is vertical: across the plane of incidence of an upright mirror, as a
        # horizontal one is to the road.
        return np.where(
            is_on_face, fresnel_coefficients(sines, self.permittivity, "horizontal"), 0.0
        )


@frozen_dataclass
class BodyMultipath(Propagation):
    r"""Reflections off the flat vertical sides of bodies: two-bounce and three-bounce ghosts.

    A long flat side of a body (a truck, a wall, the beam of a guard rail) mirrors all other targets
    on its outer side; foliage and curved bodies are no mirrors. With the image a' of an antenna a
    in the moving side, a path via the mirror is as long as the straight one from a' to the
    scatterer p (image method), so that a ghost has range, velocity and two directions of its own:

    .. math:: R = \tfrac12 (|p - a'| + |p - a|), \quad v = \dot R

    with the mirror on the way out (order outbound) or back (inbound), and :math:`R = |p - a'|` with
    both. The receivers observe outbound ghosts at the angle of the target, inbound ones at that of
    its image. A path exists if its point of reflection is within the length and the height of the
    side, for each scatterer in the middle of a run of chirps. Powers follow the radar equation with
    both path lengths, the cross section of the direct path, and Fresnel's coefficient for a field
    that is vertical, at the angle of incidence :math:`\theta`,

    .. math:: \Gamma = \frac{\cos\theta - \sqrt{\epsilon - \sin^2\theta}}
        {\cos\theta + \sqrt{\epsilon - \sin^2\theta}}

    Notes
    -----
    Walls have the permittivity that reflects the share R (1 - S^2) of their settings at normal
    incidence: with S = 0.4, within 0.8 dB of (1 - S^2) times that of R at all angles.

    Sides are flat and smooth, with sharp edges: a hard limit replaces the Fresnel zone, and the
    profile of a real beam weakens its reflections further, for which `loss` stands. Paths via two
    bodies are left out, and of moving mirrors those of one bounce to targets within 8 deg of the
    line between mirror and radar. Bodies shadow these paths too. Moving sides are followed within
    1 mm (`test_body_multipath.py`).

    References
    ----------
    C. A. Balanis, Advanced Engineering Electromagnetics, 2nd ed. (2012), 5.3 and 7.4.
    """

    min_length_m: float = 4.0
    """Least length of a side that reflects: 4 m includes cars' sides of more than that, trucks,
    walls and rails."""
    permittivity: float = _METAL
    """Relative permittivity of the sides, a ratio; 1e6 metal, 5.24 concrete (ITU-R P.2040). Walls
    have that of their own `reflectivity`."""
    loss: float = 1.0
    """Further loss of power at each reflection (dB in files)."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "min_length_m")
        check_positive_fields(self, "permittivity", at_least=1.001, at_most=1e6)
        check_positive_fields(self, "loss", at_least=1.0)

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Yield each group, and its copies over the paths that each side adds."""
        scene, upwards = _with_boxes(scene), up_vector_in_radar_axes(scene)
        result: list[EchoGroup] = []
        for group in groups:
            result.append(group)
            if group.targets is None:
                continue
            mid_s = mid_run_time_s(group, window)
            for key, face in self._faces_towards_radar(scene, mid_s).items():
                others = group.select(group.targets != face.target)
                if not others.scatterers.amplitudes.size:
                    continue

                def coefficients(
                    image_m: np.ndarray, positions_m: np.ndarray, face: _Face = face
                ) -> np.ndarray:
                    return self._coefficients(face, image_m, positions_m)

                _, *copies = group_and_reflected_copies(
                    others, face.mirror, coefficients, radar, upwards
                )
                if copies:
                    local_s = _NODES * _half_run_s(group, window)
                    mirrors = [
                        self._faces(scene, mid_s + time_s)[key].mirror
                        for time_s in local_s.tolist()
                    ]
                    result += [
                        _follow_mirror(copy, others, face.mirror, mirrors, local_s)
                        for copy in copies
                    ]
        return result

    def ghosts(self, scene: Scene, radar: Radar, *, frame: int = 0) -> xr.Dataset:
        """Return the ghosts of the origins of all targets, as a label of detections.

        Shadows are not applied: some of these ghosts may be hidden by other bodies.

        Returns
        -------
        Dataset over `ghost`
            In the middle of the frame, from the origin of the array: `target`, `mirror` (names),
            `order` (outbound, inbound or both), `range` (m), `velocity` (m/s), and `azimuth` (rad),
            at which the wave arrives.
        """
        scene = _with_boxes(scene)
        time_s = radar.frame.frame_start_s(frame) + radar.frame.for_frame(frame).mid_frame_s
        rows = []
        origin_m = np.zeros(3)
        for key, face in self._faces_towards_radar(scene, time_s).items():
            position_m = scene.target_positions_m([time_s])[0]
            coefficients = self._coefficients(
                face, face.mirror.image_positions_m(origin_m[None])[0], position_m
            )
            is_ahead = face.mirror.signed_distances_m(position_m) > 0
            is_ahead[face.target] = False
            early, late = (
                self._path_lengths_m(scene, key, time_s + step_s)
                for step_s in (-_DERIVATIVE_STEP_S, _DERIVATIVE_STEP_S)
            )
            now = self._path_lengths_m(scene, key, time_s)
            image_m = face.mirror.image_positions_m(position_m)
            for target in np.flatnonzero(is_ahead & (coefficients != 0)).tolist():
                for order, weights, arrival_m in (
                    ("outbound", (0.5, 0.5), position_m),
                    ("inbound", (0.5, 0.5), image_m),
                    ("both", (0.0, 1.0), image_m),
                ):
                    rate = (late - early)[:, target] / (2 * _DERIVATIVE_STEP_S)
                    x, y, _ = arrival_m[target]
                    rows.append(
                        (
                            scene.names[target],
                            scene.names[face.target],
                            order,
                            float(now[:, target] @ weights),
                            float(rate @ weights),
                            float(np.arctan2(y, x)),
                        )
                    )
        columns = list(zip(*rows, strict=True)) or [()] * 6
        names = ("target", "mirror", "order", "range", "velocity", "azimuth")
        units = ("", "", "", "m", "m/s", "rad")
        return xr.Dataset(
            {
                name: ("ghost", np.array(column, dtype=float if unit else str), {"units": unit})
                for name, unit, column in zip(names, units, columns, strict=True)
            }
        )

    def _path_lengths_m(self, scene: Scene, key: tuple[int, int], time_s: float) -> np.ndarray:
        """Return the one-way lengths to all targets, (2, n_targets): direct, and via a side."""
        position_m = scene.target_positions_m([time_s])[0]
        image_m = self._faces(scene, time_s)[key].mirror.image_positions_m(np.zeros((1, 3)))
        return np.linalg.norm([position_m, position_m - image_m], axis=-1)

    def _coefficients(
        self, face: _Face, image_m: np.ndarray, positions_m: np.ndarray
    ) -> np.ndarray:
        return face.coefficients(image_m, positions_m) / np.sqrt(self.loss)

    def _faces_towards_radar(self, scene: Scene, time_s: float) -> dict[tuple[int, int], _Face]:
        return {
            key: face
            for key, face in self._faces(scene, time_s).items()
            if face.mirror.offset_m < -MIN_MIRROR_DISTANCE_M
        }

    def _faces(self, scene: Scene, time_s: float) -> dict[tuple[int, int], _Face]:
        """Return all long sides, by number of the box and of its side."""
        screens = screens_of_bodies(scene, time_s)
        axes = scene.ego.axes(np.array([time_s]))[0]
        up = np.array([0.0, 0.0, 1.0]) @ axes
        sides_m = np.roll(screens.corners_m, -1, axis=1) - screens.corners_m
        faces = {}
        permittivities = [self._permittivity(scene, target) for target in screens.targets]
        for box, side in np.argwhere(abs(sides_m) >= max(self.min_length_m, 1e-3)).tolist():
            if permittivities[box] == 1.0:
                continue
            corner_m, length_m = screens.corners_m[box, side], abs(sides_m[box, side])
            along = sides_m[box, side] / length_m
            outwards = -1j * along  # the corners run to the left
            offset_m = float((corner_m * outwards.conjugate()).real)
            faces[box, side] = _Face(
                target=int(screens.targets[box]),
                mirror=Mirror(_upright_vector(outwards) @ axes, offset_m),
                start_m=_upright_vector(corner_m) @ axes,
                along=_upright_vector(along) @ axes,
                length_m=float(length_m),
                band_m=screens.bands_m[box, 0],
                up=up,
                permittivity=permittivities[box],
            )
        return faces

    def _permittivity(self, scene: Scene, target: int) -> float:
        """Return the permittivity of the sides of a body; 1, which reflects nothing, if curved."""
        body = scene.targets[target].body
        reflectivity = None if body is None else body.side_reflectivity
        if reflectivity is None:
            return self.permittivity
        amplitude = np.sqrt(reflectivity)
        return float(min(((1 + amplitude) / max(1 - amplitude, 1e-9)) ** 2, _METAL))


def _upright_vector(from_above: complex) -> np.ndarray:
    return np.array([from_above.real, from_above.imag, 0.0])


def _with_boxes(scene: Scene) -> Scene:
    """Return the scene with the boxes of its bodies, which one without shadows does not list."""
    return scene if scene.shadowing else replace(scene, shadowing=True)


def _half_run_s(group: EchoGroup, window: SampleWindow) -> float:
    """Return half of the duration of a run of chirps, with the samples after its last start."""
    starts_s = group.transmission.starts_s
    return float(max(-starts_s[0], starts_s[-1]) + window.times_s[-1])


def _follow_mirror(
    copy: EchoGroup,
    group: EchoGroup,
    mirror: Mirror,
    mirrors: Sequence[Mirror],
    times_s: np.ndarray,
) -> EchoGroup:
    """Return reflected echoes that follow a mirror at some times of the run of chirps.

    The images of antennas are constant. Displacements of the scatterers stand for their motion: the
    opposite one with both paths mirrored, and with one path that which gives both together the
    true length.
    """
    tx_m, rx_m = (getattr(group.transmission, f"{side}_m").mean(axis=0) for side in ("tx", "rx"))
    has_image = [
        not np.array_equal(
            getattr(copy.transmission, f"{side}_m"), getattr(group.transmission, f"{side}_m")
        )
        for side in ("tx", "rx")
    ]
    reflected_m = tx_m if has_image[0] else rx_m
    image_m = mirror.image_positions_m(reflected_m[None])[0]
    images_m = np.array([moved.image_positions_m(reflected_m[None])[0] for moved in mirrors])
    if np.allclose(images_m, image_m, rtol=0, atol=1e-12):
        return copy
    path_m = copy.scatterers.path_m
    if all(has_image):
        displacements_m = np.repeat((image_m - images_m)[:, None], path_m.shape[1], axis=1)
        is_followed = np.ones(path_m.shape[1], bool)
    else:
        powers = times_s[:, None] ** np.arange(len(path_m))
        positions_m = np.einsum("kp,pni->kni", powers, path_m)
        other_m = rx_m if has_image[0] else tx_m
        displacements_m, is_followed = _displacements_of_equal_length_m(
            path_m[0], positions_m, image_m, images_m, other_m
        )
    terms = times_s[:, None] ** np.arange(1, _N_TERMS + 1)
    fitted_m = np.einsum("pk,kni->pni", np.linalg.pinv(terms), displacements_m)
    moved_m = np.zeros((max(len(path_m), _N_TERMS + 1), *path_m.shape[1:]))
    moved_m[: len(path_m)] += path_m
    moved_m[1 : _N_TERMS + 1] += fitted_m
    return copy._replace(scatterers=copy.scatterers._replace(path_m=moved_m)).select(is_followed)


def _displacements_of_equal_length_m(
    middle_m: np.ndarray,
    positions_m: np.ndarray,
    image_m: np.ndarray,
    images_m: np.ndarray,
    other_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements, (n_times, n, 3), and for which scatterers, (n,), there are any.

    They are along the sum of the unit vectors of both paths in the middle of the run.
    """
    directions = sum(
        (middle_m - end_m) / np.linalg.norm(middle_m - end_m, axis=-1, keepdims=True)
        for end_m in (image_m, other_m)
    )
    squares = np.sum(directions**2, axis=-1)
    is_followed = squares > _MIN_SQUARE

    def lengths_m(points_m: np.ndarray, moved_image_m: np.ndarray) -> np.ndarray:
        return np.asarray(
            np.linalg.norm(points_m - moved_image_m, axis=-1)
            + np.linalg.norm(points_m - other_m, axis=-1)
        )

    wanted_m = lengths_m(positions_m, images_m[:, None])
    steps_m = np.zeros(wanted_m.shape)
    for _ in range(_N_NEWTON_STEPS):
        points_m = positions_m + steps_m[..., None] * directions
        missing_m = wanted_m - lengths_m(points_m, image_m)
        steps_m += np.where(is_followed, missing_m / np.maximum(squares, _MIN_SQUARE), 0.0)
    return steps_m[..., None] * directions, is_followed
