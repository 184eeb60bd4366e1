"""Choices shared by both design rules: start frequency, ramp bandwidth, number of chirps."""

import math

from dechirp.radar.design.relaxation import BrokenLimit
from dechirp.radar.design.requirements import BANDS_HZ, Requirements
from dechirp.radar.frame import Frame

DEFAULT_N_CHIRPS = 128
MAX_N_CHIRPS = 2**31 - 1  # the limit of `Frame.n_chirps`


def start_frequency_hz(requirements: Requirements, ramp_bandwidth_hz: float) -> float:
    """Return the carrier, or the lower band edge if a ramp from the carrier leaves the band."""
    if requirements.band is None:
        return requirements.carrier_hz
    low_hz, high_hz = BANDS_HZ[requirements.band]
    is_inside = (
        low_hz <= requirements.carrier_hz and requirements.carrier_hz + ramp_bandwidth_hz <= high_hz
    )
    return requirements.carrier_hz if is_inside else low_hz


def find_broken_band_limit(
    requirements: Requirements, ramp_bandwidth_hz: float
) -> list[BrokenLimit]:
    """Return the band as a broken limit if the ramp is wider than the band.

    Without a band, a carrier from 76 to 81 GHz has the 5 GHz of both automotive bands.
    """
    if requirements.band is not None:
        low_hz, high_hz = BANDS_HZ[requirements.band]
        name = f"requirements.band {requirements.band}"
    else:
        low_hz, high_hz = BANDS_HZ["76-77 GHz"][0], BANDS_HZ["77-81 GHz"][1]
        name = "76-81 GHz, the automotive bands"
        if not low_hz <= requirements.carrier_hz < high_hz:
            return []
    if ramp_bandwidth_hz <= high_hz - low_hz:
        return []
    return [
        BrokenLimit(
            limit="band",
            demand=f"a ramp of {ramp_bandwidth_hz / 1e6:.5g} MHz",
            bound=f"at most {(high_hz - low_hz) / 1e6:.5g} MHz ({name})",
        )
    ]


def required_n_chirps(requirements: Requirements, *, wavelength_m: float, interval_s: float) -> int:
    """Return the chirps for the velocity resolution, lambda / (2 T dv); 128 without one."""
    if requirements.velocity_resolution_m_per_s is None:
        return DEFAULT_N_CHIRPS
    chirps = wavelength_m / (2 * interval_s * requirements.velocity_resolution_m_per_s)
    # The 1e-9 keeps 64.00000000000001 at 64.
    return min(max(2, math.ceil(chirps - 1e-9)), MAX_N_CHIRPS)


def find_broken_chirp_count_limit(requirements: Requirements, frame: Frame) -> list[BrokenLimit]:
    """Return the chirp count as a broken limit if the velocity resolution needs too many."""
    if requirements.velocity_resolution_m_per_s is None or frame.n_chirps < MAX_N_CHIRPS:
        return []
    return [
        BrokenLimit(
            limit="chirps",
            demand=f"{MAX_N_CHIRPS} chirps or more",
            bound=f"fewer than {MAX_N_CHIRPS} in a frame",
        )
    ]
