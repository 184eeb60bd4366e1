"""From chirps in the order sent to channels: one for each slot of a round and receiver."""

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
        Where transmitters take turns, channel `tx * n_rx + rx`, both in the order of the array;
        else `slot * n_rx + rx`, slots in the order sent. A view where the samples are
        contiguous, unless the transmitters send in another order than that of the array.

    Notes
    -----
    Where several transmitters send together, each slot holds the sum of their echoes, each
    times its factor in the code, and they are not decoded: they stay together. That is no
    loss for detection. Over a round the factors of different transmitters are orthogonal, so
    the powers of the slots add up to n_slots times those of the echoes of all transmitters,
    whatever their phases: mixed terms cancel (Parseval). Velocities are those of the rounds.

    Channels of different slots see a moving target at different times: from slot to slot its
    beat turns by 4 pi v T / lambda (1.7 rad at 15 m/s, 35 us and 77 GHz) and its range moves
    by v T. Sums of powers do not mind the phase. They do not mind the range either as long
    as the walk within the whole frame stays within a range cell, v n_sent T < c / 2B, as it
    must for one transmitter; from slot to slot it is n_sent times smaller.
    """
    if frame.n_slots == 1:
        return samples
    _, n_rx, n_samples = samples.shape
    sent = samples.reshape(frame.n_chirps, frame.n_slots, n_rx, n_samples)
    turns = frame.turns
    if turns is not None and list(turns) != sorted(turns):
        sent = sent.take(np.argsort(turns), axis=1)
    return sent.reshape(frame.n_chirps, frame.n_slots * n_rx, n_samples)
