"""Ambiguity numbers of velocities from the ranges of the same target in successive frames.

A radar with one transmitter and one interval measures velocities modulo lambda / 2T. Where a target
crosses range cells from frame to frame, the slope of its ranges over time is its velocity without
ambiguity. The Doppler frequency remains the accurate measurement; the slope chooses the ambiguity
number.

Targets are lines of range over time, see `range_lines`.

The velocities v_j of a line, unwrapped from frame to frame, are those of the target less a common
multiple k of the span. So its ranges follow R_0 + k span t + integral of v dt, whatever it
accelerates, and k span is the slope of what remains after the integral. Errors of the slope follow
from the residuals, with Student's distribution. They give the probability of each k.

Numbers stay unresolved if the slope of the ranges is no whole number of spans within its errors,
and if an echo may stay at the range of the detection: if the line moves by less than two range
cells, or others are there in half as many frames as the line has. An echo that stays, such as a
tree in the wind, has a Doppler frequency too.

An unknown number also shifts the range, by range-Doppler coupling. Where numbers up to K occur, K
the largest resolved one, and 1 at least if persons who walk are aliased, `range_std` contains the
standard deviation of equally likely numbers from -K to K, sqrt(K (K + 1) / 3) shifts.
"""

from collections.abc import Mapping

import numpy as np
import scipy

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.processing.velocity_ambiguity.hypotheses import MIN_CONFIDENCE
from dechirp.processing.velocity_ambiguity.range_lines import (
    MIN_FRAMES,
    Movers,
    Track,
    find_line,
    fit_range_slope,
    fit_track,
    movement_candidate_mask,
    select_movers,
)
from dechirp.radar.frame import Frame
from dechirp.radar.velocity_ambiguity import range_shift_per_ambiguity_m

# Largest standard error of a slope, in spans: a third of the numbers would be wrong with 0.5.
_MAX_SLOPE_STD = 0.25
# Probability of a slope of the correct number to be rejected as no whole number of spans.
_REJECTION_PROBABILITY = 1e-4
# Ambiguity numbers with a probability, on each side of the likeliest.
_NUMBERS = np.arange(-50, 51)
# Velocity of a walking person, which radars with a smaller unambiguous one alias.
_WALKING_M_PER_S = 2.0


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
        cross cells within a frame, and the shifts of other and of unknown numbers.
        `ambiguity_number` is NaN for a probability below 0.99; detections with another one than 0
        are `moving`, whatever their aliased velocity is.
    """
    resolved = {name: column.copy() for name, column in columns.items()}
    movers, shift_m = select_movers(columns, frame), range_shift_per_ambiguity_m(frame)
    number, variance, range_rms_m, confidence, best_rank = np.zeros((5, len(movers.rows)))
    if len(np.unique(movers.frame_number)) < MIN_FRAMES:
        return _widen_unknown_ranges(resolved, movers, frame)
    for index, span in enumerate(movers.span.tolist()):
        line = find_line(movers, index)
        if line is None:
            continue
        track = fit_track(movers, line, span)
        likeliest, probability, track_variance = _likeliest_common_number(track, span)
        is_uncertain = track.slope_std > _MAX_SLOPE_STD * span
        if is_uncertain or not _is_whole_number_of_spans(track, likeliest, span):
            continue
        numbers = likeliest + np.round((track.unwrapped - movers.velocity[line]) / span)
        may_have = (numbers == 0) | ~_may_stay_mask(movers, line, index)
        is_own = line == index
        if not may_have[is_own].all():
            continue
        # Ends of a line have few frames on one side, and take the number from its middle. Of lines
        # of the same length, that around a detection itself counts.
        rank = len(line) + 0.5 * is_own
        is_better = (rank > best_rank[line]) | (
            (rank == best_rank[line]) & (probability > confidence[line])
        )
        takes = may_have & is_better
        taking = line[takes]
        number[taking], best_rank[taking] = numbers[takes], rank[takes]
        confidence[taking], variance[taking] = probability, track_variance
        range_rms_m[taking] = track.range_rms_m
    is_known = confidence > 0
    resolved_rows = movers.rows[is_known]
    number = number[is_known]
    resolved["velocity"][resolved_rows] += number * movers.span[is_known]
    resolved["range"][resolved_rows] -= number * shift_m
    resolved["velocity_std"][resolved_rows] = np.sqrt(
        columns["velocity_std"][resolved_rows] ** 2 + variance[is_known]
    )
    # Where a target crosses cells within a frame, its echo is spread over them.
    crosses_cells = (
        abs(resolved["velocity"][resolved_rows]) * frame.duration_s > movers.tolerance_m / 2
    )
    resolved["range_std"][resolved_rows] = np.sqrt(
        columns["range_std"][resolved_rows] ** 2
        + np.where(crosses_cells, range_rms_m[is_known], 0.0) ** 2
        + variance[is_known] * (shift_m / movers.span[is_known]) ** 2
    )
    resolved["ambiguity_confidence"][resolved_rows] = confidence[is_known]
    is_certain = confidence[is_known] >= MIN_CONFIDENCE
    resolved["ambiguity_number"][resolved_rows[is_certain]] = number[is_certain]
    resolved["moving"][resolved_rows[is_certain & (number != 0)]] = 1
    return _widen_unknown_ranges(resolved, movers, frame)


def _may_stay_mask(movers: Movers, line: np.ndarray, index: int) -> np.ndarray:
    """Return which detections of a line may be echoes that stay at their range."""
    if fit_range_slope(movers, line)[1] < movers.tolerance_m:
        return np.ones(len(line), bool)
    others = np.setdiff1d(movers.neighbours(index), line)
    if not others.size:
        return np.zeros(len(line), bool)
    is_there = abs(movers.range_m[line][:, None] - movers.range_m[others]) <= movers.tolerance_m
    _, starts = np.unique(movers.frame_number[others], return_index=True)
    n_frames = np.logical_or.reduceat(is_there, starts, axis=1).sum(axis=1)
    return np.asarray(2 * n_frames >= len(line))


def _widen_unknown_ranges(
    resolved: dict[str, np.ndarray], movers: Movers, frame: Frame
) -> dict[str, np.ndarray]:
    """Return the columns, with the shifts of unknown numbers in the errors of ranges."""
    numbers = resolved["ambiguity_number"][movers.rows]
    largest = float(abs(numbers[np.isfinite(numbers)]).max(initial=0.0))
    if movers.rows.size and float(movers.span.min()) / 2 < _WALKING_M_PER_S:
        largest = max(largest, 1.0)
    shift_std_m = range_shift_per_ambiguity_m(frame) * np.sqrt(largest * (largest + 1) / 3)
    is_unknown = (
        movement_candidate_mask(resolved)
        & np.isnan(resolved["ambiguity_number"])
        & np.isnan(resolved["ambiguity_confidence"])
        & np.isfinite(resolved["velocity"])
    )
    resolved["range_std"][is_unknown] = np.hypot(resolved["range_std"][is_unknown], shift_std_m)
    return resolved


def _likeliest_common_number(track: Track, span: float) -> tuple[float, float, float]:
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


def _is_whole_number_of_spans(track: Track, number: float, span: float) -> bool:
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
    is_certain = np.isfinite(resolved["ambiguity_number"][changed])
    strongest = changed[
        np.argmax(resolved["snr"][changed] * (is_certain if is_certain.any() else 1))
    ]
    return (
        Finding(
            level="note",
            setting="radar.frame.interval",
            value=f"{format_count_with_noun(len(changed), 'moving detection')} with an aliased"
            " velocity: the ranges in successive frames give the true one, such as"
            f" {format_number(resolved['velocity'][strongest], 3)} m/s instead of"
            f" {format_number(columns['velocity'][strongest], 3)} m/s at"
            f" {format_number(resolved['range'][strongest], 3)} m",
            expected="a correct sweep bandwidth, to which the slopes of ranges are proportional;"
            " velocities of other detections, without ambiguity_number, may still be aliased, and"
            " their ranges shifted by range-Doppler coupling",
            fix="--set recording.fit_chain=false keeps the velocities within the unambiguous span",
        ),
    )
