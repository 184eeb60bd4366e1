"""Findings on single chirps: interference bursts, and outlier chirps."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.units import to_decibels
from dechirp.processing.quality.recording_measures import RecordingMeasures

BURST_REPAIR_OPTION = "--set 'chain.mitigation=[{kind: interference-autoregression}]'"


def has_burst_mask(recorded: RecordingMeasures) -> np.ndarray:
    """Return the mask (frame, chirp) of chirps that contain bursts."""
    return np.asarray(recorded.values_of_measure("burst") > 1)


def outlier_chirp_mask(excess: np.ndarray, burst_excess: np.ndarray) -> np.ndarray:
    """Return the mask of outlier chirps without bursts, from both measures of any shape."""
    return np.asarray((excess > 1) & ~(burst_excess > 1))


def interference_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report bursts of energy in parts of chirps."""
    has_burst = has_burst_mask(recorded)
    if not has_burst.any():
        return []
    n_chirps = int(np.count_nonzero(~recorded.values_of_measure("lost")))
    share = float(np.sum(recorded.values_of_measure("burst_share")[has_burst])) / n_chirps
    kurtosis = float(np.nanmax(recorded.values_of_measure("kurtosis")[has_burst]))
    normal = 2 if recorded.has_complex_samples else 3
    return [
        Finding(
            level="warning",
            setting="recording.interference",
            value=f"bursts in {np.count_nonzero(has_burst)} of {n_chirps} chirps,"
            f" {100 * share:.2g} % of"
            f" all samples, kurtosis up to {kurtosis:.3g}:"
            f" {format_chirps_by_frame(has_burst, recorded.frame_numbers)}",
            expected=f"noise of constant power throughout a chirp, with kurtosis {normal}",
            fix=f"repair these chirps: {BURST_REPAIR_OPTION}; causes are another radar, a switching"
            " supply, or in a first chirp an unsettled receiver",
        )
    ]


def outlier_chirp_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report chirps that differ from both neighbours more than echoes can explain."""
    excess = recorded.values_of_measure("unlike")
    is_outlier = outlier_chirp_mask(excess, recorded.values_of_measure("burst"))
    if not is_outlier.any():
        return []
    largest_db = float(to_decibels(np.max(excess[is_outlier])))
    size_text = (
        f", by up to {largest_db:.0f} dB more than noise and moving echoes explain"
        if np.isfinite(largest_db)
        else ", some of them all zero"
    )
    return [
        Finding(
            level="warning",
            setting="recording.chirps",
            value=f"{np.count_nonzero(is_outlier)} of"
            f" {np.count_nonzero(~recorded.values_of_measure('lost'))} chirps unlike"
            f" the ones before and after{size_text}:"
            f" {format_chirps_by_frame(is_outlier, recorded.frame_numbers)}",
            expected="equal chirps, since an outlier adds to every velocity",
            fix="`dechirp run` interpolates them from the others; if it is the first of each frame,"
            " let the radar settle",
        )
    ]


def format_chirps_by_frame(
    flags: np.ndarray, frame_numbers: np.ndarray, *, at_most: int = 4
) -> str:
    """Format flags (frame, chirp) as chirps and their frames.

    Frames with the same chirps are grouped, as where the first chirp of each is damaged.
    """
    frames_by_chirps: dict[bytes, list[int]] = {}
    for index in np.flatnonzero(flags.any(axis=1)):
        frames_by_chirps.setdefault(flags[index].tobytes(), []).append(int(index))
    groups = list(frames_by_chirps.values())
    parts = [
        f"{format_number_ranges('chirp', np.flatnonzero(flags[indices[0]]))} of"
        f" {format_number_ranges('frame', frame_numbers[indices])}"
        for indices in groups[:at_most]
    ]
    n_remaining = sum(len(indices) for indices in groups[at_most:])
    if n_remaining:
        parts.append(f"chirps of {n_remaining} more frames")
    return "; ".join(parts)
