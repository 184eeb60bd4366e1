"""What a perfect radar reports of each target: ambiguous ranges and velocities folded."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar


class Place(NamedTuple):
    """Ranges (m) and velocities (m/s) of the same shape."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray


class Frequencies(NamedTuple):
    """Beat and Doppler frequencies (Hz) of the same shape, before sampling folds them."""

    beat_hz: np.ndarray
    doppler_hz: np.ndarray


def seen(truth: xr.Dataset, radar: Radar, *, folds: int | None = 1) -> Place:
    """Return what a perfect radar reports of the truth, (target, frame): aliases folded.

    Differs from the truth only where a range or velocity is ambiguous. A fold of one moves
    the other too: ranges are reported less the coupling of the velocity that is reported,
    and the mirror half of a real spectrum turns the sign of the velocity. One chirp alone
    tells no velocity: NaN, and the range is that of a target at rest with this beat frequency.
    `folds`: how many of them, about zero velocity, are told from each other; none: all.
    """
    known = truth.transpose("target", "frame")
    made = Place(*np.empty((2, *known.range.shape)))
    for place, number in enumerate(truth.frame.values.tolist()):
        own = Place(known.range.values[:, place], known.velocity.values[:, place])
        of_frame = folded(own, radar.at(number), folds=folds)
        made.range_m[:, place], made.velocity_m_per_s[:, place] = of_frame
    return made


def folded(place: Place, radar: Radar, *, folds: int | None = 1) -> Place:
    """Return what a perfect radar reports of places in one frame, any shape; see `seen`.

    Triangles tell by the difference of their beats what folds: places stay.
    """
    chirp = radar.frame.chirp
    if radar.frame.falls:
        return place
    at = frequencies(place, radar)
    beat_hz, doppler_hz = at.beat_hz % chirp.sample_rate_hz, at.doppler_hz
    if chirp.sampling == "real":
        # The upper half of the spectrum is the mirror of the lower: both frequencies turn.
        mirrored = beat_hz > chirp.sample_rate_hz / 2
        beat_hz = np.where(mirrored, chirp.sample_rate_hz - beat_hz, beat_hz)
        doppler_hz = np.where(mirrored, -doppler_hz, doppler_hz)
    if radar.frame.n_chirps == 1:
        return Place(chirp.range_m(1.0) * beat_hz, np.full_like(doppler_hz, np.nan))
    if folds is not None:
        doppler_hz = wrapped(doppler_hz, folds / radar.frame.repetition_s)
    delay_hz = beat_hz - doppler_hz
    return Place(
        chirp.range_m(1.0) * delay_hz,
        doppler_hz * SPEED_OF_LIGHT / (2 * (chirp.mean_sampled_frequency_hz - delay_hz)),
    )


def frequencies(place: Place, radar: Radar) -> Frequencies:
    """Frequencies of echoes at mid-window, see `Chirp.echo_frequencies_hz`."""
    return Frequencies(*radar.frame.chirp.echo_frequencies_hz(*place))


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: coupling put back, velocities folded."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = frequencies(place, radar)
    doppler_hz = wrapped(doppler_hz, 1 / radar.frame.repetition_s)
    return Place(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def wrapped(amount: np.ndarray, period: float | np.ndarray) -> np.ndarray:
    """Return amounts within half a period of zero, whole periods taken off."""
    return (amount + period / 2) % period - period / 2
