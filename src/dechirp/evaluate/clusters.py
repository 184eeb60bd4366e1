"""Whose cluster is whose."""

import numpy as np

from dechirp.evaluate.look import Case, Look


def n_of_targets(look: Look, case: Case) -> np.ndarray:
    """Clusters of each target in each frame, (n_targets, n_frames).

    A cluster belongs to the target that most of its detections are of, by their power over the
    noise; one that holds none of any target belongs to nobody. `look.detections` has the column
    `cluster`, as `process.cluster.cluster` adds it.
    """
    assert look.clusters is not None
    columns, n_targets = look.detections, len(case.names)
    counts = np.zeros((n_targets, len(case.times_s)))
    cluster = np.asarray(columns["cluster"], dtype=int)
    told = (cluster >= 0) & (look.match.target >= 0)
    power = np.zeros((look.clusters.sizes["cluster"], n_targets))
    np.add.at(power, (cluster[told], look.match.target[told]), columns["snr"][told])
    owned = np.flatnonzero(power.any(axis=1))
    frame = np.asarray(look.clusters["frame"].values[owned], dtype=int)
    at = np.searchsorted(case.truth["frame"].values, frame)
    np.add.at(counts, (power[owned].argmax(axis=1), at), 1)
    return counts
