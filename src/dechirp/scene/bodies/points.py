"""Individual scatterers, also on rotating or oscillating parts: wheels, arms, rotors, pipes."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import (
    Vector,
    check_and_convert_vector_field,
    check_instances,
    check_non_negative_fields,
    check_number,
    check_positive_fields,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import MAX_RCS_M2, MIN_RCS_M2, Body
from dechirp.scene.speed_limit import check_speed_limit

__all__ = ["Oscillation", "Points", "Rotation", "Scatterer"]

# Limits wider than from a rail wheel to a dentist's drill: other values indicate a wrong unit.
_MAX_TURN_RATE_RAD_PER_S = 1e5
_MAX_OSCILLATION_HZ = 1e5


@frozen_dataclass
class Rotation:
    """Rotation at constant rate."""

    center_m: Vector
    """Point on the axis, in the axes of the body."""
    axis: Vector = (0.0, 1.0, 0.0)
    """Direction of the axis, of any length; that of a wheel points left."""
    rate_rad_per_s: float
    """Right-handed rate: a wheel rolls forward about an axis to the left."""

    def __post_init__(self) -> None:
        check_and_convert_vector_field(self, "center_m", max_magnitude=1e9)
        check_and_convert_vector_field(self, "axis", max_magnitude=1e9)
        if math.hypot(*self.axis) < 1e-9:
            raise InvalidSetting(
                "Rotation.axis",
                value=self.axis,
                expected="a vector of positive length",
                fix="give (0, 1, 0) for a wheel, (0, 0, 1) for a rotor",
            )
        max_rate = _MAX_TURN_RATE_RAD_PER_S
        setting = "Rotation.rate_rad_per_s"
        rate = check_number(setting, self.rate_rad_per_s, at_least=-max_rate, at_most=max_rate)
        object.__setattr__(self, "rate_rad_per_s", rate)


@frozen_dataclass
class Oscillation:
    """Sinusoidal oscillation."""

    amplitude_m: Vector
    """Largest displacement from the middle, with its direction, in the axes of the body."""
    frequency_hz: float
    phase_rad: float = 0.0
    """Phase of the sine at time zero; 0: in the middle, moving along the amplitude."""

    def __post_init__(self) -> None:
        check_and_convert_vector_field(self, "amplitude_m", max_magnitude=1e9)
        check_non_negative_fields(self, "frequency_hz", at_most=_MAX_OSCILLATION_HZ)
        turn = 2 * math.pi
        phase = check_number("Oscillation.phase_rad", self.phase_rad, at_least=-turn, at_most=turn)
        object.__setattr__(self, "phase_rad", phase)
        speed = turn * self.frequency_hz * math.hypot(*self.amplitude_m)
        check_speed_limit("Oscillation.amplitude_m", speed, context=" in the middle")


@frozen_dataclass
class Scatterer:
    """One point of a body."""

    position_m: Vector
    """Position in the axes of the body: at time zero, the middle of an oscillation."""
    rcs_m2: float
    """Mean cross section (dBsm in files)."""
    rotation: Rotation | None = None
    oscillation: Oscillation | None = None
    """Oscillation; of the rotation axis, if the point rotates as well."""

    def __post_init__(self) -> None:
        check_and_convert_vector_field(self, "position_m", max_magnitude=1e9)
        check_positive_fields(self, "rcs_m2", at_least=MIN_RCS_M2, at_most=MAX_RCS_M2)
        for name, kind in (("rotation", Rotation), ("oscillation", Oscillation)):
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Scatterer.{name}",
                    value=getattr(self, name),
                    expected=f"a {kind.__name__}, or none",
                    fix="create one, or omit it",
                )
        if self.rotation is not None:
            radius_m = math.dist(self.position_m, self.rotation.center_m)  # at most
            speed = abs(self.rotation.rate_rad_per_s) * radius_m
            check_speed_limit("Scatterer.rotation", speed, context=" on its circle")


@frozen_dataclass
class Points(Body):
    """Individual scatterers; `PointCloud` accepts arrays of many."""

    scatterers: tuple[Scatterer, ...]
    """Points of the body, with their position and cross section."""

    def __post_init__(self) -> None:
        fix = "give at least one Scatterer, each with its position and rcs"
        points = check_instances("Points.scatterers", self.scatterers, Scatterer, fix=fix)
        if not points:
            need = "a list of at least one scatterer"
            raise InvalidSetting("Points.scatterers", value="empty", expected=need, fix=fix)
        object.__setattr__(self, "scatterers", points)

    @property
    def is_rigid(self) -> bool:
        return all(p.rotation is None and p.oscillation is None for p in self.scatterers)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        offsets_m = np.repeat(self._positions_m[None], len(times_s), axis=0)
        t = times_s[:, None, None]
        indices, rate, centre_m, cosine_m, sine_m = self._rotation_arrays
        if indices.size:  # Rodrigues' formula
            offsets_m[:, indices] = (
                centre_m + cosine_m * np.cos(rate * t) + sine_m * np.sin(rate * t)
            )
        indices, amplitude_m, angular, phase_rad = self._oscillation_arrays
        if indices.size:
            offsets_m[:, indices] += amplitude_m * np.sin(angular * t + phase_rad)
        return offsets_m

    def cross_sections_m2(self) -> np.ndarray:
        return np.array([point.rcs_m2 for point in self.scatterers])

    @cached_property
    def _positions_m(self) -> np.ndarray:
        return np.array([point.position_m for point in self.scatterers])

    @cached_property
    def _rotation_arrays(self) -> tuple[np.ndarray, ...]:
        """Return indices (n,), rate (n, 1), and centre, cosine and sine of the circles (n, 3)."""
        rotations = [
            (i, p.rotation) for i, p in enumerate(self.scatterers) if p.rotation is not None
        ]
        indices = np.array([i for i, _ in rotations], dtype=int)
        rate = np.array([[rotation.rate_rad_per_s] for _, rotation in rotations])
        center_m = np.array([rotation.center_m for _, rotation in rotations]).reshape(-1, 3)
        axis = np.array([rotation.axis for _, rotation in rotations]).reshape(-1, 3)
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        arm_m = self._positions_m[indices] - center_m
        fixed_m = (arm_m * axis).sum(axis=1, keepdims=True) * axis
        return indices, rate, center_m + fixed_m, arm_m - fixed_m, np.cross(axis, arm_m)

    @cached_property
    def _oscillation_arrays(self) -> tuple[np.ndarray, ...]:
        """Return indices (n,), amplitude (n, 3), angular frequency and phase (n, 1)."""
        oscillations = [
            (i, p.oscillation) for i, p in enumerate(self.scatterers) if p.oscillation is not None
        ]
        indices = np.array([i for i, _ in oscillations], dtype=int)
        amplitude_m = np.array(
            [oscillation.amplitude_m for _, oscillation in oscillations]
        ).reshape(-1, 3)
        angular = np.array(
            [[2 * np.pi * oscillation.frequency_hz] for _, oscillation in oscillations]
        )
        phase_rad = np.array([[oscillation.phase_rad] for _, oscillation in oscillations])
        return indices, amplitude_m, angular, phase_rad
