"""A flat road: echoes come straight, off the road, and both."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from dechirp.core.checks import number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.images import NEAREST_M, Mirror, reflected, up
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

# Feet and wheels of a body may go a little into the road.
_SUNK_M = 0.1


@value
class Ground(Propagation):
    r"""Reflections off a flat, level road: two rays there and two back.

    Over range the power of an echo varies by the two-way factor

    .. math:: |1 + \Gamma e^{-ik\Delta}|^4, \quad
        \Delta = \sqrt{R^2 + (h_1 + h_2)^2} - \sqrt{R^2 + (h_1 - h_2)^2},

    up to 12 dB above free space and down to nulls. The coefficient is Fresnel's of a lossless
    dielectric at the grazing angle psi, times exp(-2 (k sigma sin psi)^2) for a rough surface
    (Ament 1953). The power that a rough road scatters elsewhere is left out.

    Scatterers below the road are not mirrored. The road neither ends nor hides anything. Ways
    go off walls as well, whichever is listed first; rain and other losses take the longer ways
    into account where they are listed after it.

    References
    ----------
    M. W. Long, Radar Reflectivity of Land and Sea, 3rd ed., 2001, chapter 4.
    W. S. Ament, Toward a theory of reflection by a rough surface, Proc. IRE 41, 1953.
    """

    height_m: float
    """Of the origin of the radar's coordinates above the road, at all times."""
    permittivity: float = 5.24
    """Relative, a ratio; of concrete where not given (ITU-R P.2040-3, 1 to 100 GHz)."""
    roughness_m: float = 0.0
    """Standard deviation of the heights of the surface."""
    polarisation: Literal["vertical", "horizontal"] = "vertical"
    """Of the electric field."""

    def __post_init__(self) -> None:
        # Wider than from a bumper to an aircraft: outside, a unit is wrong.
        positive(self, "height_m", at_least=NEAREST_M, at_most=1e5)
        positive(self, "permittivity", at_least=1.001, at_most=1e6)  # air has 1.0006
        number("Ground.roughness_m", self.roughness_m, at_least=0.0, at_most=10.0)
        if self.polarisation not in ("vertical", "horizontal"):
            raise InvalidSetting(
                "Ground.polarisation",
                got=repr(self.polarisation),
                need="vertical or horizontal",
                fix="Choose one.",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where an antenna or a target is below the road, or the radar rises."""
        road = self._mirror(scene)
        for kind, antennas_m in (("transmitter", radar.array.tx_m), ("receiver", radar.array.rx_m)):
            heights_m = road.distances_m(np.array(antennas_m))
            if heights_m.min() < NEAREST_M:
                raise InvalidSetting(
                    "height",
                    got=f"{self.height_m:.6g} m, with {kind} {heights_m.argmin()}"
                    f" {heights_m.min():.6g} m above the road",
                    need=f"so much that every antenna is at least {NEAREST_M:g} m above it",
                    fix="Raise the radar, or check the pitch and roll of scene.ego.",
                )
        rises_m_per_s = scene.ego.velocity_m_per_s[2]
        if abs(rises_m_per_s) > 1e-6 * np.linalg.norm(scene.ego.velocity_m_per_s):
            raise InvalidSetting(
                "height",
                got=f"one at all times, and scene.ego rises at {rises_m_per_s:.4g} m/s",
                need="that of a radar which moves level",
                fix="Let scene.ego.velocity be level, or move the targets instead.",
            )
        if not scene.targets:
            return
        heights_m = road.distances_m(scene.positions_m([0.0])[0])
        lowest = int(heights_m.argmin())
        if heights_m[lowest] < -_SUNK_M:
            raise InvalidSetting(
                "height",
                got=f"{self.height_m:.6g} m, with scene.targets."
                f"{scene.names[scene.owners[lowest]]} {-heights_m[lowest]:.4g} m below the road",
                need=f"so much that targets are on the road, or {_SUNK_M:g} m in it at most",
                fix=f"The road is at z = {scene.ego.position_m[2] - self.height_m:.6g} m in the"
                " scene: raise the target, or the radar.",
            )

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """Each part, and the same there, back, or both ways off the road."""
        road, upwards = self._mirror(scene), up(scene)
        wavenumber = 2 * np.pi / radar.frame.chirp.wavelength_m

        def coefficients(image_m: np.ndarray, places_m: np.ndarray) -> np.ndarray:
            ways_m = places_m - image_m
            # From below there is no way; the formula has a pole there.
            sines = np.maximum(ways_m @ upwards / np.linalg.norm(ways_m, axis=-1), 0.0)
            rough = np.exp(-2 * (wavenumber * self.roughness_m * sines) ** 2)
            return np.asarray(rough * fresnel(sines, self.permittivity, self.polarisation))

        return [
            copy for part in parts for copy in reflected(part, road, coefficients, radar, upwards)
        ]

    def _mirror(self, scene: Scene) -> Mirror:
        return Mirror(up(scene), -self.height_m)


def fresnel(
    grazing_sines: np.ndarray,
    permittivity: float,
    polarisation: Literal["vertical", "horizontal"],
) -> np.ndarray:
    """Amplitude reflection coefficients of a lossless dielectric, real; -1 at grazing.

    Vertical polarisation: 0 at Brewster's angle, positive above it. `grazing_sines`: of the
    angles from the surface, 0 to 1.
    """
    inside = np.sqrt(permittivity - 1 + grazing_sines**2)
    outside = grazing_sines * (permittivity if polarisation == "vertical" else 1.0)
    return np.asarray((outside - inside) / (outside + inside))
