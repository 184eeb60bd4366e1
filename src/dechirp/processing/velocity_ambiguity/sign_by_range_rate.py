"""Sign of the Doppler velocities, from the ranges of moving targets in successive frames.

A falling ramp that is taken for a rising one, and exchanged I and Q, reverse the sign of all
velocities, while ranges of real samples stay right. Along a line of range over time (see
`range_lines`) the ranges follow R_0 + k span t + s (integral of v dt) with a whole number k and the
sign s, +1 or -1. Of each sign, the sum of squared deviations SS is that of the best R_0 and k. With
Gaussian errors of unknown variance, the logarithm of the likelihood ratio of both signs is
(n - 1) / 2 ln(SS_- / SS_+) for n detections, and that of several targets is the sum.

The sweep bandwidth may be known to 15 % only, and with it the slopes of ranges. So the deviation of
a slope from a number of spans counts beyond 15 % of the slope alone: targets faster than three
spans decide nothing. Targets that move by less than two range cells decide nothing either:
residuals of echoes that stay have velocities without ranges.
"""

from collections.abc import Mapping

import numpy as np

from dechirp.processing.velocity_ambiguity.range_lines import (
    Movers,
    find_line,
    fit_range_slope,
    fit_track,
    select_movers,
)
from dechirp.radar.frame import Frame

DECISIVE_LOG_LIKELIHOOD_RATIO = 10.4
"""Ratio of 32,000 to 1: that of an error beyond four standard deviations on one side, 3.2e-5."""
_MAX_SCALE_ERROR = 0.15
# Smallest deviation of a range from its line, in cells, of targets that consist of several echoes.
_MIN_DEVIATION_CELLS = 0.05


def velocity_sign_log_likelihood_ratio(columns: Mapping[str, np.ndarray], frame: Frame) -> float:
    """Return the log-likelihood ratio of the stated and the opposite sign of all velocities.

    `columns` are those of `core.detection_columns` of successive frames, before the ambiguity of
    their velocities is resolved. 0 without a target that shows the sign.
    """
    movers = select_movers(columns, frame)
    lines = [line for index in range(len(movers.rows)) if (line := _moving_line(movers, index))]
    # Of overlapping lines, the longest counts.
    is_used = np.zeros(len(movers.rows), bool)
    min_variance = (_MIN_DEVIATION_CELLS * frame.chirp.range_resolution_m) ** 2
    ratio = 0.0
    for line in sorted(lines, key=len, reverse=True):
        if is_used[line].any():
            continue
        is_used[line] = True
        stated, opposite = (
            _squared_deviation(movers, np.array(line), sign) + len(line) * min_variance
            for sign in (1, -1)
        )
        ratio += (len(line) - 1) / 2 * float(np.log(opposite / stated))
    return ratio


def _moving_line(movers: Movers, index: int) -> list[int]:
    """Return the line through a detection if it moves by two range cells; else nothing."""
    line = find_line(movers, index)
    if line is None or fit_range_slope(movers, line)[1] < movers.tolerance_m:
        return []
    return [int(member) for member in line]


def _squared_deviation(movers: Movers, line: np.ndarray, sign: int) -> float:
    """Return the sum of squared deviations of the ranges of a line for a sign of its velocities."""
    span = float(movers.span[line].mean())
    track = fit_track(movers, line, span, sign=sign)
    deviation = abs(track.slope - span * np.round(track.slope / span))
    tolerated = _MAX_SCALE_ERROR * abs(fit_range_slope(movers, line)[0])
    excess = max(0.0, deviation - tolerated)
    return track.n_free * track.range_rms_m**2 + track.time_moment * excess**2
