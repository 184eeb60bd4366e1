"""The radar's own pose and motion."""

import math

import numpy as np

from dechirp.core.checks import Vector, number, vector
from dechirp.core.values import value
from dechirp.scene.rotations import about_z
from dechirp.scene.slow import slow_vector


@value
class Ego:
    """Where the radar is, where it looks, and how it moves: as on a car, along an arc.

    By default the coordinates of the scene are those of the radar at time zero.
    """

    position_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the radar's coordinates at time zero, in those of the scene."""
    yaw_rad: float = 0.0
    """Of its x axis at time zero, to the left of the scene's. Yaw first, then pitch, then roll."""
    pitch_rad: float = 0.0
    """Upwards positive."""
    roll_rad: float = 0.0
    """About its x axis, the left side upwards positive."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    """At time zero, in coordinates of the scene. It turns with the radar."""
    turn_rate_rad_per_s: float = 0.0
    """About the z axis of the scene, to the left positive."""

    def __post_init__(self) -> None:
        # Beyond the Moon, more than a turn, and faster than any spindle: a unit is wrong.
        vector(self, "position_m", at_most=1e9)
        for name, at_most in (
            ("yaw_rad", 2 * math.pi),
            ("pitch_rad", 2 * math.pi),
            ("roll_rad", 2 * math.pi),
            ("turn_rate_rad_per_s", 1e5),
        ):
            angle = number(f"Ego.{name}", getattr(self, name), at_least=-at_most, at_most=at_most)
            object.__setattr__(self, name, angle)
        slow_vector(self, "velocity_m_per_s")

    @property
    def is_turning(self) -> bool:
        """Whether its axes turn."""
        return self.turn_rate_rad_per_s != 0

    def ways_m(self, times_s: np.ndarray) -> np.ndarray:
        r"""How far it has come since time zero, (n_times, 3), scene coordinates.

        .. math:: \int_0^t R_z(\omega s)\, v \, ds = t \left(v_\parallel
            \frac{\sin \omega t}{\omega t} + (z \times v) \frac{1 - \cos \omega t}{\omega t}
            + v_z \right)
        """
        x, y, z = self.velocity_m_per_s
        # np.sinc has the limit at rate 0; 1 - cos a = a sin^2(a / 2) / (a / 2) keeps its digits.
        half = self.turn_rate_rad_per_s * times_s / 2
        along = times_s * np.sinc(2 * half / np.pi)
        across = times_s * half * np.sinc(half / np.pi) ** 2
        return np.stack([along * x - across * y, along * y + across * x, times_s * z], axis=-1)

    def velocities_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Velocity at each time, (n_times, 3), scene coordinates."""
        turns = about_z(self.turn_rate_rad_per_s * times_s)
        return turns @ np.array(self.velocity_m_per_s)

    def axes(self, times_s: np.ndarray) -> np.ndarray:
        """Axes of the radar at each time, (n_times, 3, 3): columns in scene coordinates."""
        turns = about_z(self.yaw_rad + self.turn_rate_rad_per_s * times_s)
        return turns @ self._tilt

    @property
    def _tilt(self) -> np.ndarray:
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        pitch = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
        roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        return pitch @ roll
