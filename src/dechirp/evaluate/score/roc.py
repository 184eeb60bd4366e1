"""Receiver operating characteristic: detections over false alarms, as the threshold moves."""

from dataclasses import replace
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from dechirp.core.checks import series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.expected import detection_probabilities
from dechirp.evaluate.gates import gates
from dechirp.evaluate.independent import rate
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_have_targets, must_rise
from dechirp.evaluate.score.base import Better, Estimate, Need, Score
from dechirp.evaluate.shares import share
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.maps import left_by
from dechirp.process.mitigation.noise import searched
from dechirp.process.spectrum import independent_rows


class Curve(NamedTuple):
    """A measured curve, and the intervals of both its axes; each (n_thresholds,)."""

    designed: np.ndarray
    """False-alarm probability that each threshold is made for."""
    false_alarm_probability: np.ndarray
    """Measured in a cell of noise alone."""
    false_alarm_low: np.ndarray
    false_alarm_high: np.ndarray
    detection_probability: np.ndarray
    detection_low: np.ndarray
    detection_high: np.ndarray


@value
class Roc(Score):
    """Detections and false alarms at the thresholds of several false-alarm probabilities.

    A target is detected where the largest cell within two resolution cells of it, over its
    threshold, exceeds it: so a target without power is found as often as noise exceeds it in
    any of those cells. False alarms are cells over threshold in maps of the scenario without
    targets. The one value is the area under the curve: the mean detection probability over the
    logarithm of the false-alarm probability for which thresholds are made, between the ends.
    """

    better: ClassVar[Better] = "more"
    needs: ClassVar[frozenset[Need]] = frozenset({"maps", "noise"})
    false_alarm_probabilities: tuple[float, ...] = (
        1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8,
    )  # fmt: skip
    """At least two, falling."""

    def __post_init__(self) -> None:
        where = "Roc.false_alarm_probabilities"
        told = series(where, self.false_alarm_probabilities, at_least=1e-15, at_most=0.5)
        if len(told) < 2 or any(np.diff(told) >= 0):
            raise InvalidSetting(
                where,
                got=list(told),
                need="two or more, each below the one before",
                fix="Write them from the largest to the smallest, such as [1e-2, 1e-4, 1e-6].",
            )
        object.__setattr__(self, "false_alarm_probabilities", told)

    @property
    def n_sums(self) -> int:  # type: ignore[override]
        """Hits at each threshold, looks, alarms at each, cells tested."""
        return 2 * len(self.false_alarm_probabilities) + 2

    def check(self, case: Case) -> None:
        """There must be targets, and ramps that rise."""
        must_have_targets(case, self.label())
        must_rise(case, self.label())

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Of each target; false alarms are those of all."""
        assert look.maps is not None and look.noise is not None
        chain, radar = case.chain, case.radar
        noise = chain.noise(radar)
        rows = independent_rows(radar.frame.chirp, noise.over_range)
        left = left_by(radar, chain)
        may = None if left is None else searched(left)
        unit = replace(chain.cfar, false_alarm_probability=None, offset=1.0)
        factors = _factors(
            chain.cfar, noise, rows.stop - rows.start, self.false_alarm_probabilities
        )
        n = len(factors)
        made = np.zeros((len(case.names), self.n_sums))
        for power, gate in zip(look.maps, gates(case), strict=True):
            own = (gate.range >= rows.start) & (gate.range < rows.stop)
            if may is not None:
                own &= may[gate.velocity, gate.range]
            at = np.stack([gate.velocity[own], gate.range[own] - rows.start], axis=1)
            within = np.ascontiguousarray(power[:, rows])
            level = within[at[:, 0], at[:, 1]] / unit.threshold_at(within, at, noise)
            over = level > factors[:, at[:, 1]]
            for target in range(len(made)):
                made[target, :n] += over[:, gate.target[own] == target].any(axis=1)
        made[:, n] = len(look.maps)
        within = np.ascontiguousarray(look.noise.power[:, rows])
        made[:, n + 1 : -1] = _alarms(within, unit.threshold(within, noise), factors, may, rows)
        made[:, -1] = look.noise.n_tested
        return made

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Area under the curve of detection probabilities, see `independent.share`."""
        n = len(self.false_alarm_probabilities)
        return share(sums[:, :n] @ self._weights, sums[:, n], confidence=confidence)

    def curve(self, sums: np.ndarray, *, confidence: float) -> Curve:
        """Measured curve of independent trials, (n_trials, n_sums), as `estimate` takes them."""
        n = len(self.false_alarm_probabilities)
        found = [share(sums[:, k], sums[:, n], confidence=confidence) for k in range(n)]
        false = [rate(sums[:, n + 1 + k], sums[:, -1], confidence=confidence) for k in range(n)]
        return Curve(
            np.array(self.false_alarm_probabilities), *np.array(false).T, *np.array(found).T
        )

    def theory_curve(self, case: Case) -> np.ndarray:
        """Detection probability at each threshold, (n_targets, n_thresholds).

        NaN where there is no law, see `expected.detection_probabilities`.
        """
        cfars = (
            replace(case.chain.cfar, false_alarm_probability=p, offset=None)
            for p in self.false_alarm_probabilities
        )
        cases = (replace(case, chain=replace(case.chain, cfar=cfar)) for cfar in cfars)
        return np.stack([detection_probabilities(one) for one in cases], axis=1)

    def theory(self, case: Case) -> np.ndarray:
        """Area under the curve of theory."""
        return np.asarray(self.theory_curve(case) @ self._weights)

    @property
    def _weights(self) -> np.ndarray:
        """Of each probability in the mean over their logarithm: the trapezoidal rule."""
        steps = -np.diff(np.log(self.false_alarm_probabilities))
        ends = np.append(steps, 0.0) + np.insert(steps, 0, 0.0)
        return np.asarray(ends / ends.sum())


@lru_cache(maxsize=16)
def _factors(cfar: Cfar, noise: Noise, n_rows: int, probabilities: tuple[float, ...]) -> np.ndarray:
    """Threshold over the statistic, for each probability and row, (n, n_rows) float32.

    From a map of ones: whatever the statistic makes of it, the factor makes the probability.
    """
    ones = np.ones((2 * cfar.ring.half_velocity + 1, n_rows), np.float32)
    alone = replace(cfar, false_alarm_probability=None, offset=1.0).threshold(ones, noise)[0]
    every = (replace(cfar, false_alarm_probability=p, offset=None) for p in probabilities)
    return np.stack([one.threshold(ones, noise)[0] for one in every]) / alone


def _alarms(
    power: np.ndarray,
    statistic: np.ndarray,
    factors: np.ndarray,
    may: np.ndarray | None,
    rows: slice,
) -> np.ndarray:
    """Cells over each threshold, (n,): of the few that are over the lowest."""
    over = power > statistic * factors[0]
    if may is not None:
        over &= may[:, rows]
    at = np.flatnonzero(over)
    level, factor = power.flat[at] / statistic.flat[at], factors[:, at % power.shape[1]]
    return np.count_nonzero(level > factor, axis=1)
