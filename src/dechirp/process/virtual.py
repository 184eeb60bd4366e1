"""From chirps in the order sent to channels: one for each transmitter and receiver."""

import numpy as np

from dechirp.radar.frame import Frame


def channels(samples: np.ndarray, frame: Frame) -> np.ndarray:
    """Part the transmitters of one frame; the samples themselves where there is one.

    Parameters
    ----------
    samples : array (chirp, rx, sample)
        All chirps of the frame in the order sent.
    frame : Frame
        Says which transmitter sent which of them.

    Returns
    -------
    array (chirp of one transmitter, channel, sample)
        Channel `tx * n_rx + rx`, both in the order of the array. A view where the samples are
        contiguous and the transmitters send in the order of the array.

    Notes
    -----
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
    order = [transmitter for (transmitter,) in frame.slots]
    if order != sorted(order):
        sent = sent.take(np.argsort(order), axis=1)
    return sent.reshape(frame.n_chirps, frame.n_slots * n_rx, n_samples)
