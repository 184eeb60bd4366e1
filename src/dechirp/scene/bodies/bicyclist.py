"""A bicyclist: frame, rider, pedals, and wheels with spokes."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import count, not_negative, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import Body
from dechirp.scene.person import (
    ANKLE,
    ARMS,
    BEHIND_ANKLE,
    FOOT,
    HALF_SHOULDERS,
    LEGS,
    NECK_AND_HEAD,
    SHANK,
    SHARES,
    THIGH,
    TRUNK,
    Joint,
    scatterers_m,
)

# Of a touring bicycle of common size; x from the crank axle, z from the ground.
_CRANK_AXLE_M = 0.27j
_REAR_AXLE_X_M, _FRONT_AXLE_X_M = -0.44, 0.61
_HEAD_TUBE_M = 0.42 + 0.85j
_HALF_PEDALS_M, _HALF_HANDLEBAR_M = 0.1, 0.25

# Of the rider, over the height. The saddle leaves the knee bent by 30 degrees at the lowest.
_CRANK = 0.097
_LONGEST_REACH = (THIGH + SHANK) * math.cos(math.radians(15))
_SEAT_TUBE = -np.exp(-1j * np.radians(73))  # backward and up
_SPINE, _ARM = np.exp(1j * np.radians(60)), 0.37 * np.exp(-1j * np.radians(40))
_HEAD = np.exp(1j * np.radians(75))
_BALL = 0.72  # share of the foot behind its ball, which is on the pedal

_MOST_PEDALLING_HZ = 3.0

# Shares of the cross section; half of it is the rider's.
_OF_RIDER, _OF_FRAME, _OF_PEDALS, _OF_WHEELS = 0.5, 0.15, 0.05, 0.3
_ALONG_TUBE = np.array([1 / 6, 0.5, 5 / 6])
_ALONG_SPOKE = np.array([1 / 3, 2 / 3, 1.0])  # the last is on the rim


@value
class Bicyclist(Body):
    """A rider who pedals with still trunk and arms, on a bicycle whose wheels roll.

    The target's velocity carries it: give both the same speed, or the wheels slide. Its
    origin is on the ground below the crank axle; a radar 0.6 m above the ground has it at
    z = -0.6 m. Points on the rims go at 0 to 2 times the speed, pedals and feet turn at the
    cadence, speed over development.

    The groups of scatterers are those of M. Stolz, E. Schubert, F. Meinl, M. Kunert, W. Menzel,
    Multi-target reflection point model of cyclists for automotive radar, European Radar
    Conference 2017. How they share the cross section is assumed: the rider has a half, wheels
    30 %, the frame 15 % and the pedals 5 %.
    """

    height_m: float = 1.75
    """Of the rider, standing."""
    speed_m_per_s: float
    """At which the wheels roll; 0: all is still."""
    wheel_radius_m: float = 0.34
    n_spokes: int = 16
    """Of each wheel, with two scatterers on each and one on the rim."""
    development_m: float | None = 5.0
    """Way of one turn of the cranks in the gear that is in; none: the rider does not pedal."""
    phase_rad: float = 0.0
    """Of the cranks at time zero; 0: the left pedal is on top."""
    rcs_m2: float = 0.32
    """Of all scatterers together, -5 dBsm: twice that of a pedestrian."""

    def __post_init__(self) -> None:
        positive(self, "height_m", at_least=1.0, at_most=2.5)
        not_negative(self, "speed_m_per_s", at_most=40.0)  # 144 km/h, beyond the hour record
        # From a folding bicycle's to where two wheels would touch.
        positive(self, "wheel_radius_m", at_least=0.15, at_most=0.5)
        count(self, "n_spokes", at_least=3, at_most=100)
        if self.development_m is not None:
            positive(self, "development_m", at_least=0.5, at_most=20.0)
            self._must_pedal_slowly(self.development_m)
        turn = 2 * math.pi
        phase = number("Bicyclist.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        positive(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    def _must_pedal_slowly(self, development_m: float) -> None:
        if self.speed_m_per_s > _MOST_PEDALLING_HZ * development_m:
            raise InvalidSetting(
                "Bicyclist.development_m",
                got=f"{development_m:.3g} m: {60 * self.cadence_hz:.0f} turns of the cranks a"
                f" minute at {self.speed_m_per_s:.3g} m/s",
                need=f"at least {self.speed_m_per_s / _MOST_PEDALLING_HZ:.3g} m: at most"
                f" {60 * _MOST_PEDALLING_HZ:.0f} turns a minute",
                fix="Take a higher gear, or none where the rider does not pedal.",
            )

    @property
    def cadence_hz(self) -> float:
        """Turns of the cranks a second, speed over development; 0 without pedalling."""
        return 0.0 if self.development_m is None else self.speed_m_per_s / self.development_m

    @property
    def is_rigid(self) -> bool:
        """Whether it stands."""
        return self.speed_m_per_s == 0

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers at each time, (n_times, n_scatterers, 3), axes of the body.

        The rider's come first, then those of frame, pedals, rear wheel and front wheel.
        """
        # Forward + i upward; wheels and cranks turn from upward to forward.
        cranks = 1j * np.exp(-1j * (self.phase_rad + 2 * np.pi * self.cadence_hz * times_s))
        pedals_m = _CRANK * self.height_m * cranks[:, None] * np.array([1, -1]) + _CRANK_AXLE_M
        wheels = np.exp(-1j * self.speed_m_per_s / self.wheel_radius_m * times_s)
        frame_m = np.broadcast_to(self._frame_m, (len(times_s), *self._frame_m.shape))
        parts = [
            scatterers_m(self._rider_m(pedals_m)),
            frame_m,
            _upright(pedals_m, _HALF_PEDALS_M * np.array([1, -1])),
            *(
                _upright(axle_m + wheels[:, None] * self._spokes_m, np.zeros(self._spokes_m.size))
                for axle_m in self._axles_m
            ),
        ]
        return np.concatenate(parts, axis=1)

    def cross_sections_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,)."""
        n_frame, n_wheels = len(self._frame_m), 2 * self._spokes_m.size
        return self.rcs_m2 * np.concatenate(
            [
                _OF_RIDER * SHARES,
                np.full(n_frame, _OF_FRAME / n_frame),
                np.full(2, _OF_PEDALS / 2),
                np.full(n_wheels, _OF_WHEELS / n_wheels),
            ]
        )

    def _rider_m(self, pedals_m: np.ndarray) -> np.ndarray:
        """Where the joints are, (n_times, n_joints, 3), for pedals (n_times, 2)."""
        height_m = self.height_m
        joints_m = np.repeat(self._still_m[None], len(pedals_m), axis=0)
        ankles_m = pedals_m + self._ankle_from_pedal_m
        knees_m = self._knees_m(ankles_m)
        heels_m = ankles_m - (BEHIND_ANKLE * FOOT + 1j * ANKLE) * height_m
        hips_m = np.full_like(ankles_m, self._hip_m)
        legs_m = np.stack([hips_m, knees_m, ankles_m, heels_m, heels_m + FOOT * height_m], axis=-1)
        for side, left in enumerate((1, -1)):
            joints_m[:, LEGS[side]] = _upright(legs_m[:, side], np.full(5, left * _HALF_PEDALS_M))
        return joints_m

    def _knees_m(self, ankles_m: np.ndarray) -> np.ndarray:
        """Knees, in front of the lines from the hips to the ankles; triangles of known sides."""
        thigh_m, shank_m = THIGH * self.height_m, SHANK * self.height_m
        line_m = ankles_m - self._hip_m
        reach_m = abs(line_m)
        along_m = (reach_m**2 + thigh_m**2 - shank_m**2) / (2 * reach_m)
        ahead_m = np.sqrt(thigh_m**2 - along_m**2)
        return np.asarray(self._hip_m + line_m / reach_m * (along_m + 1j * ahead_m))

    @property
    def _ankle_from_pedal_m(self) -> complex:
        """The foot stays level, its ball on the pedal."""
        return self.height_m * complex((BEHIND_ANKLE - _BALL) * FOOT, ANKLE)

    @property
    def _hip_m(self) -> complex:
        """Up the seat tube from the middle of the ankles' circles."""
        middle_m = _CRANK_AXLE_M + self._ankle_from_pedal_m
        return complex(middle_m + (_LONGEST_REACH - _CRANK) * self.height_m * _SEAT_TUBE)

    @property
    def _axles_m(self) -> tuple[complex, complex]:
        """Rear and front."""
        up_m = 1j * self.wheel_radius_m
        return _REAR_AXLE_X_M + up_m, _FRONT_AXLE_X_M + up_m

    @cached_property
    def _still_m(self) -> np.ndarray:
        """The joints, (n_joints, 3): those of the legs are not filled in."""
        height_m, found = self.height_m, np.zeros((len(Joint), 3))
        neck_m = self._hip_m + TRUNK * height_m * _SPINE
        crown_m = neck_m + NECK_AND_HEAD * height_m * _HEAD
        middle_m = np.array([self._hip_m, neck_m, crown_m])
        found[: Joint.LEFT_SHOULDER] = _upright(middle_m, np.zeros(3))
        along = np.array([0.0, 0.5, 0.9, 1.0])  # the fingers hold the handlebar
        for side, left in enumerate((1, -1)):
            across_m = HALF_SHOULDERS * height_m * (1 - along) + _HALF_HANDLEBAR_M * along
            found[ARMS[side]] = _upright(neck_m + _ARM * height_m * along, left * across_m)
        return found

    @cached_property
    def _frame_m(self) -> np.ndarray:
        """Points on the tubes, (n, 3)."""
        rear_m, front_m = self._axles_m
        saddle_m = self._hip_m - 0.05j * self.height_m
        stem_m = complex(*self._still_m[Joint.LEFT_FINGERS, [0, 2]])
        tubes = (
            (_CRANK_AXLE_M, saddle_m),
            (_CRANK_AXLE_M, rear_m),
            (saddle_m, rear_m),
            (saddle_m, _HEAD_TUBE_M),
            (_CRANK_AXLE_M, _HEAD_TUBE_M),
            (front_m, _HEAD_TUBE_M),
            (_HEAD_TUBE_M, stem_m),
        )
        points_m = np.concatenate([a + (b - a) * _ALONG_TUBE for a, b in tubes])
        bar_m = _HALF_HANDLEBAR_M * np.array([-1.0, 0.0, 1.0])
        return np.concatenate(
            [_upright(points_m, np.zeros(points_m.size)), _upright(np.full(3, stem_m), bar_m)]
        )

    @cached_property
    def _spokes_m(self) -> np.ndarray:
        """Points of a wheel about its axle at time zero, (n,); the first spoke is up."""
        turns = np.arange(self.n_spokes) / self.n_spokes
        spokes = 1j * np.exp(-2j * np.pi * turns[:, None])
        return (self.wheel_radius_m * spokes * _ALONG_SPOKE).ravel()


def _upright(plane_m: np.ndarray, left_m: np.ndarray) -> np.ndarray:
    """Places (..., n, 3) from places in the plane of the bicycle (..., n), and those to its left.

    In the plane they are complex, forward + i upward.
    """
    return np.stack([plane_m.real, np.broadcast_to(left_m, plane_m.shape), plane_m.imag], axis=-1)
