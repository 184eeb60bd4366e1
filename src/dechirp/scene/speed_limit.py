"""Speed limit of the simulation, a thousandth of the speed of light."""

import math

from dechirp.core.checks import check_and_convert_vector_field
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT

# The motion during the return path is neglected, a relative error of v / c.
MAX_SPEED_M_PER_S = SPEED_OF_LIGHT / 1000


def check_and_convert_velocity_field(owner: object, name: str) -> None:
    """Convert the named field to a vector within the speed limit, or raise `InvalidSetting`."""
    check_and_convert_vector_field(owner, name, max_magnitude=math.inf)
    check_speed_limit(f"{type(owner).__name__}.{name}", math.hypot(*getattr(owner, name)))


def check_speed_limit(setting: str, speed_m_per_s: float, *, context: str = "") -> None:
    """Raise `InvalidSetting` for `setting` if a speed exceeds the limit."""
    if speed_m_per_s > MAX_SPEED_M_PER_S:
        raise InvalidSetting(
            setting,
            value=f"{speed_m_per_s:.4g} m/s{context}",
            expected=f"at most {MAX_SPEED_M_PER_S:.6g} m/s, a thousandth of the speed of light",
            fix="check the units of lengths, times and velocities",
        )
