"""The rule of the reference report: a chirp lasts 5.5 round trips to the largest range."""

import math

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.chirp import Chirp
from dechirp.radar.choices import (
    N_CHIRPS,
    n_chirps,
    outside_band,
    start_frequency_hz,
    too_many_chirps,
)
from dechirp.radar.derived import Derived
from dechirp.radar.frame import Frame
from dechirp.radar.nearest import Broken
from dechirp.radar.requirements import Requirements

ROUND_TRIPS = 5.5


def frame(asked: Requirements, *, speed_of_light_m_per_s: float) -> Frame:
    """Chirps of 5.5 round trips back to back, sampled at twice the bandwidth.

    The rule has no fly-back and samples from the start of the ramp on.
    """
    bandwidth_hz = speed_of_light_m_per_s / (2 * asked.range_resolution_m)
    sample_rate_hz = 2 * bandwidth_hz
    # Rounding up lengthens the chirp at the same bandwidth, so the resolution stays exact.
    # The 1e-9 keeps 2200.0000000000005 at 2200.
    cells = 2 * ROUND_TRIPS * asked.max_range_m / asked.range_resolution_m
    n_samples = max(2, math.ceil(cells - 1e-9))
    duration_s = n_samples / sample_rate_hz
    chirp = Chirp(
        start_frequency_hz=start_frequency_hz(asked, bandwidth_hz),
        slope_hz_per_s=bandwidth_hz / duration_s,
        ramp_duration_s=duration_s,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling=asked.sampling,
    )
    wavelength_m = chirp.wavelength_m * speed_of_light_m_per_s / SPEED_OF_LIGHT
    chirps = n_chirps(asked, wavelength_m=wavelength_m, interval_s=duration_s)
    return Frame(chirp=chirp, n_chirps=max(N_CHIRPS, chirps), interval_s=duration_s)


def breaks(asked: Requirements, *, speed_of_light_m_per_s: float) -> list[Broken]:
    """Limits of the rule that requirements break: velocity, chirps of a frame, the band."""
    made = frame(asked, speed_of_light_m_per_s=speed_of_light_m_per_s)
    scale = speed_of_light_m_per_s / SPEED_OF_LIGHT
    broken = outside_band(asked, made.chirp.ramp_bandwidth_hz)
    broken += too_many_chirps(asked, made)
    if made.max_velocity_m_per_s * scale < asked.max_velocity_m_per_s * (1 - 1e-9):
        longest_s = made.chirp.wavelength_m * scale / (4 * asked.max_velocity_m_per_s)
        broken.append(
            Broken(
                limit="interval",
                takes=f"an interval of at most {longest_s * 1e6:.4g} us, lambda / 4v",
                allowed=f"chirps of {ROUND_TRIPS} round trips,"
                f" {made.only_interval_s * 1e6:.4g} us (the rule)",
            )
        )
    return broken


def derived(
    asked: Requirements, made: Frame, *, speed_of_light_m_per_s: float
) -> tuple[Derived, ...]:
    """Choices of the rule, in the order in which it makes them."""
    chirp = made.chirp
    round_trip_s = 2 * asked.max_range_m / speed_of_light_m_per_s
    resolution, farthest = (
        f"dR = {asked.range_resolution_m:.6g} m",
        f"R = {asked.max_range_m:.6g} m",
    )
    alias = 2 * ROUND_TRIPS if chirp.sampling == "complex" else ROUND_TRIPS
    return (
        Derived(
            name="bandwidth",
            value=chirp.sampled_bandwidth_hz,
            unit="Hz",
            formula="c / 2 dR",
            uses=f"{resolution}; swept while sampling",
        ),
        Derived(name="round_trip", value=round_trip_s, unit="s", formula="2 R / c", uses=farthest),
        Derived(
            name="n_samples",
            value=chirp.n_samples,
            unit="1",
            formula="11 R / dR, rounded up",
            uses=f"{farthest}, {resolution}",
        ),
        Derived(
            name="sample_rate",
            value=chirp.sample_rate_hz,
            unit="Hz",
            formula="2 B",
            uses=f"{chirp.sampling} samples: ranges alias beyond {alias:g} R",
        ),
        Derived(
            name="chirp_duration",
            value=chirp.ramp_duration_s,
            unit="s",
            formula="N / fs = 5.5 x 2 R / c, to whole samples",
            uses="the whole ramp is sampled; chirps back to back",
        ),
        Derived(name="slope", value=chirp.slope_hz_per_s, unit="Hz/s", formula="B / T"),
        Derived(
            name="late_samples",
            value=math.ceil(round_trip_s * chirp.sample_rate_hz - 1e-9),
            unit="1",
            formula="2 R fs / c, rounded up",
            uses="samples before the echo from R arrives, since sampling starts with the ramp",
        ),
    )
