"""Leakage from transmitters to receivers, which appears as a static echo next to zero range.

It travels from antenna to antenna, centimetres, and through the chip, so that its beat frequency
lies within the main lobe of zero. Targets that near are not separated from it.
"""

import numpy as np
import xarray as xr

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar


def leakage_mask(detections: xr.Dataset, radar: Radar, chain: Chain) -> np.ndarray:
    """Return which detections are leakage, or not separated from it, (n,).

    Those within half the main lobe of the range window from zero range that are within two cells
    of velocity from zero, since it drifts, or that the map without static echoes does not confirm
    as moving (`join_moving_detections`), and all at zero range.
    """
    frame = radar.for_frame(0).frame
    ranges_m = detections["range"].values
    # Unknown velocities are those of single chirps.
    is_slow = ~(abs(detections["velocity"].values) > 2 * frame.velocity_resolution_m_per_s)
    if chain.moving_targets is not None:
        is_slow |= np.isnan(detections["moving"].values)
    is_near = ranges_m < zero_range_main_lobe_m(radar, chain)
    return np.asarray((is_near & is_slow) | (ranges_m == 0))


def leakage_findings(detections: xr.Dataset, radar: Radar, chain: Chain) -> tuple[Finding, ...]:
    """Return a note on the detections of a recording that are leakage."""
    ranges_m = detections["range"].values[leakage_mask(detections, radar, chain)]
    if not ranges_m.size:
        return ()
    limits_m = " to ".join(dict.fromkeys(f"{limit:.2f}" for limit in np.sort(ranges_m)[[0, -1]]))
    return (
        Finding(
            level="note",
            setting="radar",
            value=f"{format_count_with_noun(ranges_m.size, 'detection')} at {limits_m} m:"
            " probably leakage between the antennas, left out of tables",
            expected=f"targets beyond {zero_range_main_lobe_m(radar, chain):.2g} m, the main lobe"
            " of zero range",
            fix="nothing is to be done; more bandwidth separates nearer targets",
        ),
    )


def zero_range_main_lobe_m(radar: Radar, chain: Chain) -> float:
    """Return half the main lobe of the range window at zero range, in which leakage lies."""
    chirp = radar.for_frame(0).frame.chirp
    transform = chain.range_transform(chirp)
    bin_m = chirp.sample_rate_hz / transform.n_bins * chirp.range_m(1.0)
    return float(transform.main_lobe_half_width_bins * bin_m)
