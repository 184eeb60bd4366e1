"""Walking pedestrian: fifteen segments with swinging limbs."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.scene.gait import MAX_RELATIVE_SPEED_PER_S, Gait
from dechirp.scene.skeleton import (
    HALF_SHOULDERS,
    HIP_HEIGHT,
    RCS_SHARES,
    scatterer_positions_on_segments_m,
)


@frozen_dataclass
class Pedestrian(Body):
    """Walking person: head, trunk in two parts, arms, hands, thighs, shanks and feet.

    The velocity of the target moves it: use the same speed for both, or the feet slide. Its origin
    is on the ground below the pelvis, at z = -0.6 m for a radar 0.6 m above the ground. Limbs move
    about that by `Gait`, with zero mean over a cycle: a foot on the ground moves backward at the
    walking speed, and one in the air forward at 2 to 4 times that.
    """

    height_m: float = 1.75
    """Standing height."""
    speed_m_per_s: float
    """Walking speed; 0: standing. At most 2.3 times the height of its hips per second (2.13 m/s
    at 1.75 m); faster people run."""
    phase_rad: float = 0.0
    """Phase of the gait at time zero; 0: the right heel strikes; 180 deg: the left."""
    rcs_m2: float = 0.16
    """Total cross section, shared like the skin over segments. -8 dBsm: N. Yamada, Y. Tanaka, K.
    Nishikawa, Radar cross section for pedestrian in 76 GHz band, European Microwave Conference
    2005."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "height_m", at_least=0.5, at_most=2.5)
        check_non_negative_fields(self, "speed_m_per_s")
        fastest = MAX_RELATIVE_SPEED_PER_S * HIP_HEIGHT * self.height_m
        if self.speed_m_per_s > fastest * (1 + 1e-9):
            raise InvalidSetting(
                "Pedestrian.speed_m_per_s",
                value=f"{self.speed_m_per_s:.4g} m/s",
                expected=f"at most {fastest:.3g} m/s at a height of {self.height_m:.3g} m: faster"
                " people run, and the model is one of walking",
                fix="reduce the speed, or check the units",
            )
        turn = 2 * math.pi
        phase = check_number("Pedestrian.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        check_positive_fields(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    @property
    def is_rigid(self) -> bool:
        return self.speed_m_per_s == 0

    @property
    def blocking_box_m(self) -> np.ndarray:
        """Return the box of the shoulders, half as deep as wide, from the ground to the crown."""
        half_m = HALF_SHOULDERS * self.height_m
        return np.array([[-half_m / 2, -half_m, -np.inf], [half_m / 2, half_m, self.height_m]])

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        cycles = self.phase_rad / (2 * np.pi) + self._gait.cycle_frequency_hz * times_s
        return scatterer_positions_on_segments_m(self._gait.joint_positions_m(cycles))

    def cross_sections_m2(self) -> np.ndarray:
        return self.rcs_m2 * RCS_SHARES

    @cached_property
    def _gait(self) -> Gait:
        return Gait(height_m=self.height_m, speed_m_per_s=self.speed_m_per_s)
