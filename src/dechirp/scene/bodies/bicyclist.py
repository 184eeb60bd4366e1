"""Bicyclist: frame, rider, pedals, and wheels with spokes."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import (
    check_integer_fields,
    check_non_negative_fields,
    check_number,
    check_positive_fields,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.scene.skeleton import (
    ANKLE,
    ARMS,
    FOOT,
    HALF_SHOULDERS,
    HEEL_SHARE,
    LEGS,
    NECK_AND_HEAD,
    RCS_SHARES,
    SHANK,
    THIGH,
    TRUNK,
    Joint,
    scatterer_positions_on_segments_m,
)

# Dimensions of a common touring bicycle; x from the crank axle, z from the ground.
_CRANK_AXLE_M = 0.27j
_REAR_AXLE_X_M, _FRONT_AXLE_X_M = -0.44, 0.61
_HEAD_TUBE_M = 0.42 + 0.85j
_HALF_PEDALS_M, _HALF_HANDLEBAR_M = 0.1, 0.25

# Dimensions of the rider, over the height. The saddle leaves the knee bent by 30 degrees at the
# lowest pedal.
_CRANK = 0.097
_LEG_REACH = (THIGH + SHANK) * math.cos(math.radians(15))
_SEAT_TUBE = -np.exp(-1j * np.radians(73))  # backward and up
_SPINE, _ARM = np.exp(1j * np.radians(60)), 0.37 * np.exp(-1j * np.radians(40))
_HEAD = np.exp(1j * np.radians(75))
_BALL_SHARE = 0.72  # share of the foot behind its ball, which is on the pedal

_MAX_CADENCE_HZ = 3.0

# Shares of the cross section; half of it is the rider's.
_RIDER_SHARE, _FRAME_SHARE, _PEDAL_SHARE, _WHEEL_SHARE = 0.5, 0.15, 0.05, 0.3
_ALONG_TUBE = np.array([1 / 6, 0.5, 5 / 6])
_ALONG_SPOKE = np.array([1 / 3, 2 / 3, 1.0])  # the last is on the rim


@frozen_dataclass
class Bicyclist(Body):
    """Rider who pedals with motionless trunk and arms, on a bicycle with rolling wheels.

    The velocity of the target moves it: use the same speed for both, or the wheels slide. Its
    origin is on the ground below the crank axle, at z = -0.6 m for a radar 0.6 m above the ground.
    Points on the rims move at 0 to 2 times the speed; pedals and feet rotate at the cadence, speed
    over development.

    The groups of scatterers are those of M. Stolz, E. Schubert, F. Meinl, M. Kunert, W. Menzel,
    Multi-target reflection point model of cyclists for automotive radar, European Radar
    Conference 2017. Their shares of the cross section are assumed: rider 50 %, wheels 30 %, frame
    15 %, pedals 5 %.
    """

    height_m: float = 1.75
    """Standing height of the rider."""
    speed_m_per_s: float
    """Speed of the rolling wheels; 0: at rest."""
    wheel_radius_m: float = 0.34
    """Radius of the tyres, whose points touch the ground."""
    n_spokes: int = 16
    """Spokes of each wheel, with two scatterers on each and one on the rim."""
    development_m: float | None = 5.0
    """Distance per turn of the cranks in the current gear; none: no pedalling."""
    phase_rad: float = 0.0
    """Angle of the cranks at time zero; 0: the left pedal is at the top."""
    rcs_m2: float = 0.32
    """Total cross section, -5 dBsm: twice that of a pedestrian."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "height_m", at_least=1.0, at_most=2.5)
        # 144 km/h, beyond the hour record.
        check_non_negative_fields(self, "speed_m_per_s", at_most=40.0)
        # From a folding bicycle to wheels that would touch.
        check_positive_fields(self, "wheel_radius_m", at_least=0.15, at_most=0.5)
        check_integer_fields(self, "n_spokes", at_least=3, at_most=100)
        if self.development_m is not None:
            check_positive_fields(self, "development_m", at_least=0.5, at_most=20.0)
            self._check_cadence(self.development_m)
        turn = 2 * math.pi
        phase = check_number("Bicyclist.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        check_positive_fields(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    def _check_cadence(self, development_m: float) -> None:
        if self.speed_m_per_s > _MAX_CADENCE_HZ * development_m:
            raise InvalidSetting(
                "Bicyclist.development_m",
                value=f"{development_m:.3g} m: {60 * self.cadence_hz:.0f} crank turns per minute"
                f" at {self.speed_m_per_s:.3g} m/s",
                expected=f"at least {self.speed_m_per_s / _MAX_CADENCE_HZ:.3g} m: at most"
                f" {60 * _MAX_CADENCE_HZ:.0f} turns per minute",
                fix="use a higher gear, or none for a rider who does not pedal",
            )

    @property
    def cadence_hz(self) -> float:
        """Return the crank turns per second, speed over development; 0 without pedalling."""
        return 0.0 if self.development_m is None else self.speed_m_per_s / self.development_m

    @property
    def is_rigid(self) -> bool:
        return self.speed_m_per_s == 0

    @property
    def blocking_box_m(self) -> np.ndarray:
        """Return the box of the scatterers at time zero, with feet and wheels on the ground."""
        points_m = self.scatterer_offsets_m(np.zeros(1))[0]
        low_m = np.array([*points_m.min(axis=0)[:2], -np.inf])
        return np.stack([low_m, points_m.max(axis=0)])

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the positions of the scatterers at each time, (n_times, n_scatterers, 3).

        The order is rider, frame, pedals, rear wheel, front wheel.
        """
        # Forward + i upward; wheels and cranks turn from upward to forward.
        cranks = 1j * np.exp(-1j * (self.phase_rad + 2 * np.pi * self.cadence_hz * times_s))
        pedals_m = _CRANK * self.height_m * cranks[:, None] * np.array([1, -1]) + _CRANK_AXLE_M
        wheels = np.exp(-1j * self.speed_m_per_s / self.wheel_radius_m * times_s)
        frame_m = np.broadcast_to(
            self._frame_tube_points_m, (len(times_s), *self._frame_tube_points_m.shape)
        )
        parts = [
            scatterer_positions_on_segments_m(self._rider_joints_m(pedals_m)),
            frame_m,
            _plane_to_3d_m(pedals_m, _HALF_PEDALS_M * np.array([1, -1])),
            *(
                _plane_to_3d_m(
                    axle_m + wheels[:, None] * self._wheel_points_m,
                    np.zeros(self._wheel_points_m.size),
                )
                for axle_m in self._axle_positions_m
            ),
        ]
        return np.concatenate(parts, axis=1)

    def cross_sections_m2(self) -> np.ndarray:
        n_frame, n_wheels = len(self._frame_tube_points_m), 2 * self._wheel_points_m.size
        return self.rcs_m2 * np.concatenate(
            [
                _RIDER_SHARE * RCS_SHARES,
                np.full(n_frame, _FRAME_SHARE / n_frame),
                np.full(2, _PEDAL_SHARE / 2),
                np.full(n_wheels, _WHEEL_SHARE / n_wheels),
            ]
        )

    def _rider_joints_m(self, pedals_m: np.ndarray) -> np.ndarray:
        """Return the positions of the joints, (n_times, n_joints, 3), for pedals (n_times, 2)."""
        height_m = self.height_m
        joints_m = np.repeat(self._static_joints_m[None], len(pedals_m), axis=0)
        ankles_m = pedals_m + self._ankle_offset_from_pedal_m
        knees_m = self._knee_positions_m(ankles_m)
        heels_m = ankles_m - (HEEL_SHARE * FOOT + 1j * ANKLE) * height_m
        hips_m = np.full_like(ankles_m, self._hip_position_m)
        legs_m = np.stack([hips_m, knees_m, ankles_m, heels_m, heels_m + FOOT * height_m], axis=-1)
        for side, side_sign in enumerate((1, -1)):
            joints_m[:, LEGS[side]] = _plane_to_3d_m(
                legs_m[:, side], np.full(5, side_sign * _HALF_PEDALS_M)
            )
        return joints_m

    def _knee_positions_m(self, ankles_m: np.ndarray) -> np.ndarray:
        """Return the knees, in front of the lines from hips to ankles."""
        thigh_m, shank_m = THIGH * self.height_m, SHANK * self.height_m
        line_m = ankles_m - self._hip_position_m
        reach_m = abs(line_m)
        along_m = (reach_m**2 + thigh_m**2 - shank_m**2) / (2 * reach_m)
        ahead_m = np.sqrt(thigh_m**2 - along_m**2)
        return np.asarray(self._hip_position_m + line_m / reach_m * (along_m + 1j * ahead_m))

    @property
    def _ankle_offset_from_pedal_m(self) -> complex:
        """Return the ankle relative to the pedal, for a level foot with its ball on the pedal."""
        return self.height_m * complex((HEEL_SHARE - _BALL_SHARE) * FOOT, ANKLE)

    @property
    def _hip_position_m(self) -> complex:
        """Return the hip, up the seat tube from the middle of the ankles' circles."""
        middle_m = _CRANK_AXLE_M + self._ankle_offset_from_pedal_m
        return complex(middle_m + (_LEG_REACH - _CRANK) * self.height_m * _SEAT_TUBE)

    @property
    def _axle_positions_m(self) -> tuple[complex, complex]:
        """Return the rear and the front axle."""
        up_m = 1j * self.wheel_radius_m
        return _REAR_AXLE_X_M + up_m, _FRONT_AXLE_X_M + up_m

    @cached_property
    def _static_joints_m(self) -> np.ndarray:
        """Return the joints that do not move, (n_joints, 3); zeros for the legs."""
        height_m, joints_m = self.height_m, np.zeros((len(Joint), 3))
        neck_m = self._hip_position_m + TRUNK * height_m * _SPINE
        crown_m = neck_m + NECK_AND_HEAD * height_m * _HEAD
        middle_m = np.array([self._hip_position_m, neck_m, crown_m])
        joints_m[: Joint.LEFT_SHOULDER] = _plane_to_3d_m(middle_m, np.zeros(3))
        fractions = np.array([0.0, 0.5, 0.9, 1.0])  # the fingers hold the handlebar
        for side, side_sign in enumerate((1, -1)):
            across_m = HALF_SHOULDERS * height_m * (1 - fractions) + _HALF_HANDLEBAR_M * fractions
            joints_m[ARMS[side]] = _plane_to_3d_m(
                neck_m + _ARM * height_m * fractions, side_sign * across_m
            )
        return joints_m

    @cached_property
    def _frame_tube_points_m(self) -> np.ndarray:
        """Return points on the tubes, (n, 3)."""
        rear_m, front_m = self._axle_positions_m
        saddle_m = self._hip_position_m - 0.05j * self.height_m
        stem_m = complex(*self._static_joints_m[Joint.LEFT_FINGERS, [0, 2]])
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
            [
                _plane_to_3d_m(points_m, np.zeros(points_m.size)),
                _plane_to_3d_m(np.full(3, stem_m), bar_m),
            ]
        )

    @cached_property
    def _wheel_points_m(self) -> np.ndarray:
        """Return points of a wheel about its axle at time zero, (n,); the first spoke is up."""
        turns = np.arange(self.n_spokes) / self.n_spokes
        spokes = 1j * np.exp(-2j * np.pi * turns[:, None])
        return (self.wheel_radius_m * spokes * _ALONG_SPOKE).ravel()


def _plane_to_3d_m(plane_m: np.ndarray, left_m: np.ndarray) -> np.ndarray:
    """Return positions (..., n, 3) from points in the bicycle's plane (..., n) and left offsets.

    Points in the plane are complex, forward + i upward.
    """
    return np.stack([plane_m.real, np.broadcast_to(left_m, plane_m.shape), plane_m.imag], axis=-1)
