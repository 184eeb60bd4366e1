"""Pose and motion of the radar."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import Vector, check_and_convert_vector_field, check_number
from dechirp.core.values import frozen_dataclass
from dechirp.scene.rotations import rotation_about_z
from dechirp.scene.speed_limit import check_and_convert_velocity_field


@frozen_dataclass
class Ego:
    """Position, orientation and motion of the radar, which moves along a line or an arc like a car.

    By default, the coordinates of the scene are those of the radar at time zero.
    """

    position_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the radar's coordinates at time zero, in those of the scene."""
    yaw_rad: float = 0.0
    """Yaw of its x axis at time zero, to the left of the scene's. The order is yaw, pitch, roll."""
    pitch_rad: float = 0.0
    """Pitch, upwards positive."""
    roll_rad: float = 0.0
    """Roll about its x axis, the left side upwards positive."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    """Velocity at time zero, in coordinates of the scene. It turns with the radar."""
    turn_rate_rad_per_s: float = 0.0
    """Turn rate about the z axis of the scene, to the left positive."""

    def __post_init__(self) -> None:
        # Limits beyond the Moon, a full turn, and any spindle: other values indicate a wrong unit.
        check_and_convert_vector_field(self, "position_m", max_magnitude=1e9)
        for name, at_most in (
            ("yaw_rad", 2 * math.pi),
            ("pitch_rad", 2 * math.pi),
            ("roll_rad", 2 * math.pi),
            ("turn_rate_rad_per_s", 1e5),
        ):
            angle = check_number(
                f"Ego.{name}", getattr(self, name), at_least=-at_most, at_most=at_most
            )
            object.__setattr__(self, name, angle)
        check_and_convert_velocity_field(self, "velocity_m_per_s")

    @property
    def is_turning(self) -> bool:
        """Return whether the axes of the radar turn."""
        return self.turn_rate_rad_per_s != 0

    def displacements_m(self, times_s: np.ndarray) -> np.ndarray:
        r"""Return the displacements since time zero, (n_times, 3), in scene coordinates.

        .. math:: \int_0^t R_z(\omega s)\, v \, ds = t \left(v_\parallel
            \frac{\sin \omega t}{\omega t} + (z \times v) \frac{1 - \cos \omega t}{\omega t}
            + v_z \right)
        """
        x, y, z = self.velocity_m_per_s
        if not (x or y or z):  # 25 us less, five times a frame
            return np.zeros((len(times_s), 3))
        # np.sinc has the limit at rate 0; 1 - cos a = a sin^2(a / 2) / (a / 2) avoids cancellation.
        half = self.turn_rate_rad_per_s * times_s / 2
        forward = times_s * np.sinc(2 * half / np.pi)
        sideways = times_s * half * np.sinc(half / np.pi) ** 2
        return np.stack(
            [forward * x - sideways * y, forward * y + sideways * x, times_s * z], axis=-1
        )

    def velocities_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Return the velocity at each time, (n_times, 3), in scene coordinates."""
        turns = rotation_about_z(self.turn_rate_rad_per_s * times_s)
        return turns @ np.array(self.velocity_m_per_s)

    def axes(self, times_s: np.ndarray) -> np.ndarray:
        """Return the axes of the radar at each time, (n_times, 3, 3), columns in the scene."""
        turns = rotation_about_z(self.yaw_rad + self.turn_rate_rad_per_s * times_s)
        return turns @ self._pitch_and_roll_matrix

    @cached_property
    def _pitch_and_roll_matrix(self) -> np.ndarray:
        cos_pitch, sin_pitch = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cos_roll, sin_roll = math.cos(self.roll_rad), math.sin(self.roll_rad)
        pitch = np.array([[cos_pitch, 0, -sin_pitch], [0, 1, 0], [sin_pitch, 0, cos_pitch]])
        roll = np.array([[1, 0, 0], [0, cos_roll, -sin_roll], [0, sin_roll, cos_roll]])
        return pitch @ roll
