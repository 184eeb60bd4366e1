"""What a recording tells of its receivers: what full scale is, their noise, their offsets."""

import numpy as np
import xarray as xr

from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.coloured_noise import ColouredNoise
from dechirp.echoes.impairments.dc_offset import DcOffset
from dechirp.experiment.twin.measure import Seen, floor, is_noisy, stretches
from dechirp.process.chain import Chain
from dechirp.process.spectrum import noise_gain
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar

_ISOLATION = 1e6  # from what is sent to the strongest cell, where no noise tells full scale


def watts_per_unit(frame: xr.DataArray, radar: Radar, chain: Chain) -> float:
    """What makes the mean noise of the recording k T0 F fs; 1 where its samples are in watts.

    Without noise, what puts its strongest cell 60 dB below what is sent.
    """
    if frame.attrs.get("units") == "sqrt(W)":
        return 1.0
    seen = Seen(frame=frame, radar=radar, chain=chain)
    if not is_noisy(seen):
        sent_w = radar.known_hardware().transmit_power_w
        return sent_w / _ISOLATION / float(seen.power.max())
    return _thermal_in_cell(radar, chain) / float(floor(seen).mean())


def _thermal_in_cell(radar: Radar, chain: Chain) -> float:
    """Mean power of thermal noise in a cell of the map."""
    noise = chain.noise(radar)
    gain = noise_gain(noise.over_range, noise.over_velocity, radar.frame.chirp)
    return noise_power_w(radar) * gain


def noise_over_range(seen: Seen) -> tuple[ColouredNoise, ...]:
    """Noise over range as the recording has it; none where it has none."""
    if not is_noisy(seen):
        return ()
    level = floor(seen) / _thermal_in_cell(seen.radar, seen.chain)
    chirp, n_bins = seen.radar.frame.chirp, seen.chain.noise(seen.radar).over_range.n_bins
    middles = np.array([(one.start + one.stop - 1) / 2 for one in stretches(seen)])
    beat_hz = middles * chirp.sample_rate_hz / n_bins
    # Six digits are more than it is known to, and a file that can be read.
    return (
        ColouredNoise(
            beat_hz=tuple(float(f"{one:.6g}") for one in beat_hz),
            level=tuple(float(f"{one:.6g}") for one in level),
        ),
    )


def offsets(seen: Seen) -> tuple[Impairment, ...]:
    """The offset of each receiver's samples, where they are real.

    Of complex ones each would have another power, and what is at range 0 is taken as leakage.
    """
    if seen.radar.frame.chirp.sampling == "complex":
        return ()
    means = seen.frame.mean(("chirp", "sample")).values.astype(float)
    largest = float(abs(means).max())
    if not largest:
        return ()
    phases_rad = np.arccos(means / largest)
    return (DcOffset(power_w=largest**2 / 2, phases_rad=tuple(phases_rad.tolist())),)
