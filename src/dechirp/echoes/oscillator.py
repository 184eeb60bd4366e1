"""What a phase error of the sweep does to echoes, however many there are.

The mixer sees the phase error now less that of the echo, which left a delay ago:

    s(t) = sum over echoes of b_i(t) exp i (phi(t) - phi(t - tau_i)).

Echoes of a linear ramp lie at f = S tau, so that a filter whose group delay is f / S gives all
of them their own delays at once (deskew filter: Meta, Hoogeboom & Ligthart 2007). With b mixed
down by f_mid = S tau_mid, and Q the multiplication of a spectrum by exp(i pi f^2 / S),

    s(t) = exp i (phi(t) + 2 pi f_mid t)  Q^-1 [ Q[exp(-i phi(t - tau_mid))] Q[b] ]:

a frequency f_n of the error and f of an echo give exp(-2 pi i f_n f / S), that error a delay
later. The Doppler frequency counts as delay, f_D / S: what range-Doppler coupling says.

A frequency f_n of the error needs the echo f_n / S away in time, so that echoes are summed for
longer than they are kept: on each side as long as fs / 2 needs and 10 samples, an eighth of the
window at most. Against a sum echo by echo, what comes out is off by 1e-5 of the power of the
phase noise at the ends of the window and 1e-6 within it where echoes fill six tenths of the
sample rate, 1e-3 and 3e-5 where they fill 85 %.

Where an eighth of the window is not enough (fs^2 / S above a quarter of the samples: slow ramps,
sampled fast), it is so for what is slower than S times an eighth of the window, and for the first
echo. What is faster keeps its power towards the ends of the window, but there does not cancel as
far as the delay would have it.

Echoes that begin within the samples (`Engine.late`) jump there, and around the jump, as far as
echoes are needed, the error is not that of their delay.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
from scipy.fft import fft, ifft, next_fast_len

from dechirp.core.findings import Finding
from dechirp.core.threads import in_threads
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar

# Samples of some chirps that are turned at once, 1 MB: fewer take longer in Python than in loops.
_AT_ONCE = 2**17
# Samples beyond those that the fastest error needs, in which echoes pass over to a copy.
_RINGING = 10


def surprise(radar: Radar) -> Finding | None:
    """What to know of a ramp so slow that echoes do not tell of all of the error, if it is."""
    chirp = radar.frame.chirp
    farthest = chirp.sample_rate_hz**2 / abs(chirp.slope_hz_per_s)
    if farthest <= chirp.n_samples / 4:
        return None
    right_hz = abs(chirp.slope_hz_per_s) * (chirp.n_samples // 8) / chirp.sample_rate_hz
    return Finding(
        level="warning",
        setting="impairments",
        got=f"an oscillator's error on a ramp on which fs^2 / S is {farthest:.4g} samples",
        need=f"at most a quarter of the {chirp.n_samples} of a chirp: errors faster than"
        f" {right_hz / 1e6:.4g} MHz do not cancel towards the ends of the window",
        fix="Sample slower, or sweep faster.",
    )


class Reach(NamedTuple):
    """How far apart in time what is sent and what comes back may be, in samples."""

    first: float
    """Delay before which no echo comes."""
    middle: float
    """Delay about in the middle of those of all echoes."""
    spread: int
    """By which delays differ from it, at most."""
    before: int
    """Samples of the echoes that are needed before those that are kept."""
    after: int
    n_kept: int
    n_around: int
    """Points of the transforms: samples of the echoes, and more where their ends are joined."""

    @property
    def n_wide(self) -> int:
        """Samples of the echoes."""
        return self.before + self.n_kept + self.after

    @property
    def n_joined(self) -> int:
        """Points from the last sample of the echoes round to the first."""
        return self.n_around - self.n_wide

    @property
    def n_more(self) -> int:
        """Of those, how many on each side of the echoes tell of the error there."""
        return self.n_joined - self.spread

    @property
    def n_over(self) -> int:
        """Samples in which echoes pass over to a copy, at each of their ends."""
        return min(_RINGING, self.before)

    @property
    def first_copied(self) -> int:
        """Sample of the echoes whose copy follows the last."""
        return max((self.n_wide - self.n_joined) // 2, self.n_over)

    @property
    def first_kept(self) -> int:
        """Where in the phase window the samples that are kept begin."""
        return self.n_more + round(self.middle) + self.before

    def phase_window(self, wide: Window) -> Window:
        """When the phase error must be known, for the echoes of `wide`."""
        n_times = max(self.n_wide + 2 * self.n_more, self.first_kept + self.n_kept)
        early = self.first_kept - self.before
        return wide.wider(early, n_times - early - wide.n_times)


def reach(
    parts: Sequence[Part],
    kept: Window,
    radar: Radar,
    added_s: Sequence[tuple[float, float]] = (),
) -> Reach:
    """Find how late echoes of a frame come, and what is needed to turn their phases.

    `added_s`: delays between which lies what is added without scatterers.

    Beats fill the sample rate at most: echoes that are later fold onto earlier ones, and get
    the delay of those. What was sent more than an interval ago is taken to be as long ago.
    """
    rate_hz, slope = kept.rate_hz, abs(radar.frame.chirp.slope_hz_per_s)
    seen = [part for part in parts if part.scatterers.amplitudes.any()]
    bounds_s = [*(_delays_s(part, kept) for part in seen), *added_s] or [(0.0, 0.0)]
    latest_s = min(max(late for _, late in bounds_s), radar.frame.only_interval_s)
    earliest_s = min(latest_s, *(early for early, _ in bounds_s))
    latest_s = min(latest_s, earliest_s + rate_hz / slope)
    earliest, half = earliest_s * rate_hz, (latest_s - earliest_s) / 2 * rate_hz
    # Between an error at half the sample rate and the echo that it needs.
    farthest = rate_hz**2 / (2 * slope)
    most = max(kept.n_times // 8, 1)
    more = math.ceil(min(farthest + _RINGING, most))
    # A jump where the ends are joined has frequencies that need echoes farther off than `more`.
    smooth = math.ceil(min(8 * farthest / more + 8, most + 8))
    n_wide = kept.n_times + 2 * more
    # The first echo, often the strongest, and with the least noise left, is on a bin: it goes
    # round without a jump, and has what the fastest error needs.
    spread = math.ceil(half + min(half, farthest / n_wide)) + 1
    n_around = next_fast_len(n_wide + 2 * spread + smooth)
    bin_apart = 2 * farthest / n_around
    middle = earliest + round(half / bin_apart) * bin_apart
    return Reach(earliest, middle, spread, more, more, kept.n_times, n_around)


def turned(echo: np.ndarray, phase_rad: np.ndarray, found: Reach, radar: Radar) -> np.ndarray:
    """Echoes with exp(i (phase now - phase a delay ago)), only those samples that are kept.

    Parameters
    ----------
    echo : (n_chirps, n_rx, n_wide), complex64 or complex128
        Dechirped with a perfect ramp.
    phase_rad : (n_chirps, n_times)
        At the times of the phase window, the same for all receivers.
    found : Reach
        How late echoes are.

    Returns
    -------
    (n_chirps, n_rx, n_kept) of the same precision
    """
    out = np.empty((*echo.shape[:2], found.n_kept), echo.dtype)
    chirp = radar.frame.chirp
    deskew = _deskew(found, chirp.slope_hz_per_s, chirp.sample_rate_hz, echo.dtype)
    at_once = max(1, _AT_ONCE // (echo.shape[1] * len(deskew.of_echo)))
    rows = [slice(row, row + at_once) for row in range(0, len(echo), at_once)]

    def one(some: slice) -> None:
        out[some] = _turned(echo[some], phase_rad[some], found, deskew)

    in_threads(min(numba.get_num_threads(), len(rows)), one, rows)
    return out


def _delays_s(part: Part, kept: Window) -> tuple[float, float]:
    """Delays between which the echoes of a part lie."""
    scatterers, sent = part.scatterers, part.sent
    seen = scatterers.amplitudes != 0
    longest_s = np.abs(sent.starts_s[[0, -1]] + kept.times_s[[0, -1]]).max()
    moved_m = np.zeros(np.count_nonzero(seen))
    for power, term_m in enumerate(scatterers.path_m[1:, seen], start=1):
        moved_m += np.linalg.norm(term_m, axis=1) * longest_s**power
    nearest_m, farthest_m = np.zeros((2, len(moved_m)))
    for antennas_m in (sent.tx_m, sent.rx_m):
        least_m, most_m = _ways_m(scatterers.path_m[0, seen], antennas_m)
        nearest_m += least_m - moved_m
        farthest_m += most_m + moved_m
    return max(nearest_m.min(), 0.0) / SPEED_OF_LIGHT, farthest_m.max() / SPEED_OF_LIGHT


def _ways_m(at_m: np.ndarray, antennas_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From each scatterer to the antenna that is nearest, and that is farthest."""
    least_m, most_m = np.full(len(at_m), np.inf), np.zeros(len(at_m))
    for antenna_m in antennas_m:
        way_m = np.linalg.norm(at_m - antenna_m, axis=1)
        np.minimum(least_m, way_m, out=least_m)
        np.maximum(most_m, way_m, out=most_m)
    return least_m, most_m


class _Deskew(NamedTuple):
    """What is the same for all chirps."""

    of_error: np.ndarray
    """(n_fine,): Q, in the order of a transform, with what the middle delay is off the samples.

    Finer in time than the samples are: the error widens the band of the echoes, which must
    not fold before their delays are undone."""
    of_echo: np.ndarray
    """(n_fine,): Q."""
    down: np.ndarray
    """(n_wide,): to the middle of the band of the echoes."""
    copied: complex
    """What turns a copy of the echoes so that the first goes on where they end."""


def _deskew(
    found: Reach, slope_hz_per_s: float, rate_hz: float, dtype: np.dtype[np.complexfloating]
) -> _Deskew:
    n = found.n_around
    slope = slope_hz_per_s / rate_hz**2  # cycles for each sample squared
    n_fine = min(next_fast_len(n + math.ceil(2 * n * abs(slope) * found.spread)), 2 * n)
    frequency = ((np.arange(n_fine) + n_fine // 2) % n_fine - n_fine // 2) / n
    q = frequency**2 / (2 * slope)
    late = frequency * (found.middle - round(found.middle))
    # The inverse transform of n_fine points divides by that much.
    of_error = _turns(q - late) * (n_fine / n)
    down = _turns(-slope * found.middle * np.arange(found.n_wide))
    copied = _turns(slope * (found.first - found.middle) * (found.n_wide - found.first_copied))
    return _Deskew(
        of_error.astype(dtype), _turns(q).astype(dtype), down.astype(dtype), complex(copied)
    )


def _turns(cycles: np.ndarray | float) -> np.ndarray:
    return np.exp(2j * np.pi * (cycles - np.rint(cycles)))


def _turned(echo: np.ndarray, phase_rad: np.ndarray, found: Reach, deskew: _Deskew) -> np.ndarray:
    kept = slice(found.before, found.before + found.n_kept)
    error = _conjugate_turns(phase_rad, echo.dtype)
    made = _finer(_around(echo * deskew.down, found, deskew.copied), deskew.of_echo)
    made *= _finer(_joined(error, found), deskew.of_error)[:, None]
    made = fft(made, overwrite_x=True)
    made *= deskew.of_echo.conj()
    late = ifft(_folded(made, found.n_around), overwrite_x=True)[..., kept]
    now = error[:, found.first_kept : found.first_kept + found.n_kept] * deskew.down[kept]
    return late * now.conj()[:, None]


def _conjugate_turns(phase_rad: np.ndarray, dtype: np.dtype[np.complexfloating]) -> np.ndarray:
    """exp(-i phase); whole turns are taken off in double precision."""
    cycles = phase_rad / (-2 * np.pi)
    cycles -= np.rint(cycles)
    made = np.empty(phase_rad.shape, dtype)
    within_rad = (2 * np.pi * cycles).astype(made.real.dtype)
    np.cos(within_rad, out=made.real)
    np.sin(within_rad, out=made.imag)
    return made


def _around(echo: np.ndarray, found: Reach, copied: complex) -> np.ndarray:
    """Echoes whose end passes over into their beginning through a copy of their middle.

    A copy has the frequencies that they have, and so the delays: nothing jumps, which would
    ring, and an error that needs echoes from beyond the end finds their power.
    """
    n, over = found.n_wide, found.n_over
    around = np.empty((*echo.shape[:-1], found.n_around), echo.dtype)
    around[..., :n] = echo
    places = found.first_copied - over + np.arange(found.n_joined + 2 * over)
    copy = echo[..., places % n] * echo.dtype.type(copied)
    around[..., n:] = copy[..., over:-over]
    rising = _rising(over, 4.0).astype(echo.real.dtype)
    around[..., n - over : n] += rising * (copy[..., :over] - echo[..., n - over :])
    around[..., :over] += rising[::-1] * (copy[..., -over:] - echo[..., :over])
    return around


def _joined(error: np.ndarray, found: Reach) -> np.ndarray:
    """The error a middle delay ago, its end faded into its beginning."""
    n_wide, n_more, spread = found.n_wide, found.n_more, found.spread
    around = np.zeros((len(error), found.n_around), error.dtype)
    around[:, : n_wide + n_more] = error[:, n_more : 2 * n_more + n_wide]
    # Delays reach `spread` beyond either end.
    beginning = np.zeros(found.n_joined, error.real.dtype)
    beginning[spread:n_more] = _rising(n_more - spread, 8.0)
    beginning[n_more:] = 1
    around[:, n_wide:] *= 1 - beginning
    around[:, n_wide + spread :] += beginning[spread:] * error[:, :n_more]
    return around


def _rising(n: int, shape: float) -> np.ndarray:
    """From 0 to 1 in n steps, smooth at both ends: the integral of Kaiser's window."""
    rising = np.cumsum(np.kaiser(n + 1, shape))
    return rising[:-1] / rising[-1]


def _finer(signal: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Signals after Q, at more points in time."""
    n, n_fine = signal.shape[-1], len(q)
    spectrum = fft(signal, overwrite_x=True)
    fine = np.zeros((*signal.shape[:-1], n_fine), signal.dtype)
    above, below = n - n // 2, n // 2
    np.multiply(spectrum[..., :above], q[:above], out=fine[..., :above])
    np.multiply(spectrum[..., above:], q[n_fine - below :], out=fine[..., n_fine - below :])
    return ifft(fine, overwrite_x=True)


def _folded(fine: np.ndarray, n: int) -> np.ndarray:
    """The spectrum of n samples, on which frequencies beyond their rate fold."""
    n_fine = fine.shape[-1]
    above, below = n_fine - n_fine // 2, n_fine // 2
    spectrum = np.zeros((*fine.shape[:-1], n), fine.dtype)
    spectrum[..., :above] = fine[..., :above]
    spectrum[..., n - below :] += fine[..., above:]
    return spectrum
