"""Error scores: bias and RMSE of the strongest detection of a target, on each axis."""

from typing import ClassVar, Literal

import numpy as np
import scipy

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.case_bounds import rms_error_bounds
from dechirp.evaluation.detected_targets import strongest_detection_rows_per_target_frame
from dechirp.evaluation.preconditions import check_scene_has_targets
from dechirp.evaluation.score.base import NO_ESTIMATE, Better, Estimate, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean
from dechirp.processing.direction_finding import checked_direction_aperture

Axis = Literal["range", "velocity", "azimuth", "elevation"]


@frozen_dataclass
class ErrorScore(Score):
    """Errors on one axis, of the strongest detection of a target in each frame.

    Frames in which a target is missed, or its detection has no value on the axis, do not count;
    nor do bodies, which have no single position.
    """

    axis: ClassVar[Axis]
    exponent: ClassVar[int]
    """Power of the errors that is summed."""
    n_sums: ClassVar[int] = 2

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())
        if all(target.body is not None for target in context.scene.targets):
            self._raise_score_undefined(
                "in a scene of bodies alone",
                "a target without a body, since a body has no single position",
                "add a target without a body",
            )
        if self.axis == "velocity" and not context.radar.frame.can_measure_velocity:
            self._raise_score_undefined(
                "with one chirp", "several chirps, which resolve velocities", "transmit more"
            )
        if self.axis in ("azimuth", "elevation"):
            self._check_angle_measurable(context)

    def _check_angle_measurable(self, context: TrialContext) -> None:
        chain = context.chain
        if chain.angle is None:
            self._raise_score_undefined(
                "with chain.angle none",
                "a direction estimator, and an array that resolves directions",
                "set chain.angle to {kind: fft}, with two virtual elements or more",
            )
        resolves_angle = checked_direction_aperture(
            context.radar, chain.field_of_view
        ).resolves_azimuth_and_elevation
        if not resolves_angle[("azimuth", "elevation").index(self.axis)]:
            way = "horizontally" if self.axis == "azimuth" else "vertically"
            self._raise_score_undefined(
                f"with an array that resolves no {self.axis}",
                f"elements that are separated {way}",
                "correct radar.array",
            )

    def _raise_score_undefined(self, value: str, expected: str, fix: str) -> None:
        raise InvalidSetting(
            "scores",
            value=f"{self.kind()}, {value}",
            expected=expected,
            fix=f"{fix}, or leave out {self.kind()}",
        )

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the sum of the errors to the power, for each target, and their number."""
        strongest = strongest_detection_rows_per_target_frame(result, context)
        units = {"range": "m", "velocity": "m_per_s"}
        errors = getattr(result.association, f"{self.axis}_error_{units.get(self.axis, 'rad')}")[
            strongest
        ]
        is_known = np.isfinite(errors)
        target, n = result.association.target[strongest][is_known], len(context.target_names)
        return np.stack(
            [
                np.bincount(target, errors[is_known] ** self.exponent, n),
                np.bincount(target, minlength=n),
            ],
            axis=1,
        )


@frozen_dataclass
class BiasScore(ErrorScore):
    """Mean error."""

    exponent: ClassVar[int] = 1

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums[_mask_of_trials_with_errors(sums)].T, confidence=confidence)

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return 0 where errors have a bound: estimates are the most likely values."""
        return 0.0 * rms_error_bounds(context)[self.axis]


@frozen_dataclass
class RmseScore(ErrorScore):
    """Root mean square error."""

    better: ClassVar[Better] = "less"
    exponent: ClassVar[int] = 2

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        r"""Estimate with a chi-square interval for the equivalent number of independent errors.

        .. math:: \nu = 2 q^2 / \mathrm{var}(q), \quad
            \mathrm{var}(q) = \frac{n}{n - 1} \frac{\sum (s_t - q c_t)^2}{(\sum c_t)^2}

        with s_t the sum of squares and c_t the number of errors of trial t, q = sum s / sum c
        (Satterthwaite 1946): about the number of errors if they are normal and independent, and
        never more; less if errors of a trial are dependent, or some are outliers. Times the square
        of the normal over Student's quantile, as the variance is estimated from n trials only; at
        least one error, the value for one trial.
        """
        squares, counts = sums[_mask_of_trials_with_errors(sums)].T
        if not len(counts):
            return NO_ESTIMATE
        n, tail, mean = len(counts), (1 - confidence) / 2, squares.sum() / counts.sum()
        n_equivalent, variance = 1.0, 0.0
        if n > 1:
            spread = np.sum((squares - mean * counts) ** 2) * n / (n - 1)
            variance = float(spread / counts.sum() ** 2)
            student_correction = scipy.special.ndtri(tail) / scipy.special.stdtrit(n - 1, tail)
            n_equivalent = float(counts.sum())
            if variance > 0:
                n_equivalent = max(
                    min(n_equivalent, 2 * mean**2 / variance) * student_correction**2, 1.0
                )
        half_degrees = n_equivalent / 2
        low, high = (
            mean * half_degrees / inverse_gamma
            for inverse_gamma in (
                scipy.special.gammainccinv(half_degrees, tail),
                scipy.special.gammaincinv(half_degrees, tail),
            )
        )
        return Estimate(*np.sqrt([mean, low, high]).tolist())

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        return rms_error_bounds(context)[self.axis]

    def combine_theoretical_values(self, values: np.ndarray) -> float:
        """Return the theoretical value of a single target, NaN for several.

        That of several targets depends on how often each is detected.
        """
        return float(values[0]) if len(values) == 1 else np.nan


def _mask_of_trials_with_errors(sums: np.ndarray) -> np.ndarray:
    """Return True for trials with errors: failed ones are NaN, others may have no detection."""
    return np.asarray(np.nan_to_num(sums[:, 1]) > 0)


@frozen_dataclass
class RangeBias(BiasScore):
    """Mean error of the range of a detected target."""

    unit: ClassVar[str | None] = "m"
    axis: ClassVar[Axis] = "range"


@frozen_dataclass
class RangeRmse(RmseScore):
    """Root mean square error of the range of a detected target."""

    unit: ClassVar[str | None] = "m"
    axis: ClassVar[Axis] = "range"


@frozen_dataclass
class VelocityBias(BiasScore):
    """Mean error of the velocity of a detected target."""

    unit: ClassVar[str | None] = "m_per_s"
    axis: ClassVar[Axis] = "velocity"


@frozen_dataclass
class VelocityRmse(RmseScore):
    """Root mean square error of the velocity of a detected target."""

    unit: ClassVar[str | None] = "m_per_s"
    axis: ClassVar[Axis] = "velocity"


@frozen_dataclass
class AzimuthBias(BiasScore):
    """Mean error of the azimuth of a detected target."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "azimuth"


@frozen_dataclass
class AzimuthRmse(RmseScore):
    """Root mean square error of the azimuth of a detected target."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "azimuth"


@frozen_dataclass
class ElevationBias(BiasScore):
    """Mean error of the elevation of a detected target."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "elevation"


@frozen_dataclass
class ElevationRmse(RmseScore):
    """Root mean square error of the elevation of a detected target."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "elevation"
