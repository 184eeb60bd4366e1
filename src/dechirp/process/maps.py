"""Range-Doppler maps: power, threshold, and the cells that exceed it."""

import numpy as np
import xarray as xr

from dechirp.core.conventions import axis
from dechirp.core.memory import must_fit
from dechirp.process.chain import Chain
from dechirp.process.mitigation.cleaned import cleaned
from dechirp.process.mitigation.noise import evened, noise_left, searched
from dechirp.process.peaks import clear_of_sidelobes, highest
from dechirp.process.range_walk import undone_by
from dechirp.process.spectrum import (
    independent_rows,
    mean_power,
)
from dechirp.process.virtual import channels
from dechirp.radar.radar import Radar


def power_map(cube: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Range-Doppler map of one frame, (chirp, rx, sample), to (velocity, range).

    Mean power over the channels, see `channels`; a tone on a bin keeps its power. Where clean-up
    weakens velocities, the map is divided by what it leaves of white noise there, but for cells
    with less than a tenth left, see `process.mitigation.noise`.
    """
    noise = chain.noise(radar)
    samples = cube.variable.transpose("chirp", "rx", "sample").values
    if chain.mitigation:
        samples = cleaned(samples, radar.frame, chain.mitigation).samples
    units = "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
    return xr.DataArray(
        power_of(channels(samples, radar.frame), radar, chain),
        dims=("velocity", "range"),
        coords={
            "velocity": axis(
                "velocity", radar.frame.velocity_bins_m_per_s(noise.over_velocity.n_bins)
            ),
            "range": axis("range", radar.frame.chirp.range_bins_m(noise.over_range.n_bins)),
        },
        attrs={"units": units, "long_name": "power"},
    )


def threshold_map(power: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Threshold of each cell of a map; infinite in cells where no false-alarm law holds.

    Those are the rows about DC and about half the sample rate of real sampling, see
    `process.spectrum.independent_rows`, and what clean-up leaves less than a tenth of the noise
    of; they are not training cells either.
    """
    labelled = power.transpose("velocity", "range")
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    level = np.ascontiguousarray(level_of(labelled.values, radar, chain)[:, rows])
    threshold = np.full_like(labelled.values, np.inf)
    threshold[:, rows] = chain.cfar.threshold(level, noise)
    if (left := left_by(radar, chain)) is not None:
        threshold[~searched(left)] = np.inf
    return labelled.copy(data=threshold).assign_attrs(long_name="threshold")


def threshold_through(
    power: xr.DataArray, radar: Radar, chain: Chain, cell: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The same for the row and the column through a cell (velocity, range) only.

    (range,) and (velocity,): from the part of the map that they train on, in a third of the time.
    """
    row, column = cell
    noise, ring = chain.noise(radar), chain.cfar.ring
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    values = power.variable.transpose("velocity", "range").values
    level = level_of(values, radar, chain)[:, rows]
    about = np.arange(row - ring.half_velocity, row + ring.half_velocity + 1) % len(level)
    over_range = np.full(values.shape[1], np.inf, np.float32)
    over_range[rows] = chain.cfar.threshold(level[about], noise)[ring.half_velocity]
    over_velocity = np.full(values.shape[0], np.inf, np.float32)
    if rows.start <= column < rows.stop:
        place = int(ring.places(level.shape[1])[column - rows.start])
        first = column - rows.start - place
        box = np.ascontiguousarray(level[:, first : first + 2 * ring.half_range + 1])
        over_velocity = chain.cfar.threshold(box, noise)[:, place]
    if (left := left_by(radar, chain)) is not None:
        within = searched(left)
        over_range[~within[row]] = np.inf
        over_velocity = np.where(within[:, column], over_velocity, np.inf)
    return over_range, over_velocity


def power_of(samples: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Range-Doppler map of one frame, clean, (chirp, channel, sample) to (velocity, range)."""
    noise = chain.noise(radar)
    cells = noise.over_range.n_bins * noise.over_velocity.n_bins
    must_fit(
        "range-Doppler map",
        needed_bytes=cells * (3 * 8.0 + 3 * 4.0),  # spectra of a channel, power, threshold
        fix="Take fewer range or velocity bins.",
    )
    chirp = radar.frame.chirp
    transform = undone_by(chain.range_walk, chirp)
    power = mean_power(samples, chirp.sampling, noise.over_range, noise.over_velocity, transform)
    if (left := left_by(radar, chain)) is not None:
        np.divide(power, left, out=power, where=searched(left))
    return power


def left_by(radar: Radar, chain: Chain) -> np.ndarray | None:
    """Noise that clean-up leaves in each cell of a map, see `noise_left`; none where all."""
    if not any(one.filters_slow_time for one in chain.mitigation):
        return None
    noise = chain.noise(radar)
    return noise_left(chain.mitigation, radar.frame.chirp, noise.over_range, noise.over_velocity)


def level_of(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """A map as a detector sees it: cells that are not searched hold the noise beside them."""
    left = left_by(radar, chain)
    return power if left is None else evened(power, searched(left).astype(np.float32))


def cells_over(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Peaks of a map, (n, 2), velocity and range, strongest first: as `peaks` of its threshold.

    `power` as a detector sees it, see `level_of`. Which cells exceed the threshold, and that of a
    few, are known in a fraction of the time that an ordered statistic takes for a whole map.
    """
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    within = np.ascontiguousarray(power[:, rows])
    over = chain.cfar.exceeds(within, noise)
    if within.shape != power.shape:
        of_rows, over = over, np.zeros(power.shape, bool)
        over[:, rows] = of_rows
    if (left := left_by(radar, chain)) is not None:
        over &= searched(left)
    found = highest(power, over)
    threshold = chain.cfar.threshold_at(within, found - (0, rows.start), noise)
    return clear_of_sidelobes(power, found, threshold, noise)
