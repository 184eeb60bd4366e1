"""Detected targets of a trial, with their detections and clusters."""

import numpy as np

from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.scene.shadowing import SHADOWED_LOSS


def count_clusters_per_target_and_frame(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Count the clusters of each target in each frame, (n_targets, n_frames).

    A cluster belongs to the target with the largest signal-to-noise sum of its detections; clusters
    without detections of targets are not counted. `result.detections` has the column `cluster` of
    `processing.cluster.cluster`.
    """
    assert result.clusters is not None
    detections, n_targets = result.detections, len(context.target_names)
    counts = np.zeros((n_targets, len(context.times_s)))
    cluster = np.asarray(detections["cluster"], dtype=int)
    is_assigned = (cluster >= 0) & (result.association.target >= 0)
    power = np.zeros((result.clusters.sizes["cluster"], n_targets))
    np.add.at(
        power,
        (cluster[is_assigned], result.association.target[is_assigned]),
        detections["snr"][is_assigned],
    )
    owned = np.flatnonzero(power.any(axis=1))
    frame = np.asarray(result.clusters["frame"].values[owned], dtype=int)
    frame_index = np.searchsorted(context.truth["frame"].values, frame)
    np.add.at(counts, (power[owned].argmax(axis=1), frame_index), 1)
    return counts


def detected_target_mask_per_frame(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Return True for targets with a detection, by frame, bool (n_targets, n_frames)."""
    target = result.association.target
    has_target = target >= 0
    detected = np.zeros((len(context.target_names), len(context.times_s)), dtype=bool)
    detected[target[has_target], _detection_frame_indices(result, context)[has_target]] = True
    return detected


def shadowed_target_mask_per_frame(context: TrialContext) -> np.ndarray:
    """Return True for targets in the shadow of others, by frame, bool (n_targets, n_frames)."""
    if "shadow_loss" not in context.truth:
        return np.zeros((len(context.target_names), len(context.times_s)), dtype=bool)
    loss = context.truth["shadow_loss"].transpose("target", "frame").values
    return np.asarray(loss > SHADOWED_LOSS)


def strongest_detection_rows_per_target_frame(
    result: TrialResult, context: TrialContext
) -> np.ndarray:
    """Return the row of the strongest detection of each target in each frame.

    Later stages use the strongest one. The nearest to the truth would be too optimistic, since it
    is unknown to a radar; the mean of all would include noise near the target.
    """
    target, frame = result.association.target, _detection_frame_indices(result, context)
    # By target, then by frame, the strongest first; sources of one detection keep their order.
    order = np.lexsort((-np.asarray(result.detections["snr"]), frame, target))
    order = order[target[order] >= 0]
    target_frame = target[order] * len(context.times_s) + frame[order]
    is_first = np.diff(target_frame, prepend=-1) != 0
    return np.asarray(order[is_first])


def _detection_frame_indices(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Return the index in the truth of the frame of each detection."""
    return np.searchsorted(context.truth["frame"].values, result.detections["frame"])
