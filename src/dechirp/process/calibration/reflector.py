"""A reflector at rest in a frame: what every virtual element hears of it."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.special import gammainccinv, gammaincinv

from dechirp.core.errors import InvalidSetting
from dechirp.process.chain import Chain
from dechirp.process.interpolation import between_bins
from dechirp.process.maps import power_map
from dechirp.process.peaks import peaks
from dechirp.process.refine import refine
from dechirp.process.spectrum import independent_rows, noise_gain
from dechirp.process.virtual import channels, element_noise, elements
from dechirp.radar.radar import Radar

_FALSE_ALARMS = 1e-9  # of noise alone, in a cell
# Antennas hear each other and the bumper in the first cells.
_LEAKAGE_CELLS = 3.0
# How far from the given range a reflector is looked for: cables and filters add less.
_NEAR_M, _NEAR_CELLS = 0.5, 3.0
_BESIDE_CELLS = 3.0


@dataclass(frozen=True)
class Reflector:
    """What is heard of a reflector in one frame."""

    snapshot: np.ndarray
    """(n_elements,) complex amplitudes, element tx * n_rx + rx, without calibration."""
    noise_power: float
    """Noise in an element, E|w|^2."""
    range_m: float
    """As measured, without calibration."""
    beside: float
    """Power of the strongest echo within three range cells, over the reflector's."""
    next_range_m: float | None
    """Where the strongest other echo at rest is that would have been taken without this one."""
    next_power: float
    """Its power over the reflector's."""


def reflector(frame: xr.DataArray, radar: Radar, range_m: float | None) -> Reflector:
    """Find the strongest echo at rest near a range, or of all beyond the first three cells.

    What stands still lies in the middle row of the map; noise is taken from the rows beside
    it, so that a room full of echoes hides none. All echoes at rest are refined together, each
    freed of the others' sidelobes.

    Parameters
    ----------
    frame : DataArray (frame, chirp, rx, sample)
        Of length 1 along `frame`.

    Raises
    ------
    InvalidSetting
        If there is no such echo over the noise.
    """
    chain, chirp = Chain(), radar.frame.chirp
    noise = chain.noise(radar)
    power = power_map(frame.isel(frame=0), radar, chain).values
    middle = power.shape[0] // 2
    rows = independent_rows(chirp, noise.over_range)
    cell_noise = _noise(power[:, rows], noise.over_velocity.main_lobe_bins, noise.n_channels)
    threshold = np.full_like(power, np.inf)
    factor = gammainccinv(noise.n_channels, _FALSE_ALARMS) / noise.n_channels
    threshold[middle, rows] = factor * cell_noise
    found = peaks(power, threshold, noise)

    gain = noise_gain(noise.over_range, noise.over_velocity, chirp)
    sample_noise = np.full(len(found), max(cell_noise / gain, float(np.finfo(np.float32).tiny)))
    kind = np.complex64 if chirp.sampling == "complex" else np.float32
    samples = np.ascontiguousarray(frame.isel(frame=0).transpose("chirp", "rx", "sample"), kind)
    slow, fast = between_bins(power, found, noise)
    tones = refine(channels(samples, radar.frame), 0 * slow, fast, sample_noise)
    ranges_m = tones.fast * chirp.range_m(chirp.sample_rate_hz) / (2 * np.pi)

    chosen, others = _strongest(tones.energy, ranges_m, chirp.range_resolution_m, range_m)
    own = tones.energy[chosen]
    near = abs(ranges_m - ranges_m[chosen]) < _BESIDE_CELLS * chirp.range_resolution_m
    near[chosen] = False
    channel_noise = float(sample_noise[chosen]) / (radar.frame.n_chirps * chirp.n_samples)
    return Reflector(
        snapshot=elements(tones.amplitude[[chosen]], radar.frame, np.zeros(1))[0],
        noise_power=channel_noise * element_noise(radar.frame),
        range_m=float(ranges_m[chosen]),
        beside=float(tones.energy[near].max(initial=0) / own),
        next_range_m=float(ranges_m[others[0]]) if others.size else None,
        next_power=float(tones.energy[others[0]] / own) if others.size else 0.0,
    )


def _noise(power: np.ndarray, main_lobe_bins: float, n_channels: int) -> float:
    """Mean noise in a cell: by the median of what moves, or of all where no row is free."""
    apart = abs(np.arange(len(power)) - len(power) // 2) > np.ceil(main_lobe_bins)
    cells = power[apart] if apart.any() else power
    return float(np.median(cells) * n_channels / gammaincinv(n_channels, 0.5))


def _strongest(
    energy: np.ndarray, ranges_m: np.ndarray, cell_m: float, range_m: float | None
) -> tuple[int, np.ndarray]:
    """The echo that is meant, and the others that it was chosen from, strongest first."""
    if range_m is None:
        possible = ranges_m > _LEAKAGE_CELLS * cell_m
        where = f"beyond {_LEAKAGE_CELLS * cell_m:.3g} m, where the antennas hear each other"
    else:
        reach_m = max(_NEAR_M, _NEAR_CELLS * cell_m)
        possible = abs(ranges_m - range_m) < reach_m
        where = f"from {max(range_m - reach_m, 0):.4g} to {range_m + reach_m:.4g} m"
    order = np.argsort(-energy, kind="stable")
    order = order[possible[order]]
    if not order.size:
        some = ", ".join(f"{r:.4g} m" for r in ranges_m[np.argsort(-energy)][:3])
        raise InvalidSetting(
            "cube",
            got=f"without an echo at rest {where}"
            + (f"; the strongest are at {some}" if some else ""),
            need="of a reflector that stands still, over the noise",
            fix="Give the range at which it stands, or record it nearer, for longer.",
        )
    return int(order[0]), order[1:]
