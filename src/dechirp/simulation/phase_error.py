"""Phase error of the sweep, applied to all echoes at once by a deskew filter.

The mixer outputs the present phase error minus that of the echo, which left one delay earlier:

    s(t) = sum over echoes of b_i(t) exp i (phi(t) - phi(t - tau_i)).

Echoes of a linear ramp lie at f = S tau, so a filter with the group delay f / S delays each of them
by its own delay at once (deskew filter: Meta, Hoogeboom & Ligthart 2007). With b mixed down by
f_mid = S tau_mid, and Q the multiplication of a spectrum by exp(i pi f^2 / S),

    s(t) = exp i (phi(t) + 2 pi f_mid t)  Q^-1 [ Q[exp(-i phi(t - tau_mid))] Q[b] ]:

a frequency f_n of the error and f of an echo yield exp(-2 pi i f_n f / S), the error one delay
later. The Doppler frequency counts as the delay f_D / S, as in range-Doppler coupling.

A frequency f_n of the error needs the echo f_n / S away in time. Echoes are therefore summed over
more samples than are kept: on each side as many as fs / 2 needs plus 10, at most an eighth of the
window. Against a sum echo by echo, the result errs by 1e-5 of the power of the phase noise at the
ends of the window and 1e-6 inside it if echoes fill 60 % of the sample rate, and by 1e-3 and 3e-5
if they fill 85 %.

If an eighth of the window does not suffice (fs^2 / S above a quarter of the samples: slow ramps,
fast sampling), this accuracy holds for error frequencies below S times an eighth of the window,
and for the first echo. Faster errors keep their power towards the ends of the window, but cancel
there less than the delay implies.

Echoes that begin within the samples (`Engine.late`) have a jump. Around it, over the length of
the margins, the error is not that of their delay.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
from scipy.fft import fft, ifft, next_fast_len

from dechirp.core.findings import Finding
from dechirp.core.threads import run_in_threads
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow

# Samples of the chirps processed together, 1 MB: smaller blocks spend longer in Python than in
# loops.
_BLOCK_SAMPLES = 2**17
# Samples beyond those that the fastest error needs, for the crossfade of echoes into a copy.
_CROSSFADE_SAMPLES = 10


def slow_ramp_finding(radar: Radar) -> Finding | None:
    """Return a warning if the ramp is too slow for the phase error to cancel at all frequencies."""
    chirp = radar.frame.chirp
    needed_samples = chirp.sample_rate_hz**2 / abs(chirp.slope_hz_per_s)
    if needed_samples <= chirp.n_samples / 4:
        return None
    max_error_hz = abs(chirp.slope_hz_per_s) * (chirp.n_samples // 8) / chirp.sample_rate_hz
    return Finding(
        level="warning",
        setting="impairments",
        value=f"an oscillator error on a ramp with fs^2 / S = {needed_samples:.4g} samples",
        expected=f"at most a quarter of the {chirp.n_samples} samples of a chirp: errors faster"
        f" than {max_error_hz / 1e6:.4g} MHz do not cancel towards the ends of the window",
        fix="reduce the sample rate, or raise the slope",
    )


class DelaySpread(NamedTuple):
    """Delay spread of the echoes of a frame, and the lengths of its transforms, in samples."""

    first_delay: float
    """Delay of the first echo."""
    mid_delay: float
    """Delay near the middle of all delays."""
    half_spread: int
    """Largest difference of a delay from `mid_delay`."""
    n_before: int
    """Extra samples of the echoes needed before the kept ones."""
    n_after: int
    """Extra samples of the echoes needed after the kept ones."""
    n_kept: int
    n_fft: int
    """Length of the transforms: samples of the echoes, and padding that joins their ends."""

    @property
    def n_echo_samples(self) -> int:
        """Return the number of summed samples of each echo."""
        return self.n_before + self.n_kept + self.n_after

    @property
    def n_padding_samples(self) -> int:
        """Return the number of points between the last sample of the echoes and the first."""
        return self.n_fft - self.n_echo_samples

    @property
    def n_phase_margin_samples(self) -> int:
        """Return the padding points on each side at which the phase error is needed."""
        return self.n_padding_samples - self.half_spread

    @property
    def n_crossfade_samples(self) -> int:
        """Return the length of the crossfade from echoes to their copy, at each end."""
        return min(_CROSSFADE_SAMPLES, self.n_before)

    @property
    def first_sample_of_periodic_copy(self) -> int:
        """Return the sample of the echoes with which the copy after the last one begins."""
        return max((self.n_echo_samples - self.n_padding_samples) // 2, self.n_crossfade_samples)

    @property
    def first_kept_in_phase_window(self) -> int:
        """Return the index of the first kept sample in the phase window."""
        return self.n_phase_margin_samples + round(self.mid_delay) + self.n_before

    def phase_sample_window(self, echo_window: SampleWindow) -> SampleWindow:
        """Return the times at which the phase error is needed, for the echoes of `echo_window`."""
        n_times = max(
            self.n_echo_samples + 2 * self.n_phase_margin_samples,
            self.first_kept_in_phase_window + self.n_kept,
        )
        early = self.first_kept_in_phase_window - self.n_before
        return echo_window.widen(early, n_times - early - echo_window.n_times)


def find_delay_spread(
    groups: Sequence[EchoGroup],
    window: SampleWindow,
    radar: Radar,
    added_delay_bounds_s: Sequence[tuple[float, float]] = (),
) -> DelaySpread:
    """Find the delays of the echoes of a frame, and the margins their phase correction needs.

    Beat signals fill the sample rate at most: later echoes alias onto earlier ones and get their
    delay. Delays are limited to one chirp interval.

    Parameters
    ----------
    added_s
        Bounds of the delays of signals that are added without scatterers.
    """
    rate_hz, slope = window.rate_hz, abs(radar.frame.chirp.slope_hz_per_s)
    reflecting = [part for part in groups if part.scatterers.amplitudes.any()]
    bounds_s = [*(_delay_bounds_s(part, window) for part in reflecting), *added_delay_bounds_s] or [
        (0.0, 0.0)
    ]
    latest_s = min(max(late for _, late in bounds_s), radar.frame.single_interval_s)
    earliest_s = min(latest_s, *(early for early, _ in bounds_s))
    latest_s = min(latest_s, earliest_s + rate_hz / slope)
    earliest, half_delay = earliest_s * rate_hz, (latest_s - earliest_s) / 2 * rate_hz
    # Distance between an error at half the sample rate and the echo that it needs.
    echo_distance = rate_hz**2 / (2 * slope)
    max_margin = max(window.n_times // 8, 1)
    margin = math.ceil(min(echo_distance + _CROSSFADE_SAMPLES, max_margin))
    # A jump where the ends are joined has frequencies that need echoes beyond the margin.
    n_taper = math.ceil(min(8 * echo_distance / margin + 8, max_margin + 8))
    n_wide = window.n_times + 2 * margin
    # The first echo, often the strongest with the least residual noise, lies on a bin: it wraps
    # round without a jump, and has the margin that the fastest error needs.
    spread = math.ceil(half_delay + min(half_delay, echo_distance / n_wide)) + 1
    n_around = next_fast_len(n_wide + 2 * spread + n_taper)
    bin_apart = 2 * echo_distance / n_around
    middle = earliest + round(half_delay / bin_apart) * bin_apart
    return DelaySpread(earliest, middle, spread, margin, margin, window.n_times, n_around)


def apply_phase_error(
    echo: np.ndarray, phase_rad: np.ndarray, delays: DelaySpread, radar: Radar
) -> np.ndarray:
    """Multiply echoes by exp(i (phase now - phase one delay ago)), and keep the inner samples.

    Parameters
    ----------
    echo : (n_chirps, n_rx, n_echo_samples), complex64 or complex128
        Dechirped with a perfect ramp.
    phase_rad : (n_chirps, n_times)
        Phase error at the times of the phase window, the same for all receivers.
    delays : DelaySpread

    Returns
    -------
    (n_chirps, n_rx, n_kept) of the same precision
    """
    out = np.empty((*echo.shape[:2], delays.n_kept), echo.dtype)
    chirp = radar.frame.chirp
    deskew = _make_deskew_filter(delays, chirp.slope_hz_per_s, chirp.sample_rate_hz, echo.dtype)
    block_length = max(1, _BLOCK_SAMPLES // (echo.shape[1] * len(deskew.echo_response)))
    rows = [slice(row, row + block_length) for row in range(0, len(echo), block_length)]

    def process_rows(block: slice) -> None:
        out[block] = _apply_phase_error_to_chirps(echo[block], phase_rad[block], delays, deskew)

    run_in_threads(min(numba.get_num_threads(), len(rows)), process_rows, rows)
    return out


def _delay_bounds_s(group: EchoGroup, window: SampleWindow) -> tuple[float, float]:
    """Return the least and the largest delay of the echoes of a group."""
    scatterers, transmission = group.scatterers, group.transmission
    reflects = scatterers.amplitudes != 0
    longest_s = np.abs(transmission.starts_s[[0, -1]] + window.times_s[[0, -1]]).max()
    moved_m = np.zeros(np.count_nonzero(reflects))
    for power, term_m in enumerate(scatterers.path_m[1:, reflects], start=1):
        moved_m += np.linalg.norm(term_m, axis=1) * longest_s**power
    nearest_m, farthest_m = np.zeros((2, len(moved_m)))
    for antennas_m in (transmission.tx_m, transmission.rx_m):
        least_m, most_m = _nearest_and_farthest_antenna_distances_m(
            scatterers.path_m[0, reflects], antennas_m
        )
        nearest_m += least_m - moved_m
        farthest_m += most_m + moved_m
    return max(nearest_m.min(), 0.0) / SPEED_OF_LIGHT, farthest_m.max() / SPEED_OF_LIGHT


def _nearest_and_farthest_antenna_distances_m(
    positions_m: np.ndarray, antennas_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances from each scatterer to the nearest and the farthest antenna."""
    nearest_m, farthest_m = np.full(len(positions_m), np.inf), np.zeros(len(positions_m))
    for antenna_m in antennas_m:
        distance_m = np.linalg.norm(positions_m - antenna_m, axis=1)
        np.minimum(nearest_m, distance_m, out=nearest_m)
        np.maximum(farthest_m, distance_m, out=farthest_m)
    return nearest_m, farthest_m


class _DeskewFilter(NamedTuple):
    """Deskew filter, the same for all chirps."""

    error_response: np.ndarray
    """(n_fine,): Q in the order of a transform, with the fractional part of the middle delay.
    Finer in time than the samples, since the error widens the band of the echoes, which must not
    alias before their delays are removed."""
    echo_response: np.ndarray
    """(n_fine,): Q."""
    downmixer: np.ndarray
    """(n_echo_samples,): shift to the middle of the band of the echoes."""
    copy_phasor: complex
    """Phase of the copy of the echoes with which the first echo continues without a jump."""


def _make_deskew_filter(
    delays: DelaySpread, slope_hz_per_s: float, rate_hz: float, dtype: np.dtype[np.complexfloating]
) -> _DeskewFilter:
    n = delays.n_fft
    slope = slope_hz_per_s / rate_hz**2  # cycles for each sample squared
    n_fine = min(next_fast_len(n + math.ceil(2 * n * abs(slope) * delays.half_spread)), 2 * n)
    frequency = ((np.arange(n_fine) + n_fine // 2) % n_fine - n_fine // 2) / n
    q = frequency**2 / (2 * slope)
    fractional_delay = frequency * (delays.mid_delay - round(delays.mid_delay))
    # The inverse transform divides by n_fine.
    error_response = _cycles_to_phasors(q - fractional_delay) * (n_fine / n)
    downmixer = _cycles_to_phasors(-slope * delays.mid_delay * np.arange(delays.n_echo_samples))
    copy_phasor = _cycles_to_phasors(
        slope
        * (delays.first_delay - delays.mid_delay)
        * (delays.n_echo_samples - delays.first_sample_of_periodic_copy)
    )
    return _DeskewFilter(
        error_response.astype(dtype),
        _cycles_to_phasors(q).astype(dtype),
        downmixer.astype(dtype),
        complex(copy_phasor),
    )


def _cycles_to_phasors(cycles: np.ndarray | float) -> np.ndarray:
    return np.exp(2j * np.pi * (cycles - np.rint(cycles)))


def _apply_phase_error_to_chirps(
    echo: np.ndarray, phase_rad: np.ndarray, delays: DelaySpread, deskew: _DeskewFilter
) -> np.ndarray:
    kept_samples = slice(delays.n_before, delays.n_before + delays.n_kept)
    error = _conjugate_phasors(phase_rad, echo.dtype)
    product = _filter_and_upsample(
        _extend_echoes_periodically(echo * deskew.downmixer, delays, deskew.copy_phasor),
        deskew.echo_response,
    )
    product *= _filter_and_upsample(
        _delay_and_extend_error_periodically(error, delays), deskew.error_response
    )[:, None]
    product = fft(product, overwrite_x=True)
    product *= deskew.echo_response.conj()
    delayed = ifft(_alias_spectrum_to_bins(product, delays.n_fft), overwrite_x=True)[
        ..., kept_samples
    ]
    undelayed = (
        error[
            :, delays.first_kept_in_phase_window : delays.first_kept_in_phase_window + delays.n_kept
        ]
        * deskew.downmixer[kept_samples]
    )
    return delayed * undelayed.conj()[:, None]


def _conjugate_phasors(phase_rad: np.ndarray, dtype: np.dtype[np.complexfloating]) -> np.ndarray:
    """Return exp(-i phase), with whole cycles removed in double precision."""
    cycles = phase_rad / (-2 * np.pi)
    cycles -= np.rint(cycles)
    phasors = np.empty(phase_rad.shape, dtype)
    within_rad = (2 * np.pi * cycles).astype(phasors.real.dtype)
    np.cos(within_rad, out=phasors.real)
    np.sin(within_rad, out=phasors.imag)
    return phasors


def _extend_echoes_periodically(
    echo: np.ndarray, delays: DelaySpread, copy_phasor: complex
) -> np.ndarray:
    """Join the end of the echoes to their beginning by a crossfade through a copy of their middle.

    The copy has the same frequencies and therefore the same delays. There is no jump that would
    ring,
    and an error that needs echoes from beyond the end finds their power.
    """
    n, n_crossfade = delays.n_echo_samples, delays.n_crossfade_samples
    extended = np.empty((*echo.shape[:-1], delays.n_fft), echo.dtype)
    extended[..., :n] = echo
    indices = (
        delays.first_sample_of_periodic_copy
        - n_crossfade
        + np.arange(delays.n_padding_samples + 2 * n_crossfade)
    )
    copy = echo[..., indices % n] * echo.dtype.type(copy_phasor)
    extended[..., n:] = copy[..., n_crossfade:-n_crossfade]
    rising = _rising_taper(n_crossfade, 4.0).astype(echo.real.dtype)
    extended[..., n - n_crossfade : n] += rising * (
        copy[..., :n_crossfade] - echo[..., n - n_crossfade :]
    )
    extended[..., :n_crossfade] += rising[::-1] * (
        copy[..., -n_crossfade:] - echo[..., :n_crossfade]
    )
    return extended


def _delay_and_extend_error_periodically(
    error_phasors: np.ndarray, delays: DelaySpread
) -> np.ndarray:
    """Return the error one middle delay ago, its end faded into its beginning."""
    n_wide, n_margin, half_spread = (
        delays.n_echo_samples,
        delays.n_phase_margin_samples,
        delays.half_spread,
    )
    extended = np.zeros((len(error_phasors), delays.n_fft), error_phasors.dtype)
    extended[:, : n_wide + n_margin] = error_phasors[:, n_margin : 2 * n_margin + n_wide]
    # Delays extend half the spread beyond either end.
    beginning = np.zeros(delays.n_padding_samples, error_phasors.real.dtype)
    beginning[half_spread:n_margin] = _rising_taper(n_margin - half_spread, 8.0)
    beginning[n_margin:] = 1
    extended[:, n_wide:] *= 1 - beginning
    extended[:, n_wide + half_spread :] += beginning[half_spread:] * error_phasors[:, :n_margin]
    return extended


def _rising_taper(n: int, kaiser_shape: float) -> np.ndarray:
    """Return a smooth rise from 0 to 1 in n steps, the integral of a Kaiser window."""
    rising = np.cumsum(np.kaiser(n + 1, kaiser_shape))
    return rising[:-1] / rising[-1]


def _filter_and_upsample(signal: np.ndarray, filter_response: np.ndarray) -> np.ndarray:
    """Filter signals by Q, and sample them more finely."""
    n, n_fine = signal.shape[-1], len(filter_response)
    spectrum = fft(signal, overwrite_x=True)
    fine = np.zeros((*signal.shape[:-1], n_fine), signal.dtype)
    above, below = n - n // 2, n // 2
    np.multiply(spectrum[..., :above], filter_response[:above], out=fine[..., :above])
    np.multiply(
        spectrum[..., above:], filter_response[n_fine - below :], out=fine[..., n_fine - below :]
    )
    return ifft(fine, overwrite_x=True)


def _alias_spectrum_to_bins(fine_spectrum: np.ndarray, n_bins: int) -> np.ndarray:
    """Alias a spectrum onto the n bins of the sample rate."""
    n_fine = fine_spectrum.shape[-1]
    above, below = n_fine - n_fine // 2, n_fine // 2
    spectrum = np.zeros((*fine_spectrum.shape[:-1], n_bins), fine_spectrum.dtype)
    spectrum[..., :above] = fine_spectrum[..., :above]
    spectrum[..., n_bins - below :] += fine_spectrum[..., above:]
    return spectrum
