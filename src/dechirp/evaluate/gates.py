"""Cells of a map in which a target is looked for."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.evaluate.look import Case
from dechirp.evaluate.match import CELLS, scatterers, visible
from dechirp.process.spectrum import Transform
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies


class Gate(NamedTuple):
    """Cells of one frame, (n,) each: a row for each cell of each target."""

    target: np.ndarray
    velocity: np.ndarray
    range: np.ndarray


@lru_cache(maxsize=4)
def gates(case: Case) -> tuple[Gate, ...]:
    """Cells within two resolution cells of where targets are in each frame.

    Of a body, of where any of its visible scatterers is. Velocities go round; ranges end.
    """
    return tuple(_in_frame(case, at) for at in range(len(case.times_s)))


def turns(place: Place, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Cycles of an echo from sample to sample and from chirp to chirp, as the map shows them.

    The first from 0 to 1, the second in any fold.
    """
    frame = radar.frame
    beat_hz, doppler_hz = frequencies(place, radar)
    fast = np.asarray(beat_hz / frame.chirp.sample_rate_hz % 1.0)
    slow = np.asarray(doppler_hz * frame.repetition_s)
    if frame.chirp.sampling == "real":  # the upper half is the mirror of the lower
        mirrored = fast > 0.5
        fast, slow = np.where(mirrored, 1 - fast, fast), np.where(mirrored, -slow, slow)
    return fast, slow


def reach(transform: Transform) -> int:
    """Bins to either side within which a detection is the target's, as far as there are any."""
    within = int(CELLS * transform.n_bins / transform.n_points)
    return min(within, (transform.n_bins - 1) // 2)


def _in_frame(case: Case, at: int) -> Gate:
    radar, time_s = case.radar.at(int(case.truth["frame"].values[at])), float(case.times_s[at])
    noise = case.chain.noise(radar)
    n_velocity, n_range = noise.over_velocity.n_bins, noise.over_range.n_bins
    shown = visible(case.scene, time_s, radar)
    moving = scatterers(case.scene, case.times_s[at : at + 1])
    fast, slow = turns(Place(*(of[0, shown] for of in moving)), radar)
    row = np.rint(fast * n_range).astype(int) % n_range
    column = np.rint(slow * n_velocity).astype(int) + n_velocity // 2
    beside = [
        np.arange(-reach(one), reach(one) + 1) for one in (noise.over_velocity, noise.over_range)
    ]
    # (scatterer, velocity, range)
    columns = (column[:, None, None] + beside[0][:, None]) % n_velocity
    rows = row[:, None, None] + beside[1]
    owners = case.scene.owners[shown][:, None, None]
    every = np.stack(np.broadcast_arrays(owners, columns, rows), axis=-1).reshape(-1, 3)
    n_rows = n_range if radar.frame.chirp.sampling == "complex" else n_range // 2 + 1
    within = (every[:, 2] >= 0) & (every[:, 2] < n_rows)
    return Gate(*np.unique(every[within], axis=0).T)
