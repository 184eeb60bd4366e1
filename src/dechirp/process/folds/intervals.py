"""Which fold a velocity is in, told from frames whose intervals differ."""

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from dechirp.process.folds.ambiguity import Folds
from dechirp.radar.folds import coupling_m, span_m_per_s
from dechirp.radar.frame import Frame

# Targets change their radial velocity from frame to frame by as much in a second, as standard
# deviation: braking and turning cars.
_ACCELERATION = 3.0  # m/s^2
# A target that is in one frame is found in another.
_IS_FOUND = 0.9
# No fold is as unlikely by what a frame alone tells.
_SURE = 1e-6


class Alone(NamedTuple):
    """What a frame by itself tells of its detections; arrays (n,)."""

    number: int
    """Of the frame, counted from the one that has the first interval."""
    time_s: float
    """To which the estimates refer."""
    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    """Of the fold about zero velocity."""
    range_std_m: np.ndarray
    velocity_std_m_per_s: np.ndarray
    folds: Folds


def folds(frames: Sequence[Alone], frame: Frame) -> list[Folds]:
    r"""Folds of the detections of each frame that explain those of all, by a noisy remainder.

    A frame tells the velocity up to multiples of lambda / 2T, T its own. The hypothesis h of a
    detection, v + h lambda / 2T, and with it another range by range-Doppler coupling, says
    where the target is in the frames about it, as many as there are intervals, and at which
    remainder. For each such frame

    .. math::

        p \propto (1 - P) + P \sum_j \frac{N(\Delta v_j)\, N(\Delta R_j)}{\rho}

    over its detections j, rho their density: none need be this target. Variances are those of
    both standard errors, and of 3 m/s^2 in between. So a hypothesis gains from what lies where
    it says, the less the more crowded it is there, and loses little where a target fades. What
    the frame alone tells of its folds counts as well.

    Parameters
    ----------
    frames : sequence of Alone
        In any order; those next to each other compare.
    frame : Frame
        With its intervals, and chirps that tell velocities; as many folds are told as
        `Frame.n_folds_in_turn` says.

    Returns
    -------
    list of Folds
        For each of the frames.

    References
    ----------
    Of exact remainders: G. Trunk and S. Brockett, Range and velocity ambiguity resolution, IEEE
    National Radar Conference 1993. Of noisy ones: X.-G. Xia and G. Wang, Phase unwrapping and a
    robust Chinese remainder theorem, IEEE Signal Processing Letters 14(4), 2007.
    """
    by_number = {one.number: one for one in frames}
    told = []
    for own in frames:
        one = frame.at(own.number)
        span = span_m_per_s(own.range_m, one)
        cycles = own.velocity_m_per_s / span
        fold = _hypotheses(cycles, frame.n_folds_in_turn(own.number))
        range_m = own.range_m[:, None] - coupling_m(one) * fold
        velocity = own.velocity_m_per_s[:, None] + span[:, None] * fold
        log_p = np.log(_prior(own.folds, fold, None if one.falls else one.n_folds))
        for number in range(own.number - frame.n_intervals + 1, own.number + frame.n_intervals):
            other = by_number.get(number)
            if number == own.number or other is None or not other.range_m.size:
                continue
            other_span = span_m_per_s(other.range_m, frame.at(number))
            log_p += _log_evidence(
                range_m,
                velocity,
                _measured(own),
                _measured(other),
                other_span,
                coupling_m(frame.at(number)),
                other.range_m.size / (frame.chirp.range_bins_m()[-1] * other_span.mean()),
            )
        p = np.exp(log_p - log_p.max(axis=1, keepdims=True))
        told.append(Folds(p / p.sum(axis=1, keepdims=True), fold))
    return told


def _measured(alone: Alone) -> np.ndarray:
    """(5, n): see `_log_evidence`."""
    time_s = np.full(alone.range_m.size, alone.time_s)
    variances = alone.range_std_m**2, alone.velocity_std_m_per_s**2
    return np.array([time_s, alone.range_m, alone.velocity_m_per_s, *variances])


def _hypotheses(cycles: np.ndarray, n_folds: int) -> np.ndarray:
    """So many folds nearest to zero velocity, (n, n_folds), of velocities in spans, (n,)."""
    return np.asarray(np.ceil(-n_folds / 2 - cycles)[:, None] + np.arange(n_folds))


def _prior(alone: Folds, fold: np.ndarray, n_folds: int | None) -> np.ndarray:
    """What a frame alone has told of each hypothesis, (n, most).

    Slots tell folds up to multiples of n_folds; none: they tell each.
    """
    apart = fold[:, :, None] - alone.fold[:, None, :]
    same = (apart if n_folds is None else apart % n_folds) == 0
    known = np.where(same, alone.probability[:, None, :], 0.0).sum(axis=2)
    is_known = np.isfinite(alone.probability).all(axis=1, keepdims=True)
    return np.where(is_known, np.maximum(known, _SURE), 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_evidence(
    range_m: np.ndarray,
    velocity: np.ndarray,
    own: np.ndarray,
    other: np.ndarray,
    span: np.ndarray,
    coupling_m: float,
    density: float,
) -> np.ndarray:
    """What the detections of another frame say of each hypothesis, (n, n_folds).

    `own` and `other`, (5, n): times, ranges, velocities, and the variances of those two. `span`
    and `coupling_m`: by what a fold of the others moves their velocity, and takes off their range.
    """
    out = np.empty(range_m.shape)
    for i in range(range_m.shape[0]):
        for h in range(range_m.shape[1]):
            likelihood = 0.0
            for j in range(other.shape[1]):
                late_s = other[0, j] - own[0, i]
                changed = (_ACCELERATION * late_s) ** 2
                var_v = own[4, i] + other[4, j] + changed
                var_r = own[3, i] + other[3, j] + changed * late_s**2 / 4 + own[4, i] * late_s**2
                dv = other[2, j] - velocity[i, h]
                folds = np.round(dv / span[j])  # by which the other one is out
                dv -= folds * span[j]
                z = dv * dv / var_v
                if z > 50.0:
                    continue
                dr = other[1, j] + folds * coupling_m - range_m[i, h] - velocity[i, h] * late_s
                z += dr * dr / var_r
                likelihood += np.exp(-z / 2) / (2 * np.pi * np.sqrt(var_v * var_r))
            out[i, h] = np.log(1 - _IS_FOUND + _IS_FOUND * likelihood / density)
    return out
