"""Clusters: detections that lie close together are one object."""

import numpy as np
import xarray as xr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from dechirp.core.checks import count, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.process.centroids import Placed, centroids, placed
from dechirp.process.columns import columns, is_frame_number, must_be, must_hold
from dechirp.radar.cells import in_one_fold
from dechirp.radar.radar import Radar

_NEEDED = ("frame", "range", "velocity", "snr")
_OTHERS = ("time", "azimuth", "elevation", "fold")
_ERRORS = ("range_std", "velocity_std", "azimuth_std", "elevation_std")

_PAIR_BYTES = 120.0  # of two neighbours: their places, both ways, and links of the graph

_COUNTED = 256  # detections whose neighbours are counted, to know how many pairs there are


@value
class Reach:
    """How far apart neighbours are at most, along each axis, in resolution cells."""

    range: float = 5.0
    """Peaks three cells beside a stronger one are often below its sidelobes, so that those of one
    car come four or five apart."""
    velocity: float = 2.0
    direction: float = 0.5
    """Of the sines of azimuth and elevation. Below 1: detections in different cells of the map
    are told apart more finely than sources in one."""

    def __post_init__(self) -> None:
        # Wider than any map: a unit is wrong.
        positive(self, "range", "velocity", "direction", at_most=1e4)

    @property
    def of_axes(self) -> np.ndarray:
        """Along range, velocity, azimuth and elevation, (4,)."""
        return np.array([self.range, self.velocity, self.direction, self.direction])


@value
class Dbscan:
    """Density-based clusters: chains of detections that have enough neighbours.

    Neighbours are within reach along every axis that both tell.

    References
    ----------
    M. Ester, H.-P. Kriegel, J. Sander, X. Xu, A density-based algorithm for discovering clusters
    in large spatial databases with noise, KDD 1996.
    """

    reach: Reach = Reach()
    min_detections: int = 1
    """Within reach of a detection, itself among them, for it to start a cluster. At 1 every
    detection is in one, as is right where objects far away are one detection."""

    def __post_init__(self) -> None:
        if not isinstance(self.reach, Reach):
            raise InvalidSetting(
                "Dbscan.reach",
                got=repr(self.reach),
                need="a Reach: cells along range, velocity and direction",
                fix="Give Reach(range=5, velocity=2, direction=0.5).",
            )
        count(self, "min_detections", at_most=1_000_000)


_DEFAULT = Dbscan()


def cluster(
    detections: xr.Dataset, radar: Radar, dbscan: Dbscan = _DEFAULT
) -> tuple[xr.Dataset, xr.Dataset]:
    """Detections with the cluster that each is in, and the clusters.

    Parameters
    ----------
    detections : Dataset over `detection`
        As `detect` gives them, of any number of frames: each frame has clusters of its own.
        `frame range velocity snr` are needed, other columns count as not told where missing.
    radar : Radar
        Whose they are: its resolution, and after how much velocities go round.
    dbscan : Dbscan, optional

    Returns
    -------
    Dataset over `detection`
        The same with `cluster`: a row of the clusters, -1 for noise.
    Dataset over `cluster`
        frame, time : 1, s
            Of its detections.
        range, velocity, azimuth, elevation : m, m/s, rad, rad
            Centroid: means over its detections, weighted by their ratios; an angle of those
            that tell it, NaN where none does. Velocities, and the ranges that go with them, are
            brought to one fold before: that of the strongest detection whose fold is known,
            else the one about zero.
        range_std, velocity_std, azimuth_std, elevation_std : m, m/s, rad, rad
            Standard errors of these means, from those of the detections. That another look sees
            other parts of a large object they do not say: the extents do.
        snr : ratio
            Sum over its detections.
        range_extent, velocity_extent, azimuth_extent : m, m/s, rad
            Largest less smallest.
        fold
            NaN where no detection tells it.
        n_detections
            How many they are.

    Raises
    ------
    InvalidSetting
        If a column is missing or holds what it cannot.
    NotEnoughMemory
        If so many detections lie so close together that their pairs would not fit.
    """
    must_be("radar", radar, Radar, fix="Give the radar that they were detected with.")
    must_be("dbscan", dbscan, Dbscan, fix="Give Dbscan(), or leave it out.")
    told = columns(detections, _NEEDED, _OTHERS + _ERRORS)
    must_hold(
        told,
        {
            "frame": (is_frame_number(told["frame"]), "the number of a frame, 0 or more"),
            "range": (np.isfinite(told["range"]), "a finite number"),
            "velocity": (~np.isinf(told["velocity"]), "a finite number, or NaN"),
            "azimuth": (~np.isinf(told["azimuth"]), "a finite number, or NaN"),
            "elevation": (~np.isinf(told["elevation"]), "a finite number, or NaN"),
            # Lists of other radars tell no ratio.
            "snr": (~((told["snr"] < 0) | np.isinf(told["snr"])), "0 or more and finite, or NaN"),
        },
    )
    at = placed(told, radar)
    label = _labels(told["frame"], at, radar, dbscan)
    marked = detections.assign(cluster=("detection", label, {"units": "1"}))
    return marked, centroids(told, at, label, radar.frame.n_chirps)


def _labels(frame: np.ndarray, at: Placed, radar: Radar, dbscan: Dbscan) -> np.ndarray:
    """Cluster of each detection, (n,): of those near it that start clusters, the first one's."""
    n = frame.size
    if not n:
        return np.empty(0, np.int64)
    first, second = _neighbours(frame, at, radar, dbscan.reach)
    n_near = 1 + np.bincount(first, minlength=n) + np.bincount(second, minlength=n)
    starts = n_near >= dbscan.min_detections
    chained = starts[first] & starts[second]
    links = np.ones(chained.sum()), (first[chained], second[chained])
    chain = connected_components(coo_array(links, shape=(n, n)), directed=False)[1]
    label = np.where(starts, chain, n)
    for ones, others in ((first, second), (second, first)):
        edge = starts[others] & ~starts[ones]
        np.minimum.at(label, ones[edge], chain[others[edge]])
    used, label = np.unique(label, return_inverse=True)
    return np.where(used[label] < n, label, -1)


def _neighbours(
    frame: np.ndarray, at: Placed, radar: Radar, reach: Reach
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of detections in one frame within reach along all axes that both tell, (n_pairs,)."""
    # In units of the reach, and frames too far apart along an axis of their own to be neighbours.
    cells = at.cells / reach.of_axes
    n_chirps = radar.frame.n_chirps / reach.velocity
    apart = 3.0 * np.unique(frame, return_inverse=True)[1]
    counts = np.append(apart.any(), np.isfinite(cells).all(axis=0))
    places = np.column_stack([apart, in_one_fold(cells, n_chirps)])[:, counts]
    around = np.array([0, 0, n_chirps, 0, 0])[counts]
    # Cut in the middle of boxes, not at medians: pairs are then found in two thirds of the time.
    tree = KDTree(places, boxsize=around, balanced_tree=False)
    some = places[:: -(-len(places) // _COUNTED)]  # counting all takes as long as finding them
    n_near = tree.query_ball_point(some, 1.0, p=np.inf, return_length=True)
    must_fit(
        "the pairs of neighbours among detections",
        needed_bytes=_PAIR_BYTES * float(np.mean(n_near)) / 2 * len(places),
        fix="Lower the reach, or keep fewer detections.",
    )
    first, second = tree.query_pairs(1.0, p=np.inf, output_type="ndarray").T
    off = cells[first] - cells[second]
    period = n_chirps * np.minimum(at.n_told[first], at.n_told[second])
    off[:, 1] -= period * np.rint(off[:, 1] / period)
    near = ~(abs(off) > 1.0).any(axis=1)  # NaN is not beyond
    return first[near], second[near]
