"""Comparison of two settings by paired Monte Carlo trials, with theory.

Scores, intervals and theory are those of studies: the same settings, seed and trial number give
the same sums there.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from dechirp.config.dumping import to_yaml_data
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import capture_warned_findings
from dechirp.core.threads import exclusive_single_thread
from dechirp.evaluation.detector_law import find_detector_law
from dechirp.evaluation.score.base import Score
from dechirp.evaluation.score.errors import AzimuthRmse, RangeRmse, VelocityRmse
from dechirp.evaluation.score.probabilities import (
    DetectionProbability,
    FalseAlarmProbability,
    FrameFalseAlarmProbability,
)
from dechirp.evaluation.trial import TrialContext
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.results import estimate_score
from dechirp.experiments.study.trial import TrialRunner
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.experiments.tune.gain import Gain, estimate_paired_gain

COMPARED_SCORES: tuple[Score, ...] = (
    DetectionProbability(),
    FrameFalseAlarmProbability(),
    FalseAlarmProbability(),
    RangeRmse(),
    VelocityRmse(),
    AzimuthRmse(),
)
"""Scores that are compared, where they apply to the settings."""
MAX_TRIALS = 20_000
"""Number of trials after which counting stops: proportions are known to 0.007, and the sums of
ten targets take 13 MB."""

# Groups of trials for the jackknife estimate of the spread of a difference. A hundred groups would
# reduce Student's quantile of 2.09 by only 0.1.
_N_GROUPS = 20


class ScoreEstimate(NamedTuple):
    """Score of one variant with its interval and theory."""

    value: float
    low: float
    high: float
    theory: float
    missing_theory: str = ""
    """Reason why there is no theory; empty if there is."""


@dataclass(frozen=True)
class ComparisonRow:
    """Score of one target, or of the whole scene, for both variants."""

    score: Score
    target: str | None
    """None for the whole scene."""
    a: ScoreEstimate | None
    """None if the score does not apply."""
    b: ScoreEstimate | None
    change: Gain | None
    """Difference B minus A in the same trials, with the certainty of its sign. None before two
    trials, or if the score does not apply to both."""


@dataclass(frozen=True)
class ChangedSetting:
    """Setting that differs between the variants."""

    path: str
    a: str
    b: str


class Comparison:
    """Alternating trials of variants A and B with the same random numbers.

    Each trial simulates the first frame, without tracks. Only `run_trials_for` does work.

    Parameters
    ----------
    a, b : Scenario
        Variants to compare; the seed of A applies to both.
    confidence : float
        Confidence of all two-sided intervals.

    Raises
    ------
    InvalidSetting
        If one is a recording: its truth is unknown, and it has only one trial.
    """

    def __init__(self, a: Scenario, b: Scenario, *, confidence: float = 0.95) -> None:
        self._confidence = confidence
        with exclusive_single_thread(), capture_warned_findings():
            self._a, self._b = _Variant(a, a.seed), _Variant(b, a.seed)
        self._pending_steps = self._compute_theory_and_trials_stepwise()
        self.n_trials = 0
        """Trials finished for both variants."""

    @property
    def is_done(self) -> bool:
        """True if all trials are finished."""
        return self.n_trials == MAX_TRIALS

    def run_trials_for(self, duration_s: float) -> None:
        """Work for a duration, and until the end of the current step.

        A step is one trial of one variant, or the theory of one score, computed once.

        Raises
        ------
        DechirpError
            If a trial fails.
        """
        until_s = perf_counter() + duration_s
        with exclusive_single_thread(), capture_warned_findings():
            for _ in self._pending_steps:
                if perf_counter() >= until_s:
                    return

    def comparison_rows_so_far(self) -> list[ComparisonRow]:
        """Return the results so far, by score and target."""
        keys = dict.fromkeys(
            (score, target)
            for score in COMPARED_SCORES
            for side in (self._a, self._b)
            for target in side.targets_with_score(score)
        )
        rows = (self._build_comparison_row(score, target) for score, target in keys)
        return [row for row in rows if row.a or row.b]

    def _compute_theory_and_trials_stepwise(self) -> Iterator[None]:
        sides = (self._a, self._b)
        for side in sides:
            for score in side.scores:
                side.compute_and_store_theory(score)
                yield
        for trial in range(MAX_TRIALS):
            for side in sides:
                side.run_trial_and_store_sums(trial)
                yield
            self.n_trials += 1

    def _build_comparison_row(self, score: Score, target: str | None) -> ComparisonRow:
        a, b = (self._estimate_score_of_variant(side, score, target) for side in (self._a, self._b))
        return ComparisonRow(
            score, target, a, b, self._estimate_score_difference(score, target) if a and b else None
        )

    def _estimate_score_of_variant(
        self, variant: "_Variant", score: Score, target: str | None
    ) -> ScoreEstimate | None:
        if target not in variant.targets_with_score(score):
            return None
        estimate = variant.estimate_score_with_theory(
            score, target, self.n_trials, self._confidence
        )
        return None if np.isnan([estimate.value, estimate.theory]).all() else estimate

    def _estimate_score_difference(self, score: Score, target: str | None) -> Gain | None:
        if self.n_trials < 2:
            return None
        sums_a, sums_b = (
            side.per_trial_score_sums(score, target, self.n_trials) for side in (self._a, self._b)
        )
        if not isinstance(score, DetectionProbability | FrameFalseAlarmProbability):
            sums_a, sums_b = _sum_trials_in_groups(sums_a), _sum_trials_in_groups(sums_b)

        def value_of(sums: np.ndarray) -> float:
            return score.estimate_with_interval(
                sums.sum(axis=0, keepdims=True), confidence=self._confidence
            ).value

        change = estimate_paired_gain(sums_a, sums_b, value_of, confidence=self._confidence)
        if change.value < 0:
            reversed_change = estimate_paired_gain(
                sums_b, sums_a, value_of, confidence=self._confidence
            )
            return change._replace(certainty=reversed_change.certainty)
        return change


class _Variant:
    """One of the two settings with the sums of its trials."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        first = replace(scenario, n_frames=1, tracker=None, group_tracker=None, ego_motion=None)
        case = build_trial_context(first)
        self.scores = tuple(score for score in COMPARED_SCORES if _is_score_applicable(score, case))
        self._runner = TrialRunner(first, self.scores, seed=seed)
        self._layout = self._runner.layout
        self._theory = {
            score: np.full(max(len(names), 1), np.nan)
            for score, names in zip(self.scores, self._layout.scored_target_names, strict=True)
        }
        # The system allocates pages only when trials write to them.
        self._sums = np.empty((MAX_TRIALS, self._layout.n_columns))

    def targets_with_score(self, score: Score) -> tuple[str | None, ...]:
        """Return the targets that a score has values for; None is the whole scene."""
        return (
            score.scored_target_names(self._runner.context) or (None,)
            if score in self.scores
            else ()
        )

    def compute_and_store_theory(self, score: Score) -> None:
        """Compute the theory of a score."""
        self._theory[score] = score.theoretical_values(self._runner.context)

    def run_trial_and_store_sums(self, trial: int) -> None:
        """Run one trial."""
        self._sums[trial] = self._runner.run_and_score(trial)

    def per_trial_score_sums(self, score: Score, target: str | None, n_trials: int) -> np.ndarray:
        """Return the sums of one score, (n_trials, n_sums)."""
        return self._layout.select_score_sums(self._sums[:n_trials], score.kind(), target)

    def estimate_score_with_theory(
        self, score: Score, target: str | None, n_trials: int, confidence: float
    ) -> ScoreEstimate:
        """Estimate a score from the trials so far, with its theory."""
        layout, label = self._layout, score.kind()
        estimate = estimate_score(
            layout, label, target, self._sums[:n_trials], confidence=confidence
        )
        laws = np.concatenate(list(self._theory.values()))
        theory = layout.theoretical_score_value(laws, label, target)
        reason = reason_of_missing_theory(score, target, self._runner.context)
        return ScoreEstimate(*estimate, theory, reason if np.isnan(theory) else "")


def reason_of_missing_theory(score: Score, target_name: str | None, context: TrialContext) -> str:
    """Return the reason why a score has no theory, as its functions list them.

    Only for a score without theory: the last reason is left when no other applies.
    """
    chain, radar = context.chain, context.radar
    target = None if target_name is None else context.scene.find_target(target_name)
    is_rate_of_noise = isinstance(score, FalseAlarmProbability | FrameFalseAlarmProbability)
    is_probability = isinstance(score, DetectionProbability)
    has_law = find_detector_law(chain.cfar, chain.map_noise_statistics(radar)) is not None
    is_white = np.isfinite(context.noise_power_w) and context.noise_power_w > 0
    is_steady = target is None or target.fluctuation == "steady"
    reasons = (
        (not is_white, "the noise is not white, or there is none"),
        (bool(chain.mitigation), "mitigation changes noise and echoes"),
        (is_rate_of_noise and chain.cfar.offset is not None, "this detector has no law of offsets"),
        (is_rate_of_noise, "so many false alarms occur in clusters"),
        (radar.frame.has_falling_ramps, "ramps also fall"),
        (target is not None and target.body is not None, "a body has many scatterers"),
        (not (is_steady or is_probability), "the echo fluctuates"),
        (is_probability and not has_law, "this detector has no closed law"),
        (is_probability, "other echoes are near, or it moves through range cells"),
        (True, "another echo is near, or the array does not resolve it"),
    )
    return next(reason for applies, reason in reasons if applies)


def _is_score_applicable(score: Score, trial_context: TrialContext) -> bool:
    """Return True if a score applies to a trial."""
    try:
        score.check_score_defined(trial_context)
    except InvalidSetting:
        return False
    return True


def _sum_trials_in_groups(trial_sums: np.ndarray) -> np.ndarray:
    """Sum trials in groups of nearly equal size, (n_groups, n_sums)."""
    n_groups = min(len(trial_sums), _N_GROUPS)
    starts = np.arange(n_groups) * len(trial_sums) // n_groups
    return np.asarray(np.add.reduceat(trial_sums, starts))


def changed_settings(a: Scenario, b: Scenario) -> list[ChangedSetting]:
    """Return the settings in which two scenarios differ, as settings files write them."""
    texts = [
        dict(_iter_leaf_paths_and_texts("", to_yaml_data(setting, None))) for setting in (a, b)
    ]
    paths = dict.fromkeys([*texts[0], *texts[1]])
    settings = (
        ChangedSetting(path, *(values.get(path, "none") for values in texts)) for path in paths
    )
    return [setting for setting in settings if setting.a != setting.b]


def _iter_leaf_paths_and_texts(parent_path: str, tree: Any) -> Iterator[tuple[str, str]]:
    if isinstance(tree, dict):
        for name, member in tree.items():
            yield from _iter_leaf_paths_and_texts(
                f"{parent_path}.{name}" if parent_path else name, member
            )
    elif isinstance(tree, list) and any(isinstance(member, dict) for member in tree):
        for index, member in enumerate(tree):
            name = member.get("name") or member.get("kind") or index
            yield from _iter_leaf_paths_and_texts(f"{parent_path}.{name}", member)
    else:
        yield parent_path, ", ".join(map(str, tree)) if isinstance(tree, list) else str(tree)
