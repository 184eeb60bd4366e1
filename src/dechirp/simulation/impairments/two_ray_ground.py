"""Two-ray ground reflection off a flat road."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from dechirp.core.checks import check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.mirror_images import (
    MIN_MIRROR_DISTANCE_M,
    Mirror,
    group_and_reflected_copies,
    up_vector_in_radar_axes,
)

# Feet and wheels of a body may sink a little into the road.
_MAX_DEPTH_M = 0.1


@frozen_dataclass
class TwoRayGround(Propagation):
    r"""Reflections off a flat, level road: two outbound and two inbound rays.

    Over range, the power of an echo varies by the two-way factor

    .. math:: |1 + \Gamma e^{-ik\Delta}|^4, \quad
        \Delta = \sqrt{R^2 + (h_1 + h_2)^2} - \sqrt{R^2 + (h_1 - h_2)^2},

    up to 12 dB above free space and down to nulls. The coefficient is Fresnel's of a lossless
    dielectric at the grazing angle psi, times exp(-2 (k sigma sin psi)^2) for a rough surface
    (Ament
    1953). Diffuse scattering by a rough road is neglected.

    Scatterers below the road are not mirrored. The road is infinite and hides nothing. Paths also
    include reflections off walls, whichever is listed first; rain and other losses include the
    longer
    paths if listed after it.

    References
    ----------
    M. W. Long, Radar Reflectivity of Land and Sea, 3rd ed., 2001, chapter 4.
    W. S. Ament, Toward a theory of reflection by a rough surface, Proc. IRE 41, 1953.
    """

    height_m: float
    """Height of the origin of the radar's coordinates above the road, constant over time."""
    permittivity: float = 5.24
    """Relative permittivity, a ratio; default: concrete (ITU-R P.2040-3, 1 to 100 GHz)."""
    roughness_m: float = 0.0
    """Standard deviation of the heights of the surface."""
    polarisation: Literal["vertical", "horizontal"] = "vertical"
    """Direction of the electric field."""

    def __post_init__(self) -> None:
        # The limits include bumpers and aircraft; other values indicate a wrong unit.
        check_positive_fields(self, "height_m", at_least=MIN_MIRROR_DISTANCE_M, at_most=1e5)
        check_positive_fields(self, "permittivity", at_least=1.001, at_most=1e6)  # air has 1.0006
        check_number("TwoRayGround.roughness_m", self.roughness_m, at_least=0.0, at_most=10.0)
        if self.polarisation not in ("vertical", "horizontal"):
            raise InvalidSetting(
                "TwoRayGround.polarisation",
                value=repr(self.polarisation),
                expected="vertical or horizontal",
                fix="choose one",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if an antenna or a target is below the road, or the radar rises."""
        road = self._road_mirror(scene)
        for kind, antennas_m in (("transmitter", radar.array.tx_m), ("receiver", radar.array.rx_m)):
            heights_m = road.signed_distances_m(np.array(antennas_m))
            if heights_m.min() < MIN_MIRROR_DISTANCE_M:
                raise InvalidSetting(
                    "height",
                    value=f"{self.height_m:.6g} m, with {kind} {heights_m.argmin()}"
                    f" {heights_m.min():.6g} m above the road",
                    expected=f"every antenna at least {MIN_MIRROR_DISTANCE_M:g} m above the road",
                    fix="raise the radar, or check the pitch and roll of scene.ego",
                )
        climb_rate_m_per_s = scene.ego.velocity_m_per_s[2]
        if abs(climb_rate_m_per_s) > 1e-6 * np.linalg.norm(scene.ego.velocity_m_per_s):
            raise InvalidSetting(
                "height",
                value=f"a constant height, with scene.ego rising at {climb_rate_m_per_s:.4g} m/s",
                expected="a radar that moves horizontally",
                fix="set the vertical component of scene.ego.velocity to 0, or move the targets",
            )
        if not scene.targets:
            return
        heights_m = road.signed_distances_m(scene.scatterer_positions_m([0.0])[0])
        lowest = int(heights_m.argmin())
        if heights_m[lowest] < -_MAX_DEPTH_M:
            raise InvalidSetting(
                "height",
                value=f"{self.height_m:.6g} m, with scene.targets."
                f"{scene.names[scene.target_index_of_scatterer[lowest]]} {-heights_m[lowest]:.4g} m"
                " below the road",
                expected=f"targets above the road, or at most {_MAX_DEPTH_M:g} m below its surface",
                fix=f"the road is at z = {scene.ego.position_m[2] - self.height_m:.6g} m in the"
                " scene: raise the target, or the radar",
            )

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Yield each group, and its copies with reflected outbound, inbound, or both paths."""
        road, upwards = self._road_mirror(scene), up_vector_in_radar_axes(scene)
        wavenumber = 2 * np.pi / radar.frame.chirp.wavelength_m

        def coefficients(image_m: np.ndarray, positions_m: np.ndarray) -> np.ndarray:
            path_vectors_m = positions_m - image_m
            # No path exists from below, where the formula has a pole.
            sines = np.maximum(
                path_vectors_m @ upwards / np.linalg.norm(path_vectors_m, axis=-1), 0.0
            )
            roughness_factor = np.exp(-2 * (wavenumber * self.roughness_m * sines) ** 2)
            return np.asarray(
                roughness_factor * fresnel_coefficients(sines, self.permittivity, self.polarisation)
            )

        return [
            copy
            for group in groups
            for copy in group_and_reflected_copies(group, road, coefficients, radar, upwards)
        ]

    def _road_mirror(self, scene: Scene) -> Mirror:
        return Mirror(up_vector_in_radar_axes(scene), -self.height_m)


def fresnel_coefficients(
    grazing_sines: np.ndarray,
    permittivity: float,
    polarisation: Literal["vertical", "horizontal"],
) -> np.ndarray:
    """Return the amplitude reflection coefficients of a lossless dielectric, real; -1 at grazing.

    With vertical polarisation they are 0 at Brewster's angle and positive above it. `grazing_sines`
    are the sines of the angles from the surface, 0 to 1.
    """
    transmitted = np.sqrt(permittivity - 1 + grazing_sines**2)
    incident = grazing_sines * (permittivity if polarisation == "vertical" else 1.0)
    return np.asarray((incident - transmitted) / (incident + transmitted))
