"""Phase error of the sweep, applied to all echoes at once by a deskew filter.

The mixer outputs the present phase error minus that of the echo, which left one delay earlier:

    s(t) = sum over echoes of b_i(t) exp i (phi(t) - phi(t - tau_i)).

Echoes of a linear ramp lie at f = S tau, so a filter with the group delay f / S delays each of them
by its own delay at once (deskew filter: Meta, Hoogeboom & Ligthart 2007). With b mixed down by
f_mid = S tau_mid, and Q the multiplication of a spectrum by exp(i pi f^2 / S),

    s(t) = exp i (phi(t) + 2 pi f_mid t)  Q^-1 [ Q[exp(-i phi(t - tau_mid))] Q[b] ]:

a frequency f_n of the error and f of an echo yield exp(-2 pi i f_n f / S), the error one delay
later. The Doppler frequency counts as the delay f_D / S, as in range-Doppler coupling.

The receiver passes a band as wide as the sample rate: complex samples beats from 0 to it, real ones
from minus to plus half of it. An error that moves power from one end of this band to the other has
the frequency of the sample rate, so errors are made at twice that rate, and what they move out of
the band is left out before the samples are taken; otherwise it would alias into it. The ends of the
band are as steep as transforms of 3.3 windows can be: at the other end of a map, phase noise beside
an echo near an end is within 0.4 dB of that of ends without width.

A frequency f_n of the error needs the echo f_n / S away in time. Echoes are therefore summed over
more samples than are kept: on each side as many as fs needs plus 16, at most a quarter of the
window. Against a sum echo by echo of all lines that are passed, the result errs by 1e-3 of the
power of the phase noise at the ends of the window and 1e-4 inside it, by 5e-3 and 5e-4 if echoes
fill 90 % of the sample rate; by 3e-5 and 1e-5 for one echo. Nearly all of this is in the cells at
the two ends of the band, over which a finite time spreads lines: without three cells at each end it
is at most 1e-7 and 1e-8, and 1e-4 and 1e-5 if echoes fill 90 % of the sample rate.

If a quarter of the window does not suffice (fs^2 / S above a quarter of the samples: slow ramps,
fast sampling), this accuracy holds for error frequencies below S times a quarter of the window,
and for the first echo. Faster errors keep their power towards the ends of the window, but cancel
there less than the delay implies.

Echoes that begin within the samples (`Engine.late`) have a jump. Around it, over the length of
the margins, the error is not that of their delay.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.findings import Finding
from dechirp.core.threads import run_in_threads, thread_count
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow

PHASE_OVERSAMPLING = 2
"""Points of the phase error for each sample: an error that moves power from one end of the band to
the other has the frequency of the sample rate."""

# Samples of the chirps processed together, 1 MB: smaller blocks spend longer in Python than in
# loops.
_BLOCK_SAMPLES = 2**17
# Samples beyond those that the fastest error needs, for the crossfade of echoes into a copy.
_CROSSFADE_SAMPLES = 16
# Samples of the crossfade from the end of the phase error to its beginning: of an echo 18 bins from
# an end of the band it spreads -65 dB over that end with 12 samples, -91 dB with 32.
_PHASE_CROSSFADE_SAMPLES = 32
# Length of the transforms in windows of samples. The ends of the passed band are as wide as a bin
# of the transforms, and steep noise beside them is 1 dB off with bins of half a cell.
_BAND_END_WINDOWS = 3.3


def slow_ramp_finding(radar: Radar) -> Finding | None:
    """Return a warning if the ramp is too slow for the phase error to cancel at all frequencies."""
    chirp = radar.frame.chirp
    needed_samples = chirp.sample_rate_hz**2 / abs(chirp.slope_hz_per_s)
    if needed_samples <= chirp.n_samples / 4:
        return None
    max_error_hz = abs(chirp.slope_hz_per_s) * (chirp.n_samples // 4) / chirp.sample_rate_hz
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
    last_delay: float
    """Delay of the last echo."""
    n_before: int
    """Extra samples of the echoes needed before the kept ones."""
    n_after: int
    """Extra samples of the echoes needed after the kept ones."""
    n_kept: int
    n_fft: int
    """Length of the transforms: samples of the echoes, and padding that joins their ends."""
    first_passed_bin: float
    """Lower end of the `n_fft` bins that the receiver passes, from the middle echo."""

    @property
    def n_echo_samples(self) -> int:
        """Return the number of summed samples of each echo."""
        return self.n_before + self.n_kept + self.n_after

    @property
    def n_padding_samples(self) -> int:
        """Return the number of points between the last sample of the echoes and the first."""
        return self.n_fft - self.n_echo_samples

    @property
    def n_crossfade_samples(self) -> int:
        """Return the length of the crossfade from echoes to their copy, at each end."""
        return min(_CROSSFADE_SAMPLES, self.n_before)

    @property
    def copy_lengths(self) -> list[int]:
        """Return the lengths of the copies of the middle of the echoes that fill the padding."""
        longest = max(self.n_echo_samples - 4 * self.n_crossfade_samples, 1)
        n_copies = math.ceil(self.n_padding_samples / longest)
        ends = np.rint(np.linspace(0, self.n_padding_samples, n_copies + 1)).astype(int)
        return np.diff(ends).tolist()

    @property
    def n_early_phases(self) -> int:
        """Return the number of phase errors needed before the first sample of the echoes."""
        return PHASE_OVERSAMPLING * (math.ceil(self.last_delay) + 1)

    @property
    def n_faded_phases(self) -> int:
        """Return the number of phase errors in which their end fades into their beginning."""
        return PHASE_OVERSAMPLING * self.n_padding_samples - self.n_early_phases

    def phase_sample_window(self, echo_window: SampleWindow) -> SampleWindow:
        """Return the times at which the phase error is needed, for the echoes of `echo_window`."""
        window = echo_window._replace(
            rate_hz=PHASE_OVERSAMPLING * echo_window.rate_hz,
            n_times=PHASE_OVERSAMPLING * echo_window.n_times,
        )
        return window.widen(self.n_early_phases + self.n_faded_phases, self.n_faded_phases)


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
    added_delay_bounds_s
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
    # Distance between an error at the sample rate and the echo that it needs.
    echo_distance = rate_hz**2 / slope
    max_margin = max(window.n_times // 4, 1)
    margin = math.ceil(min(echo_distance + _CROSSFADE_SAMPLES, max_margin))
    # A jump where the ends are joined has frequencies that need echoes beyond the margin.
    n_taper = math.ceil(min(8 * echo_distance / margin, max_margin) + _PHASE_CROSSFADE_SAMPLES)
    n_wide = window.n_times + 2 * margin
    n_joined = n_wide + math.ceil(latest_s * rate_hz) + 1 + n_taper
    lowest_hz = _lowest_passed_frequency_hz(
        slope * earliest_s, slope * latest_s, _max_doppler_hz(reflecting, radar), radar
    )
    n_around = _choose_transform_length(
        max(n_joined, math.ceil(_BAND_END_WINDOWS * window.n_times)),
        lowest_hz / rate_hz - earliest / echo_distance,
        nearer_lower_end=slope * (earliest_s + latest_s) < 2 * lowest_hz + rate_hz,
    )
    # The first echo, often the strongest with the least residual noise, lies on a bin: it wraps
    # round without a jump.
    bin_apart = echo_distance / n_around
    middle = earliest + round(half_delay / bin_apart) * bin_apart
    first_passed_bin = (lowest_hz / rate_hz - middle / echo_distance) * n_around
    return DelaySpread(
        earliest, middle, latest_s * rate_hz, margin, margin, window.n_times, n_around,
        min(max(first_passed_bin, -n_around + 0.5), -0.5),
    )  # fmt: skip


def _choose_transform_length(shortest: int, lowest_passed: float, *, nearer_lower_end: bool) -> int:
    """Return a fast length that puts the ends of the passed band off the middle of a bin.

    A bin that an end cuts passes a share of its power. Steep noise beside an echo two cells away
    is 1 dB too strong beyond an end in the middle of a bin, 0.5 dB too weak beyond one between
    bins, and 0.3 dB off if four fifths of the bin are within the band. The end that is nearer to
    the echoes counts.

    Parameters
    ----------
    shortest
        Shortest length; up to an eighth more is tried.
    lowest_passed
        Lower end of the band from the first echo, which lies on a bin; relative to the sample rate.
    nearer_lower_end
        Whether the lower end is nearer to the echoes than the upper one.
    """
    lengths = [scipy.fft.next_fast_len(shortest)]
    while (length := scipy.fft.next_fast_len(lengths[-1] + 1)) <= 1.125 * shortest:
        lengths.append(length)
    shares = (0.5 - np.array(lengths) * lowest_passed) % 1
    return lengths[int(np.argmin(np.abs(shares - (0.8 if nearer_lower_end else 0.2))))]


def _lowest_passed_frequency_hz(
    first_beat_hz: float, last_beat_hz: float, max_doppler_hz: float, radar: Radar
) -> float:
    """Return the lower end of the band, as wide as the sample rate, that the receiver passes.

    Complex samples: from 0; real ones: half the sample rate on either side of 0. Echoes within a
    cell of the ends of the band, or beyond, move it by whole cells so that each keeps the slow
    errors of its own frequency.
    """
    chirp = radar.frame.chirp
    bin_hz = chirp.sample_rate_hz / chirp.n_samples
    own_hz = max_doppler_hz + bin_hz
    lowest_hz = 0.0 if chirp.sampling == "complex" else -chirp.sample_rate_hz / 2
    lowest_hz = min(lowest_hz, math.floor((first_beat_hz - own_hz) / bin_hz) * bin_hz)
    highest_needed_hz = math.ceil((last_beat_hz + own_hz) / bin_hz) * bin_hz
    return max(lowest_hz, highest_needed_hz - chirp.sample_rate_hz)


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
    block_length = max(1, _BLOCK_SAMPLES // (echo.shape[1] * len(deskew.response)))
    rows = [slice(row, row + block_length) for row in range(0, len(echo), block_length)]

    def process_rows(block: slice) -> None:
        out[block] = _apply_phase_error_to_chirps(echo[block], phase_rad[block], delays, deskew)

    run_in_threads(min(thread_count(), len(rows)), process_rows, rows)
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


def _max_doppler_hz(groups: Sequence[EchoGroup], radar: Radar) -> float:
    """Return a bound of the Doppler frequencies of all echoes, of either sign."""
    chirp = radar.frame.chirp
    speeds_m_per_s = [
        np.linalg.norm(group.scatterers.path_m[1], axis=1).max()
        for group in groups
        if len(group.scatterers.path_m) > 1
    ]
    highest_hz = chirp.start_frequency_hz + chirp.ramp_bandwidth_hz
    return 2 * highest_hz * float(max(speeds_m_per_s, default=0.0)) / SPEED_OF_LIGHT


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
    """Deskew filter, the same for all chirps, with the frequencies in the order of a transform."""

    response: np.ndarray
    """(n_fine,): Q, at the rate of the phase error."""
    error_response: np.ndarray
    """(n_fine,): Q, and the middle delay."""
    downmixer: np.ndarray
    """(n_echo_samples,): shift to the middle of the band of the echoes."""
    cycles_per_sample: float
    """Frequency of the first echo after the downmixer: its copies continue it without a jump."""
    echo_crossfade: np.ndarray
    """(n_crossfade,): weights of the copy of the echoes after their end, rising."""
    phase_crossfade: np.ndarray
    """(n,): weights of the beginning of the phase error after its end, rising."""


def _make_deskew_filter(
    delays: DelaySpread, slope_hz_per_s: float, rate_hz: float, dtype: np.dtype[np.complexfloating]
) -> _DeskewFilter:
    n_fine = PHASE_OVERSAMPLING * delays.n_fft
    slope = slope_hz_per_s / rate_hz**2  # cycles for each sample squared
    frequency = scipy.fft.fftfreq(n_fine, 1 / PHASE_OVERSAMPLING)
    q = frequency**2 / (2 * slope)
    error_response = _cycles_to_phasors(q - frequency * delays.mid_delay)
    downmixer = _cycles_to_phasors(-slope * delays.mid_delay * np.arange(delays.n_echo_samples))
    return _DeskewFilter(
        _cycles_to_phasors(q).astype(dtype),
        error_response.astype(dtype),
        downmixer.astype(dtype),
        slope * (delays.first_delay - delays.mid_delay),
        _rising_taper(delays.n_crossfade_samples, 6.0).astype(downmixer.astype(dtype).real.dtype),
        _rising_taper(delays.n_faded_phases, 8.0),
    )


def _cycles_to_phasors(cycles: np.ndarray | float) -> np.ndarray:
    return np.exp(2j * np.pi * (cycles - np.rint(cycles)))


def _apply_phase_error_to_chirps(
    echo: np.ndarray, phase_rad: np.ndarray, delays: DelaySpread, deskew: _DeskewFilter
) -> np.ndarray:
    kept_samples = slice(delays.n_before, delays.n_before + delays.n_kept)
    phasors = _phasors(_extend_phase_periodically(phase_rad, delays, deskew), echo.dtype)
    error = scipy.fft.fft(phasors.conj(), overwrite_x=True)
    error *= deskew.error_response
    echo_spectrum = scipy.fft.fft(
        _extend_echoes_periodically(echo, delays, deskew), overwrite_x=True
    )
    product = _filter_and_upsample(echo_spectrum, deskew.response)
    product *= scipy.fft.ifft(error, overwrite_x=True)[:, None]
    product = scipy.fft.fft(product, overwrite_x=True)
    product *= deskew.response.conj()
    product = scipy.fft.ifft(product, overwrite_x=True)
    product *= phasors[:, None]
    passed = _select_passed_bins(scipy.fft.fft(product, overwrite_x=True), echo_spectrum, delays)
    return (
        scipy.fft.ifft(passed, overwrite_x=True)[..., kept_samples]
        * deskew.downmixer[kept_samples].conj()
    )


def _phasors(phase_rad: np.ndarray, dtype: np.dtype[np.complexfloating]) -> np.ndarray:
    """Return exp(i phase), with whole cycles removed in double precision."""
    cycles = phase_rad / (2 * np.pi)
    cycles -= np.rint(cycles)
    phasors = np.empty(phase_rad.shape, dtype)
    within_rad = (2 * np.pi * cycles).astype(phasors.real.dtype)
    np.cos(within_rad, out=phasors.real)
    np.sin(within_rad, out=phasors.imag)
    return phasors


def _extend_echoes_periodically(
    echo: np.ndarray, delays: DelaySpread, deskew: _DeskewFilter
) -> np.ndarray:
    """Mix echoes down, and join their end to their beginning through copies of their middle.

    Copies have the same frequencies and therefore the same delays. There is no jump that would
    ring, and an error that needs echoes from beyond the end finds their power.
    """
    n, n_crossfade = delays.n_echo_samples, delays.n_crossfade_samples
    extended = np.empty((*echo.shape[:-1], delays.n_fft), echo.dtype)
    np.multiply(echo, deskew.downmixer, out=extended[..., :n])
    position, copy = n, extended[..., :0]
    for length in delays.copy_lengths:
        source = (n - length) // 2 - n_crossfade
        phasor = _cycles_to_phasors(deskew.cycles_per_sample * (position - n_crossfade - source))
        copy = extended[..., source : source + length + 2 * n_crossfade] * echo.dtype.type(phasor)
        end = extended[..., position - n_crossfade : position]
        end += deskew.echo_crossfade * (copy[..., :n_crossfade] - end)
        extended[..., position : position + length] = copy[..., n_crossfade:-n_crossfade]
        position += length
    beginning = extended[..., :n_crossfade]
    beginning += deskew.echo_crossfade[::-1] * (copy[..., -n_crossfade:] - beginning)
    return extended


def _extend_phase_periodically(
    phase_rad: np.ndarray, delays: DelaySpread, deskew: _DeskewFilter
) -> np.ndarray:
    """Return the phase error at all points of a transform, its end faded into its beginning.

    The phase is faded and not its phasor: errors now and one delay ago cancel there as well.
    """
    n_early, n_faded = delays.n_early_phases, delays.n_faded_phases
    first = PHASE_OVERSAMPLING * delays.n_echo_samples
    extended = np.empty((len(phase_rad), PHASE_OVERSAMPLING * delays.n_fft))
    extended[:, : first + n_faded] = phase_rad[:, n_early + n_faded :]
    extended[:, first + n_faded :] = phase_rad[:, n_faded : n_faded + n_early]
    end = extended[:, first : first + n_faded]
    step_rad = phase_rad[:, :n_faded] - end
    step_rad -= 2 * np.pi * np.rint(step_rad[:, n_faded // 2, None] / (2 * np.pi))
    end += deskew.phase_crossfade * step_rad
    return extended


def _rising_taper(n: int, kaiser_shape: float) -> np.ndarray:
    """Return a smooth rise from 0 to 1 in n steps, the integral of a Kaiser window."""
    rising = np.cumsum(np.kaiser(n + 1, kaiser_shape))
    return rising[:-1] / rising[-1]


def _filter_and_upsample(spectrum: np.ndarray, filter_response: np.ndarray) -> np.ndarray:
    """Filter the spectrum of echoes by Q; return its samples at the rate of the phase error."""
    n, n_fine = spectrum.shape[-1], len(filter_response)
    fine = np.empty((*spectrum.shape[:-1], n_fine), spectrum.dtype)
    above, below = n - n // 2, n // 2
    np.multiply(spectrum[..., :above], filter_response[:above], out=fine[..., :above])
    fine[..., above : n_fine - below] = 0
    np.multiply(
        spectrum[..., above:], filter_response[n_fine - below :], out=fine[..., n_fine - below :]
    )
    return scipy.fft.ifft(fine, overwrite_x=True)


def _select_passed_bins(
    fine_spectrum: np.ndarray, echo_spectrum: np.ndarray, delays: DelaySpread
) -> np.ndarray:
    """Return the bins of a spectrum that the receiver passes, in the order of a transform.

    An end of the band within a bin passes a share of its power, and the rest of the alias at the
    other end. Echoes alias onto the bins from all other bins, as they were sampled: jumps where
    their ends are joined have all frequencies.
    """
    n, n_fine = delays.n_fft, fine_spectrum.shape[-1]
    cut_bin = math.ceil(delays.first_passed_bin - 0.5)
    n_above = n + cut_bin + 1
    passed = np.empty_like(echo_spectrum)
    passed[..., :n_above] = fine_spectrum[..., :n_above]
    passed[..., n_above:] = fine_spectrum[..., n + n_above :]
    first, last = sorted((n - n // 2, n_above))
    passed[..., first:last] += echo_spectrum[..., first:last]
    index = cut_bin % n
    share = cut_bin + 0.5 - delays.first_passed_bin
    lower, upper = math.sqrt(share), math.sqrt(1 - share)
    echo_weight = lower if index - n * (index >= n - n // 2) == cut_bin else upper
    passed[..., index] = (
        lower * fine_spectrum[..., cut_bin % n_fine]
        + upper * fine_spectrum[..., cut_bin + n]
        + (1 - echo_weight) * echo_spectrum[..., index]
    )
    return passed
