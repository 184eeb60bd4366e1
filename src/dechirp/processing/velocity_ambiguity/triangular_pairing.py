"""Pairing of the peaks of rising and falling ramps: range and velocity of triangles."""

from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.refine import RefinedPeaks, Tones, average_sidelobe_errors
from dechirp.processing.velocity_ambiguity.hypotheses import AmbiguityHypotheses, ResolvedPeaks
from dechirp.radar.frame import Frame
from dechirp.theory.bounds import frequency_variance

# Probability that noise makes the two peaks of a target differ more than accepted.
_REJECTION_PROBABILITY = 1e-6
# Difference of the amplitudes of one target beyond noise, relative to the echo.
_MODEL_ERROR = 0.03
# Largest speed of a pair, in m/s: most wrong pairs of a scene exceed it.
_MAX_SPEED = 150.0


class PeakPairs(NamedTuple):
    """Pairs of peaks of both ramps, strongest first."""

    up: np.ndarray
    down: np.ndarray
    """(n,): indices of the peaks."""
    probability: np.ndarray
    """(n,): probability that the two belong to one target."""


def pair_rising_and_falling_peaks(
    up: RefinedPeaks, down: RefinedPeaks, frame: Frame
) -> ResolvedPeaks:
    r"""Pair the peaks of rising and falling ramps, and resolve range and velocity.

    The beat frequencies of the n-th pair are S tau + f_D and S tau - f_D: half their sum gives
    the range, half their difference the Doppler frequency, and so the ambiguity number of that
    from several chirps. A frame of one triangle gives both as well.

    Parameters
    ----------
    up, down : RefinedPeaks
        Of the rising ramps; of the falling ones, reversed by `split_chirps_into_slots`.
    frame : Frame
        With triangular modulation.

    Returns
    -------
    ResolvedPeaks
        Peaks without a partner are dropped, as noise has none. Probabilities include that of the
        pair.
    """
    pairs = _assign_peak_pairs(up, down, frame)
    u, d = pairs.up, pairs.down
    chirp, slope = frame.chirp, frame.chirp.slope_hz_per_s
    beat_up, beat_down = (_beat_frequencies_hz(peaks.tones.fast, frame) for peaks in (up, down))
    up_hz = chirp.mean_sampled_frequency_hz
    down_hz = up_hz - _falling_ramp_frequency_drop_hz(frame)
    coarse = _relative_doppler_from_beats(beat_up[u] - beat_down[d], frame)
    delay_s = (beat_up[u] + beat_down[d] - coarse * (up_hz - down_hz)) / (2 * slope * (1 - coarse))
    echo_hz = up_hz - slope * delay_s
    doppler_hz, repetition_s = coarse * echo_hz, frame.repetition_s
    numbers = np.zeros((len(u), 1))
    conditional = np.ones((len(u), 1))
    if frame.n_chirps > 1:
        turn = 2 * np.pi * repetition_s
        as_up = (
            down.tones.slow[d]
            + _falling_ramp_doppler_drop_hz(coarse, beat_up[u] + beat_down[d], frame) * turn
        )
        slow = np.angle(np.exp(1j * up.tones.slow[u]) + np.exp(1j * as_up))
        fine_hz = slow / turn
        numbers = np.round((doppler_hz - fine_hz) * repetition_s)[:, None] + np.arange(-2, 3)
        off = (doppler_hz - fine_hz)[:, None] - numbers / repetition_s
        variance = (
            _beat_frequency_variance(up.snr[u], frame)
            + _beat_frequency_variance(down.snr[d], frame)
        ) / 4
        conditional = np.exp(
            -(off**2 - np.min(off**2, axis=1, keepdims=True)) / (2 * variance[:, None])
        )
        conditional /= conditional.sum(axis=1, keepdims=True)
        best = conditional.argmax(axis=1)
        doppler_hz = fine_hz + numbers[np.arange(len(u)), best] / repetition_s
        # Range for the refined Doppler frequency, from the sum of the beats.
        coarse = doppler_hz / echo_hz
        delay_s = beat_up[u] + beat_down[d] - coarse * (up_hz - down_hz)
        delay_s /= 2 * slope * (1 - coarse)
    hypotheses = AmbiguityHypotheses(conditional * pairs.probability[:, None], numbers)
    if frame.n_chirps > 1:
        doppler_hz = np.where(
            np.isnan(hypotheses.certain_ambiguity_numbers_or_nan), fine_hz, doppler_hz
        )
    up_amplitude, down_amplitude = up.tones.amplitude[u], down.tones.amplitude[d]
    correlation = np.sum(up_amplitude * down_amplitude.conj(), axis=1)
    down_amplitude = down_amplitude * np.exp(1j * np.angle(correlation))[:, None]
    tones = Tones(
        slow=2 * np.pi * doppler_hz * repetition_s,
        fast=(slope * delay_s + doppler_hz) * 2 * np.pi / chirp.sample_rate_hz,
        energy=up.tones.energy[u] + down.tones.energy[d],
        amplitude=(up_amplitude + down_amplitude) / 2,
    )
    noise = (up.amplitude_noise[u] + down.amplitude_noise[d]) / 4
    sidelobes = average_sidelobe_errors(
        up.sidelobes and up.sidelobes.select(u), down.sidelobes and down.sidelobes.select(d)
    )
    return ResolvedPeaks(
        RefinedPeaks(tones, up.snr[u] + down.snr[d], noise, sidelobes), doppler_hz, hypotheses
    )


def _assign_peak_pairs(up: RefinedPeaks, down: RefinedPeaks, frame: Frame) -> PeakPairs:
    """Find the likeliest assignment, and the probability of each of its pairs."""
    # A peak without a partner costs as much as a pair at the limit.
    unpaired_cost = float(
        scipy.special.gammainccinv(
            _degrees_of_freedom_of_pair_cost(up, frame) / 2, _REJECTION_PROBABILITY
        )
    )
    costs = np.minimum(_pair_costs(up, down, frame), unpaired_cost)
    u, d = scipy.optimize.linear_sum_assignment(costs)
    is_pair = costs[u, d] < unpaired_cost
    u, d = u[is_pair], d[is_pair]
    order = np.argsort(-(up.snr[u] + down.snr[d]), kind="stable")
    u, d = u[order], d[order]
    return PeakPairs(u, d, _pair_probability(costs, unpaired_cost, u, d))


def _pair_probability(
    costs: np.ndarray, unpaired_cost: float, rising_index: np.ndarray, falling_index: np.ndarray
) -> np.ndarray:
    """Compute the probability of each pair against assignments one exchange away.

    Exchanges of partners with another pair, of one partner for an unpaired peak, or for none.
    """
    pair_cost = costs[rising_index, falling_index]
    exchanged = (
        costs[np.ix_(rising_index, falling_index)]
        + costs[np.ix_(rising_index, falling_index)].T
        - pair_cost[:, None]
        - pair_cost
    )
    np.fill_diagonal(exchanged, np.inf)
    free_up = np.delete(costs, rising_index, axis=0)[:, falling_index] - pair_cost
    free_down = np.delete(costs, falling_index, axis=1)[rising_index] - pair_cost[:, None]
    others = np.exp(pair_cost - unpaired_cost) + np.exp(-exchanged).sum(axis=1)
    others += np.exp(-free_up).sum(axis=0) + np.exp(-free_down).sum(axis=1)
    return 1 / (1 + others)


def _degrees_of_freedom_of_pair_cost(peaks: RefinedPeaks, frame: Frame) -> int:
    """Return the number of measured values in which the peaks of a target differ by noise."""
    n_rx = peaks.tones.amplitude.shape[1]
    return 2 * n_rx - 1 + (2 if frame.n_chirps > 1 else 0)


def _pair_costs(up: RefinedPeaks, down: RefinedPeaks, frame: Frame) -> np.ndarray:
    """Compute half the squared differences over variances, (n_up, n_down); infinite if too fast.

    Differences of amplitudes up to a common phase, of the Doppler frequencies from chirp to
    chirp, and of these from the Doppler frequency of the beats, aliased.
    """
    if not (len(up.snr) and len(down.snr)):
        return np.zeros((len(up.snr), len(down.snr)))
    noise = up.amplitude_noise[:, None] + down.amplitude_noise
    up_amplitude, down_amplitude = up.tones.amplitude, down.tones.amplitude
    power = np.sum(abs(up_amplitude) ** 2, axis=1)[:, None] + np.sum(
        abs(down_amplitude) ** 2, axis=1
    )
    noise = noise + _MODEL_ERROR**2 * power / up_amplitude.shape[1]
    costs = np.maximum(power - 2 * abs(up_amplitude @ down_amplitude.conj().T), 0.0) / noise
    beats = _beat_frequencies_hz(up.tones.fast, frame)[:, None] - _beat_frequencies_hz(
        down.tones.fast, frame
    )
    over_c = _relative_doppler_from_beats(beats, frame)
    if frame.n_chirps > 1:
        turn = 2 * np.pi * frame.repetition_s
        both = _beat_frequencies_hz(up.tones.fast, frame)[:, None] + _beat_frequencies_hz(
            down.tones.fast, frame
        )
        doppler_difference = (
            up.tones.slow[:, None]
            - down.tones.slow
            - _falling_ramp_doppler_drop_hz(over_c, both, frame) * turn
        )
        doppler_difference = (doppler_difference + np.pi) % (2 * np.pi) - np.pi
        slow_variance = frequency_variance(snr=up.snr, n_points=frame.n_chirps)[
            :, None
        ] + frequency_variance(snr=down.snr, n_points=frame.n_chirps)
        costs += doppler_difference**2 / (2 * slow_variance)
        doppler_error = over_c * frame.chirp.mean_sampled_frequency_hz * turn
        doppler_error = doppler_error - up.tones.slow[:, None] + doppler_difference / 2
        doppler_error = (doppler_error + np.pi) % (2 * np.pi) - np.pi
        variance = _beat_frequency_variance(up.snr, frame)[:, None] + _beat_frequency_variance(
            down.snr, frame
        )
        costs += doppler_error**2 / (2 * (variance / 4 * turn**2 + slow_variance / 4))
    return np.where(abs(over_c) < 2 * _MAX_SPEED / SPEED_OF_LIGHT, costs, np.inf)


def _beat_frequencies_hz(fast: np.ndarray, frame: Frame) -> np.ndarray:
    return fast * frame.chirp.sample_rate_hz / (2 * np.pi)


def _relative_doppler_from_beats(beat_difference_hz: np.ndarray, frame: Frame) -> np.ndarray:
    """Return 2 v / c from the difference of the beats, with the motion between the ramps."""
    chirp, (_, fall) = frame.chirp, frame.ramps
    both_hz = 2 * chirp.start_frequency_hz + fall.shift_hz
    return beat_difference_hz / (both_hz - chirp.slope_hz_per_s * frame.slot_starts_s[1])


def _falling_ramp_frequency_drop_hz(frame: Frame) -> float:
    """Return the decrease of the mean sampled frequency of falling ramps."""
    chirp, (_, fall) = frame.chirp, frame.ramps
    return 2 * chirp.slope_hz_per_s * chirp.mid_window_s - fall.shift_hz


def _falling_ramp_doppler_drop_hz(
    relative_doppler: np.ndarray, beat_sum_hz: np.ndarray, frame: Frame
) -> np.ndarray:
    """Return the decrease of Doppler frequencies of falling ramps, from the sum of the beats.

    The echo of a rising ramp is S tau below the transmitted frequency, that of a falling one above.
    """
    return relative_doppler * (_falling_ramp_frequency_drop_hz(frame) - beat_sum_hz)


def _beat_frequency_variance(snr: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the Cramer-Rao bound of the beat frequency of a peak, Hz^2."""
    if not len(snr):
        return np.zeros(0)
    chirp = frame.chirp
    variance = frequency_variance(snr=snr, n_points=chirp.n_samples)
    return np.asarray(variance * (chirp.sample_rate_hz / (2 * np.pi)) ** 2)
