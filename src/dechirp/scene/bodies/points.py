"""Scatterers one by one, some on parts that turn or swing: wheels, arms, rotors, pipes."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import Vector, instances, not_negative, number, positive, vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import LEAST_RCS_M2, MOST_RCS_M2, Body
from dechirp.scene.slow import must_be_slow

# Wider than from a rail wheel to a dentist's drill: outside, a unit is wrong.
_FASTEST_TURN_RAD_PER_S = 1e5
_FASTEST_SWING_HZ = 1e5


@value
class Rotation:
    """A turn at constant rate."""

    center_m: Vector
    """A place on the axis, in the axes of the body."""
    axis: Vector = (0.0, 1.0, 0.0)
    """Direction of the axis, of any length; a wheel's points left."""
    rate_rad_per_s: float
    """Right-handed: a wheel rolls forward about an axis to the left."""

    def __post_init__(self) -> None:
        vector(self, "center_m", at_most=1e9)
        vector(self, "axis", at_most=1e9)
        if math.hypot(*self.axis) < 1e-9:
            raise InvalidSetting(
                "Rotation.axis",
                got=self.axis,
                need="a direction",
                fix="Give (0, 1, 0) for a wheel, (0, 0, 1) for a rotor.",
            )
        most = _FASTEST_TURN_RAD_PER_S
        where = "Rotation.rate_rad_per_s"
        rate = number(where, self.rate_rad_per_s, at_least=-most, at_most=most)
        object.__setattr__(self, "rate_rad_per_s", rate)


@value
class Oscillation:
    """A swing to and fro, as a sine."""

    amplitude_m: Vector
    """Largest way from the middle, and its direction, in the axes of the body."""
    frequency_hz: float
    phase_rad: float = 0.0
    """Of the sine at time zero; 0: in the middle, on its way along the amplitude."""

    def __post_init__(self) -> None:
        vector(self, "amplitude_m", at_most=1e9)
        not_negative(self, "frequency_hz", at_most=_FASTEST_SWING_HZ)
        turn = 2 * math.pi
        phase = number("Oscillation.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        speed = turn * self.frequency_hz * math.hypot(*self.amplitude_m)
        must_be_slow("Oscillation.amplitude_m", speed, of=" in the middle")


@value
class Scatterer:
    """One point of a body."""

    position_m: Vector
    """In the axes of the body: at time zero, the middle of an oscillation."""
    rcs_m2: float
    """Mean cross section (dBsm in files)."""
    rotation: Rotation | None = None
    oscillation: Oscillation | None = None
    """Of the axis it turns about, where it turns as well."""

    def __post_init__(self) -> None:
        vector(self, "position_m", at_most=1e9)
        positive(self, "rcs_m2", at_least=LEAST_RCS_M2, at_most=MOST_RCS_M2)
        for name, kind in (("rotation", Rotation), ("oscillation", Oscillation)):
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Scatterer.{name}",
                    got=getattr(self, name),
                    need=f"of the class {kind.__name__}, or none",
                    fix="Make one, or leave it out.",
                )
        if self.rotation is not None:
            radius_m = math.dist(self.position_m, self.rotation.center_m)  # at most
            speed = abs(self.rotation.rate_rad_per_s) * radius_m
            must_be_slow("Scatterer.rotation", speed, of=" on its circle")


@value
class Points(Body):
    """Scatterers one by one; `Cloud` takes many from arrays."""

    scatterers: tuple[Scatterer, ...]

    def __post_init__(self) -> None:
        fix = "Give at least one Scatterer, each with its position and its rcs."
        points = instances("Points.scatterers", self.scatterers, Scatterer, fix=fix)
        if not points:
            need = "a list of at least one scatterer"
            raise InvalidSetting("Points.scatterers", got="empty", need=need, fix=fix)
        object.__setattr__(self, "scatterers", points)

    @property
    def is_rigid(self) -> bool:
        """Whether no scatterer turns or swings."""
        return all(p.rotation is None and p.oscillation is None for p in self.scatterers)

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers at each time, (n_times, n_scatterers, 3), axes of the body."""
        offsets_m = np.repeat(self._at_m[None], len(times_s), axis=0)
        t = times_s[:, None, None]
        places, rate, fixed, along, across = self._turning
        if places.size:  # Rodrigues' formula
            offsets_m[:, places] = fixed + along * np.cos(rate * t) + across * np.sin(rate * t)
        places, amplitude_m, angular, phase_rad = self._swinging
        if places.size:
            offsets_m[:, places] += amplitude_m * np.sin(angular * t + phase_rad)
        return offsets_m

    def cross_sections_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,)."""
        return np.array([point.rcs_m2 for point in self.scatterers])

    @cached_property
    def _at_m(self) -> np.ndarray:
        return np.array([point.position_m for point in self.scatterers])

    @cached_property
    def _turning(self) -> tuple[np.ndarray, ...]:
        """Which turn: places (n,), rate (n, 1), and centre, cosine and sine of circles (n, 3)."""
        turns = [(i, p.rotation) for i, p in enumerate(self.scatterers) if p.rotation is not None]
        places = np.array([i for i, _ in turns], dtype=int)
        rate = np.array([[turn.rate_rad_per_s] for _, turn in turns])
        center_m = np.array([turn.center_m for _, turn in turns]).reshape(-1, 3)
        axis = np.array([turn.axis for _, turn in turns]).reshape(-1, 3)
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        arm_m = self._at_m[places] - center_m
        fixed_m = (arm_m * axis).sum(axis=1, keepdims=True) * axis
        return places, rate, center_m + fixed_m, arm_m - fixed_m, np.cross(axis, arm_m)

    @cached_property
    def _swinging(self) -> tuple[np.ndarray, ...]:
        """Which swing: places (n,), amplitude (n, 3), angular frequency and phase (n, 1)."""
        swings = [
            (i, p.oscillation) for i, p in enumerate(self.scatterers) if p.oscillation is not None
        ]
        places = np.array([i for i, _ in swings], dtype=int)
        amplitude_m = np.array([swing.amplitude_m for _, swing in swings]).reshape(-1, 3)
        angular = np.array([[2 * np.pi * swing.frequency_hz] for _, swing in swings])
        phase_rad = np.array([[swing.phase_rad] for _, swing in swings])
        return places, amplitude_m, angular, phase_rad
