"""What a body is: scatterers that move together, and with each other."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.families import Family
from dechirp.core.findings import Finding

LEAST_RCS_M2, MOST_RCS_M2 = 1e-18, 1e12
"""Wider than from a point among many of a grain of dust to a planet."""


class Body(Family):
    """Scatterers in axes of their own: x forward along the heading, y left, z up."""

    group: ClassVar[str] = "dechirp.body"

    @abstractmethod
    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers at each time, (n_times, n_scatterers, 3), axes of the body.

        As smooth over time as positions are: a part that jumps is refused.
        """

    @abstractmethod
    def cross_sections_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,)."""

    @property
    def is_rigid(self) -> bool:
        """Whether no part moves; `offsets_m` is the same at all times then."""
        return False

    def n_scatterers(self) -> int:
        """How many there are, the same at all times."""
        return len(self.cross_sections_m2())

    def findings(self, setting: str) -> list[Finding]:
        """List what surprises in it, under the path of its setting."""
        return []


class AspectBody(Body):
    """A body that reflects more to one side than to another: hidden corners, flat panels."""

    @abstractmethod
    def n_scatterers(self) -> int:
        """How many there are, the same at all times and from all sides."""

    @abstractmethod
    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Mean cross section of each scatterer, (n_places, n_scatterers), 0 where it is hidden.

        `radar_m`: from where it is seen, (n_places, 3), axes of the body. Taken at mid-frame.
        """

    def cross_sections_m2(self) -> np.ndarray:
        """0 for each, (n_scatterers,): they depend on the aspect."""
        return np.zeros(self.n_scatterers())
