"""Gait: joint positions of a walking person over the gait cycle."""

from functools import cached_property

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.scene.skeleton import (
    ANKLE,
    ARMS,
    FOOT,
    FOREARM,
    HALF_HIPS,
    HALF_SHOULDERS,
    HAND,
    HEEL_SHARE,
    HIP_HEIGHT,
    LEGS,
    NECK_AND_HEAD,
    SHANK,
    THIGH,
    TRUNK,
    UPPER_ARM,
    Joint,
)

MAX_RELATIVE_SPEED_PER_S = 2.3
"""Largest walking speed over the height of the hips, 1/s; faster people run."""

# Harmonics of the angles. The tables have three to five turning points a cycle, which six harmonics
# approximate within 2 degrees.
_N_HARMONICS = 6
# Harmonics of the height of the pelvis; odd ones cancel between the legs.
_N_HEIGHT_HARMONICS = 4
_N_PHASES = 256
_SIDE_PHASES = np.array([0.5, 0.0])  # the left leg and arm lag the right ones by half a cycle
_SIDE_SIGNS = np.array([1.0, -1.0])  # y is to the left
_TWO_PI = 2 * np.pi


@frozen_dataclass
class Gait:
    r"""Walking at constant speed, by the model of Boulic and the Thalmanns.

    .. math:: V_R = v / H_t, \quad R_C = 1.346 \sqrt{V_R}, \quad T_C = R_C / V_R

    with the height of the hips :math:`H_t`, the relative length :math:`R_C` of a cycle of two
    steps, and its duration :math:`T_C`. A foot is on the ground for 0.752 T_C - 0.143 s. A cycle
    starts when the right heel strikes. Angles of hips, knees, ankles, elbows and thorax pass
    through the turning points of the model's tables, which are linear in V_R between 0, 0.5, 1.3
    and 3; pelvis, spine and shoulders turn and swing as its sines.

    There are two deviations. Angles are sums of six harmonics, smooth at all times. The height of
    the pelvis is that which the lower foot needs, up to the fourth harmonic: with the model's own
    rise and fall, 0.015 V_R H_t, the feet of fast walkers would sink in by 5 cm. Residual errors of
    the tables: a foot on the ground slides by up to 0.3 v to and fro, by 0.1 v in the mean; below 1
    m/s, where the legs swing more than the steps are long, by up to 0.5 v backward. Feet in the air
    peak at 3.5 v (2 m/s) to 4 v (1.3 m/s), and at 5 v at 0.5 m/s.

    References
    ----------
    R. Boulic, N. Magnenat-Thalmann, D. Thalmann, A global human walking model with real-time
    kinematic personification, The Visual Computer 6, 1990. Numbers of its plots as in
    V. C. Chen, The Micro-Doppler Effect in Radar, 2011, chapter 4.
    """

    height_m: float
    speed_m_per_s: float

    @property
    def speed_over_hip_height_per_s(self) -> float:
        """Return the speed over the height of the hips, V_R."""
        return self.speed_m_per_s / (HIP_HEIGHT * self.height_m)

    @property
    def cycle_frequency_hz(self) -> float:
        """Return the cycles per second, 1 / T_C, of two steps each."""
        return float(np.sqrt(self.speed_over_hip_height_per_s)) / 1.346

    def joint_positions_m(self, cycles: np.ndarray) -> np.ndarray:
        """Return the positions of the joints, (n_times, n_joints, 3), in the order of `Joint`.

        x forward, y left, z up from the ground, moving along at the mean speed.

        Parameters
        ----------
        cycles : array (n_times,)
            Phase in cycles; 0: the right heel strikes.
        """
        height_m = self.height_m
        joints_m = np.zeros((len(cycles), len(Joint), 3))
        forward_m, left_m = self._pelvis_sway_m(cycles)
        pelvis_m = np.stack(
            [forward_m, left_m, _evaluate_harmonics(self._pelvis_height_harmonics_m, cycles)],
            axis=-1,
        )
        joints_m[:, Joint.PELVIS] = pelvis_m

        lean = np.radians(2 * self._slow_walk_motion_factor) * (
            1 - np.sin(_TWO_PI * (2 * cycles - 0.1))
        )
        spine = np.stack([np.sin(lean), np.zeros_like(lean), np.cos(lean)], axis=-1)
        joints_m[:, Joint.NECK] = pelvis_m + TRUNK * height_m * spine
        joints_m[:, Joint.CROWN] = pelvis_m + (TRUNK + NECK_AND_HEAD) * height_m * spine

        twist = -_evaluate_harmonics(self._joint_angle_harmonics["thorax"], cycles)
        half_m = HALF_SHOULDERS * height_m
        legs_m, arms_m = self._leg_joints_m(cycles), self._arm_joints_m(cycles)
        for side, side_sign in enumerate(_SIDE_SIGNS):
            arm, leg = joints_m[:, ARMS[side]], joints_m[:, LEGS[side]]
            arm[...] = joints_m[:, Joint.NECK, None]
            arm[..., 0] += arms_m[:, side].real - (side_sign * half_m * np.sin(twist))[:, None]
            arm[..., 1] += (side_sign * half_m * np.cos(twist))[:, None]
            arm[..., 2] += arms_m[:, side].imag
            leg[...] = pelvis_m[:, None]
            leg[..., 0] += legs_m[:, side].real
            # Legs lean with the hips; the feet stay in place.
            lean_shares = np.array([1.0, (ANKLE + SHANK) / HIP_HEIGHT, 0.0, 0.0, 0.0])
            leg[..., 1] = side_sign * HALF_HIPS * height_m + lean_shares * left_m[:, None]
            leg[..., 2] += legs_m[:, side].imag
        return joints_m

    @property
    def _slow_walk_motion_factor(self) -> float:
        """Return the factor, 0 to 1, of motions that grow up to a relative speed of 0.5."""
        slow = min(self.speed_over_hip_height_per_s, 0.5)
        return 4 * slow * (1 - slow)

    @property
    def _stance_fraction(self) -> float:
        """Return the share of a cycle during which a foot is on the ground."""
        return 0.752 - 0.143 * self.cycle_frequency_hz

    @cached_property
    def _joint_angle_harmonics(self) -> dict[str, np.ndarray]:
        """Return the harmonics of the angles, rad: right limbs; tilt and thorax to the left."""
        speed = self.speed_over_hip_height_per_s

        def by_speed(*values: float) -> float:
            return float(np.interp(speed, (0.0, 0.5, 1.3, 3.0), values))

        turning_points = {
            "hip": (
                (by_speed(-0.1, -0.1, -0.1, 0.1), by_speed(0, 25, 25, 30)),
                (0.5, by_speed(0, -15, -15, -15)),
                (0.9, by_speed(0, 25, 25, 31)),
            ),
            "knee": (
                (by_speed(0.17, 0.17, 0.17, 0.12), by_speed(3, 3, 3, 25)),
                (0.4, 3.0),
                (by_speed(0.75, 0.75, 0.75, 0.7), by_speed(3, 70, 70, 65)),
                (by_speed(1, 1, 1, 0.97), by_speed(3, 3, 3, 6)),
            ),
            "ankle": (
                (0.0, by_speed(-3, -3, -3, 2)),
                (0.08, by_speed(-3, -18, -18, -14)),
                (by_speed(0.5, 0.5, 0.5, 0.4), by_speed(-3, 8, 8, 5)),
                (self._stance_fraction, by_speed(-3, -20, -20, -28)),
                (0.85, by_speed(-3, -3, -3, 2)),
            ),
            "elbow": (
                (0.05, by_speed(3, 6, 14, 8)),
                (by_speed(0.5, 0.5, 0.51, 0.55), by_speed(3, 20, 44, 70)),
                (by_speed(0.9, 0.9, 0.9, 0.8), by_speed(3, 8, 17, 11)),
            ),
            "tilt": ((0.0, 0.0), (0.15, -3.32 * speed), (0.5, 0.0), (0.65, 3.32 * speed)),
            "thorax": (
                (0.1, 4 / 3 * speed),
                (0.4, -1.5 * speed),
                (0.6, -4 / 3 * speed),
                (0.9, 1.5 * speed),
            ),
        }
        return {
            name: np.pi / 180 * _smooth_curve_harmonics(points)
            for name, points in turning_points.items()
        }

    @cached_property
    def _pelvis_height_harmonics_m(self) -> np.ndarray:
        """Return the harmonics of the pelvis height over the lowest point of both feet."""
        legs_m = self._leg_joints_m(np.arange(_N_PHASES) / _N_PHASES)
        lowest_m = legs_m[..., -2:].imag.min(axis=(1, 2))
        return _fourier_coefficients(-lowest_m, _N_HEIGHT_HARMONICS)

    def _pelvis_sway_m(self, cycles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the displacement of the pelvis ahead of the mean motion, and to the left."""
        hips_m = HIP_HEIGHT * self.height_m
        ahead = (
            -0.021
            * self._slow_walk_motion_factor
            * np.sin(2 * _TWO_PI * (cycles + 0.625 - self._stance_fraction))
        )
        leftward = -0.032 * self._slow_walk_motion_factor * np.sin(_TWO_PI * (cycles - 0.1))
        return hips_m * ahead, hips_m * leftward

    def _leg_joints_m(self, cycles: np.ndarray) -> np.ndarray:
        """Return hip to toe from the pelvis, (n_times, 2 sides, 5), forward + i upward."""
        side_cycles = cycles[:, None] + _SIDE_PHASES
        hip, knee, ankle = (
            _evaluate_harmonics(self._joint_angle_harmonics[name], side_cycles)
            for name in ("hip", "knee", "ankle")
        )
        turn = np.radians(4 * self.speed_over_hip_height_per_s) * np.cos(_TWO_PI * cycles)
        tilt = _evaluate_harmonics(self._joint_angle_harmonics["tilt"], cycles)
        # The pelvis turns the hips; legs swing in planes along the direction of walking.
        hips = _SIDE_SIGNS * HALF_HIPS * (-np.sin(turn) + 1j * np.sin(tilt))[:, None]
        knees = hips - 1j * THIGH * np.exp(1j * hip)
        ankles = knees - 1j * SHANK * np.exp(1j * (hip - knee))
        sole = np.exp(1j * (hip - knee + ankle))
        heels = ankles - (HEEL_SHARE * FOOT + 1j * ANKLE) * sole
        toes = heels + FOOT * sole
        return self.height_m * np.stack([hips, knees, ankles, heels, toes], axis=-1)

    def _arm_joints_m(self, cycles: np.ndarray) -> np.ndarray:
        """Return shoulder to fingers from the shoulder, (n_times, 2 sides, 4), as plane points."""
        side_cycles = cycles[:, None] + _SIDE_PHASES
        swing = 9.88 * self.speed_over_hip_height_per_s
        shoulder = np.radians(3 - swing / 2 - swing * np.cos(_TWO_PI * side_cycles))
        elbow = _evaluate_harmonics(self._joint_angle_harmonics["elbow"], side_cycles)
        upper, lower = -1j * np.exp(1j * shoulder), -1j * np.exp(1j * (shoulder + elbow))
        elbows = UPPER_ARM * upper
        wrists = elbows + FOREARM * lower
        fingers = wrists + HAND * lower
        return self.height_m * np.stack([0 * elbows, elbows, wrists, fingers], axis=-1)


def _smooth_curve_harmonics(turning_points: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return the harmonics of a periodic curve, cubic between its level turning points."""
    times, values = np.array(sorted((time % 1.0, value) for time, value in turning_points)).T
    times = np.concatenate([times - 1, times, times + 1])
    values = np.tile(values, 3)
    cycles = np.arange(_N_PHASES) / _N_PHASES
    previous = np.searchsorted(times, cycles, side="right") - 1
    following = previous + 1
    fraction = (cycles - times[previous]) / (times[following] - times[previous])
    curve = values[previous] + (values[following] - values[previous]) * fraction**2 * (
        3 - 2 * fraction
    )
    return _fourier_coefficients(curve, _N_HARMONICS)


def _fourier_coefficients(curve: np.ndarray, max_harmonic: int) -> np.ndarray:
    """Return the harmonics 0 to `max_harmonic` of a cycle, whose real parts add up to it."""
    coefficients = np.fft.rfft(curve)[: max_harmonic + 1] / len(curve)
    coefficients[1:] *= 2
    return coefficients


def _evaluate_harmonics(harmonics: np.ndarray, cycles: np.ndarray) -> np.ndarray:
    """Return the sum of harmonics at phases of any shape."""
    phasors_sum = np.polynomial.polynomial.polyval(np.exp(1j * _TWO_PI * cycles), harmonics)
    return np.asarray(phasors_sum.real)
