"""From the peaks of a recording to points that give the same peaks.

Echoes of neighbours lie in each other's cells, so their powers cannot be read off the map one by
one. What each point adds to each peak's cell is simulated, and amplitudes and phases follow from
linear equations: at each peak the twin has the recorded power and the phase that fits best. A phase
is a quarter of a wavelength of range at most, far below a cell; places are corrected by whole half
wavelengths, which leave phases as they are. Three to eight rounds do.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dechirp.core.findings import PhysicsWarning
from dechirp.echoes.echo import clean_echoes, simulate
from dechirp.echoes.impairments.base import Impairment
from dechirp.experiment.twin.echoes import Echoes
from dechirp.experiment.twin.measure import Peaks, Seen, echoes_at, floor_at, peaks_at, searched
from dechirp.radar.radar import Radar

_ROUNDS, _TURNS = 12, 3
_SINGLE: np.dtype[np.complexfloating] = np.dtype(np.complex64)
# Of what is missing, the part that a round corrects: neighbours move each other's peaks.
_STEP, _FARTHEST = 0.7, 0.3  # cells
# What a round may leave for it to be the last, and in how many rounds it must have become less.
_POWER_DB, _CELLS, _PATIENCE = 0.1, 0.1, 3
# Amplitudes of points that no peak tells apart are left out.
_LEAST_TOLD = 1e-4
_MOST_STEP = 3.0


def matched(
    recorded: Seen,
    start: Echoes,
    radar: Radar,
    *,
    constants: Sequence[Impairment] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Echoes:
    """Points whose echoes, without noise, give the peaks of a map.

    Parameters
    ----------
    recorded : Seen
        Samples in sqrt(W).
    start : Echoes
        A point for each peak, about where it is.
    radar : Radar
        With its hardware.
    constants : sequence of impairments
        What is in the twin besides the points, and not random.
    progress : callable, optional
        Called with the number of rounds done and of all, at most.

    Returns
    -------
    Echoes
        Those of `start`, and of peaks that one point does not put in their place a second one
        beside it: the rest of a body that is larger than a cell.
    """
    found = start
    for turn in range(_TURNS):
        told = progress and partial(_of_turn, progress, turn)
        found = _rounds(recorded, found, radar, constants, told)
        others = _second(recorded, found, radar, constants)
        if not len(others) or turn == _TURNS - 1:
            break
        found = found.beside(others)
    if progress is not None:
        progress(_TURNS * _ROUNDS, _TURNS * _ROUNDS)
    return found


def _of_turn(progress: Callable[[int, int], None], turn: int, done: int) -> None:
    progress(turn * _ROUNDS + done, _TURNS * _ROUNDS)


def _rounds(
    recorded: Seen,
    start: Echoes,
    radar: Radar,
    constants: Sequence[Impairment],
    progress: Callable[[int], None] | None,
) -> Echoes:
    """Of all rounds that whose largest difference is the smallest."""
    cells, asked = start.cell, _asked(recorded, start)
    wanted, heard = peaks_at(recorded, cells), echoes_at(recorded, cells)
    counted = start.is_peak & searched(recorded, cells)
    found, best, least = start, start, np.inf
    own, last = None, 0
    for number in range(_ROUNDS):
        if progress is not None:
            progress(number)
        found = _amplitudes(found, recorded, asked, heard, own, radar, constants)
        twin = simulated(found, radar, recorded, constants)
        there = peaks_at(twin, cells)
        own = echoes_at(twin, cells)
        worst = _worst(there, wanted, asked)[counted].max(initial=0.0)
        if worst < least:
            best, least, last = found, worst, number
        if least < 1 or number - last >= _PATIENCE:
            break
        found = _moved(found, there, wanted, radar, recorded, counted)
    return best


def _asked(recorded: Seen, echoes: Echoes) -> np.ndarray:
    """Power that is asked of each cell, W: the noise in it is a part of what was recorded."""
    power = recorded.power.values[echoes.cell[:, 0], echoes.cell[:, 1]].astype(float)
    # A cell of twice the noise keeps a half.
    return np.maximum(power - floor_at(recorded, echoes.cell[:, 1]), power / 2)


def _second(recorded: Seen, found: Echoes, radar: Radar, constants: Sequence[Impairment]) -> Echoes:
    """A point beside each peak that is out of place, in the cell where most is missing."""
    twin = simulated(found, radar, recorded, constants)
    there, wanted = (peaks_at(one, found.cell) for one in (twin, recorded))
    off = _worst(there, wanted, _asked(recorded, found)) > 1
    off &= found.is_peak & ~found.leaks & searched(recorded, found.cell)
    of, (n_velocity, n_rows) = np.flatnonzero(off), recorded.power.shape
    steps = np.array([(0, 1), (0, -1), (1, 0), (-1, 0)])
    around = found.cell[of][:, None] + steps
    around[..., 0] %= n_velocity
    around[..., 1] = around[..., 1].clip(0, n_rows - 1)
    flat = around.reshape(-1, 2)
    missing = abs(echoes_at(recorded, flat) - echoes_at(twin, flat)) ** 2
    best = missing.sum(axis=1).reshape(len(of), len(steps)).argmax(axis=1)
    cells = around[np.arange(len(of)), best]
    taken = {tuple(cell) for cell in found.cell.tolist()}
    free = np.array([tuple(cell) not in taken for cell in cells.tolist()], dtype=bool)
    cells, step = cells[free], steps[best[free]]
    others = replace(
        found.only(*of[free].tolist()), is_peak=np.zeros(len(cells), dtype=bool), cell=cells
    )
    per_slow, per_fast = _of_cells(radar, recorded)
    others = others.moved(range_m=step[:, 1] * per_fast, velocity_m_per_s=step[:, 0] * per_slow)
    return replace(others, power_w=_asked(recorded, others))


def simulated(echoes: Echoes, radar: Radar, like: Seen, constants: Sequence[Impairment]) -> Seen:
    """One frame of points without noise, seen as the recording is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # said of the twin, not of its trials
        cube = simulate(
            echoes.scene(radar), radar, impairments=[*echoes.leakage(radar), *constants]
        )
    return Seen(frame=cube.isel(frame=0), radar=radar, chain=like.chain)


def _alone(one: Echoes, radar: Radar, like: Seen) -> Seen:
    """A frame of one point: what the sum of all is made of takes most of the time."""
    if one.leaks.any():
        return simulated(one, radar, like, ())
    cube = clean_echoes(one.scene(radar), radar, dtype=_SINGLE)
    return Seen(frame=cube.isel(frame=0), radar=radar, chain=like.chain)


def _amplitudes(
    echoes: Echoes,
    recorded: Seen,
    power_w: np.ndarray,
    heard: np.ndarray,
    own: np.ndarray | None,
    radar: Radar,
    constants: Sequence[Impairment],
) -> Echoes:
    """Points of the powers and phases that the peaks ask for.

    `own` is what the twin had in the cells before, (n, channel); none: what each point has alone.
    """
    (n, n_channels), cells = heard.shape, echoes.cell
    each = np.stack([echoes_at(_alone(echoes.only(k), radar, recorded), cells) for k in range(n)])
    still = np.zeros_like(heard)
    if constants:
        still = echoes_at(simulated(echoes.only(), radar, recorded, constants), cells)
    # Channels of a recording are not those of points in the open. So each peak is asked for the
    # recorded power, in the twin's own shares of the channels, at the phase that fits best.
    shape = each[np.arange(n), np.arange(n)] if own is None else own
    size = np.linalg.norm(shape, axis=1)
    turn = np.exp(1j * np.angle(np.sum(heard * shape.conj(), axis=1)))
    asked = (np.sqrt(power_w * n_channels) / size * turn)[:, None] * shape - still
    weights = np.repeat(1 / np.sqrt(power_w), n_channels)
    matrix = weights[:, None] * each.reshape(n, -1).T
    largest = np.linalg.norm(matrix, axis=0)
    factors, *_ = np.linalg.lstsq(matrix / largest, weights * asked.ravel(), rcond=_LEAST_TOLD)
    factors = factors / largest
    louder = np.clip(np.abs(factors), 1 / _MOST_STEP, _MOST_STEP)
    turned = replace(echoes, power_w=echoes.power_w * louder**2)
    way_m = np.angle(factors) * radar.frame.chirp.wavelength_m / (4 * np.pi)
    return turned.moved(range_m=way_m, velocity_m_per_s=np.zeros(n))


def _moved(
    echoes: Echoes,
    there: Peaks,
    wanted: Peaks,
    radar: Radar,
    recorded: Seen,
    counted: np.ndarray,
) -> Echoes:
    """Points nearer to where their peaks are asked for."""
    per_slow, per_fast = _of_cells(radar, recorded)
    slow, fast = (
        _STEP * np.clip(missing, -_FARTHEST, _FARTHEST) * counted
        for missing in (wanted.slow - there.slow, wanted.fast - there.fast)
    )
    half_m = radar.frame.chirp.wavelength_m / 2
    return echoes.moved(
        range_m=np.round(fast * per_fast / half_m) * half_m, velocity_m_per_s=slow * per_slow
    )


def _of_cells(radar: Radar, recorded: Seen) -> tuple[float, float]:
    """Steps of the map in velocity, m/s, and range, m; one chirp has none in velocity."""
    frame, chirp, noise = radar.frame, radar.frame.chirp, recorded.chain.noise(radar)
    span = chirp.wavelength_m / 2 / frame.repetition_s if frame.tells_velocity else 0.0
    span_m = chirp.range_m(1.0) * chirp.sample_rate_hz
    return span / noise.over_velocity.n_bins, span_m / noise.over_range.n_bins


def _worst(there: Peaks, wanted: Peaks, power_w: np.ndarray) -> np.ndarray:
    """Largest difference of each peak, over what is little."""
    apart_db = abs(10 * np.log10(np.maximum(there.power, 1e-300) / power_w))
    away = np.maximum(abs(there.slow - wanted.slow), abs(there.fast - wanted.fast))
    return np.asarray(np.maximum(apart_db / _POWER_DB, away / _CELLS))
