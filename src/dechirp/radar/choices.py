"""Choices that every rule of design makes alike."""

import math

from dechirp.radar.frame import Frame
from dechirp.radar.nearest import Broken
from dechirp.radar.requirements import BANDS_HZ, Requirements

N_CHIRPS = 128
MOST_CHIRPS = 2**31 - 1  # what a frame can count


def start_frequency_hz(asked: Requirements, swept_hz: float) -> float:
    """Carrier, or the lower edge of the band where a ramp from the carrier would leave it."""
    if asked.band is None:
        return asked.carrier_hz
    low_hz, high_hz = BANDS_HZ[asked.band]
    inside = low_hz <= asked.carrier_hz and asked.carrier_hz + swept_hz <= high_hz
    return asked.carrier_hz if inside else low_hz


def outside_band(asked: Requirements, swept_hz: float) -> list[Broken]:
    """Band as a broken limit, where the ramp is wider than all of it.

    Without a band, a carrier from 76 to 81 GHz has the 5 GHz of both automotive bands.
    """
    if asked.band is not None:
        low_hz, high_hz = BANDS_HZ[asked.band]
        name = f"requirements.band {asked.band}"
    else:
        low_hz, high_hz = BANDS_HZ["76-77 GHz"][0], BANDS_HZ["77-81 GHz"][1]
        name = "76-81 GHz, the automotive bands"
        if not low_hz <= asked.carrier_hz < high_hz:
            return []
    if swept_hz <= high_hz - low_hz:
        return []
    return [
        Broken(
            limit="band",
            takes=f"a ramp of {swept_hz / 1e6:.5g} MHz",
            allowed=f"at most {(high_hz - low_hz) / 1e6:.5g} MHz ({name})",
        )
    ]


def n_chirps(asked: Requirements, *, wavelength_m: float, interval_s: float) -> int:
    """Chirps that the velocity resolution takes, lambda / (2 T dv); 128 where none is asked."""
    if asked.velocity_resolution_m_per_s is None:
        return N_CHIRPS
    chirps = wavelength_m / (2 * interval_s * asked.velocity_resolution_m_per_s)
    # The 1e-9 keeps 64.00000000000001 at 64.
    return min(max(2, math.ceil(chirps - 1e-9)), MOST_CHIRPS)


def too_many_chirps(asked: Requirements, made: Frame) -> list[Broken]:
    """Count of chirps as a broken limit, where the velocity resolution takes more than fit."""
    if asked.velocity_resolution_m_per_s is None or made.n_chirps < MOST_CHIRPS:
        return []
    return [
        Broken(limit="chirps", takes="more chirps", allowed=f"fewer than {MOST_CHIRPS} in a frame")
    ]
