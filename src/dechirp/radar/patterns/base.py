"""Antenna patterns: base class, and directions in the axes of a beam."""

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import check_number
from dechirp.core.families import Family

MIN_GAIN, MAX_GAIN = 1e-12, 1e12
"""Bounds from below the deepest measured null to above the largest dish."""


class Pattern(Family):
    """Gain of one antenna, transmit or receive, relative to a lossless isotropic one."""

    group: ClassVar[str] = "dechirp.pattern"

    @abstractmethod
    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Return the power gain towards directions in the axes of the radar, a ratio.

        Any shapes that broadcast; the broadcast shape.
        """

    @property
    @abstractmethod
    def peak_gain(self) -> float:
        """Largest gain, a ratio."""


def check_beam_direction(pattern: object) -> None:
    """Convert the beam direction of a pattern to floats, or raise `InvalidSetting`."""
    for name, at_most_rad in (("beam_azimuth_rad", math.pi), ("beam_elevation_rad", math.pi / 2)):
        limit_rad = at_most_rad + 1e-9  # tolerance for angles converted from degrees
        setting = f"{type(pattern).__name__}.{name}"
        angle = check_number(
            setting, getattr(pattern, name), at_least=-limit_rad, at_most=limit_rad
        )
        object.__setattr__(pattern, name, angle)


def direction_in_beam_axes(
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    *,
    beam_azimuth_rad: float,
    beam_elevation_rad: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return direction cosines along the beam, to its left and above it.

    The antenna is raised by the beam's elevation, then turned by its azimuth, not rolled. Vectors
    are rotated, since differences of angles would distort a beam that points upwards.
    """
    elevation = np.asarray(elevation_rad, dtype=float)
    relative_azimuth = np.asarray(azimuth_rad, dtype=float) - beam_azimuth_rad
    forward, leftward, upward = (
        np.cos(elevation) * np.cos(relative_azimuth),
        np.cos(elevation) * np.sin(relative_azimuth),
        np.sin(elevation),
    )
    c, s = math.cos(beam_elevation_rad), math.sin(beam_elevation_rad)
    return (
        np.asarray(c * forward + s * upward),
        np.asarray(leftward),
        np.asarray(c * upward - s * forward),
    )
