"""Velocity ambiguity: unambiguous span, and the range shift of each ambiguity number."""

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.frame import Frame

UNAMBIGUOUS = 2.0**40
"""Number of spans beyond every velocity, for velocities that do not alias."""


def unambiguous_velocity_span_m_per_s(range_m: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the unambiguous velocity span of echoes from given ranges, (n,).

    lambda / 2T of the frequency that they have at mid-window, T from a chirp of a transmitter to
    its next. `frame` has a single interval, see `Frame.for_frame`.
    """
    chirp = frame.chirp
    echo_hz = chirp.mean_sampled_frequency_hz - range_m / chirp.range_m(1.0)
    return np.asarray(SPEED_OF_LIGHT / (2 * echo_hz * frame.repetition_s))


def range_shift_per_ambiguity_m(frame: Frame) -> float:
    """Return the decrease in range for each ambiguity number, by range-Doppler coupling.

    0 for a triangle, whose two beat frequencies determine the range without coupling.
    """
    return 0.0 if frame.has_falling_ramps else float(frame.chirp.range_m(1.0)) / frame.repetition_s


def n_spans_until_aliasing(
    ambiguity_number: np.ndarray, frame: Frame, frame_index: int
) -> np.ndarray:
    """Return the number of spans after which velocities of a frame alias; 2^40 if never, (n,).

    Parameters
    ----------
    ambiguity_number : array (n,)
        Ambiguity number of each detection; NaN where unknown, which gives one span.
    frame : Frame
        With all its intervals.
    frame_index : int
        Index of the frame.
    """
    if frame.has_falling_ramps and frame.n_chirps == 1:  # two beats alone determine the velocity
        return np.full(ambiguity_number.shape, UNAMBIGUOUS)
    if frame.has_falling_ramps:
        n_resolvable = UNAMBIGUOUS
    elif frame.n_intervals > 1:
        n_resolvable = float(frame.n_resolvable_ambiguities_across_frames(frame_index))
    else:
        n_resolvable = float(frame.n_resolvable_ambiguities)
    return np.where(np.isnan(ambiguity_number), 1.0, n_resolvable)
