"""Peaks of rising ramps and of falling ones, brought together: range and velocity of triangles."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import gammainccinv

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.process.folds.ambiguity import Folds
from dechirp.process.refine import Tones
from dechirp.radar.frame import Frame
from dechirp.theory.bounds import frequency_variance

# Two peaks of one target are as unlike as noise makes them but once in so many times.
_RARELY = 1e-6
# By so much, relative to the echo, amplitudes of one target differ beyond noise.
_UNKNOWN = 0.03
# Nothing that is paired is faster, in m/s: of all pairs of a scene most are.
_FASTEST = 150.0


class Peaks(NamedTuple):
    """Peaks of one map, as rising ramps would have them."""

    tones: Tones
    snr: np.ndarray
    """(n,): after integration over this map's samples."""
    amplitude_noise: np.ndarray
    """(n,): E|w|^2 in the amplitude of a channel."""


class Pairs(NamedTuple):
    """Targets of which both ramps have a peak, strongest first."""

    up: np.ndarray
    down: np.ndarray
    """(n,): places among the peaks."""
    probability: np.ndarray
    """(n,): that these two belong together."""


class Unfolded(NamedTuple):
    """Peaks with their Doppler frequencies."""

    peaks: Peaks
    doppler_hz: np.ndarray
    """(n,): unfolded where the fold is certain, else within half a cycle a repetition of zero."""
    folds: Folds


def paired(up: Peaks, down: Peaks, frame: Frame) -> Unfolded:
    r"""Targets from the peaks of both kinds of ramps.

    The beat frequencies of the n-th pair are S tau + f_D and S tau - f_D: half their sum tells
    the range, half their difference the Doppler frequency, and with it in which fold that of
    the chirps lies, where there are several. A frame of one triangle tells both as well.

    Parameters
    ----------
    up, down : Peaks
        Of the rising ramps; of the falling ones, made to rise by `channels`.
    frame : Frame
        With triangular modulation.

    Returns
    -------
    Unfolded
        Peaks without a partner are left out: noise has none. The probability of a fold is
        that of the pair too.
    """
    pairs = _pairs(up, down, frame)
    u, d = pairs.up, pairs.down
    chirp, slope = frame.chirp, frame.chirp.slope_hz_per_s
    beat_up, beat_down = (_beats_hz(of.tones.fast, frame) for of in (up, down))
    up_hz = chirp.mean_sampled_frequency_hz
    down_hz = up_hz - _lower_hz(frame)
    coarse = _doppler_over_c(beat_up[u] - beat_down[d], frame)
    delay_s = (beat_up[u] + beat_down[d] - coarse * (up_hz - down_hz)) / (2 * slope * (1 - coarse))
    echo_hz = up_hz - slope * delay_s
    doppler_hz, repetition_s = coarse * echo_hz, frame.repetition_s
    fold = np.zeros((len(u), 1))
    given = np.ones((len(u), 1))
    if frame.n_chirps > 1:
        turn = 2 * np.pi * repetition_s
        as_up = down.tones.slow[d] + _slower_hz(coarse, beat_up[u] + beat_down[d], frame) * turn
        slow = np.angle(np.exp(1j * up.tones.slow[u]) + np.exp(1j * as_up))
        fine_hz = slow / turn
        fold = np.round((doppler_hz - fine_hz) * repetition_s)[:, None] + np.arange(-2, 3)
        off = (doppler_hz - fine_hz)[:, None] - fold / repetition_s
        variance = (_beat_variance(up.snr[u], frame) + _beat_variance(down.snr[d], frame)) / 4
        given = np.exp(-(off**2 - np.min(off**2, axis=1, keepdims=True)) / (2 * variance[:, None]))
        given /= given.sum(axis=1, keepdims=True)
        best = given.argmax(axis=1)
        doppler_hz = fine_hz + fold[np.arange(len(u)), best] / repetition_s
        # The range that goes with it: the difference of the beats is not asked again.
        coarse = doppler_hz / echo_hz
        delay_s = beat_up[u] + beat_down[d] - coarse * (up_hz - down_hz)
        delay_s /= 2 * slope * (1 - coarse)
    folds = Folds(given * pairs.probability[:, None], fold)
    if frame.n_chirps > 1:
        doppler_hz = np.where(np.isnan(folds.certain), fine_hz, doppler_hz)
    one, other = up.tones.amplitude[u], down.tones.amplitude[d]
    alike = np.sum(one * other.conj(), axis=1)
    other = other * np.exp(1j * np.angle(alike))[:, None]
    made = Tones(
        slow=2 * np.pi * doppler_hz * repetition_s,
        fast=(slope * delay_s + doppler_hz) * 2 * np.pi / chirp.sample_rate_hz,
        energy=up.tones.energy[u] + down.tones.energy[d],
        amplitude=(one + other) / 2,
    )
    noise = (up.amplitude_noise[u] + down.amplitude_noise[d]) / 4
    return Unfolded(Peaks(made, up.snr[u] + down.snr[d], noise), doppler_hz, folds)


def _pairs(up: Peaks, down: Peaks, frame: Frame) -> Pairs:
    """The likeliest assignment, and how likely each pair of it is."""
    # A peak that has no partner is as unlikely as a pair at the limit.
    left = float(gammainccinv(_freedom(up, frame) / 2, _RARELY))
    unlike = np.minimum(_unlike(up, down, frame), left)
    u, d = linear_sum_assignment(unlike)
    kept = unlike[u, d] < left
    u, d = u[kept], d[kept]
    order = np.argsort(-(up.snr[u] + down.snr[d]), kind="stable")
    u, d = u[order], d[order]
    return Pairs(u, d, _probability(unlike, left, u, d))


def _probability(unlike: np.ndarray, left: float, u: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Of each pair of the best assignment, against all others that are one exchange away.

    Of partners with another pair, of one of them for a peak that is left, or for none.
    """
    own = unlike[u, d]
    exchanged = unlike[np.ix_(u, d)] + unlike[np.ix_(u, d)].T - own[:, None] - own
    np.fill_diagonal(exchanged, np.inf)
    free_up = np.delete(unlike, u, axis=0)[:, d] - own
    free_down = np.delete(unlike, d, axis=1)[u] - own[:, None]
    others = np.exp(own - left) + np.exp(-exchanged).sum(axis=1)
    others += np.exp(-free_up).sum(axis=0) + np.exp(-free_down).sum(axis=1)
    return 1 / (1 + others)


def _freedom(peaks: Peaks, frame: Frame) -> int:
    """Numbers in which the two peaks of one target differ by noise alone."""
    n_rx = peaks.tones.amplitude.shape[1]
    return 2 * n_rx - 1 + (2 if frame.n_chirps > 1 else 0)


def _unlike(up: Peaks, down: Peaks, frame: Frame) -> np.ndarray:
    """Half the squared differences over their variances, (n_up, n_down); infinite: too fast.

    Of amplitudes but for a common phase; of Doppler frequencies from chirp to chirp; of those
    from what the beats say, folded.
    """
    noise = up.amplitude_noise[:, None] + down.amplitude_noise
    one, other = up.tones.amplitude, down.tones.amplitude
    power = np.sum(abs(one) ** 2, axis=1)[:, None] + np.sum(abs(other) ** 2, axis=1)
    noise = noise + _UNKNOWN**2 * power / one.shape[1]
    unlike = np.maximum(power - 2 * abs(one @ other.conj().T), 0.0) / noise
    beats = _beats_hz(up.tones.fast, frame)[:, None] - _beats_hz(down.tones.fast, frame)
    over_c = _doppler_over_c(beats, frame)
    if frame.n_chirps > 1:
        turn = 2 * np.pi * frame.repetition_s
        both = _beats_hz(up.tones.fast, frame)[:, None] + _beats_hz(down.tones.fast, frame)
        apart = up.tones.slow[:, None] - down.tones.slow - _slower_hz(over_c, both, frame) * turn
        apart = (apart + np.pi) % (2 * np.pi) - np.pi
        slow_variance = frequency_variance(snr=up.snr, n_points=frame.n_chirps)[
            :, None
        ] + frequency_variance(snr=down.snr, n_points=frame.n_chirps)
        unlike += apart**2 / (2 * slow_variance)
        off = over_c * frame.chirp.mean_sampled_frequency_hz * turn
        off = off - up.tones.slow[:, None] + apart / 2
        off = (off + np.pi) % (2 * np.pi) - np.pi
        variance = _beat_variance(up.snr, frame)[:, None] + _beat_variance(down.snr, frame)
        unlike += off**2 / (2 * (variance / 4 * turn**2 + slow_variance / 4))
    return np.where(abs(over_c) < 2 * _FASTEST / SPEED_OF_LIGHT, unlike, np.inf)


def _beats_hz(fast: np.ndarray, frame: Frame) -> np.ndarray:
    return fast * frame.chirp.sample_rate_hz / (2 * np.pi)


def _doppler_over_c(beats_hz: np.ndarray, frame: Frame) -> np.ndarray:
    """2 v / c from the difference of the beats; the range moves on in between."""
    chirp, (_, fall) = frame.chirp, frame.ramps
    both_hz = 2 * chirp.start_frequency_hz + fall.shift_hz
    return beats_hz / (both_hz - chirp.slope_hz_per_s * frame.slots_s[1])


def _lower_hz(frame: Frame) -> float:
    """By how much the mean of what falling ramps send is lower: windows need not be in mid-ramp."""
    chirp, (_, fall) = frame.chirp, frame.ramps
    return 2 * chirp.slope_hz_per_s * chirp.mid_window_s - fall.shift_hz


def _slower_hz(over_c: np.ndarray, beats_hz: np.ndarray, frame: Frame) -> np.ndarray:
    """By how much Doppler frequencies of falling ramps are lower, from the sum of the beats.

    The echo of a rising ramp is S tau lower than what is sent, that of a falling one higher.
    """
    return over_c * (_lower_hz(frame) - beats_hz)


def _beat_variance(snr: np.ndarray, frame: Frame) -> np.ndarray:
    """Of the beat frequency of one peak, Hz^2, at the bound."""
    chirp = frame.chirp
    variance = frequency_variance(snr=snr, n_points=chirp.n_samples)
    return np.asarray(variance * (chirp.sample_rate_hz / (2 * np.pi)) ** 2)
