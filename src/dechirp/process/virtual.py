"""From chirps in the order sent to channels, and from channels to the virtual array."""

from functools import lru_cache

import numpy as np

from dechirp.radar.frame import Frame


def channels(samples: np.ndarray, frame: Frame) -> np.ndarray:
    """Part the slots of one frame; the samples themselves where there is one.

    Parameters
    ----------
    samples : array (chirp, rx, sample)
        All chirps of the frame in the order sent.
    frame : Frame
        Says which transmitters sent which of them.

    Returns
    -------
    array (round, channel, sample)
        Channel `slot * n_rx + rx`, slots in the order sent. A view where the samples are
        contiguous, unless ramps fall.

    Notes
    -----
    Where several transmitters send together, each slot holds the sum of their echoes, each
    times its factor in the code; `elements` parts them, detection by detection. Detection
    itself needs no parting: over a round the factors of different transmitters are
    orthogonal, so the powers of the slots add up to n_slots times those of the echoes of all
    transmitters, whatever their phases: mixed terms cancel (Parseval). Velocities are those
    of the rounds.

    Channels of different slots see a moving target at different times: from slot to slot its
    beat turns by 4 pi v T / lambda (1.7 rad at 15 m/s, 35 us and 77 GHz) and its range moves
    by v T. Sums of powers do not mind the phase. They do not mind the range either as long
    as the walk within the whole frame stays within a range cell, v n_sent T < c / 2B, as it
    must for one transmitter; from slot to slot it is n_sent times smaller.

    The beat of a falling ramp is -S tau + f_D. Its samples backwards are those of a rising one
    that moves the other way within each chirp: S tau - f_D. So the echoes of both kinds lie at
    their velocity, and f_D / S apart in delay on each side of their range, see
    `process.folds.pairing`; and the frequency sent grows with the sample in both.
    """
    if frame.n_slots == 1:
        return samples
    _, n_rx, n_samples = samples.shape
    falls = np.array([ramp.sign < 0 for ramp in frame.ramps])
    if falls.any():
        samples = samples.reshape(frame.n_chirps, frame.n_slots, n_rx, n_samples).copy()
        samples[:, falls] = samples[:, falls, :, ::-1]
    return samples.reshape(frame.n_chirps, frame.n_slots * n_rx, n_samples)


def turns(frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    """How far motion turns each slot of a round on from the first, (..., n_slots) complex."""
    return np.asarray(np.exp(2j * np.pi * np.asarray(doppler_hz)[..., None] * frame.turning_s))


def elements(amplitudes: np.ndarray, frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    r"""Amplitudes of the virtual elements, from those of the channels.

    .. math:: x_{l,r} = \sum_t W_{l,t}\, a_{t,r}\, e^{2\pi\mathrm{i} f_D t_l}

    is what slot l, sent t_l after the first of its round, holds of a target: the code times
    what each pair of antennas sees, turned on by the motion since. The turn is undone, then
    the code, by its pseudo-inverse (its conjugate over n_slots for an orthogonal one).

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        Of each detection in each channel, see `channels`.
    frame : Frame
        Its code and times.
    doppler_hz : array (n,)
        Doppler frequencies, unfolded: a fold of 1 / repetition left in them turns the
        transmitters against each other, and with them the angle.

    Returns
    -------
    array (n, n_tx * n_rx), complex
        Element tx * n_rx + rx, as `Array.virtual_m`.

    References
    ----------
    J. Bechter, F. Roos and C. Waldschmidt, Compensation of motion-induced phase errors in TDM
    MIMO radars, IEEE Microwave and Wireless Components Letters 27(12), 2017.
    """
    n_slots, n_tx = np.shape(frame.weights)
    still = turns(frame, doppler_hz).conj()
    n, n_channels = amplitudes.shape
    by_slot = amplitudes.reshape(n, n_slots, n_channels // n_slots) * still[:, :, None]
    parted = np.einsum("tl,nlr->ntr", _parting(frame.weights), by_slot)
    return np.asarray(parted.reshape(len(amplitudes), n_tx * parted.shape[2]))


def element_noise(frame: Frame) -> float:
    """Noise power in an element over that in a channel: 1 / n_slots where all send in every slot.

    The mean over the transmitters, which differ where their code is not orthogonal.
    """
    return float(np.sum(np.abs(_parting(frame.weights)) ** 2) / len(frame.weights[0]))


@lru_cache
def parts(frame: Frame) -> bool:
    """Whether the code of a round tells every transmitter from the others."""
    code = np.array(frame.weights)
    return bool(np.linalg.matrix_rank(code, tol=1e-3 * len(code)) == code.shape[1])


@lru_cache
def _parting(weights: tuple[tuple[complex, ...], ...]) -> np.ndarray:
    """From slots to transmitters, (n_tx, n_slots)."""
    return np.asarray(np.linalg.pinv(weights))
