"""One place for the detections of a cluster: weighted means in one fold, errors, extents."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.radar.cells import in_cells
from dechirp.radar.folds import NEVER, coupling_m, n_told, span_m_per_s
from dechirp.radar.radar import Radar

_UNITS = {"range": "m", "velocity": "m/s", "azimuth": "rad", "elevation": "rad"}
_EXTENTS = ("range", "velocity", "azimuth")


class Placed(NamedTuple):
    """Detections in resolution cells, and what folds do to them; each by its own frame."""

    cells: np.ndarray
    """(n, 4), see `radar.cells`."""
    n_told: np.ndarray
    """After how many spans of unambiguous velocity its velocity goes round, (n,)."""
    span_m_per_s: np.ndarray
    """(n,)."""
    coupling_m: np.ndarray
    """What a fold takes off the range, (n,)."""


def placed(told: Mapping[str, np.ndarray], radar: Radar) -> Placed:
    """Where detections are, from their columns, (n,) each."""
    numbers = told["frame"].astype(int)
    n = numbers.size
    at = Placed(np.empty((n, 4)), np.ones(n), np.ones(n), np.zeros(n))
    # Frames with the same interval are alike.
    turns = numbers % radar.frame.n_intervals
    for turn in np.unique(turns).tolist():
        own, one = turns == turn, radar.at(turn)
        range_m, velocity, azimuth, elevation, fold = (
            told[name][own] for name in ("range", "velocity", "azimuth", "elevation", "fold")
        )
        at.cells[own] = in_cells(range_m, velocity, azimuth, elevation, one)
        at.n_told[own] = n_told(fold, radar.frame, turn)
        at.span_m_per_s[own] = span_m_per_s(range_m, one.frame)
        at.coupling_m[own] = coupling_m(one.frame)
    return at


def centroids(
    told: Mapping[str, np.ndarray], at: Placed, label: np.ndarray, n_chirps: int
) -> xr.Dataset:
    """One row for each label but -1; see `cluster`."""
    members = np.flatnonzero(label >= 0)
    members = members[np.argsort(label[members], kind="stable")]
    label, at = label[members], Placed(*(of[members] for of in at))
    own = {name: column[members] for name, column in told.items()}
    first = np.flatnonzero(np.diff(label, prepend=-1))  # of each cluster, a run now
    weight = _weights(own["snr"], label)
    moved, fold = _moves(own, at, weight, first, n_chirps)
    own["range"] = own["range"] - moved * at.coupling_m
    own["velocity"] = own["velocity"] + moved * at.span_m_per_s
    made = {"frame": (own["frame"][first].astype(np.int64), "1"), "time": (own["time"][first], "s")}
    for name, unit in _UNITS.items():
        mean, error = _mean(own[name], own[f"{name}_std"], weight, label)
        made[name], made[f"{name}_std"] = (mean, unit), (error, unit)
    made["snr"] = (np.bincount(label, own["snr"]), "1")
    for name in _EXTENTS:
        made[f"{name}_extent"] = (_extent(own[name], first), _UNITS[name])
    made["fold"] = (fold, "1")
    made["n_detections"] = (np.bincount(label), "1")
    return xr.Dataset(
        {name: ("cluster", column, {"units": unit}) for name, (column, unit) in made.items()}
    )


def _weights(snr: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Ratios; all alike in a cluster of which one is not known, or that has none above 0."""
    whole = np.bincount(label, snr)[label]
    return np.where(whole > 0, snr, 1.0)  # NaN is not above 0


def _moves(
    own: Mapping[str, np.ndarray],
    at: Placed,
    weight: np.ndarray,
    first: np.ndarray,
    n_chirps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """By how many folds to move each detection, (n,), and what is then the fold of each cluster.

    All of a cluster to where they are nearest to the strongest, of those with a known fold if
    there are any; then, where there are none, the mean to about zero.
    """
    sizes = np.diff(first, append=weight.size)
    label = np.repeat(np.arange(first.size), sizes)
    turns = np.nan_to_num(at.cells[:, 1])
    known = np.isfinite(own["fold"])
    strongest = np.lexsort((weight, known, label))[np.cumsum(sizes) - 1]
    goes_round = at.n_told < NEVER
    moved = np.where(goes_round, np.rint((turns[strongest][label] - turns) / n_chirps), 0.0)
    mean = np.bincount(label, weight * (turns + n_chirps * moved)) / np.bincount(label, weight)
    to_zero = goes_round & ~known[strongest][label]
    return moved - np.where(to_zero, np.rint(mean / n_chirps)[label], 0.0), own["fold"][strongest]


def _mean(
    of: np.ndarray, error: np.ndarray, weight: np.ndarray, label: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means of what is told, and their standard errors, (n_clusters,) each; else NaN."""
    weight = np.where(np.isnan(of), 0.0, weight)
    whole = np.bincount(label, weight)
    whole = np.where(whole > 0, whole, np.nan)
    mean = np.bincount(label, weight * np.nan_to_num(of)) / whole
    variance = np.bincount(label, np.where(weight > 0, weight * error, 0.0) ** 2)
    return mean, np.sqrt(variance) / whole


def _extent(of: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Largest less smallest of what is told in each run, NaN where nothing is."""
    if not first.size:  # there are no runs to reduce
        return np.empty(0)
    return np.fmax.reduceat(of, first) - np.fmin.reduceat(of, first)
