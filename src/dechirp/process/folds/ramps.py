"""Which fold a velocity is in, told from ramps of one transmitter at other times or frequencies."""

import numpy as np
from scipy.special import gammaincinv, logsumexp

from dechirp.process.folds.ambiguity import Folds, hypotheses
from dechirp.process.virtual import turns
from dechirp.radar.frame import Frame
from dechirp.theory.bounds import frequency_variance

# By so much, relative to the echo, amplitudes of different slots differ beyond noise.
_UNKNOWN = 0.03
# Errors of the beat frequency that are summed over, in standard deviations.
_ERRORS = np.linspace(-4, 4, 33)


def unshifted(amplitudes: np.ndarray, fast: np.ndarray, frame: Frame) -> np.ndarray:
    """Amplitudes (n, n_slots * n_rx) less what the beat (n,) turns ramps of other frequencies.

    The beat is in rad per sample. A ramp that starts higher by d turns the echo by d tau = d
    (f_b - f_D) / S more: the part of the beat f_b is taken off here, that of the Doppler
    frequency f_D counts as time, `Frame.turning_s`.
    """
    if frame.ramps_are_alike:
        return amplitudes
    beat_hz = fast * frame.chirp.sample_rate_hz / (2 * np.pi)
    shift_s = np.array([ramp.shift_hz for ramp in frame.ramps]) / frame.chirp.slope_hz_per_s
    back = np.exp(-2j * np.pi * beat_hz[:, None] * shift_s)
    n_rx = amplitudes.shape[1] // frame.n_slots
    return amplitudes * np.repeat(back, n_rx, axis=1)


def folds(
    amplitudes: np.ndarray,
    frame: Frame,
    doppler_hz: np.ndarray,
    snr: np.ndarray,
    noise_power: np.ndarray,
) -> Folds:
    r"""Probability of each fold, from the amplitudes of the slots.

    .. math::

        p(h) \propto \int \exp \Big( \sum_r \frac{|\sum_l e^{-2\pi\mathrm{i} (f_h t_l + d_l
        \epsilon / S)} x_{l,r}|^2}{L \sigma^2} - \frac{\epsilon^2}{2 \sigma_b^2} \Big)
        \,\mathrm{d}\epsilon

    with f_h the Doppler frequency at fold h and t_l the times of `Frame.turning_s`: what is
    alike in all slots is the target's, an amplitude in each receiver that may be any. The error
    epsilon of the beat frequency turns slots of other frequencies, d_l higher.

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx)
        Of `unshifted`.
    frame : Frame
        Under a modulation whose ramps all rise.
    doppler_hz : array (n,)
        Principal values.
    snr : array (n,)
        After integration over all channels: how well the beat frequency is known.
    noise_power : array (n,)
        E|w|^2 in one amplitude.

    Notes
    -----
    Where more is left beside the best fold than noise leaves once in 1,000 times, what is left
    counts as noise.
    """
    n, n_slots = len(doppler_hz), frame.n_slots
    fold = hypotheses(frame, doppler_hz)
    by_slot = amplitudes.reshape(n, n_slots, amplitudes.shape[1] // n_slots)
    chirp = frame.chirp
    error_s = [ramp.shift_hz / chirp.slope_hz_per_s for ramp in frame.ramps]
    beat_std = np.sqrt(frequency_variance(snr=snr, n_points=chirp.n_samples))
    beat_std *= chirp.sample_rate_hz / (2 * np.pi)
    errors = _ERRORS if any(error_s) else np.zeros(1)
    total = np.sum(abs(by_slot) ** 2, axis=(1, 2))
    power = np.empty((n, fold.shape[1], len(errors)))
    for place, error in enumerate(errors):
        off = np.exp(-2j * np.pi * error * beat_std[:, None] * np.array(error_s))
        turned = turns(frame, doppler_hz[:, None] + fold / frame.repetition_s).conj()
        beams = np.einsum("nhl,nlr->nhr", turned * off[:, None], by_slot)
        power[:, :, place] = np.sum(abs(beams) ** 2, axis=2) / n_slots
    left = amplitudes.shape[1] * (1 - 1 / n_slots)
    noise = noise_power + _UNKNOWN**2 * total / amplitudes.shape[1]
    unfitted = total - power.max(axis=(1, 2), initial=0.0)
    noise = np.where(unfitted > gammaincinv(left, 0.999) * noise, unfitted / left, noise)
    log_p = logsumexp(power / noise[:, None, None] - errors**2 / 2, axis=2)
    weight = np.exp(log_p - log_p.max(axis=1, keepdims=True, initial=-np.inf))
    return Folds(weight / weight.sum(axis=1, keepdims=True), fold)
