"""Design rule of the reference report: chirps of 5.5 round trips to the largest range."""

import math

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.chirp import Chirp
from dechirp.radar.design.common import (
    DEFAULT_N_CHIRPS,
    find_broken_band_limit,
    find_broken_chirp_count_limit,
    required_n_chirps,
    start_frequency_hz,
)
from dechirp.radar.design.derived import DerivedValue
from dechirp.radar.design.relaxation import BrokenLimit
from dechirp.radar.design.requirements import Requirements
from dechirp.radar.frame import Frame

N_ROUND_TRIPS = 5.5


def design_frame(requirements: Requirements, *, speed_of_light_m_per_s: float) -> Frame:
    """Design back-to-back chirps of 5.5 round trips, sampled at twice the bandwidth.

    The rule has no fly-back and samples from the start of the ramp on.
    """
    bandwidth_hz = speed_of_light_m_per_s / (2 * requirements.range_resolution_m)
    sample_rate_hz = 2 * bandwidth_hz
    # Rounding up lengthens the chirp at the same bandwidth, so the resolution stays exact.
    # The 1e-9 keeps 2200.0000000000005 at 2200.
    cells = 2 * N_ROUND_TRIPS * requirements.max_range_m / requirements.range_resolution_m
    n_samples = max(2, math.ceil(cells - 1e-9))
    duration_s = n_samples / sample_rate_hz
    chirp = Chirp(
        start_frequency_hz=start_frequency_hz(requirements, bandwidth_hz),
        slope_hz_per_s=bandwidth_hz / duration_s,
        ramp_duration_s=duration_s,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling=requirements.sampling,
    )
    wavelength_m = chirp.wavelength_m * speed_of_light_m_per_s / SPEED_OF_LIGHT
    chirps = required_n_chirps(requirements, wavelength_m=wavelength_m, interval_s=duration_s)
    return Frame(chirp=chirp, n_chirps=max(DEFAULT_N_CHIRPS, chirps), interval_s=duration_s)


def find_broken_limits(
    requirements: Requirements, *, speed_of_light_m_per_s: float
) -> list[BrokenLimit]:
    """Return the limits that requirements break: velocity, chirps of a frame, the band."""
    frame = design_frame(requirements, speed_of_light_m_per_s=speed_of_light_m_per_s)
    scale = speed_of_light_m_per_s / SPEED_OF_LIGHT
    broken_limits = find_broken_band_limit(requirements, frame.chirp.ramp_bandwidth_hz)
    broken_limits += find_broken_chirp_count_limit(requirements, frame)
    if frame.max_velocity_m_per_s * scale < requirements.max_velocity_m_per_s * (1 - 1e-9):
        longest_s = frame.chirp.wavelength_m * scale / (4 * requirements.max_velocity_m_per_s)
        broken_limits.append(
            BrokenLimit(
                limit="interval",
                demand=f"an interval of at most {longest_s * 1e6:.4g} us, lambda / 4v",
                bound=f"chirps of {N_ROUND_TRIPS} round trips,"
                f" {frame.single_interval_s * 1e6:.4g} us (the rule)",
            )
        )
    return broken_limits


def values_chosen_by_rule(
    requirements: Requirements, frame: Frame, *, speed_of_light_m_per_s: float
) -> tuple[DerivedValue, ...]:
    """Return the values that the rule chooses, in the order of its choices."""
    chirp = frame.chirp
    round_trip_s = 2 * requirements.max_range_m / speed_of_light_m_per_s
    resolution, farthest = (
        f"dR = {requirements.range_resolution_m:.6g} m",
        f"R = {requirements.max_range_m:.6g} m",
    )
    alias = 2 * N_ROUND_TRIPS if chirp.sampling == "complex" else N_ROUND_TRIPS
    return (
        DerivedValue(
            name="bandwidth",
            value=chirp.sampled_bandwidth_hz,
            unit="Hz",
            formula="c / 2 dR",
            symbols=f"{resolution}; swept while sampling",
        ),
        DerivedValue(
            name="round_trip", value=round_trip_s, unit="s", formula="2 R / c", symbols=farthest
        ),
        DerivedValue(
            name="n_samples",
            value=chirp.n_samples,
            unit="1",
            formula="11 R / dR, rounded up",
            symbols=f"{farthest}, {resolution}",
        ),
        DerivedValue(
            name="sample_rate",
            value=chirp.sample_rate_hz,
            unit="Hz",
            formula="2 B",
            symbols=f"{chirp.sampling} samples: ranges alias beyond {alias:g} R",
        ),
        DerivedValue(
            name="chirp_duration",
            value=chirp.ramp_duration_s,
            unit="s",
            formula="N / fs = 5.5 x 2 R / c, to whole samples",
            symbols="the whole ramp is sampled; chirps back to back",
        ),
        DerivedValue(name="slope", value=chirp.slope_hz_per_s, unit="Hz/s", formula="B / T"),
        DerivedValue(
            name="late_samples",
            value=math.ceil(round_trip_s * chirp.sample_rate_hz - 1e-9),
            unit="1",
            formula="2 R fs / c, rounded up",
            symbols="samples before the echo from R arrives, since sampling starts with the ramp",
        ),
    )
