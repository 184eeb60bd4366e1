"""Aliasing of ranges and velocities, as an ideal radar measures them."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar


class RangeVelocity(NamedTuple):
    """Ranges (m) and velocities (m/s) of equal shape."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray


class EchoFrequencies(NamedTuple):
    """Beat and Doppler frequencies (Hz) of equal shape, before sampling aliases them."""

    beat_hz: np.ndarray
    doppler_hz: np.ndarray


def apparent_range_and_velocity(
    truth: xr.Dataset, radar: Radar, *, n_resolved_spans: int | None = 1
) -> RangeVelocity:
    """Return range and velocity of the truth, (target, frame), as an ideal radar measures them.

    They differ from the truth only where range or velocity is ambiguous. Aliasing in one changes
    the other too: reported ranges exclude the coupling of the reported velocity, and the mirror
    half of a real spectrum changes the sign of the velocity. A single chirp has no velocity: NaN,
    and the range is that of a target at rest with this beat frequency. `n_resolved_spans` is the
    number of unambiguous spans, about zero velocity, that the processing resolves; none: all.
    """
    ordered = truth.transpose("target", "frame")
    apparent = RangeVelocity(*np.empty((2, *ordered.range.shape)))
    for column, frame_number in enumerate(truth.frame.values.tolist()):
        frame_truth = RangeVelocity(
            ordered.range.values[:, column], ordered.velocity.values[:, column]
        )
        frame_apparent = alias_range_velocity(
            frame_truth, radar.for_frame(frame_number), n_resolved_spans=n_resolved_spans
        )
        apparent.range_m[:, column], apparent.velocity_m_per_s[:, column] = frame_apparent
    return apparent


def alias_range_velocity(
    true: RangeVelocity, radar: Radar, *, n_resolved_spans: int | None = 1
) -> RangeVelocity:
    """Return ranges and velocities as measured in one frame, any shape.

    See `apparent_range_and_velocity`. Triangular modulations resolve aliases by the difference of
    their beats: values are unchanged.
    """
    chirp = radar.frame.chirp
    if radar.frame.has_falling_ramps:
        return true
    beat_hz, doppler_hz = beat_and_doppler_frequencies(true, radar)
    is_single_chirp = radar.frame.n_chirps == 1
    if n_resolved_spans is not None and not is_single_chirp:
        doppler_hz = wrap_about_zero(doppler_hz, n_resolved_spans / radar.frame.repetition_s)
    delay_hz = beat_hz if is_single_chirp else beat_hz - doppler_hz
    # No delay is negative, but that of an echo at 0 may be rounded below it.
    rounding_hz = 1e-9 * chirp.sample_rate_hz
    delay_hz = (delay_hz + rounding_hz) % chirp.sample_rate_hz - rounding_hz
    if chirp.sampling == "real":
        # The upper half of the spectrum mirrors the lower: both frequencies change sign.
        is_mirrored = delay_hz > chirp.sample_rate_hz / 2
        delay_hz = np.where(is_mirrored, chirp.sample_rate_hz - delay_hz, delay_hz)
        doppler_hz = np.where(is_mirrored, -doppler_hz, doppler_hz)
    if is_single_chirp:
        return RangeVelocity(chirp.range_m(1.0) * delay_hz, np.full_like(doppler_hz, np.nan))
    return RangeVelocity(
        chirp.range_m(1.0) * delay_hz,
        doppler_hz * SPEED_OF_LIGHT / (2 * (chirp.mean_sampled_frequency_hz - delay_hz)),
    )


def beat_and_doppler_frequencies(range_velocity: RangeVelocity, radar: Radar) -> EchoFrequencies:
    """Return the frequencies of echoes at mid-window, see `Chirp.echo_frequencies_hz`."""
    return EchoFrequencies(*radar.frame.chirp.echo_frequencies_hz(*range_velocity))


def range_doppler_map_position(range_velocity: RangeVelocity, radar: Radar) -> RangeVelocity:
    """Return the position of peaks on the range-Doppler map: with coupling, velocities aliased."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = beat_and_doppler_frequencies(range_velocity, radar)
    doppler_hz = wrap_about_zero(doppler_hz, 1 / radar.frame.repetition_s)
    return RangeVelocity(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def wrap_about_zero(amount: np.ndarray, period: float | np.ndarray) -> np.ndarray:
    """Return values within half a period of zero, minus whole periods."""
    return (amount + period / 2) % period - period / 2
