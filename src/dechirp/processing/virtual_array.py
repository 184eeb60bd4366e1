"""Channels of a frame from its chirps, and elements of the virtual array from channels."""

from functools import lru_cache

import numpy as np

from dechirp.radar.frame import Frame


def split_chirps_into_slots(samples: np.ndarray, frame: Frame) -> np.ndarray:
    """Split the chirps of one frame into the slots of its rounds; a single slot is returned as is.

    Parameters
    ----------
    samples : array (chirp, rx, sample)
        All chirps of the frame in the order sent.
    frame : Frame
        Its code: the transmitters of each chirp.

    Returns
    -------
    array (round, channel, sample)
        Channel `slot * n_rx + rx`, slots in the order sent. A view where the samples are
        contiguous, unless ramps fall.

    Notes
    -----
    Where several transmitters send together, each slot contains the sum of their echoes, each
    times its factor in the code; `element_amplitudes` decodes them, detection by detection.
    Detection itself needs no decoding: over a round the factors of different transmitters are
    orthogonal, so the powers of the slots add up to n_slots times those of the echoes of all
    transmitters, whatever their phases: mixed terms cancel (Parseval). Velocities are those
    of the rounds.

    Channels of different slots sample a moving target at different times: from slot to slot its
    phase advances by 4 pi v T / lambda (1.7 rad at 15 m/s, 35 us and 77 GHz) and its range by
    v T. Sums of powers do not depend on the phase. They do not depend on the range either as
    long as the walk within the whole frame stays within a range cell, v n_sent T < c / 2B, as it
    must for one transmitter; from slot to slot it is n_sent times smaller.

    The beat of a falling ramp is -S tau + f_D. Its samples in reverse order are those of a rising
    one with the opposite motion within each chirp: S tau - f_D. So both echoes appear at their
    velocity, and f_D / S in delay on either side of their range, see
    `processing.velocity_ambiguity.triangular_pairing`; and the transmitted frequency grows with
    the sample in both.
    """
    if frame.n_slots == 1:
        return samples
    _, n_rx, n_samples = samples.shape
    falls = np.array([ramp.sign < 0 for ramp in frame.ramps])
    if falls.any():
        samples = samples.reshape(frame.n_chirps, frame.n_slots, n_rx, n_samples).copy()
        samples[:, falls] = samples[:, falls, :, ::-1]
    return samples.reshape(frame.n_chirps, frame.n_slots * n_rx, n_samples)


def slot_phase_factors(frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    """Return the phase factors of each slot of a round due to motion, (..., n_slots) complex."""
    return np.asarray(
        np.exp(2j * np.pi * np.asarray(doppler_hz)[..., None] * frame.doppler_phase_times_s)
    )


def element_amplitudes(amplitudes: np.ndarray, frame: Frame, doppler_hz: np.ndarray) -> np.ndarray:
    r"""Compute the amplitudes of the virtual elements from those of the channels.

    .. math:: x_{l,r} = \sum_t W_{l,t}\, a_{t,r}\, e^{2\pi\mathrm{i} f_D t_l}

    is the amplitude of a target in slot l, sent t_l after the first of its round: the code times
    the amplitude of each antenna pair, times the phase factor of the motion since. The phase is
    compensated, then the code decoded by its pseudo-inverse (its conjugate over n_slots if
    orthogonal).

    Parameters
    ----------
    amplitudes : array (n, n_slots * n_rx), complex
        Of each detection in each channel, see `split_chirps_into_slots`.
    frame : Frame
        Its code and times.
    doppler_hz : array (n,)
        Unambiguous Doppler frequencies: an error of 1 / repetition changes the phases between
        transmitters, and with them the angle.

    Returns
    -------
    array (n, n_tx * n_rx), complex
        Element tx * n_rx + rx, as `Array.virtual_positions_m`.

    References
    ----------
    J. Bechter, F. Roos and C. Waldschmidt, Compensation of motion-induced phase errors in TDM
    MIMO radars, IEEE Microwave and Wireless Components Letters 27(12), 2017.
    """
    n_slots, n_tx = np.shape(frame.weights)
    still = slot_phase_factors(frame, doppler_hz).conj()
    n, n_channels = amplitudes.shape
    by_slot = amplitudes.reshape(n, n_slots, n_channels // n_slots) * still[:, :, None]
    parted = np.einsum("tl,nlr->ntr", _decoding_matrix(frame.weights), by_slot)
    return np.asarray(parted.reshape(len(amplitudes), n_tx * parted.shape[2]))


def element_to_channel_noise_ratio(frame: Frame) -> float:
    """Return the noise power in an element over that in a channel.

    1 / n_slots where all transmitters send in every slot. The mean over the transmitters, which
    differ where their code is not orthogonal.
    """
    return float(np.sum(np.abs(_decoding_matrix(frame.weights)) ** 2) / len(frame.weights[0]))


@lru_cache
def can_separate_transmitters(frame: Frame) -> bool:
    """Return whether the code of a round separates all transmitters."""
    code = np.array(frame.weights)
    return bool(np.linalg.matrix_rank(code, tol=1e-3 * len(code)) == code.shape[1])


@lru_cache
def _decoding_matrix(weights: tuple[tuple[complex, ...], ...]) -> np.ndarray:
    """Return the matrix from slots to transmitters, (n_tx, n_slots)."""
    return np.asarray(np.linalg.pinv(weights))
