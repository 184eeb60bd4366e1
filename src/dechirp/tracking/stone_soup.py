"""Array interface to the joint association of Stone Soup.

Imported only when a tracker is created: Stone Soup comes with the extra `track`.
"""

from datetime import datetime
from typing import Any

import numpy as np
import scipy
from stonesoup.dataassociator.probability import JPDAwithEHM2, JPDAwithLBP
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleProbabilityHypothesis
from stonesoup.types.numeric import Probability

# Exact sums over a group of 8 tracks that compete for the same detections take 0.1 s, and 2.3 times
# that for each more. Loopy belief propagation (Williams and Lau 2014) takes negligible time.
_MAX_EXACT_TRACKS = 8

_TIME = datetime(2000, 1, 1)  # Stone Soup demands one; associations do not depend on it


def joint_association_probabilities(log_weight: np.ndarray, missed_log_weight: float) -> np.ndarray:
    """Compute the probability that a detection belongs to a track, (n_tracks, n_detections).

    Weights are those of each pair by itself, -inf outside of gates, and that of a missed track. No
    two tracks share a detection. Exact except where many tracks are linked by detections in several
    gates.
    """
    missed = np.full((len(log_weight), 1), missed_log_weight)
    # Exact for tracks that share no detection with another one.
    probability = scipy.special.softmax(np.hstack([missed, log_weight]), axis=1)[:, 1:]
    is_gated = np.isfinite(log_weight)
    group = _groups_of_linked_tracks(is_gated)
    n_tracks = np.bincount(group)[group]
    is_crowded = n_tracks > _MAX_EXACT_TRACKS
    for associator, is_member in (
        (JPDAwithEHM2, (n_tracks > 1) & ~is_crowded),
        (JPDAwithLBP, is_crowded),
    ):
        tracks = np.flatnonzero(is_member)
        if tracks.size:
            detections = np.flatnonzero(is_gated[tracks].any(axis=0))
            pairs = np.ix_(tracks, detections)
            probability[pairs] = _associate(associator, log_weight[pairs], missed_log_weight)
    return np.asarray(probability)


def _groups_of_linked_tracks(is_gated: np.ndarray) -> np.ndarray:
    """Return the number of the group of each track; tracks linked by detections share a group."""
    n_tracks, n_detections = is_gated.shape
    track, detection = np.nonzero(is_gated)
    n = n_tracks + n_detections
    links = scipy.sparse.coo_array(
        (np.ones(len(track)), (track, n_tracks + detection)), shape=(n, n)
    )
    group = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return np.asarray(group[:n_tracks])


def _associate(associator: Any, log_weight: np.ndarray, missed_log_weight: float) -> np.ndarray:
    """Compute the probabilities of pairs by an associator of Stone Soup."""
    n_tracks, n_detections = log_weight.shape
    detections = [Detection([index], timestamp=_TIME) for index in range(n_detections)]
    index_of = {id(detection): index for index, detection in enumerate(detections)}
    missed = MissedDetection(timestamp=_TIME)

    def hypothesis(weight: float, measurement: Any) -> SingleProbabilityHypothesis:
        return SingleProbabilityHypothesis(
            prediction=None,
            measurement=measurement,
            probability=Probability(weight, log_value=True),
        )

    hypotheses = {
        track: [
            hypothesis(missed_log_weight, missed),
            *(
                hypothesis(weights[index], detections[index])
                for index in np.flatnonzero(np.isfinite(weights))
            ),
        ]
        for track, weights in enumerate(log_weight)
    }
    associations = associator(_FixedHypotheses(hypotheses)).associate(
        list(hypotheses), detections, _TIME
    )
    probability = np.zeros((n_tracks, n_detections))
    for track, its_hypotheses in associations.items():
        for pair in its_hypotheses:
            if pair:
                probability[track, index_of[id(pair.measurement)]] = pair.probability
    return probability


class _FixedHypotheses:
    """Hypothesiser of Stone Soup that returns given hypotheses."""

    def __init__(self, hypotheses: dict[int, list[Any]]) -> None:
        self._hypotheses = hypotheses

    def hypothesise(self, track: int, *_: Any) -> list[Any]:
        return self._hypotheses[track]
