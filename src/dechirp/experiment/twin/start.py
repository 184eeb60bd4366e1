"""Where points are before they are matched: as the chain's detections say."""

from typing import NamedTuple

import numpy as np

from dechirp.experiment.twin.echoes import Echoes
from dechirp.experiment.twin.measure import Seen, floor_at, peaks_at
from dechirp.process.detect import detect
from dechirp.process.spectrum import independent_rows
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies

_LEAKS_WITHIN = 2.5  # range cells: nearer, what stands still is the antennas' own
_OVER_NOISE = 30.0  # for a row that is not searched to hold leakage


def leak_cells(of: Seen) -> np.ndarray:
    """Cell of the leakage where detection does not look for it, (1 or 0, 2).

    Real samples: at rest, the strongest of the rows nearer than those that are searched.
    """
    noise = of.chain.noise(of.radar)
    first = independent_rows(of.radar.frame.chirp, noise.over_range).start
    still = of.power.sizes["velocity"] // 2
    near = of.power.values[still, :first]
    if not near.size or near.max() < _OVER_NOISE * floor_at(of, np.array([near.argmax()]))[0]:
        return np.empty((0, 2), dtype=int)
    return np.array([[still, int(near.argmax())]])


def started(of: Seen, radar: Radar, cells: np.ndarray, leaks: np.ndarray) -> Echoes:
    """A point for each peak, then for each cell of leakage, about where it is.

    Parameters
    ----------
    of : Seen
        Samples in sqrt(W).
    radar : Radar
        The recording's own: its calibration tells directions.
    cells, leaks : arrays (n, 2)
        Velocity and range.
    """
    place = np.zeros((4, len(cells)))
    if len(cells):
        place = np.nan_to_num(np.stack(detected(of, radar, cells)[:4]))
    every = np.concatenate([cells, leaks])
    rest_m = of.radar.frame.chirp.range_bins_m(of.chain.noise(of.radar).over_range.n_bins)
    near = np.stack([np.maximum(rest_m[leaks[:, 1]], rest_m[1]), *np.zeros((3, len(leaks)))])
    place = np.concatenate([place, near], axis=1)
    resolution_m = of.radar.frame.chirp.range_resolution_m
    still = every[:, 0] == of.power.sizes["velocity"] // 2
    leaking = still & (place[0] < _LEAKS_WITHIN * resolution_m)
    place[1, leaking] = 0
    return Echoes(
        range_m=np.maximum(place[0], 1e-4),
        velocity_m_per_s=place[1],
        azimuth_rad=place[2],
        elevation_rad=place[3],
        power_w=peaks_at(of, every).power.astype(float),
        leaks=leaking,
        is_peak=np.ones(len(every), dtype=bool),
        cell=every,
    )


class Detected(NamedTuple):
    """Detections about cells of a map, each array (n,)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    away: np.ndarray
    """How far from the cell, in cells."""


def detected(of: Seen, radar: Radar, cells: np.ndarray) -> Detected:
    """The detection that lies nearest to each cell, (n, 2); of several sources the strongest.

    There must be one in the map.
    """
    found = detect(of.frame.expand_dims("frame"), radar, of.chain)
    frame, noise = radar.frame, of.chain.noise(radar)
    at = frequencies(Place(found.range.values, np.nan_to_num(found.velocity.values)), radar)
    n_velocity, n_bins = noise.over_velocity.n_bins, noise.over_range.n_bins
    slow = at.doppler_hz * frame.repetition_s * n_velocity + n_velocity // 2
    fast = at.beat_hz / frame.chirp.sample_rate_hz * n_bins
    apart_slow = (slow - cells[:, :1] + n_velocity / 2) % n_velocity - n_velocity / 2
    apart_fast = (fast - cells[:, 1:] + n_bins / 2) % n_bins - n_bins / 2
    # Rows of one detection have all but the same place: the first is its strongest source.
    away = np.hypot(apart_slow, apart_fast).round(2)
    rows = away.argmin(axis=1)
    range_m, velocity_m_per_s, azimuth_rad, elevation_rad = (
        found[name].values[rows] for name in ("range", "velocity", "azimuth", "elevation")
    )
    return Detected(range_m, velocity_m_per_s, azimuth_rad, elevation_rad, away.min(axis=1))
