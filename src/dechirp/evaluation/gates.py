"""Gates: cells of a map in which a target is searched."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.evaluation.association import (
    GATE_CELLS,
    scatterer_range_and_range_rate,
    visible_scatterer_mask,
)
from dechirp.evaluation.trial import TrialContext
from dechirp.processing.spectrum import Transform
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity, beat_and_doppler_frequencies


class GateCells(NamedTuple):
    """Gate cells of one frame, (n,) each: one row for each cell of each target."""

    target: np.ndarray
    velocity: np.ndarray
    range: np.ndarray


@lru_cache(maxsize=4)
def target_gate_cells(context: TrialContext) -> tuple[GateCells, ...]:
    """Return the cells within two resolution cells of the targets in each frame.

    For a body, of any visible scatterer. Velocities are periodic; ranges end.
    """
    return tuple(
        _target_gate_cells_of_frame(context, frame_index)
        for frame_index in range(len(context.times_s))
    )


def echo_cycles_per_sample_and_chirp(
    range_velocity: RangeVelocity, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cycles of an echo from sample to sample and from chirp to chirp, as in the map.

    The first from 0 to 1, the second with any ambiguity number.
    """
    frame = radar.frame
    beat_hz, doppler_hz = beat_and_doppler_frequencies(range_velocity, radar)
    fast = np.asarray(beat_hz / frame.chirp.sample_rate_hz % 1.0)
    slow = np.asarray(doppler_hz * frame.repetition_s)
    if frame.chirp.sampling == "real":  # the upper half mirrors the lower
        mirrored = fast > 0.5
        fast, slow = np.where(mirrored, 1 - fast, fast), np.where(mirrored, -slow, slow)
    return fast, slow


def gate_half_width_bins(transform: Transform) -> int:
    """Return the half width of a gate in bins, limited by the number of bins."""
    half_width = int(GATE_CELLS * transform.n_bins / transform.n_points)
    return min(half_width, (transform.n_bins - 1) // 2)


def _target_gate_cells_of_frame(context: TrialContext, frame_index: int) -> GateCells:
    radar, time_s = (
        context.radar.for_frame(int(context.truth["frame"].values[frame_index])),
        float(context.times_s[frame_index]),
    )
    noise = context.chain.map_noise_statistics(radar)
    n_velocity, n_range = noise.doppler_transform.n_bins, noise.range_transform.n_bins
    is_visible = visible_scatterer_mask(context.scene, time_s, radar)
    motion = scatterer_range_and_range_rate(
        context.scene, context.times_s[frame_index : frame_index + 1]
    )
    fast, slow = echo_cycles_per_sample_and_chirp(
        RangeVelocity(*(values[0, is_visible] for values in motion)), radar
    )
    row = np.rint(fast * n_range).astype(int) % n_range
    column = np.rint(slow * n_velocity).astype(int) + n_velocity // 2
    gate_offsets = [
        np.arange(-gate_half_width_bins(transform), gate_half_width_bins(transform) + 1)
        for transform in (noise.doppler_transform, noise.range_transform)
    ]
    # (scatterer, velocity, range)
    columns = (column[:, None, None] + gate_offsets[0][:, None]) % n_velocity
    rows = row[:, None, None] + gate_offsets[1]
    owners = context.scene.target_index_of_scatterer[is_visible][:, None, None]
    cells = np.stack(np.broadcast_arrays(owners, columns, rows), axis=-1).reshape(-1, 3)
    n_rows = n_range if radar.frame.chirp.sampling == "complex" else n_range // 2 + 1
    is_in_map = (cells[:, 2] >= 0) & (cells[:, 2] < n_rows)
    return GateCells(*np.unique(cells[is_in_map], axis=0).T)
