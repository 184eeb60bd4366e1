"""A point target and how it moves."""

import numpy as np

from dechirp.core.checks import Vector, positive, vector
from dechirp.core.values import value


@value
class Target:
    """A steady point scatterer on a straight line at constant speed."""

    name: str | None = None
    """How findings, truth and impairments call it; none: `target-N`, N its place in the scene."""
    position_m: Vector
    """At time zero, the start of the first frame; x forward, y left, z up."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    rcs_m2: float = 1.0
    """Radar cross section (dBsm in files)."""

    def __post_init__(self) -> None:
        vector(self, "position_m")
        vector(self, "velocity_m_per_s")
        positive(self, "rcs_m2")

    def position_at_m(self, time_s: float) -> np.ndarray:
        """Position at a time, (3,)."""
        return np.asarray(self.position_m) + time_s * np.asarray(self.velocity_m_per_s)
