"""How a person walks: where the joints are over the cycle of the gait."""

from functools import cached_property

import numpy as np

from dechirp.core.values import value
from dechirp.scene.person import (
    ANKLE,
    ARMS,
    BEHIND_ANKLE,
    FOOT,
    FOREARM,
    HALF_HIPS,
    HALF_SHOULDERS,
    HAND,
    HIP_HEIGHT,
    LEGS,
    NECK_AND_HEAD,
    SHANK,
    THIGH,
    TRUNK,
    UPPER_ARM,
    Joint,
)

FASTEST_PER_S = 2.3
"""Largest speed over the height of the hips, 1/s: beyond, people run."""

# Harmonics of the angles. The tables have three to five turning points a cycle, and the sixth
# harmonic is within 2 degrees of them.
_N_HARMONICS = 6
# The sum of harmonics up to this one carries the pelvis; odd ones cancel between the legs.
_HIGHEST_RISE = 4
_N_PHASES = 256
_HALF = np.array([0.5, 0.0])  # the left leg and arm are half a cycle apart from the right ones
_LEFT = np.array([1.0, -1.0])  # y is to the left
_TURN = 2 * np.pi


@value
class Gait:
    r"""Walking at constant speed, by the model of Boulic and the Thalmanns.

    .. math:: V_R = v / H_t, \quad R_C = 1.346 \sqrt{V_R}, \quad T_C = R_C / V_R

    with the height of the hips :math:`H_t`, the relative length :math:`R_C` of a cycle of two
    steps, and its duration :math:`T_C`. A foot is on the ground for 0.752 T_C - 0.143 s. A
    cycle starts when the right heel strikes. Angles of hips, knees, ankles, elbows and thorax
    go through the turning points of the model's tables, which are linear in V_R between 0,
    0.5, 1.3 and 3; pelvis, spine and shoulders turn and swing as its sines.

    Two things differ. Angles are sums of six harmonics, smooth at all times. And the pelvis
    is as high as the lower foot needs, up to the fourth harmonic: by the model's own rise and
    fall, 0.015 V_R H_t, the feet of fast walkers sink in by 5 cm. What the tables leave: a foot
    on the ground slides by up to 0.3 v to and fro, by 0.1 v in the mean; below 1 m/s, where the
    legs swing more than the steps are long, by up to 0.5 v backward. Feet in the air peak at
    3.5 v (2 m/s) to 4 v (1.3 m/s), and at 5 v at 0.5 m/s.

    References
    ----------
    R. Boulic, N. Magnenat-Thalmann, D. Thalmann, A global human walking model with real-time
    kinematic personification, The Visual Computer 6, 1990. Numbers of its plots as in
    V. C. Chen, The Micro-Doppler Effect in Radar, 2011, chapter 4.
    """

    height_m: float
    speed_m_per_s: float

    @property
    def relative_speed_per_s(self) -> float:
        """Speed over the height of the hips, V_R."""
        return self.speed_m_per_s / (HIP_HEIGHT * self.height_m)

    @property
    def frequency_hz(self) -> float:
        """Cycles a second, 1 / T_C: of two steps each."""
        return float(np.sqrt(self.relative_speed_per_s)) / 1.346

    def joints_m(self, cycles: np.ndarray) -> np.ndarray:
        """Where the joints are, (n_times, n_joints, 3), in the order of `Joint`.

        x forward, y left, z up from the ground, moving along at the mean speed.

        Parameters
        ----------
        cycles : array (n_times,)
            Cycles done; 0: the right heel strikes.
        """
        height_m = self.height_m
        found = np.zeros((len(cycles), len(Joint), 3))
        forward_m, left_m = self._sway_m(cycles)
        pelvis_m = np.stack([forward_m, left_m, _at(self._rise_m, cycles)], axis=-1)
        found[:, Joint.PELVIS] = pelvis_m

        lean = np.radians(2 * self._ease) * (1 - np.sin(_TURN * (2 * cycles - 0.1)))
        spine = np.stack([np.sin(lean), np.zeros_like(lean), np.cos(lean)], axis=-1)
        found[:, Joint.NECK] = pelvis_m + TRUNK * height_m * spine
        found[:, Joint.CROWN] = pelvis_m + (TRUNK + NECK_AND_HEAD) * height_m * spine

        twist = -_at(self._angles["thorax"], cycles)
        half_m = HALF_SHOULDERS * height_m
        legs_m, arms_m = self._legs_m(cycles), self._arms_m(cycles)
        for side, left in enumerate(_LEFT):
            arm, leg = found[:, ARMS[side]], found[:, LEGS[side]]
            arm[...] = found[:, Joint.NECK, None]
            arm[..., 0] += arms_m[:, side].real - (left * half_m * np.sin(twist))[:, None]
            arm[..., 1] += (left * half_m * np.cos(twist))[:, None]
            arm[..., 2] += arms_m[:, side].imag
            leg[...] = pelvis_m[:, None]
            leg[..., 0] += legs_m[:, side].real
            # Legs lean with the hips; the feet stay where they are.
            lean_shares = np.array([1.0, (ANKLE + SHANK) / HIP_HEIGHT, 0.0, 0.0, 0.0])
            leg[..., 1] = left * HALF_HIPS * height_m + lean_shares * left_m[:, None]
            leg[..., 2] += legs_m[:, side].imag
        return found

    @property
    def _ease(self) -> float:
        """Of what grows up to a relative speed of 0.5 and stays, 0 to 1."""
        slow = min(self.relative_speed_per_s, 0.5)
        return 4 * slow * (1 - slow)

    @property
    def _support(self) -> float:
        """Share of a cycle for which a foot is on the ground."""
        return 0.752 - 0.143 * self.frequency_hz

    @cached_property
    def _angles(self) -> dict[str, np.ndarray]:
        """Harmonics of the angles, rad: of the right limbs; of tilt and thorax, to the left."""
        speed = self.relative_speed_per_s

        def by(*values: float) -> float:
            return float(np.interp(speed, (0.0, 0.5, 1.3, 3.0), values))

        turning_points = {
            "hip": (
                (by(-0.1, -0.1, -0.1, 0.1), by(0, 25, 25, 30)),
                (0.5, by(0, -15, -15, -15)),
                (0.9, by(0, 25, 25, 31)),
            ),
            "knee": (
                (by(0.17, 0.17, 0.17, 0.12), by(3, 3, 3, 25)),
                (0.4, 3.0),
                (by(0.75, 0.75, 0.75, 0.7), by(3, 70, 70, 65)),
                (by(1, 1, 1, 0.97), by(3, 3, 3, 6)),
            ),
            "ankle": (
                (0.0, by(-3, -3, -3, 2)),
                (0.08, by(-3, -18, -18, -14)),
                (by(0.5, 0.5, 0.5, 0.4), by(-3, 8, 8, 5)),
                (self._support, by(-3, -20, -20, -28)),
                (0.85, by(-3, -3, -3, 2)),
            ),
            "elbow": (
                (0.05, by(3, 6, 14, 8)),
                (by(0.5, 0.5, 0.51, 0.55), by(3, 20, 44, 70)),
                (by(0.9, 0.9, 0.9, 0.8), by(3, 8, 17, 11)),
            ),
            "tilt": ((0.0, 0.0), (0.15, -3.32 * speed), (0.5, 0.0), (0.65, 3.32 * speed)),
            "thorax": (
                (0.1, 4 / 3 * speed),
                (0.4, -1.5 * speed),
                (0.6, -4 / 3 * speed),
                (0.9, 1.5 * speed),
            ),
        }
        return {name: np.pi / 180 * _harmonics(points) for name, points in turning_points.items()}

    @cached_property
    def _rise_m(self) -> np.ndarray:
        """Harmonics of the height of the pelvis: of the lowest place of both feet below it."""
        legs_m = self._legs_m(np.arange(_N_PHASES) / _N_PHASES)
        lowest_m = legs_m[..., -2:].imag.min(axis=(1, 2))
        return _fourier(-lowest_m, _HIGHEST_RISE)

    def _sway_m(self, cycles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far the pelvis is ahead of the mean speed, and to the left."""
        hips_m = HIP_HEIGHT * self.height_m
        ahead = -0.021 * self._ease * np.sin(2 * _TURN * (cycles + 0.625 - self._support))
        left = -0.032 * self._ease * np.sin(_TURN * (cycles - 0.1))
        return hips_m * ahead, hips_m * left

    def _legs_m(self, cycles: np.ndarray) -> np.ndarray:
        """Hip to toe from the pelvis, (n_times, 2 sides, 5), forward + i upward."""
        own = cycles[:, None] + _HALF
        hip, knee, ankle = (_at(self._angles[name], own) for name in ("hip", "knee", "ankle"))
        turn = np.radians(4 * self.relative_speed_per_s) * np.cos(_TURN * cycles)
        tilt = _at(self._angles["tilt"], cycles)
        # The pelvis turns the hips; legs swing in planes along the way.
        hips = _LEFT * HALF_HIPS * (-np.sin(turn) + 1j * np.sin(tilt))[:, None]
        knees = hips - 1j * THIGH * np.exp(1j * hip)
        ankles = knees - 1j * SHANK * np.exp(1j * (hip - knee))
        sole = np.exp(1j * (hip - knee + ankle))
        heels = ankles - (BEHIND_ANKLE * FOOT + 1j * ANKLE) * sole
        toes = heels + FOOT * sole
        return self.height_m * np.stack([hips, knees, ankles, heels, toes], axis=-1)

    def _arms_m(self, cycles: np.ndarray) -> np.ndarray:
        """Shoulder to fingers from the shoulder, (n_times, 2 sides, 4), forward + i upward."""
        own = cycles[:, None] + _HALF
        swing = 9.88 * self.relative_speed_per_s
        shoulder = np.radians(3 - swing / 2 - swing * np.cos(_TURN * own))
        elbow = _at(self._angles["elbow"], own)
        upper, lower = -1j * np.exp(1j * shoulder), -1j * np.exp(1j * (shoulder + elbow))
        elbows = UPPER_ARM * upper
        wrists = elbows + FOREARM * lower
        fingers = wrists + HAND * lower
        return self.height_m * np.stack([0 * elbows, elbows, wrists, fingers], axis=-1)


def _harmonics(points: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Harmonics of a periodic curve, level at its turning points and cubic between them."""
    times, values = np.array(sorted((time % 1.0, value) for time, value in points)).T
    times = np.concatenate([times - 1, times, times + 1])
    values = np.tile(values, 3)
    cycles = np.arange(_N_PHASES) / _N_PHASES
    before = np.searchsorted(times, cycles, side="right") - 1
    after = before + 1
    way = (cycles - times[before]) / (times[after] - times[before])
    curve = values[before] + (values[after] - values[before]) * way**2 * (3 - 2 * way)
    return _fourier(curve, _N_HARMONICS)


def _fourier(curve: np.ndarray, highest: int) -> np.ndarray:
    """Harmonics 0 to `highest` of a cycle, (highest + 1,): their real parts add up to it."""
    found = np.fft.rfft(curve)[: highest + 1] / len(curve)
    found[1:] *= 2
    return found


def _at(harmonics: np.ndarray, cycles: np.ndarray) -> np.ndarray:
    """Sum of harmonics at phases of any shape."""
    turned = np.polynomial.polynomial.polyval(np.exp(1j * _TURN * cycles), harmonics)
    return np.asarray(turned.real)
