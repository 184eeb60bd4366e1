"""Assignment of clusters to targets."""

import numpy as np

from dechirp.evaluation.trial import TrialContext, TrialResult


def count_clusters_per_target(result: TrialResult, context: TrialContext) -> np.ndarray:
    """Count the clusters of each target in each frame, (n_targets, n_frames).

    A cluster belongs to the target with the largest signal-to-noise sum of its detections; clusters
    without detections of targets are not counted. `result.detections` has the column `cluster` of
    `processing.cluster.cluster`.
    """
    assert result.clusters is not None
    detections, n_targets = result.detections, len(context.names)
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
