"""Base classes of bodies: scatterers with a common motion."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.families import Family
from dechirp.core.findings import Finding

MIN_RCS_M2, MAX_RCS_M2 = 1e-18, 1e12
"""Limits from one of many points of a grain of dust to a planet."""


class Body(Family):
    """Scatterers in the axes of the body: x forward along the heading, y left, z up."""

    group: ClassVar[str] = "dechirp.body"

    @abstractmethod
    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the positions of the scatterers at each time, (n_times, n_scatterers, 3).

        They are in axes of the body and smooth over time: a part that jumps raises an error.
        """

    @abstractmethod
    def cross_sections_m2(self) -> np.ndarray:
        """Return the mean cross section of each scatterer, (n_scatterers,)."""

    @property
    def is_rigid(self) -> bool:
        """Return whether no part moves, so that `scatterer_offsets_m` is constant."""
        return False

    @property
    def blocking_box_m(self) -> np.ndarray | None:
        """Return the corners of the box that shadows other targets, (low and high, 3), or None.

        None: the body does not shadow. A low z of -inf: the body stands on the ground, at z = 0.
        """
        return None

    @property
    def side_reflectivity(self) -> float | None:
        """Return the share of power that the sides of the box reflect like mirrors, or None.

        It is that of normal incidence; 0: the body has no flat sides, so it is no mirror. None: its
        sides are flat, of a material that `BodyMultipath` specifies.
        """
        return 0.0

    @property
    def ground_clearance_m(self) -> float:
        """Return the height of the gap below a body that stands on the ground."""
        return 0.0

    def n_scatterers(self) -> int:
        """Return the number of scatterers, constant over time."""
        return len(self.cross_sections_m2())

    def unusual_property_findings(self, setting: str) -> list[Finding]:
        """Return findings on surprising properties, under the path of the body's setting."""
        return []


class AspectBody(Body):
    """Body with aspect-dependent cross sections: hidden corners, flat panels."""

    @abstractmethod
    def n_scatterers(self) -> int:
        """Return the number of scatterers, the same at all times and aspects."""

    @abstractmethod
    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Return the mean cross section of each scatterer, (n_positions, n_scatterers).

        It is 0 if hidden. `radar_m` is the position of the radar, (n_positions, 3), in axes of the
        body, at mid-frame.
        """

    def cross_sections_m2(self) -> np.ndarray:
        """Return 0 for each scatterer, (n_scatterers,), since they depend on aspect."""
        return np.zeros(self.n_scatterers())
