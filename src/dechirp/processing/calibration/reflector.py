"""Measurement of a static reflector in a frame, in every virtual element."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.processing.chain import Chain
from dechirp.processing.peak_interpolation import interpolate_peak_frequencies
from dechirp.processing.peaks import find_peaks
from dechirp.processing.range_doppler_map import power_map
from dechirp.processing.refine import refine_tones
from dechirp.processing.scaling import to_single_precision
from dechirp.processing.spectrum import noise_gain, rows_with_circular_noise
from dechirp.processing.virtual_array import (
    element_amplitudes,
    element_to_channel_noise_ratio,
    split_chirps_into_slots,
)
from dechirp.radar.radar import Radar
from dechirp.theory.detection import detection_threshold

_FALSE_ALARM_PROBABILITY = 1e-9  # of noise only, in a cell
# Leakage and the bumper fill the first cells.
_LEAKAGE_CELLS = 3.0
# Search window about the given range: cables and filters add less.
_RANGE_TOLERANCE_M, _RANGE_TOLERANCE_CELLS = 0.5, 3.0
_NEIGHBOUR_CELLS = 3.0


@dataclass(frozen=True)
class MeasuredReflector:
    """Echo of a reflector in one frame."""

    snapshot: np.ndarray
    """Complex amplitudes (n_elements,), element tx * n_rx + rx, without calibration."""
    noise_power: float
    """Noise power in an element, E|w|^2."""
    range_m: float
    """Measured range, without calibration."""
    neighbour_power: float
    """Power of the strongest echo within three range cells, over the reflector's."""
    other_ranges_m: tuple[float, ...]
    """Ranges of the three strongest other static echoes that might be the reflector."""
    next_power: float
    """Power of the first of them over the reflector's."""


def measure_static_reflector(
    frame: xr.DataArray, radar: Radar, range_m: float | None
) -> MeasuredReflector:
    """Find the strongest static echo near a range, or of all beyond the first three cells.

    Static echoes lie in the middle row of the map; noise is estimated from the other rows, so that
    a room full of echoes masks none. All static echoes are refined together, which removes the
    sidelobes of the others.

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
    noise = chain.map_noise_statistics(radar)
    power = power_map(frame.isel(frame=0), radar, chain).values
    middle = power.shape[0] // 2
    rows = rows_with_circular_noise(chirp, noise.range_transform)
    cell_noise = _noise_power_from_moving_rows(
        power[:, rows], noise.doppler_transform.main_lobe_half_width_bins, noise.n_channels
    )
    threshold = np.full_like(power, np.inf)
    factor = detection_threshold(_FALSE_ALARM_PROBABILITY, n_summed=noise.n_channels)
    threshold[middle, rows] = factor / noise.n_channels * cell_noise
    peaks = find_peaks(power, threshold, noise)

    gain = noise_gain(noise.range_transform, noise.doppler_transform, chirp)
    sample_noise = np.full(len(peaks), max(cell_noise / gain, float(np.finfo(np.float32).tiny)))
    samples = to_single_precision(
        frame.isel(frame=0).transpose("chirp", "rx", "sample").values,
        is_complex=chirp.sampling == "complex",
    )
    slow, fast = interpolate_peak_frequencies(power, peaks, noise)
    tones = refine_tones(
        split_chirps_into_slots(samples, radar.frame), 0 * slow, fast, sample_noise
    )
    ranges_m = tones.fast * chirp.range_m(chirp.sample_rate_hz) / (2 * np.pi)

    reflector_index, others = _choose_reflector_and_rank_others(
        tones.energy, ranges_m, chirp.range_resolution_m, range_m
    )
    reflector_energy = tones.energy[reflector_index]
    is_neighbour = (
        abs(ranges_m - ranges_m[reflector_index]) < _NEIGHBOUR_CELLS * chirp.range_resolution_m
    )
    is_neighbour[reflector_index] = False
    channel_noise = float(sample_noise[reflector_index]) / (radar.frame.n_chirps * chirp.n_samples)
    return MeasuredReflector(
        snapshot=element_amplitudes(tones.amplitude[[reflector_index]], radar.frame, np.zeros(1))[
            0
        ],
        noise_power=channel_noise * element_to_channel_noise_ratio(radar.frame),
        range_m=float(ranges_m[reflector_index]),
        neighbour_power=float(tones.energy[is_neighbour].max(initial=0) / reflector_energy),
        other_ranges_m=tuple(ranges_m[others[:3]].tolist()),
        next_power=float(tones.energy[others[0]] / reflector_energy) if others.size else 0.0,
    )


def _noise_power_from_moving_rows(
    power: np.ndarray, main_lobe_bins: float, n_channels: int
) -> float:
    """Return the mean noise in a cell: by the median of moving rows, or of all if none is free."""
    is_far = abs(np.arange(len(power)) - len(power) // 2) > np.ceil(main_lobe_bins)
    cells = power[is_far] if is_far.any() else power
    return float(np.median(cells) * n_channels / detection_threshold(0.5, n_summed=n_channels))


def _choose_reflector_and_rank_others(
    energy: np.ndarray, ranges_m: np.ndarray, cell_m: float, range_m: float | None
) -> tuple[int, np.ndarray]:
    """Return the echo of the reflector, and the other candidates, strongest first."""
    if range_m is None:
        is_candidate = ranges_m > _LEAKAGE_CELLS * cell_m
        region = f"beyond {_LEAKAGE_CELLS * cell_m:.3g} m, the extent of the leakage"
    else:
        tolerance_m = max(_RANGE_TOLERANCE_M, _RANGE_TOLERANCE_CELLS * cell_m)
        is_candidate = abs(ranges_m - range_m) < tolerance_m
        region = f"from {max(range_m - tolerance_m, 0):.4g} to {range_m + tolerance_m:.4g} m"
    order = np.argsort(-energy, kind="stable")
    order = order[is_candidate[order]]
    if not order.size:
        strongest = ", ".join(f"{r:.4g} m" for r in ranges_m[np.argsort(-energy)][:3])
        raise InvalidSetting(
            "cube",
            value=f"no static echo {region}"
            + (f"; the strongest are at {strongest}" if strongest else ""),
            expected="a static reflector above the noise",
            fix="give the range of the reflector, or record it nearer or for longer",
        )
    return int(order[0]), order[1:]
