"""Receiver parameters of a recording: full scale, noise and offsets."""

import numpy as np
import xarray as xr

from dechirp.core.units import is_absolute
from dechirp.experiments.twin.measure import (
    FrameMap,
    has_noise_in_all_segments,
    noise_floor_per_segment,
    range_row_segments,
)
from dechirp.processing.chain import Chain
from dechirp.processing.spectrum import noise_gain
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.dc_offset import DcOffset
from dechirp.simulation.impairments.noise import ColouredNoise

_ISOLATION = 1e6  # transmit power to strongest cell, for recordings without noise


def estimate_watts_per_unit(frame: xr.DataArray, radar: Radar, chain: Chain) -> float:
    """Estimate the factor with which the mean noise is k T0 F fs; 1 for samples in sqrt(W).

    Without noise, the factor that puts the strongest cell 60 dB below the transmit power.
    """
    if is_absolute(frame.attrs.get("units")):
        return 1.0
    frame_map = FrameMap(samples=frame, radar=radar, chain=chain)
    if not has_noise_in_all_segments(frame_map):
        transmit_power_w = radar.require_hardware().transmit_power_w
        return transmit_power_w / _ISOLATION / float(frame_map.power.max())
    return _thermal_noise_per_cell(radar, chain) / float(noise_floor_per_segment(frame_map).mean())


def _thermal_noise_per_cell(radar: Radar, chain: Chain) -> float:
    """Return the mean power of thermal noise in a cell of the map."""
    noise = chain.map_noise_statistics(radar)
    gain = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    return noise_power_w(radar) * gain


def fit_coloured_noise(frame_map: FrameMap) -> tuple[ColouredNoise, ...]:
    """Fit noise over range to a recording; empty if it has no noise."""
    if not has_noise_in_all_segments(frame_map):
        return ()
    level = noise_floor_per_segment(frame_map) / _thermal_noise_per_cell(
        frame_map.radar, frame_map.chain
    )
    chirp, n_bins = (
        frame_map.radar.frame.chirp,
        frame_map.chain.map_noise_statistics(frame_map.radar).range_transform.n_bins,
    )
    middles = np.array(
        [(number.start + number.stop - 1) / 2 for number in range_row_segments(frame_map)]
    )
    beat_hz = middles * chirp.sample_rate_hz / n_bins
    # Six digits exceed the accuracy and keep the file readable.
    return (
        ColouredNoise(
            beat_hz=tuple(float(f"{number:.6g}") for number in beat_hz),
            level=tuple(float(f"{number:.6g}") for number in level),
        ),
    )


def estimate_dc_offsets(frame_map: FrameMap) -> tuple[Impairment, ...]:
    """Estimate the offset of each receiver's real samples.

    Offsets of complex samples would each have another power; their zero-range echo is leakage.
    """
    if frame_map.radar.frame.chirp.sampling == "complex":
        return ()
    means = frame_map.samples.mean(("chirp", "sample")).values.astype(float)
    largest = float(abs(means).max())
    if not largest:
        return ()
    phases_rad = np.arccos(means / largest)
    return (DcOffset(power_w=largest**2 / 2, phases_rad=tuple(phases_rad.tolist())),)
