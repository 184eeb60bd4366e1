"""A pedestrian who walks: fifteen segments, whose limbs swing."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import not_negative, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import Body
from dechirp.scene.gait import FASTEST_PER_S, Gait
from dechirp.scene.person import HIP_HEIGHT, SHARES, scatterers_m


@value
class Pedestrian(Body):
    """Head, trunk in two parts, upper and lower arms, hands, thighs, shanks and feet.

    The target's velocity carries it: give both the same speed, or the feet slide. Its origin
    is on the ground below the pelvis; a radar 0.6 m above the ground has it at z = -0.6 m.
    Limbs move about that by `Gait`, and their mean over a cycle is at rest: a foot on the
    ground goes back at the walking speed, and one in the air ahead at 2 to 4 times that.
    """

    height_m: float = 1.75
    speed_m_per_s: float
    """At which it walks; 0: it stands. At most 2.3 times the height of its hips a second
    (2.13 m/s at 1.75 m): beyond, people run."""
    phase_rad: float = 0.0
    """Of the gait at time zero; 0: the right heel strikes; 180 deg: the left."""
    rcs_m2: float = 0.16
    """Of all scatterers together, which share it as segments share the skin. -8 dBsm: N. Yamada,
    Y. Tanaka, K. Nishikawa, Radar cross section for pedestrian in 76 GHz band, European
    Microwave Conference 2005."""

    def __post_init__(self) -> None:
        positive(self, "height_m", at_least=0.5, at_most=2.5)
        not_negative(self, "speed_m_per_s")
        fastest = FASTEST_PER_S * HIP_HEIGHT * self.height_m
        if self.speed_m_per_s > fastest * (1 + 1e-9):
            raise InvalidSetting(
                "Pedestrian.speed_m_per_s",
                got=f"{self.speed_m_per_s:.4g} m/s",
                need=f"at most {fastest:.3g} m/s at a height of {self.height_m:.3g} m: faster ones"
                " run, and the gait is of walking",
                fix="Let it walk more slowly, or check the units.",
            )
        turn = 2 * math.pi
        phase = number("Pedestrian.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        positive(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    @property
    def is_rigid(self) -> bool:
        """Whether it stands."""
        return self.speed_m_per_s == 0

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers at each time, (n_times, n_scatterers, 3), axes of the body."""
        cycles = self.phase_rad / (2 * np.pi) + self._gait.frequency_hz * times_s
        return scatterers_m(self._gait.joints_m(cycles))

    def cross_sections_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,)."""
        return self.rcs_m2 * SHARES

    @cached_property
    def _gait(self) -> Gait:
        return Gait(height_m=self.height_m, speed_m_per_s=self.speed_m_per_s)
