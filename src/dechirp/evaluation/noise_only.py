"""False alarms of a detector in a map of noise: cells over threshold, and detections."""

import numpy as np

from dechirp.evaluation.trial import NoiseMap
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.noise_loss import usable_cells
from dechirp.processing.range_doppler_map import detect_cells, residual_noise
from dechirp.processing.spectrum import independent_rows
from dechirp.radar.radar import Radar


def count_noise_alarms(power: np.ndarray, radar: Radar, chain: Chain) -> NoiseMap:
    """Count the alarms in a map of a scene without its targets.

    Parameters
    ----------
    power : array (velocity, range), float32
        As the detector reads it: after `processing.range_doppler_map`, or as
        `processing.noise_maps.draw_noise_map` returns it.
    radar : Radar
        For triangles `Radar.with_rising_ramps_only`, with the map of the rising ramps.
    chain : Chain
        Fitted to the radar.
    """
    noise = chain.map_noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.range_transform)
    is_over = chain.cfar.exceeds_threshold(np.ascontiguousarray(power[:, rows]), noise)
    n_tested = is_over.size
    if (residual_noise_map := residual_noise(radar, chain)) is not None:
        is_usable = usable_cells(residual_noise_map)[:, rows]
        is_over &= is_usable
        n_tested = int(np.count_nonzero(is_usable))
    n_over = int(np.count_nonzero(is_over))
    # Most maps have no alarm, and then no peak: those are not looked for.
    n_peaks = len(detect_cells(power, radar, chain)[0]) if n_over else 0
    return NoiseMap(power, n_tested, n_over, n_peaks)
