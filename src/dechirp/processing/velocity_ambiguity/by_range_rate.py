"""Ambiguity numbers of velocities from the ranges of the same target in successive frames.

A radar with one transmitter and one interval measures velocities modulo lambda / 2T. Where a target
crosses range cells from frame to frame, the slope of its ranges over time is its velocity without
ambiguity. The Doppler frequency remains the accurate measurement; the slope chooses the ambiguity
number.

Targets are lines of range over time. A line goes through two moving detections of some successive
frames, and has one in at least five of them, within two range cells. Detections at random ranges
put n of them into F frames with a binomial probability, for each of all lines that are tried: lines
with an expected number of more than 1e-3 of that kind are not taken for targets.

The velocities v_j of a line, unwrapped from frame to frame, are those of the target less a common
multiple k of the span. So its ranges follow R_0 + k span t + integral of v dt, whatever it
accelerates, and k span is the slope of what remains after the integral. Errors of the slope follow
from the residuals, with Student's distribution. They give the probability of each k. Velocities
that change by more than a third of the span from frame to frame, as of targets that turn, end the
line there: which way they changed is not known.

Numbers stay unresolved if the slope of the ranges is no whole number of spans within its errors,
and if the range of the detection is occupied in as many frames as the line: an echo that stays
there, such as a tree in the wind, has a Doppler frequency too.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.processing.velocity_ambiguity.hypotheses import MIN_CONFIDENCE
from dechirp.radar.frame import Frame
from dechirp.radar.velocity_ambiguity import (
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)

# Frames on each side of a detection: 2 s of joined frames, in which a car that brakes with 1 m/s^2
# deviates from a line by 2 m.
_HALF_WINDOW = 6
_MIN_FRAMES = 5
_TOLERANCE_CELLS = 2.0
_MAX_CHANCE_LINES = 1e-3
# Moving detections of a frame that lines go through, the strongest ones: 260 in thirteen frames.
_MAX_DETECTIONS_PER_FRAME = 20
# Largest standard error of a slope, in spans: a third of the numbers would be wrong with 0.5.
_MAX_SLOPE_STD = 0.25
# Largest change of the velocity between frames of a line, in spans: half a span has either sign.
_MAX_VELOCITY_STEP = 1 / 3
# Probability of a slope of the correct number to be rejected as no whole number of spans.
_REJECTION_PROBABILITY = 1e-4
# Ambiguity numbers with a probability, on each side of the likeliest.
_NUMBERS = np.arange(-50, 51)


class _Track(NamedTuple):
    """One detection of each of some frames, by time."""

    members: np.ndarray
    """Indices of the detections."""
    slope: float
    """Slope of the ranges after the integral of the aliased velocities, m/s."""
    slope_std: float
    n_free: int
    range_rms_m: float
    """Deviation of the ranges from the track."""
    unwrapped: np.ndarray
    """Velocities without jumps by a span."""


def can_resolve_by_range_rate(frame: Frame) -> bool:
    """Return whether frames leave the ambiguity to the ranges: one transmitter, one interval."""
    return frame.n_slots == 1 and frame.n_intervals == 1 and frame.n_chirps > 1


def resolve_by_range_rate(columns: Mapping[str, np.ndarray], frame: Frame) -> dict[str, np.ndarray]:
    """Resolve the ambiguity numbers of moving detections that are on lines of range over time.

    Parameters
    ----------
    columns : mapping of arrays (n_detections,)
        Columns of detections of successive frames, see `core.detection_columns`.
    frame : Frame
        Of the radar, see `can_resolve_by_range_rate`.

    Returns
    -------
    dict of arrays
        The columns, with velocity and range (by range-Doppler coupling) of the likeliest ambiguity
        number, and its probability as `ambiguity_confidence`. `velocity_std` contains what the
        other numbers would change, and `range_std` the deviations from the line for targets that
        cross cells within a frame. `ambiguity_number` is NaN for a probability below 0.99.
    """
    resolved = {name: column.copy() for name, column in columns.items()}
    rows = _strongest_moving_rows(columns)
    if len(np.unique(columns["frame"][rows])) < _MIN_FRAMES:
        return resolved
    frame_number, time_s = columns["frame"][rows], columns["time"][rows]
    spans = unambiguous_velocity_span_m_per_s(columns["range"][rows], frame)
    velocity, velocity_std = columns["velocity"][rows], columns["velocity_std"][rows]
    # The range of the beat frequency does not depend on the ambiguity number.
    shift_m = range_shift_per_ambiguity_m(frame)
    range_m = columns["range"][rows] + shift_m * velocity / spans
    tolerance_m = _TOLERANCE_CELLS * frame.chirp.range_resolution_m
    number, variance, range_rms_m = np.zeros((3, len(rows)))
    confidence, has_own_line = np.zeros(len(rows)), np.zeros(len(rows), bool)
    for index in range(len(rows)):
        near = np.flatnonzero(abs(frame_number - frame_number[index]) <= _HALF_WINDOW)
        origin = int(np.flatnonzero(near == index)[0])
        members = _detections_on_best_line(
            frame_number[near], time_s[near], range_m[near], origin, tolerance_m
        )
        if members is None:
            continue
        span = spans[index]
        members = _members_without_jumps(time_s[near], velocity[near], members, origin, span)
        if len(members) < _MIN_FRAMES:
            continue
        track = _fit_track(
            time_s[near], range_m[near], velocity[near], velocity_std[near], members, span
        )
        likeliest, probability, track_variance = _likeliest_common_number(track, span)
        is_uncertain = track.slope_std > _MAX_SLOPE_STD * span
        if is_uncertain or not _is_whole_number_of_spans(track, likeliest, span):
            continue
        # Ends of a line have few frames on one side, and take the number from its middle.
        on_line = near[track.members]
        is_own = on_line == index
        takes = is_own | (~has_own_line[on_line] & (probability > confidence[on_line]))
        numbers = likeliest + np.round((track.unwrapped - velocity[on_line]) / span)
        n_staying = _count_frames_at_ranges(
            range_m[on_line], frame_number[near], range_m[near], tolerance_m
        )
        takes &= (numbers == 0) | (n_staying < len(members))
        if not takes[is_own].all():
            continue
        taking = on_line[takes]
        number[taking] = numbers[takes]
        confidence[taking], variance[taking] = probability, track_variance
        range_rms_m[taking] = track.range_rms_m
        has_own_line[index] = True
    is_known = confidence > 0
    resolved_rows = rows[is_known]
    number = number[is_known]
    resolved["velocity"][resolved_rows] += number * spans[is_known]
    resolved["range"][resolved_rows] -= number * shift_m
    resolved["velocity_std"][resolved_rows] = np.sqrt(
        columns["velocity_std"][resolved_rows] ** 2 + variance[is_known]
    )
    # Where a target crosses cells within a frame, its echo is spread over them.
    crosses_cells = abs(resolved["velocity"][resolved_rows]) * frame.duration_s > tolerance_m / 2
    resolved["range_std"][resolved_rows] = np.hypot(
        columns["range_std"][resolved_rows], np.where(crosses_cells, range_rms_m[is_known], 0.0)
    )
    resolved["ambiguity_confidence"][resolved_rows] = confidence[is_known]
    is_certain = confidence[is_known] >= MIN_CONFIDENCE
    resolved["ambiguity_number"][resolved_rows[is_certain]] = number[is_certain]
    return resolved


def _movement_candidate_mask(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return which detections may move: all of frames without a map of moving targets."""
    return np.asarray(columns["moving"] != 0)


def _strongest_moving_rows(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the rows of the strongest moving detections of each frame with unknown numbers."""
    is_open = _movement_candidate_mask(columns) & np.isnan(columns["ambiguity_number"])
    rows = np.flatnonzero(is_open & np.isfinite(columns["velocity"]))
    order = np.lexsort([-columns["snr"][rows], columns["frame"][rows]])
    rows = rows[order]
    frames = columns["frame"][rows]
    rank = np.arange(len(rows)) - np.searchsorted(frames, frames)
    return np.asarray(rows[rank < _MAX_DETECTIONS_PER_FRAME])


def _count_frames_at_ranges(
    ranges_m: np.ndarray, frame_number: np.ndarray, range_m: np.ndarray, tolerance_m: float
) -> np.ndarray:
    """Return in how many frames there are detections at some ranges; detections by frame."""
    is_there = abs(ranges_m[:, None] - range_m) <= tolerance_m
    _, starts = np.unique(frame_number, return_index=True)
    return np.asarray(np.logical_or.reduceat(is_there, starts, axis=1).sum(axis=1))


def _detections_on_best_line(
    frame_number: np.ndarray,
    time_s: np.ndarray,
    range_m: np.ndarray,
    origin: int,
    tolerance_m: float,
) -> np.ndarray | None:
    """Return one detection of each frame on the best line through one of them, by time.

    None without a line that is significant.
    """
    time_s, range_m = time_s - time_s[origin], range_m - range_m[origin]
    others = np.flatnonzero(time_s != 0)
    frames, frame_index = np.unique(frame_number, return_inverse=True)
    if len(frames) < _MIN_FRAMES:
        return None
    residuals_m = abs(range_m - (range_m[others] / time_s[others])[:, None] * time_s)
    # Nearest detection of each frame to each line, (n_lines, n_frames).
    order = np.argsort(frame_index, kind="stable")
    starts = np.searchsorted(frame_index[order], np.arange(len(frames)))
    nearest_m = np.minimum.reduceat(residuals_m[:, order], starts, axis=1)
    is_on_line = nearest_m <= tolerance_m
    spread_m = np.where(is_on_line, nearest_m, 0).sum(axis=1)
    best = int(np.lexsort([spread_m, -is_on_line.sum(axis=1)])[0])
    n_on_line = int(is_on_line[best].sum())
    if n_on_line < _MIN_FRAMES:
        return None
    # Two detections define a line; the others are on it by chance.
    extent_m = float(np.ptp(range_m)) + 2 * tolerance_m
    per_frame = 1 - np.exp(-2 * tolerance_m / extent_m * len(range_m) / len(frames))
    chance = scipy.special.bdtrc(n_on_line - 3, len(frames) - 2, per_frame)
    if len(others) * chance > _MAX_CHANCE_LINES:
        return None
    residual_m = residuals_m[best].copy()
    residual_m[origin] = -1.0  # of its frame, this one
    nearest = [frame[np.argmin(residual_m[frame])] for frame in np.split(order, starts[1:])]
    return np.array(nearest)[is_on_line[best]]


def _members_without_jumps(
    time_s: np.ndarray, velocity: np.ndarray, members: np.ndarray, origin: int, span: float
) -> np.ndarray:
    """Return the members around one, by time, whose velocities follow each other without jumps."""
    members = members[np.argsort(time_s[members])]
    steps = np.diff(velocity[members])
    is_jump = abs(steps - span * np.round(steps / span)) > _MAX_VELOCITY_STEP * span
    part = np.concatenate([[0], np.cumsum(is_jump)])
    return np.asarray(members[part == part[members == origin]])


def _fit_track(
    time_s: np.ndarray,
    range_m: np.ndarray,
    velocity: np.ndarray,
    velocity_std: np.ndarray,
    members: np.ndarray,
    span: float,
) -> _Track:
    """Fit the slope of the ranges of some detections after the integral of their velocities."""
    t, unwrapped = time_s[members], np.unwrap(velocity[members], period=span)
    steps_m = np.diff(t) * (unwrapped[1:] + unwrapped[:-1]) / 2
    rest_m = range_m[members] - np.concatenate([[0.0], np.cumsum(steps_m)])
    deviation_s, n_free = t - t.mean(), len(t) - 2
    moment = float(deviation_s @ deviation_s)
    slope = float(deviation_s @ rest_m) / moment
    residual_m = rest_m - rest_m.mean() - slope * deviation_s
    range_rms_m = float(np.sqrt(residual_m @ residual_m / n_free))
    mean_velocity_std = float(np.sqrt(np.sum(velocity_std[members] ** 2))) / len(t)
    slope_std = float(np.hypot(range_rms_m / np.sqrt(moment), mean_velocity_std)) + 1e-9
    return _Track(members, slope, slope_std, n_free, range_rms_m, unwrapped)


def _likeliest_common_number(track: _Track, span: float) -> tuple[float, float, float]:
    """Return the likeliest number of spans in a slope, its probability, and the variance.

    The variance is that of the velocity, due to the other numbers.
    """
    likeliest = np.round(track.slope / span)
    deviation = ((likeliest + _NUMBERS) * span - track.slope) / track.slope_std
    density = (1 + deviation**2 / track.n_free) ** (-(track.n_free + 1) / 2)
    probability = density / density.sum()
    return (
        float(likeliest),
        float(probability.max()),
        float(probability @ (_NUMBERS * span) ** 2),
    )


def _is_whole_number_of_spans(track: _Track, number: float, span: float) -> bool:
    """Return whether a slope is a number of spans within its errors."""
    quantile = scipy.special.stdtrit(track.n_free, 1 - _REJECTION_PROBABILITY / 2)
    return bool(abs(track.slope - number * span) <= quantile * track.slope_std)


def range_rate_findings(
    columns: Mapping[str, np.ndarray], resolved: Mapping[str, np.ndarray]
) -> tuple[Finding, ...]:
    """Return a note on the moving detections whose velocities were aliased, before and after."""
    is_changed = resolved["velocity"] != columns["velocity"]
    changed = np.flatnonzero(is_changed & np.isfinite(columns["velocity"]))
    if not changed.size:
        return ()
    n_moving = int(np.sum(_movement_candidate_mask(columns)))
    is_certain = np.isfinite(resolved["ambiguity_number"][changed])
    strongest = changed[
        np.argmax(resolved["snr"][changed] * (is_certain if is_certain.any() else 1))
    ]
    return (
        Finding(
            level="note",
            setting="radar.frame.interval",
            value=f"{len(changed)} of {n_moving} moving detections are aliased; their ranges in"
            " successive frames give their velocities, such as"
            f" {format_number(resolved['velocity'][strongest], 3)} m/s instead of"
            f" {format_number(columns['velocity'][strongest], 3)} m/s at"
            f" {format_number(resolved['range'][strongest], 3)} m",
            expected="a correct sweep bandwidth, to which the slopes of ranges are proportional;"
            " velocities of other detections, without ambiguity_number, may still be aliased, and"
            " their ranges shifted by range-Doppler coupling",
            fix="--set recording.fit_chain=false keeps the velocities within the unambiguous span",
        ),
    )
