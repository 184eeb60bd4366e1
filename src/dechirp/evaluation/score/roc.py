"""Receiver operating characteristic: detections over false alarms, as the threshold moves."""

from dataclasses import replace
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from dechirp.core.checks import check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.gates import target_gate_cells
from dechirp.evaluation.preconditions import check_no_triangular_ramps, check_scene_has_targets
from dechirp.evaluation.predicted_detection import theoretical_detection_probabilities
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_rate
from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.mitigation.noise_loss import sufficient_noise_gain_mask
from dechirp.processing.range_doppler_map import residual_noise_gain
from dechirp.processing.spectrum import (
    nearest_circular_noise_rows,
    rows_with_circular_noise,
    searched_cell_mask,
)


class RocCurve(NamedTuple):
    """Measured curve with the intervals of both axes; each (n_thresholds,)."""

    designed: np.ndarray
    """Design false-alarm probability of each threshold."""
    false_alarm_probability: np.ndarray
    """Measured in cells of noise alone."""
    false_alarm_low: np.ndarray
    false_alarm_high: np.ndarray
    detection_probability: np.ndarray
    detection_low: np.ndarray
    detection_high: np.ndarray


@frozen_dataclass
class Roc(Score):
    """Detections and false alarms at the thresholds of several false-alarm probabilities.

    A target is detected if any cell within two resolution cells of it exceeds its threshold: so a
    target without power is detected as often as noise exceeds it in any of those cells. False
    alarms are cells over threshold in maps of the scenario without targets. Of real samples, those
    at the ends of the range axis are left out: their false-alarm probability is the same. The
    single value is the area under the curve: the mean detection probability over the logarithm of
    the design false-alarm probability, between the ends.
    """

    better: ClassVar[Better] = "more"
    needs: ClassVar[frozenset[Need]] = frozenset({"maps", "noise"})
    false_alarm_probabilities: tuple[float, ...] = (
        1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8,
    )  # fmt: skip
    """At least two, falling."""

    def __post_init__(self) -> None:
        where = "Roc.false_alarm_probabilities"
        probabilities = check_numbers(
            where, self.false_alarm_probabilities, at_least=1e-15, at_most=0.5
        )
        if len(probabilities) < 2 or any(np.diff(probabilities) >= 0):
            raise InvalidSetting(
                where,
                value=list(probabilities),
                expected="two or more values in descending order",
                fix="write them from the largest to the smallest, such as [1e-2, 1e-4, 1e-6]",
            )
        object.__setattr__(self, "false_alarm_probabilities", probabilities)

    @property
    def n_sums(self) -> int:  # type: ignore[override]
        """Hits at each threshold, attempts, alarms at each threshold, tested cells."""
        return 2 * len(self.false_alarm_probabilities) + 2

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())
        check_no_triangular_ramps(context, self.kind())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the sums of each target; false alarms are common to all."""
        assert result.maps is not None and result.noise is not None
        chain, radar = context.chain, context.radar
        noise = chain.map_noise_statistics(radar)
        rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
        searched_cells = searched_cell_mask(
            radar.frame.chirp, noise.range_transform, noise.doppler_transform
        )
        residual_noise_map = residual_noise_gain(radar, chain)
        usable = (
            None if residual_noise_map is None else sufficient_noise_gain_mask(residual_noise_map)
        )
        unit = replace(chain.cfar, false_alarm_probability=None, offset=1.0)
        factors = _threshold_factors(
            chain.cfar, noise, rows.stop - rows.start, self.false_alarm_probabilities
        )
        n = len(factors)
        sums = np.zeros((len(context.target_names), self.n_sums))
        for power, gate in zip(result.maps, target_gate_cells(context), strict=True):
            is_searched = searched_cells[gate.velocity, gate.range]
            if usable is not None:
                is_searched &= usable[gate.velocity, gate.range]
            velocity, row = gate.velocity[is_searched], gate.range[is_searched]
            cells = np.stack([velocity, nearest_circular_noise_rows(row, rows)], axis=1)
            level = power[velocity, row] / unit.threshold_at_cells(
                np.ascontiguousarray(power[:, rows]), cells, noise
            )
            is_over = level > factors[:, cells[:, 1]]
            for target in range(len(sums)):
                sums[target, :n] += is_over[:, gate.target[is_searched] == target].any(axis=1)
        sums[:, n] = len(result.maps)
        searched_power = np.ascontiguousarray(result.noise.power[:, rows])
        sums[:, n + 1 : -1] = _count_cells_over_thresholds(
            searched_power, unit.threshold(searched_power, noise), factors, usable, rows
        )
        sums[:, -1] = result.noise.n_tested
        return sums

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate the area under the curve, see `proportions.estimate_proportion`."""
        n = len(self.false_alarm_probabilities)
        return estimate_proportion(
            sums[:, :n] @ self._trapezoid_weights, sums[:, n], confidence=confidence
        )

    def estimate_roc_curve(self, sums: np.ndarray, *, confidence: float) -> RocCurve:
        """Estimate the curve from independent trials, (n_trials, n_sums)."""
        n = len(self.false_alarm_probabilities)
        detections = [
            estimate_proportion(sums[:, k], sums[:, n], confidence=confidence) for k in range(n)
        ]
        false_alarms = [
            estimate_rate(sums[:, n + 1 + k], sums[:, -1], confidence=confidence) for k in range(n)
        ]
        return RocCurve(
            np.array(self.false_alarm_probabilities),
            *np.array(false_alarms).T,
            *np.array(detections).T,
        )

    def theoretical_roc_probabilities(self, context: TrialContext) -> np.ndarray:
        """Return the detection probability at each threshold, (n_targets, n_thresholds).

        NaN without a law, see `predicted_detection.theoretical_detection_probabilities`.
        """
        cfars = (
            replace(context.chain.cfar, false_alarm_probability=p, offset=None)
            for p in self.false_alarm_probabilities
        )
        cases = (replace(context, chain=replace(context.chain, cfar=cfar)) for cfar in cfars)
        return np.stack(
            [theoretical_detection_probabilities(threshold_context) for threshold_context in cases],
            axis=1,
        )

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return the area under the theoretical curve."""
        return np.asarray(self.theoretical_roc_probabilities(context) @ self._trapezoid_weights)

    @property
    def _trapezoid_weights(self) -> np.ndarray:
        """Weights of the trapezoidal rule over the logarithm of the probabilities."""
        steps = -np.diff(np.log(self.false_alarm_probabilities))
        ends = np.append(steps, 0.0) + np.insert(steps, 0, 0.0)
        return np.asarray(ends / ends.sum())


@lru_cache(maxsize=16)
def _threshold_factors(
    cfar: Cfar, noise: MapNoise, n_rows: int, probabilities: tuple[float, ...]
) -> np.ndarray:
    """Return the threshold over the statistic, for each probability and row, (n, n_rows) float32.

    Computed from a map of ones, since the factor does not depend on the map.
    """
    ones = np.ones((2 * cfar.training_window.half_velocity + 1, n_rows), np.float32)
    unit_threshold = replace(cfar, false_alarm_probability=None, offset=1.0).threshold(ones, noise)[
        0
    ]
    cfars = (replace(cfar, false_alarm_probability=p, offset=None) for p in probabilities)
    return (
        np.stack([threshold_cfar.threshold(ones, noise)[0] for threshold_cfar in cfars])
        / unit_threshold
    )


def _count_cells_over_thresholds(
    power: np.ndarray,
    noise_statistic: np.ndarray,
    threshold_factors: np.ndarray,
    usable: np.ndarray | None,
    rows: slice,
) -> np.ndarray:
    """Count cells over each threshold, (n,), among the few over the lowest."""
    is_over = power > noise_statistic * threshold_factors[0]
    if usable is not None:
        is_over &= usable[:, rows]
    cells = np.flatnonzero(is_over)
    level, factor = (
        power.flat[cells] / noise_statistic.flat[cells],
        threshold_factors[:, cells % power.shape[1]],
    )
    return np.count_nonzero(level > factor, axis=1)
