"""Lines of range over time through moving detections of successive frames.

A line goes through two moving detections of some successive frames, and has one in at least five of
them, within two range cells. Detections at random ranges put n of them into F frames with a
binomial probability, for each of all lines that are tried: lines with an expected number of more
than 3e-4 of that kind are not taken for targets. The density of random detections is that of the
detections beside the line.

Velocities that change by more than a third of the unambiguous span from frame to frame, as of
targets that turn, end the line there: which way they changed is not known.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.radar.frame import Frame
from dechirp.radar.velocity_ambiguity import (
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)

# Frames on each side of a detection: 2 s of joined frames, in which a car that brakes with 1 m/s^2
# deviates from a line by 2 m.
_HALF_WINDOW = 6
MIN_FRAMES = 5
_TOLERANCE_CELLS = 2.0
# A detection becomes part of a random line once in 10^3: without its own detections, the density
# of the others is lower by up to a quarter.
_MAX_CHANCE_LINES = 3e-4
# Moving detections of a frame that lines go through, the strongest ones: 260 in thirteen frames.
_MAX_DETECTIONS_PER_FRAME = 20
# Largest change of the velocity between frames of a line, in spans: half a span has either sign.
_MAX_VELOCITY_STEP = 1 / 3


class Movers(NamedTuple):
    """Moving detections whose ambiguity number is unknown, strongest first within each frame."""

    rows: np.ndarray
    """Their rows in the columns."""
    frame_number: np.ndarray
    time_s: np.ndarray
    range_m: np.ndarray
    """Ranges of the beat frequencies, which do not depend on the ambiguity number."""
    velocity: np.ndarray
    """Aliased velocities."""
    velocity_std: np.ndarray
    span: np.ndarray
    """Unambiguous span at each range."""
    tolerance_m: float
    """Largest distance of a detection from its line."""

    def neighbours(self, index: int) -> np.ndarray:
        """Return the indices of the detections in the frames around one."""
        return np.flatnonzero(abs(self.frame_number - self.frame_number[index]) <= _HALF_WINDOW)


class Track(NamedTuple):
    """Fit of the slope that remains of a line after the integral of its velocities."""

    slope: float
    """Slope, m/s."""
    slope_std: float
    n_free: int
    range_rms_m: float
    """Deviation of the ranges from the fit."""
    unwrapped: np.ndarray
    """Velocities without jumps by a span."""
    time_moment: float
    """Sum of the squared deviations of the times from their mean, s^2."""


def movement_candidate_mask(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return which detections may move: all of frames without a map of moving targets."""
    return np.asarray(columns["moving"] != 0)


def select_movers(columns: Mapping[str, np.ndarray], frame: Frame) -> Movers:
    """Return the strongest moving detections of each frame with unknown ambiguity numbers."""
    is_open = movement_candidate_mask(columns) & np.isnan(columns["ambiguity_number"])
    rows = np.flatnonzero(is_open & np.isfinite(columns["velocity"]))
    rows = rows[np.lexsort([-columns["snr"][rows], columns["frame"][rows]])]
    frames = columns["frame"][rows]
    rank = np.arange(len(rows)) - np.searchsorted(frames, frames)
    rows = rows[rank < _MAX_DETECTIONS_PER_FRAME]
    velocity = columns["velocity"][rows]
    span = unambiguous_velocity_span_m_per_s(columns["range"][rows], frame)
    return Movers(
        rows=rows,
        frame_number=columns["frame"][rows],
        time_s=columns["time"][rows],
        range_m=columns["range"][rows] + range_shift_per_ambiguity_m(frame) * velocity / span,
        velocity=velocity,
        velocity_std=columns["velocity_std"][rows],
        span=span,
        tolerance_m=_TOLERANCE_CELLS * frame.chirp.range_resolution_m,
    )


def find_line(movers: Movers, index: int) -> np.ndarray | None:
    """Return the detections of the best line through one of them, by time; None without a line."""
    near = movers.neighbours(index)
    line = _detections_on_best_line(movers, near, index)
    if line is None:
        return None
    line = _line_without_jumps(movers, line, index)
    return line if len(line) >= MIN_FRAMES else None


def _detections_on_best_line(movers: Movers, near: np.ndarray, index: int) -> np.ndarray | None:
    """Return one detection of each frame on the best line through one of them, by time.

    None without a line that is significant.
    """
    frames, frame_index = np.unique(movers.frame_number[near], return_inverse=True)
    if len(frames) < MIN_FRAMES:
        return None
    time_s = movers.time_s[near] - movers.time_s[index]
    range_m = movers.range_m[near] - movers.range_m[index]
    others = np.flatnonzero(time_s != 0)
    residuals_m = abs(range_m - (range_m[others] / time_s[others])[:, None] * time_s)
    # Nearest detection of each frame to each line, (n_lines, n_frames).
    order = np.argsort(frame_index, kind="stable")
    starts = np.searchsorted(frame_index[order], np.arange(len(frames)))
    nearest_m = np.minimum.reduceat(residuals_m[:, order], starts, axis=1)
    is_on_line = nearest_m <= movers.tolerance_m
    spread_m = np.where(is_on_line, nearest_m, 0).sum(axis=1)
    best = int(np.lexsort([spread_m, -is_on_line.sum(axis=1)])[0])
    n_on_line = int(is_on_line[best].sum())
    if n_on_line < MIN_FRAMES:
        return None
    # Two detections define a line; the others are on it by chance.
    n_beside = len(near) - n_on_line + 2
    extent_m = float(np.ptp(range_m)) + 2 * movers.tolerance_m
    per_frame = 1 - np.exp(-2 * movers.tolerance_m / extent_m * n_beside / len(frames))
    chance = scipy.special.bdtrc(n_on_line - 3, len(frames) - 2, per_frame)
    if len(others) * chance > _MAX_CHANCE_LINES:
        return None
    residual_m = residuals_m[best].copy()
    residual_m[near == index] = -1.0  # of its frame, this one
    nearest = [frame[np.argmin(residual_m[frame])] for frame in np.split(order, starts[1:])]
    return near[np.array(nearest)[is_on_line[best]]]


def _line_without_jumps(movers: Movers, line: np.ndarray, index: int) -> np.ndarray:
    """Return the detections around one, by time, whose velocities follow without jumps."""
    line = line[np.argsort(movers.time_s[line])]
    steps, span = np.diff(movers.velocity[line]), movers.span[index]
    is_jump = abs(steps - span * np.round(steps / span)) > _MAX_VELOCITY_STEP * span
    part = np.concatenate([[0], np.cumsum(is_jump)])
    return np.asarray(line[part == part[line == index]])


def fit_track(movers: Movers, line: np.ndarray, span: float, *, sign: int = 1) -> Track:
    """Fit the slope of the ranges of a line after the integral of its velocities.

    With `sign` -1, after that of the opposite velocities.
    """
    t, unwrapped = movers.time_s[line], np.unwrap(sign * movers.velocity[line], period=span)
    steps_m = np.diff(t) * (unwrapped[1:] + unwrapped[:-1]) / 2
    rest_m = movers.range_m[line] - np.concatenate([[0.0], np.cumsum(steps_m)])
    deviation_s, n_free = t - t.mean(), len(t) - 2
    moment = float(deviation_s @ deviation_s)
    slope = float(deviation_s @ rest_m) / moment
    residual_m = rest_m - rest_m.mean() - slope * deviation_s
    range_rms_m = float(np.sqrt(residual_m @ residual_m / n_free))
    mean_velocity_std = float(np.sqrt(np.sum(movers.velocity_std[line] ** 2))) / len(t)
    slope_std = float(np.hypot(range_rms_m / np.sqrt(moment), mean_velocity_std)) + 1e-9
    return Track(slope, slope_std, n_free, range_rms_m, unwrapped, moment)


def fit_range_slope(movers: Movers, line: np.ndarray) -> tuple[float, float]:
    """Return the slope of the ranges of a line in m/s, and the distance between its ends in m."""
    time_s = movers.time_s[line]
    deviation_s = time_s - time_s.mean()
    slope = float(deviation_s @ movers.range_m[line]) / float(deviation_s @ deviation_s)
    return slope, abs(slope) * float(np.ptp(time_s))
