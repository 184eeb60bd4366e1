"""Ghosts of radars with the same ramps: echoes that go through range faster than anything does.

Another radar whose ramps have the same slope makes a beat of constant frequency, as an echo
does. But its clock is not this radar's: where the two differ by a part in 1e6, its ramps come
later and later by a picosecond for each microsecond, and the ghost walks by c / 2 times that,
150 m/s. Crystals differ by several parts in 1e6, and nothing on a road is as fast as one makes a
ghost. Between chirps phases say nothing: 150 m/s are many folds of the velocity.

A ghost of a clock that is closer than that is not told from an echo here.
"""

from dataclasses import dataclass

import numba
import numpy as np
import scipy.fft

from dechirp.core.findings import Finding
from dechirp.core.spans import spans
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.process.health.quiet import standing
from dechirp.process.health.recorded import Recorded
from dechirp.radar.frame import Frame
from dechirp.theory.windows import taper

FASTEST_M_PER_S = 150.0
"""What is faster is no echo: c / 2 times a part in 1e6."""
_FEWEST = 24  # chirps on a line
_CELLS = 4.0  # through which they go: a target that fades into another goes in steps instead
_OFF = 0.5  # of a cell, that a chirp on the line may be off it
_FILLED = 0.75  # of the chirps from the first on the line to the last, that are on it
_STARTS = 512  # chirps at which lines are tried to begin
_FEWEST_SAMPLES = 32
_BLOCK_NUMBERS = 2**17  # transformed before they leave the cache of a core


@dataclass(frozen=True)
class Walk:
    """A line on which the strongest beat of many chirps goes through range; NaN if none does."""

    velocity_m_per_s: float = np.nan
    range_m: float = np.nan
    """In the first chirp on the line."""
    first: int = -1
    last: int = -1
    """Chirps at its ends."""


def walk(samples: np.ndarray, lost: np.ndarray, frame: Frame, scale: float) -> Walk:
    """Look in one frame, (chirp, rx, sample), for what is faster than 150 m/s.

    Of what does not stand still the strongest beat of each rising ramp counts. In noise it is
    any of B: beside the two chirps that a line goes through, 22 of 30 others lie on it with a
    chance of 6e6 B^-22, and M chirps have 3 M lines: below 1e-20 a frame from 32 beats on.

    Parameters
    ----------
    samples : array, complex64 or float32, contiguous
    lost : array (chirp,), bool
        Chirps to leave out.
    frame : Frame
        With one interval.
    scale : float
        Largest number.
    """
    rises = np.array([ramp.sign > 0 for ramp in frame.ramps])
    chosen = np.flatnonzero(~lost & np.tile(rises, frame.n_chirps))
    if chosen.size < _FEWEST or samples.shape[2] < _FEWEST_SAMPLES:
        return Walk()
    beats = _strongest(samples, chosen, frame.n_slots, scale)
    # In cells of range, and from here on in cells a second.
    cell_m = frame.chirp.range_resolution_m
    times = frame.chirps_s[chosen]
    least = FASTEST_M_PER_S / cell_m
    start, slope = _line(times, beats, least, max(1, chosen.size // _STARTS), _OFF)
    if not np.isfinite(slope):
        return Walk()
    at = _filled(np.abs(beats - start - slope * times) <= _OFF)
    if at.size < _FEWEST:
        return Walk()
    slope, start = np.polyfit(times[at], beats[at], 1)
    at = _filled(np.abs(beats - start - slope * times) <= _OFF)
    if (
        at.size < _FEWEST
        or abs(slope) < least
        or abs(slope) * (times[at[-1]] - times[at[0]]) < _CELLS
    ):
        return Walk()
    return Walk(
        velocity_m_per_s=float(slope * cell_m),
        range_m=float((start + slope * times[at[0]]) * cell_m),
        first=int(chosen[at[0]]),
        last=int(chosen[at[-1]]),
    )


def _strongest(samples: np.ndarray, chosen: np.ndarray, n_slots: int, scale: float) -> np.ndarray:
    """Strongest beat of some chirps, between bins, (n,), of what does not stand still."""
    n_samples = samples.shape[2]
    inverse = np.float32(1 / scale)
    still = standing(samples.view(np.float32), chosen, n_slots, inverse).view(samples.dtype)
    weights = taper("hann", n_samples).astype(np.float32)
    found = np.empty(chosen.size)
    per_block = max(1, _BLOCK_NUMBERS // samples[0].size)
    for first in range(0, chosen.size, per_block):
        some = chosen[first : first + per_block]
        moving = samples[some] * inverse - still[some % n_slots]
        tapered = moving * weights
        spectra = scipy.fft.fft(tapered) if np.iscomplexobj(samples) else scipy.fft.rfft(tapered)
        power = np.sum(np.abs(spectra) ** 2, axis=1)
        found[first : first + some.size] = _between_bins(power)
    return found


def _between_bins(power: np.ndarray) -> np.ndarray:
    """Bin of the peak of each row, by a parabola through logarithms: 0.02 off under Hann."""
    rows, top = np.arange(len(power)), np.argmax(power, axis=1)
    near = np.stack([power[rows, (top + k) % power.shape[1]] for k in (-1, 0, 1)])
    below, peak, above = np.log(np.maximum(near, np.float32(1e-37)))
    bend = np.minimum(below - 2 * peak + above, -1e-6)
    return np.asarray(top + np.clip((below - above) / (2 * bend), -0.5, 0.5))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _line(
    times: np.ndarray, beats: np.ndarray, least: float, step: int, off: float
) -> tuple[float, float]:
    """Start and slope of the line through two chirps on which most chirps lie.

    Of lines steeper than `least`, through chirps an eighth, a quarter and half of all apart.
    """
    most, start, slope = 2, np.nan, np.nan
    for share in (8, 4, 2):
        gap = beats.size // share
        for m in range(0, beats.size - gap, step):
            rate = (beats[m + gap] - beats[m]) / (times[m + gap] - times[m])
            if abs(rate) < least:
                continue
            origin = beats[m] - rate * times[m]
            count = 0
            for i in range(beats.size):
                count += abs(beats[i] - origin - rate * times[i]) <= off
            if count > most:
                most, start, slope = count, origin, rate
    return start, slope


def _filled(on_line: np.ndarray) -> np.ndarray:
    """Chirps on a line from one to another, between which three quarters of all are on it.

    Each counts 1, and each that is off it -3: the stretch in which that adds up to the most.
    """
    score = np.cumsum(np.where(on_line, 1.0, -_FILLED / (1 - _FILLED)))
    before = np.minimum.accumulate(np.concatenate([[0.0], score[:-1]]))
    last = int(np.argmax(score - before))
    first = int(np.argmin(np.concatenate([[0.0], score])[: last + 1]))
    return first + np.flatnonzero(on_line[first : last + 1])


def ghosts(recorded: Recorded) -> list[Finding]:
    """Echoes that go through range faster than anything on a road."""
    velocity = recorded.of("walk_velocity")
    seen = np.flatnonzero(np.isfinite(velocity))
    if not seen.size:
        return []
    worst = seen[np.argmax(np.abs(velocity[seen]))]
    speed = float(velocity[worst])
    first, last = recorded.of("walk_chirps")[worst]
    clock = abs(speed) * 2 / SPEED_OF_LIGHT
    return [
        Finding(
            level="warning",
            setting="recording.ghost",
            got=f"what looks like an echo goes through range by {speed:+.0f} m/s, from"
            f" {recorded.of('walk_range')[worst]:.4g} m on, in chirps {first} to {last} of frame"
            f" {recorded.frame_numbers[worst]}"
            + (f", and in {spans('frame', recorded.frame_numbers[seen])}" if seen.size > 1 else ""),
            need=f"echoes of less than {FASTEST_M_PER_S:.0f} m/s, as of all that drives",
            fix=f"Another radar sends the same ramps, by a clock {clock * 1e6:.2g} parts in 1e6"
            " off: believe no detection at those ranges; other ramps, or other times, avoid it.",
        )
    ]
