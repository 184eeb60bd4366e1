"""What a detector makes of a map of noise: cells over threshold, and detections."""

import numpy as np

from dechirp.evaluate.look import NoiseMap
from dechirp.process.chain import Chain
from dechirp.process.maps import cells_over, left_by
from dechirp.process.mitigation.noise import searched
from dechirp.process.spectrum import independent_rows
from dechirp.radar.radar import Radar


def counted(power: np.ndarray, radar: Radar, chain: Chain) -> NoiseMap:
    """Count the alarms in a map of a scene without its targets.

    Parameters
    ----------
    power : array (velocity, range), float32
        As a detector sees it: `process.maps.level_of` that of `power_of`, or as
        `process.noise_maps.draw_noise_map` gives it.
    radar : Radar
        Of triangles `Radar.one_sided`, and the map that of their rising ramps.
    chain : Chain
        Fitted to the radar.
    """
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    over = chain.cfar.exceeds(np.ascontiguousarray(power[:, rows]), noise)
    n_tested = over.size
    if (left := left_by(radar, chain)) is not None:
        within = searched(left)[:, rows]
        over &= within
        n_tested = int(np.count_nonzero(within))
    n_over = int(np.count_nonzero(over))
    # Most maps have no alarm, and then no peak: those are not looked for.
    n_peaks = len(cells_over(power, radar, chain)) if n_over else 0
    return NoiseMap(power, n_tested, n_over, n_peaks)
