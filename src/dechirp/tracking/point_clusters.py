"""Clusters of points that start tracks of extended objects, or split them."""

import numpy as np
import scipy

from dechirp.core.memory import check_free_memory
from dechirp.tracking.group_points import GroupPoints
from dechirp.tracking.group_tracker import GroupTracker

_PAIR_BYTES = 150.0
# Gaps of an object are rarely larger than 2.8 sigma of the difference of its points, 1.2 m for the
# default size. Gaps that last for several frames then are gaps between two objects.
_MAX_GAP2 = 8.0


def find_new_groups(points: GroupPoints, tracker: GroupTracker) -> np.ndarray:
    """Return the number of the cluster of each point, (n,), from 0; -1 for small clusters.

    Linked points form a cluster (single linkage).
    """
    return _number_large_clusters(_link_points(points, points, tracker), tracker.min_points)


def is_compact_and_separate(
    points: GroupPoints, index: np.ndarray, group: int, tracker: GroupTracker
) -> bool:
    """Return whether the points of a group could start it, apart from those of earlier groups.

    Enough of them form a cluster, and none is linked with a point of an earlier group.
    """
    own_points = points.select_points(index == group)
    if len(own_points.position_m) < tracker.min_points:
        return False
    earlier_points = points.select_points((index >= 0) & (index < group))
    if _link_points(own_points, earlier_points, tracker).any():
        return False
    return bool((find_new_groups(own_points, tracker) >= 0).any())


def release_split_points(
    points: GroupPoints, index: np.ndarray, tracker: GroupTracker
) -> np.ndarray:
    """Return the group of each point, -1 for those that a gap separates from their group.

    If the points of a group form several clusters with as many points as start a track, and gaps
    between them, the largest stays. The others start tracks, which last if the gap does.
    """
    released = index.copy()
    # Only groups of at least this width can have such a gap.
    min_width = np.sqrt(2 * _MAX_GAP2) * tracker.size_std_m
    for group in np.flatnonzero(np.bincount(index[index >= 0]) >= 2 * tracker.min_points):
        rows = np.flatnonzero(index == group)
        own_points = points.select_points(rows)
        if np.hypot(*np.ptp(own_points.position_m, axis=0)) < min_width:
            continue
        cluster = _number_large_clusters(
            _pairwise_distances2(own_points, own_points, tracker) <= _MAX_GAP2, tracker.min_points
        )
        sizes = np.bincount(cluster[cluster >= 0])
        if len(sizes) > 1:
            released[rows[(cluster >= 0) & (cluster != sizes.argmax())]] = -1
    return released


def _link_points(points: GroupPoints, others: GroupPoints, tracker: GroupTracker) -> np.ndarray:
    """Return the mask of pairs (n, n_others) that are likely to belong to one object.

    Two points of one object differ by twice the covariance of a point. They are linked if this
    distance, squared, is at most its expected value: 3, or 2 without range rates.
    """
    distance2 = _pairwise_distances2(points, others, tracker)
    variance = 2 * tracker.velocity_spread_m_per_s**2 + np.add.outer(
        points.rate_variance, others.rate_variance
    )
    rate_offset = np.subtract.outer(points.rate_m_per_s, others.rate_m_per_s)
    span = np.minimum.outer(points.span_m_per_s, others.span_m_per_s)
    finite_span = np.where(np.isfinite(span), span, 0.0)
    rate_offset -= finite_span * np.round(rate_offset / span)
    rate_distance2 = rate_offset**2 / variance
    has_rate = np.isfinite(rate_distance2)
    is_linked: np.ndarray = distance2 + np.where(has_rate, rate_distance2, 0.0) <= 2 + has_rate
    return is_linked


def _pairwise_distances2(
    points: GroupPoints, others: GroupPoints, tracker: GroupTracker
) -> np.ndarray:
    """Compute squared distances (n, n_others) in units of the expected covariance of a pair."""
    check_free_memory(
        "the pairs of points",
        needed_bytes=_PAIR_BYTES * len(points.position_m) * len(others.position_m),
        fix="raise the threshold of the detector",
    )
    spread = 2 * tracker.size_std_m**2 * np.eye(2)
    covariance = spread + points.position_covariance[:, None] + others.position_covariance
    dx, dy = np.moveaxis(points.position_m[:, None] - others.position_m, -1, 0)
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    distance2: np.ndarray = (yy * dx**2 + xx * dy**2 - 2 * xy * dx * dy) / (xx * yy - xy**2)
    return distance2


def _number_large_clusters(is_linked: np.ndarray, min_points: int) -> np.ndarray:
    """Return the number of the cluster of each point from links (n, n); -1 for small clusters."""
    if not len(is_linked):
        return np.empty(0, int)
    # A point that is linked to all others saves the search, which takes 0.4 ms.
    if is_linked.all(axis=1).any():
        labels = np.zeros(len(is_linked), int)
    else:
        labels = scipy.sparse.csgraph.connected_components(
            scipy.sparse.csr_array(is_linked), directed=False
        )[1]
    is_large = np.bincount(labels) >= min_points
    return np.asarray(np.where(is_large, np.cumsum(is_large) - 1, -1)[labels])
