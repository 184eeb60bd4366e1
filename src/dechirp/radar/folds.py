"""What a fold of the velocity is: after how much it goes round, and what range it moves."""

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.frame import Frame

NEVER = 2.0**40
"""Spans that are beyond every velocity: what goes round after so many does not."""


def span_m_per_s(range_m: np.ndarray, frame: Frame) -> np.ndarray:
    """By what a fold moves the velocity of echoes from such ranges, (n,).

    lambda / 2T of the frequency that they have at mid-window, T from a chirp of a transmitter to
    its next. `frame`: with one interval, see `Frame.at`.
    """
    chirp = frame.chirp
    echo_hz = chirp.mean_sampled_frequency_hz - range_m / chirp.range_m(1.0)
    return np.asarray(SPEED_OF_LIGHT / (2 * echo_hz * frame.repetition_s))


def coupling_m(frame: Frame) -> float:
    """What a fold takes off the range; nothing of that of a triangle, which both beats tell."""
    return 0.0 if frame.falls else float(frame.chirp.range_m(1.0)) / frame.repetition_s


def n_told(fold: np.ndarray, frame: Frame, number: int) -> np.ndarray:
    """After how many spans velocities of one frame go round, (n,); 2^40 where they do not.

    Parameters
    ----------
    fold : array (n,)
        Of each detection, NaN where it is not known: after one span.
    frame : Frame
        With all its intervals.
    number : int
        Which of the frames.
    """
    if frame.falls and frame.n_chirps == 1:  # two beats alone tell it
        return np.full(fold.shape, NEVER)
    if frame.falls:
        known = NEVER
    elif frame.n_intervals > 1:
        known = float(frame.n_folds_in_turn(number))
    else:
        known = float(frame.n_folds)
    return np.where(np.isnan(fold), 1.0, known)
