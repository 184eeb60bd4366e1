"""Synchronous interference: ghosts of radars with equal ramps, faster than any echo.

Another radar whose ramps have the same slope produces a constant beat frequency, as an echo does.
The clocks of both differ: with a difference of 1 part in 1e6, its ramps come later and later by a
picosecond for each microsecond, and the ghost moves by c / 2 times that, 150 m/s. Crystals differ
by several parts in 1e6, and no road user is as fast. Phases between chirps do not help: 150 m/s
is many unambiguous velocity spans.

Ghosts of a clock that is closer than that are not distinguished from echoes here.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.compiled_kernels import kernel
from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.quality.background import estimate_static_samples
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.radar.frame import Frame
from dechirp.theory.windows import window_weights

MAX_ECHO_SPEED_M_PER_S = 150.0
"""Largest speed of an echo: c / 2 times a part in 1e6."""
_MIN_CHIRPS = 24  # chirps on a line
_MIN_CELLS = 4.0  # range cells crossed; targets that fade into each other move in steps instead
_MAX_DEVIATION_CELLS = 0.5  # range cells from the line
_MIN_FILL = 0.75  # of the chirps from the first to the last on the line
_MAX_STARTS = 512  # first chirps of candidate lines
_MIN_SAMPLES = 32
_BLOCK_NUMBERS = 2**17  # values of a block that fit the cache of a core


@dataclass(frozen=True)
class GhostTrack:
    """Line on which the strongest beat of many chirps moves through range; NaN if there is none."""

    velocity_m_per_s: float = np.nan
    range_m: float = np.nan
    """Range in the first chirp on the line."""
    first_chirp: int = -1
    last_chirp: int = -1
    """Chirp at the end of the line."""


def find_ghost_track(
    samples: np.ndarray, is_lost: np.ndarray, frame: Frame, largest_value: float
) -> GhostTrack:
    """Find beats in one frame, (chirp, rx, sample), that move faster than 150 m/s.

    Only the strongest moving beat of each rising ramp is used. In noise it is any of B: beside the
    two chirps that define a line, 22 of 30 others lie on it with a probability of 6e6 B^-22, and M
    chirps have 3 M lines: below 1e-20 a frame from 32 beats on.

    Parameters
    ----------
    samples : array, complex64 or float32, contiguous
    is_lost : array (chirp,), bool
        Chirps to leave out.
    frame : Frame
        Frame with a single interval.
    largest_value : float
        Largest value.
    """
    is_rising = np.array([ramp.sign > 0 for ramp in frame.ramps])
    chirps = np.flatnonzero(~is_lost & np.tile(is_rising, frame.n_chirps))
    if chirps.size < _MIN_CHIRPS or samples.shape[2] < _MIN_SAMPLES:
        return GhostTrack()
    beats = _strongest_moving_beat_per_chirp(samples, chirps, frame.n_slots, largest_value)
    # From here on in range cells, and cells per second.
    cell_m = frame.chirp.range_resolution_m
    times = frame.chirp_starts_s[chirps]
    min_slope = MAX_ECHO_SPEED_M_PER_S / cell_m
    start, slope = _find_line_through_most_beats(
        times, beats, min_slope, max(1, chirps.size // _MAX_STARTS), _MAX_DEVIATION_CELLS
    )
    if not np.isfinite(slope):
        return GhostTrack()
    indices = _chirps_of_densest_stretch(
        np.abs(beats - start - slope * times) <= _MAX_DEVIATION_CELLS
    )
    if indices.size < _MIN_CHIRPS:
        return GhostTrack()
    slope, start = np.polyfit(times[indices], beats[indices], 1)
    indices = _chirps_of_densest_stretch(
        np.abs(beats - start - slope * times) <= _MAX_DEVIATION_CELLS
    )
    if (
        indices.size < _MIN_CHIRPS
        or abs(slope) < min_slope
        or abs(slope) * (times[indices[-1]] - times[indices[0]]) < _MIN_CELLS
    ):
        return GhostTrack()
    return GhostTrack(
        velocity_m_per_s=float(slope * cell_m),
        range_m=float((start + slope * times[indices[0]]) * cell_m),
        first_chirp=int(chirps[indices[0]]),
        last_chirp=int(chirps[indices[-1]]),
    )


def _strongest_moving_beat_per_chirp(
    samples: np.ndarray, chirps: np.ndarray, n_slots: int, largest_value: float
) -> np.ndarray:
    """Return the strongest moving beat of chirps, interpolated between bins, (n,)."""
    n_samples = samples.shape[2]
    inverse = np.float32(1 / largest_value)
    static_samples = estimate_static_samples(
        samples.view(np.float32), chirps, n_slots, inverse
    ).view(samples.dtype)
    weights = window_weights("hann", n_samples).astype(np.float32)
    beats = np.empty(chirps.size)
    per_block = max(1, _BLOCK_NUMBERS // samples[0].size)
    for first in range(0, chirps.size, per_block):
        block = chirps[first : first + per_block]
        moving = samples[block] * inverse - static_samples[block % n_slots]
        tapered = moving * weights
        spectra = scipy.fft.fft(tapered) if np.iscomplexobj(samples) else scipy.fft.rfft(tapered)
        power = np.sum(np.abs(spectra) ** 2, axis=1)
        beats[first : first + block.size] = _interpolated_row_peak_bins(power)
    return beats


def _interpolated_row_peak_bins(power: np.ndarray) -> np.ndarray:
    """Return the peak of each row by a parabola through logarithms: 0.02 bins off under Hann."""
    rows, top = np.arange(len(power)), np.argmax(power, axis=1)
    neighbours = np.stack([power[rows, (top + k) % power.shape[1]] for k in (-1, 0, 1)])
    below, peak, above = np.log(np.maximum(neighbours, np.float32(1e-37)))
    curvature = np.minimum(below - 2 * peak + above, -1e-6)
    return np.asarray(top + np.clip((below - above) / (2 * curvature), -0.5, 0.5))


def _find_line_through_most_beats_in_numpy(
    times: np.ndarray, beats: np.ndarray, min_slope: float, step: int, tolerance: float
) -> tuple[float, float]:
    max_count, start, slope = 2, np.nan, np.nan
    for share in (8, 4, 2):
        gap = beats.size // share
        first = np.arange(0, beats.size - gap, step)
        rates = (beats[first + gap] - beats[first]) / (times[first + gap] - times[first])
        origins = beats[first] - rates * times[first]
        distances = abs(beats - origins[:, None] - rates[:, None] * times)
        counts = np.where(abs(rates) < min_slope, 0, np.sum(distances <= tolerance, axis=1))
        best = int(counts.argmax())
        if counts[best] > max_count:
            max_count, start, slope = int(counts[best]), origins[best], rates[best]
    return start, slope


@kernel(plain=_find_line_through_most_beats_in_numpy)
def _find_line_through_most_beats(
    times: np.ndarray, beats: np.ndarray, min_slope: float, step: int, tolerance: float
) -> tuple[float, float]:
    """Return start and slope of the line through two chirps with the most chirps on it.

    Among lines steeper than `min_slope`, through chirps an eighth, a quarter and half of all
    apart.
    """
    max_count, start, slope = 2, np.nan, np.nan
    for share in (8, 4, 2):
        gap = beats.size // share
        for m in range(0, beats.size - gap, step):
            rate = (beats[m + gap] - beats[m]) / (times[m + gap] - times[m])
            if abs(rate) < min_slope:
                continue
            origin = beats[m] - rate * times[m]
            count = 0
            for i in range(beats.size):
                count += abs(beats[i] - origin - rate * times[i]) <= tolerance
            if count > max_count:
                max_count, start, slope = count, origin, rate
    return start, slope


def _chirps_of_densest_stretch(is_on_line: np.ndarray) -> np.ndarray:
    """Return the chirps of the stretch in which at least three quarters are on the line.

    A chirp on the line scores 1, and one off it -3: the stretch with the largest sum.
    """
    score = np.cumsum(np.where(is_on_line, 1.0, -_MIN_FILL / (1 - _MIN_FILL)))
    running_minimum = np.minimum.accumulate(np.concatenate([[0.0], score[:-1]]))
    last = int(np.argmax(score - running_minimum))
    first = int(np.argmin(np.concatenate([[0.0], score])[: last + 1]))
    return first + np.flatnonzero(is_on_line[first : last + 1])


def interference_ghost_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report echoes that move through range faster than any road user."""
    velocity = recorded.values_of_measure("walk_velocity")
    frames = np.flatnonzero(np.isfinite(velocity))
    if not frames.size:
        return []
    worst = frames[np.argmax(np.abs(velocity[frames]))]
    speed = float(velocity[worst])
    first, last = recorded.values_of_measure("walk_chirps")[worst]
    clock = abs(speed) * 2 / SPEED_OF_LIGHT
    return [
        Finding(
            level="warning",
            setting="recording.ghost",
            value=f"an apparent echo that moves by {speed:+.0f} m/s, from"
            f" {recorded.values_of_measure('walk_range')[worst]:.4g} m on, in chirps {first} to"
            f" {last} of frame {recorded.frame_numbers[worst]}"
            + (
                f", and in {format_number_ranges('frame', recorded.frame_numbers[frames])}"
                if frames.size > 1
                else ""
            ),
            expected=f"echoes of less than {MAX_ECHO_SPEED_M_PER_S:.0f} m/s, as of any vehicle",
            fix="discard detections at these ranges: another radar sends the same ramps with a"
            " clock"
            f" that differs by {clock * 1e6:.2g} parts in 1e6; other ramps or times avoid it",
        )
    ]
