"""How fast anything in a scene may be."""

import math

from dechirp.core.checks import vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT

# The time light takes back is neglected, an error of the relative size v / c.
FASTEST_M_PER_S = SPEED_OF_LIGHT / 1000


def slow_vector(owner: object, name: str) -> None:
    """Keep the named field as a vector far below the speed of light, or raise `InvalidSetting`."""
    vector(owner, name, at_most=math.inf)
    must_be_slow(f"{type(owner).__name__}.{name}", math.hypot(*getattr(owner, name)))


def must_be_slow(where: str, speed_m_per_s: float, *, of: str = "") -> None:
    """Raise `InvalidSetting`, about the setting `where`, for a speed near that of light."""
    if speed_m_per_s > FASTEST_M_PER_S:
        raise InvalidSetting(
            where,
            got=f"{speed_m_per_s:.4g} m/s{of}",
            need=f"at most {FASTEST_M_PER_S:.6g} m/s, a thousandth of that of light",
            fix="Check the units of lengths, times and velocities.",
        )
