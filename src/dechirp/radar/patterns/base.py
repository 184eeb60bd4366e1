"""What an antenna pattern is: a power gain for each direction."""

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import number
from dechirp.core.families import Family

LEAST_GAIN, MOST_GAIN = 1e-12, 1e12
"""Wider than from the deepest null that is measured to the largest dish."""


class Pattern(Family):
    """Gain of one antenna, transmitting or receiving, over an isotropic one without loss."""

    group: ClassVar[str] = "dechirp.pattern"

    @abstractmethod
    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Power gain towards directions in the axes of the radar, a ratio.

        Any shapes that broadcast; the broadcast shape.
        """

    @property
    @abstractmethod
    def peak_gain(self) -> float:
        """The largest gain, a ratio."""


def keep_beam(owner: object) -> None:
    """Keep the beam's direction of a pattern as floats, or raise `InvalidSetting`."""
    for name, at_most_rad in (("beam_azimuth_rad", math.pi), ("beam_elevation_rad", math.pi / 2)):
        most = at_most_rad + 1e-9  # what came through degrees
        where = f"{type(owner).__name__}.{name}"
        angle = number(where, getattr(owner, name), at_least=-most, at_most=most)
        object.__setattr__(owner, name, angle)


def seen_from_beam(
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    *,
    beam_azimuth_rad: float,
    beam_elevation_rad: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Components of directions along the beam, to its left and above it; one squared, added.

    The antenna is raised by the beam's elevation, then turned by its azimuth, not rolled.
    Vectors are turned, since differences of angles would bend a beam that looks up.
    """
    elevation = np.asarray(elevation_rad, dtype=float)
    aside = np.asarray(azimuth_rad, dtype=float) - beam_azimuth_rad
    ahead, left, up = (
        np.cos(elevation) * np.cos(aside),
        np.cos(elevation) * np.sin(aside),
        np.sin(elevation),
    )
    c, s = math.cos(beam_elevation_rad), math.sin(beam_elevation_rad)
    return np.asarray(c * ahead + s * up), np.asarray(left), np.asarray(c * up - s * ahead)
