"""Echo of the body of a vehicle, among those of its wheels."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

# A detection without an ambiguity number is of echoes in one cell that disagree: it counts as a
# tenth of its power.
_UNRESOLVED_WEIGHT = 0.1
# Bodies alone spread by less, in m/s: a car of 5 m that turns by 0.2 rad/s.
_MIN_WHEEL_SPREAD_M_PER_S = 1.0
# Share of the spread that counts as its end, and ratio within which the powers of both ends of a
# wheel are in 80 % of the cases: they are exponential (Swerling 1), and their ratio is F(2, 2).
_END_SHARE, _EQUAL_RATIO = 1 / 8, 9.0
# Share of its mean power below which 0.3 % of the echoes of a body are (Swerling 1).
_WEAKEST_BODY_SHARE = 0.003


class BodyEcho(NamedTuple):
    """Row of the detection of a body, and its velocity."""

    row: int
    velocity_m_per_s: float
    """NaN if the detections do not determine it."""


def find_body_echo(columns: Mapping[str, np.ndarray], mean_snr: float = np.nan) -> BodyEcho | None:
    """Find the echo of the body of one object among its detections, (n,) each.

    `mean_snr` is that of the true object, for the mean cross section of all its scatterers; NaN if
    unknown.

    It is the strongest detection with a direction. Where another vehicle hides the body in its
    cell, only wheels remain: rims of rolling wheels move between standstill and twice the speed of
    their vehicle, most of the time near these ends, symmetrically about its speed. So if the
    strongest detection is at one end of all velocities and one of at least a ninth of its power is
    on the other side, the velocity of the body is the middle of the ends. If even the strongest
    detection has less than 0.3 % of the mean power of the object, wheels alone are detected, of
    which the ends may be missing, and the velocity of the body is unknown.

    Returns
    -------
    BodyEcho or None
        None without a direction. The velocity is NaN if it is unknown, or the ambiguity number of
        the strongest wheels of one of both sides.

    References
    ----------
    V. C. Chen, The Micro-Doppler Effect in Radar, 2nd ed., 2019 (rolling wheels).
    """
    velocity, snr = columns["velocity"], columns["snr"]
    rows = np.flatnonzero(np.isfinite(columns["azimuth"]))
    if not rows.size:
        return None
    is_resolved = np.isfinite(columns["ambiguity_number"])
    weight = snr * np.where(is_resolved, 1.0, _UNRESOLVED_WEIGHT)
    strongest = int(rows[np.argmax(weight[rows])])
    if snr[strongest] < _WEAKEST_BODY_SHARE * mean_snr:
        return BodyEcho(strongest, np.nan)
    low, high = velocity.min(), velocity.max()
    spread = high - low
    from_end = min(velocity[strongest] - low, high - velocity[strongest])
    is_opposite = abs(velocity - velocity[strongest]) > spread / 2
    if (
        spread < _MIN_WHEEL_SPREAD_M_PER_S
        or from_end > _END_SHARE * spread
        or snr[strongest] > _EQUAL_RATIO * snr[is_opposite].max()
    ):
        return BodyEcho(strongest, float(velocity[strongest]))
    opposite = np.flatnonzero(is_opposite)[np.argmax(snr[is_opposite])]
    is_known = is_resolved[strongest] and is_resolved[opposite]
    return BodyEcho(strongest, float((low + high) / 2) if is_known else np.nan)
