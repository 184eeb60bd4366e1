"""Velocity ambiguity resolved by frames whose intervals differ."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.processing.velocity_ambiguity.hypotheses import AmbiguityHypotheses
from dechirp.radar.frame import Frame
from dechirp.radar.velocity_ambiguity import (
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)

# Standard deviation of the change of the radial velocity between frames, per second: braking and
# turning cars.
_ACCELERATION = 3.0  # m/s^2
# Probability that a target of one frame is detected in another.
_DETECTION_PROBABILITY = 0.9
# Least prior probability of a hypothesis from its own frame.
_MIN_PRIOR = 1e-6


class FrameEstimates(NamedTuple):
    """Estimates of the detections of a single frame; arrays (n,)."""

    number: int
    """Number of the frame, counted from one with the first interval."""
    time_s: float
    """Time to which the estimates refer."""
    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    """Aliased into the span about zero velocity."""
    range_std_m: np.ndarray
    velocity_std_m_per_s: np.ndarray
    hypotheses: AmbiguityHypotheses


def ambiguity_probabilities(
    frames: Sequence[FrameEstimates], frame: Frame
) -> list[AmbiguityHypotheses]:
    r"""Compute the probability of ambiguity numbers from all frames, by noisy remainders.

    A frame measures the velocity up to multiples of lambda / 2T of its interval T. The hypothesis h
    of a detection, v + h lambda / 2T, and the range coupled to it, predicts the range and the
    remainder of the velocity in the neighbouring frames, as many as there are intervals. For each
    such frame

    .. math::

        p \propto (1 - P) + P \sum_j \frac{N(\Delta v_j)\, N(\Delta R_j)}{\rho}

    over its detections j, rho their density: none need be this target. Variances are those of
    both standard errors, and of an acceleration of 3 m/s^2 in between. So a hypothesis gains from
    detections at the predicted place, less so in crowded maps, and loses little where a target
    fades. The probabilities from the frame alone are the prior. Detections of real samples also
    count as their mirror images, beyond an end of the range axis at the negative velocity: coupling
    shifts hypotheses across the end.

    Parameters
    ----------
    frames : sequence of FrameEstimates
        In any order; neighbours are compared by number.
    frame : Frame
        With its intervals and several chirps; the number of hypotheses is
        `Frame.n_resolvable_ambiguities_across_frames`.

    Returns
    -------
    list of AmbiguityHypotheses
        One for each frame.

    References
    ----------
    Of exact remainders: G. Trunk and S. Brockett, Range and velocity ambiguity resolution, IEEE
    National Radar Conference 1993. Of noisy ones: X.-G. Xia and G. Wang, Phase unwrapping and a
    robust Chinese remainder theorem, IEEE Signal Processing Letters 14(4), 2007.
    """
    by_number = {estimates.number: estimates for estimates in frames}
    resolved = []
    for estimates in frames:
        own_frame = frame.for_frame(estimates.number)
        span = unambiguous_velocity_span_m_per_s(estimates.range_m, own_frame)
        cycles = estimates.velocity_m_per_s / span
        numbers = _ambiguity_numbers_near_zero_velocity(
            cycles, frame.n_resolvable_ambiguities_across_frames(estimates.number)
        )
        range_m = estimates.range_m[:, None] - range_shift_per_ambiguity_m(own_frame) * numbers
        velocity = estimates.velocity_m_per_s[:, None] + span[:, None] * numbers
        log_p = np.log(
            _own_frame_probability(
                estimates.hypotheses,
                numbers,
                None if own_frame.has_falling_ramps else own_frame.n_resolvable_ambiguities,
            )
        )
        for number in range(
            estimates.number - frame.n_intervals + 1, estimates.number + frame.n_intervals
        ):
            other = by_number.get(number)
            if number == estimates.number or other is None or not other.range_m.size:
                continue
            other_estimates = _stack_estimates(other)
            if frame.chirp.sampling == "real":
                other_estimates = _append_mirror_images(other_estimates, frame.chirp.max_range_m)
            other_span = unambiguous_velocity_span_m_per_s(
                other_estimates[1], frame.for_frame(number)
            )
            log_p += _log_evidence_from_other_frame(
                range_m,
                velocity,
                _stack_estimates(estimates),
                other_estimates,
                other_span,
                range_shift_per_ambiguity_m(frame.for_frame(number)),
                other.range_m.size / (frame.chirp.range_bins_m()[-1] * other_span.mean()),
            )
        p = np.exp(log_p - log_p.max(axis=1, keepdims=True))
        resolved.append(AmbiguityHypotheses(p / p.sum(axis=1, keepdims=True), numbers))
    return resolved


def _stack_estimates(estimates: FrameEstimates) -> np.ndarray:
    """Stack the estimates of a frame, (5, n), see `_log_evidence_from_other_frame`."""
    time_s = np.full(estimates.range_m.size, estimates.time_s)
    variances = estimates.range_std_m**2, estimates.velocity_std_m_per_s**2
    return np.array([time_s, estimates.range_m, estimates.velocity_m_per_s, *variances])


def _append_mirror_images(estimates: np.ndarray, max_range_m: float) -> np.ndarray:
    """Append the image of each estimate, (5, n) to (5, 2 n), beyond the nearer end of the axis."""
    images = estimates.copy()
    end_m = np.where(estimates[1] < max_range_m / 2, 0.0, max_range_m)
    images[1] = 2 * end_m - estimates[1]
    images[2] = -estimates[2]
    return np.concatenate([estimates, images], axis=1)


def _ambiguity_numbers_near_zero_velocity(
    velocity_in_spans: np.ndarray, n_numbers: int
) -> np.ndarray:
    """Return the numbers nearest to zero velocity, (n, n_folds), for velocities in spans, (n,)."""
    return np.asarray(np.ceil(-n_numbers / 2 - velocity_in_spans)[:, None] + np.arange(n_numbers))


def _own_frame_probability(
    hypotheses: AmbiguityHypotheses, numbers: np.ndarray, n_folds: int | None
) -> np.ndarray:
    """Return the probability of each hypothesis from its own frame, (n, n_numbers).

    Slots resolve numbers up to multiples of n_folds; fully if None.
    """
    difference = numbers[:, :, None] - hypotheses.number[:, None, :]
    is_same = (difference if n_folds is None else difference % n_folds) == 0
    prior = np.where(is_same, hypotheses.probability[:, None, :], 0.0).sum(axis=2)
    is_known = np.isfinite(hypotheses.probability).all(axis=1, keepdims=True)
    return np.where(is_known, np.maximum(prior, _MIN_PRIOR), 1.0)


def _log_evidence_in_numpy(
    range_m: np.ndarray,
    velocity: np.ndarray,
    estimates: np.ndarray,
    other_estimates: np.ndarray,
    span: np.ndarray,
    coupling_m: float,
    density: float,
) -> np.ndarray:
    """Plain twin of `_log_evidence_from_other_frame`: equal within rounding."""
    likelihood = np.zeros(range_m.shape)
    for other, other_span in zip(other_estimates.T, span, strict=True):
        late_s = (other[0] - estimates[0])[:, None]
        changed = (_ACCELERATION * late_s) ** 2
        own_r, own_v = estimates[3, :, None], estimates[4, :, None]
        var_v = own_v + other[4] + changed
        var_r = own_r + other[3] + changed * late_s**2 / 4 + own_v * late_s**2
        dv = other[2] - velocity
        ambiguities = np.round(dv / other_span)
        z = (dv - ambiguities * other_span) ** 2 / var_v
        dr = other[1] + ambiguities * coupling_m - range_m - velocity * late_s
        density_there = np.exp(-(z + dr**2 / var_r) / 2) / (2 * np.pi * np.sqrt(var_v * var_r))
        likelihood += np.where(z > 50.0, 0.0, density_there)
    return np.log(1 - _DETECTION_PROBABILITY + _DETECTION_PROBABILITY * likelihood / density)


@kernel(plain=_log_evidence_in_numpy)
def _log_evidence_from_other_frame(
    range_m: np.ndarray,
    velocity: np.ndarray,
    estimates: np.ndarray,
    other_estimates: np.ndarray,
    span: np.ndarray,
    coupling_m: float,
    density: float,
) -> np.ndarray:
    """Compute the log likelihood of each hypothesis from another frame, (n, n_folds).

    `estimates` and `other_estimates`, (5, n): times, ranges, velocities, and the variances of those
    two. For each span added to the velocity of the others, `span` adds to it, and `coupling_m`
    decreases their range.
    """
    out = np.empty(range_m.shape)
    for i in range(range_m.shape[0]):
        for h in range(range_m.shape[1]):
            likelihood = 0.0
            for j in range(other_estimates.shape[1]):
                late_s = other_estimates[0, j] - estimates[0, i]
                changed = (_ACCELERATION * late_s) ** 2
                var_v = estimates[4, i] + other_estimates[4, j] + changed
                var_r = (
                    estimates[3, i]
                    + other_estimates[3, j]
                    + changed * late_s**2 / 4
                    + estimates[4, i] * late_s**2
                )
                dv = other_estimates[2, j] - velocity[i, h]
                ambiguities = np.round(dv / span[j])  # by which the other one is out
                dv -= ambiguities * span[j]
                z = dv * dv / var_v
                if z > 50.0:
                    continue
                dr = (
                    other_estimates[1, j]
                    + ambiguities * coupling_m
                    - range_m[i, h]
                    - velocity[i, h] * late_s
                )
                z += dr * dr / var_r
                likelihood += np.exp(-z / 2) / (2 * np.pi * np.sqrt(var_v * var_r))
            out[i, h] = np.log(
                1 - _DETECTION_PROBABILITY + _DETECTION_PROBABILITY * likelihood / density
            )
    return out
