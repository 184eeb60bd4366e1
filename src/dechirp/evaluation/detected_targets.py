"""Detected targets of a trial, and their detections."""

import numpy as np

from dechirp.evaluation.trial import TrialContext, TrialResult


def is_detected(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Return True for targets with a detection, by frame, bool (n_targets, n_frames)."""
    target = result.association.target
    has_target = target >= 0
    detected = np.zeros((len(context.names), len(context.times_s)), dtype=bool)
    detected[target[has_target], _frame_indices(result, context)[has_target]] = True
    return detected


def strongest_detections(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Return the row of the strongest detection of each target in each frame.

    Later stages use the strongest one. The nearest to the truth would be too optimistic, since it
    is unknown to a radar; the mean of all would include noise near the target.
    """
    target, frame = result.association.target, _frame_indices(result, context)
    # By target, then by frame, the strongest first; sources of one detection keep their order.
    order = np.lexsort((-np.asarray(result.detections["snr"]), frame, target))
    order = order[target[order] >= 0]
    target_frame = target[order] * len(context.times_s) + frame[order]
    is_first = np.diff(target_frame, prepend=-1) != 0
    return np.asarray(order[is_first])


def _frame_indices(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Return the index in the truth of the frame of each detection."""
    return np.searchsorted(context.truth["frame"].values, result.detections["frame"])
