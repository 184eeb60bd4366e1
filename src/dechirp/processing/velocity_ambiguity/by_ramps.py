"""Velocity ambiguity resolved by ramps of one transmitter at other times or frequencies."""

import numpy as np
import scipy

from dechirp.processing.velocity_ambiguity.hypotheses import (
    AmbiguityHypotheses,
    resolvable_ambiguity_numbers,
)
from dechirp.processing.virtual_array import slot_phase_factors
from dechirp.radar.frame import Frame
from dechirp.theory.bounds import frequency_variance

# Difference of amplitudes between slots beyond noise, relative to the echo.
_MODEL_ERROR = 0.03
# Errors of the beat frequency summed over, in standard deviations.
_ERROR_GRID = np.linspace(-4, 4, 33)


def remove_beat_phase(amplitudes: np.ndarray, fast: np.ndarray, frame: Frame) -> np.ndarray:
    """Remove the phase of the beat (n,) from ramps of other frequencies, (n, n_slots * n_rx).

    The beat is in rad per sample. A ramp that starts higher by d adds the phase d tau = d
    (f_b - f_D) / S, in cycles: the part of the beat f_b is removed here, that of the Doppler
    frequency f_D counts as time, `Frame.doppler_phase_times_s`.
    """
    if frame.has_identical_ramps:
        return amplitudes
    beat_hz = fast * frame.chirp.sample_rate_hz / (2 * np.pi)
    shift_s = np.array([ramp.shift_hz for ramp in frame.ramps]) / frame.chirp.slope_hz_per_s
    back = np.exp(-2j * np.pi * beat_hz[:, None] * shift_s)
    n_rx = amplitudes.shape[1] // frame.n_slots
    return amplitudes * np.repeat(back, n_rx, axis=1)


def ambiguity_probabilities(
    amplitudes: np.ndarray,
    frame: Frame,
    doppler_hz: np.ndarray,
    snr: np.ndarray,
    noise_power: np.ndarray,
) -> AmbiguityHypotheses:
    r"""Compute the probability of each ambiguity number from the amplitudes of the slots.

    .. math::

        p(h) \propto \int \exp \Big( \sum_r \frac{|\sum_l e^{-2\pi\mathrm{i} (f_h t_l + d_l
        \epsilon / S)} x_{l,r}|^2}{L \sigma^2} - \frac{\epsilon^2}{2 \sigma_b^2} \Big)
        \,\mathrm{d}\epsilon

    with f_h the Doppler frequency for ambiguity number h and t_l the times of
    `Frame.doppler_phase_times_s`: the target has an arbitrary amplitude in each receiver, equal in
    all slots. The error epsilon of the beat frequency changes the phase of slots whose frequency is
    d_l higher.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx)
        From `remove_beat_phase`.
    frame : Frame
        With a modulation of rising ramps only.
    doppler_hz : array (n,)
        Principal values.
    snr : array (n,)
        After integration over all channels, for the error of the beat frequency.
    noise_power : array (n,)
        E|w|^2 in one amplitude.

    Notes
    -----
    A residual of the best number that noise exceeds with a probability below 0.001 counts as
    noise.
    """
    n, n_slots = len(doppler_hz), frame.n_slots
    numbers = resolvable_ambiguity_numbers(frame, doppler_hz)
    by_slot = amplitudes.reshape(n, n_slots, amplitudes.shape[1] // n_slots)
    chirp = frame.chirp
    error_s = [ramp.shift_hz / chirp.slope_hz_per_s for ramp in frame.ramps]
    beat_std = np.sqrt(frequency_variance(snr=snr, n_points=chirp.n_samples))
    beat_std *= chirp.sample_rate_hz / (2 * np.pi)
    errors = _ERROR_GRID if any(error_s) else np.zeros(1)
    total = np.sum(abs(by_slot) ** 2, axis=(1, 2))
    power = np.empty((n, numbers.shape[1], len(errors)))
    for place, error in enumerate(errors):
        error_phase = np.exp(-2j * np.pi * error * beat_std[:, None] * np.array(error_s))
        compensation = slot_phase_factors(
            frame, doppler_hz[:, None] + numbers / frame.repetition_s
        ).conj()
        beams = np.einsum("nhl,nlr->nhr", compensation * error_phase[:, None], by_slot)
        power[:, :, place] = np.sum(abs(beams) ** 2, axis=2) / n_slots
    residual_freedom = amplitudes.shape[1] * (1 - 1 / n_slots)
    noise = noise_power + _MODEL_ERROR**2 * total / amplitudes.shape[1]
    unfitted = total - power.max(axis=(1, 2), initial=0.0)
    noise = np.where(
        unfitted > scipy.special.gammaincinv(residual_freedom, 0.999) * noise,
        unfitted / residual_freedom,
        noise,
    )
    log_p = scipy.special.logsumexp(power / noise[:, None, None] - errors**2 / 2, axis=2)
    weight = np.exp(log_p - log_p.max(axis=1, keepdims=True, initial=-np.inf))
    return AmbiguityHypotheses(weight / weight.sum(axis=1, keepdims=True), numbers)
