"""Run a search: try candidates one by one, then confirm the best one on new trials."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from dechirp.config.dumping import dump_yaml
from dechirp.core.argument_types import check_argument_types
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding
from dechirp.evaluation.score.base import Estimate, Score
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.environment import versions_system_and_processor
from dechirp.experiments.study.executors import Workers, workers_from_executor
from dechirp.experiments.study.ledger import Ledger
from dechirp.experiments.study.variants import ScenarioVariants
from dechirp.experiments.tune.gain import Gain, estimate_paired_gain
from dechirp.experiments.tune.sampler import (
    Choice,
    check_optuna_installed,
    choose_next_untried_settings,
    setting_importances,
)
from dechirp.experiments.tune.trial_sources import (
    n_frames_per_source_or_none,
    run_trial_block_of_source,
    scenario_of_source,
    source_with_scenario,
)
from dechirp.experiments.tune.tune import Decision, LabelledRecording, Limit, Tune

BLOCK_SIZE = 50
"""Trials that are saved, or lost, as a whole."""

_MAX_WORKER_DEATHS = 3
"""Worker deaths per candidate before the search stops: settings may exceed the memory."""

_MAX_CONFIRMATIONS = 5
"""Candidates to confirm in new trials, the best first, until one keeps the limits."""

Settings: TypeAlias = tuple[tuple[str, str], ...]
"""Path and text of each changed setting; empty: unchanged settings."""


class Candidate(NamedTuple):
    """Choice of settings, and its scores in the trials of the search."""

    number: int
    """0: the unchanged settings."""
    settings: Settings
    scores: Mapping[str, Estimate]
    """Estimates by label, over all sources; empty if it failed."""
    failure: str | None
    """Reason of the failure."""
    is_admitted: bool
    """Whether no limit is shown to be exceeded."""


class ConfirmedCandidate(NamedTuple):
    """Scores of a candidate in confirmation trials."""

    number: int
    scores: Mapping[str, Estimate]
    by_source: Mapping[str, Mapping[str, Estimate]]
    """Estimates by the name of the source, then label."""
    decisions: tuple[Decision, ...]
    """Decision on each limit, in order."""


class TuneResult(NamedTuple):
    """Result of a search."""

    tune: Tune
    candidates: tuple[Candidate, ...]
    """All candidates in the order of their trials, the unchanged settings first."""
    default: ConfirmedCandidate
    best: ConfirmedCandidate | None
    """None: every candidate failed or was shown to exceed a limit."""
    refuted: tuple[ConfirmedCandidate, ...]
    """Candidates that were better in the search, but exceed a limit in confirmation trials."""
    gain: Gain | None
    """Gain of the best over the unchanged settings, positive where better; confirmation trials."""
    scenarios: tuple[Scenario, ...]
    """Scenarios of all sources with the best settings; unchanged if there are none."""
    importances: Mapping[str, float]
    """Share of the variance of the objective that each setting explains, by path."""
    n_trials: tuple[int, int]
    """Trials of each candidate in the search, and confirmation trials; all sources together."""
    findings: tuple[Finding, ...]


def run_search(
    tune: Tune,
    out: Path,
    *,
    workers: Workers,
    progress: Callable[[int, int], None] | None = None,
) -> TuneResult:
    """Search, and confirm the best candidate.

    Choices follow from the seed and from the measurements, one after the other: the result does
    not depend on the number of workers. Trials are saved in `out`, and a later call continues
    from there.

    Parameters
    ----------
    tune : Tune
        The search.
    out : Path
        Folder of the ledger; created if it does not exist.
    workers : Workers
        Where trials run; `executors.workers_from_executor` wraps any executor.
    progress : callable, optional
        Called with the number of finished blocks and of all, counting one confirmation.

    Raises
    ------
    DechirpError
        If optuna is missing, the unchanged settings fail, or the folder is another search's.
    """
    check_optuna_installed()
    with Ledger.create_or_continue(
        out, identity=search_identity_texts(tune), environment=versions_system_and_processor()
    ) as ledger:
        return _Search(tune, ledger, workers, progress).run_search_and_confirmation()


@check_argument_types
def run_tune(
    tune: Tune,
    out: str | Path,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TuneResult:
    """Search, and confirm the best candidate; the result does not depend on the workers.

    Parameters
    ----------
    tune : Tune
        The search.
    out : path
        Folder of the trials, created if it does not exist; a later call continues from there.
    executor : Executor of `concurrent.futures`, optional
        Where trials run; one process a core if omitted.
    progress : callable, optional
        Called with the number of finished blocks and of all, counting one confirmation.

    Raises
    ------
    DechirpError
        If optuna is missing, the unchanged settings fail, or the folder is another search's.
    """
    with workers_from_executor(executor) as workers:
        return run_search(tune, Path(out), workers=workers, progress=progress)


def search_identity_texts(tune: Tune) -> dict[str, str]:
    """Return the inputs of a search as text by name, except `candidates`, which may grow."""
    import optuna

    named = zip(_unique_source_names(tune), _scenarios_and_recordings(tune), strict=True)
    return {
        "dechirp": _dechirp_version(),
        "optuna": optuna.__version__,
        **versions_system_and_processor(),  # other versions could choose other candidates
        **{f"source {name}": _source_as_yaml(source) for name, source in named},
        "search": "\n".join(
            f"{setting.path}: {', '.join(setting.texts)}" for setting in tune.search
        ),
        "objective": "\n".join(
            [
                f"{tune.objective.direction}: {tune.objective.score.kind()}",
                *(
                    f"{limit.score.kind()}: {limit.at_least} to {limit.at_most}"
                    for limit in tune.objective.limits
                ),
            ]
        ),
        **{name: str(getattr(tune, name)) for name in ("seed", "trials", "confirmation_trials")},
        "confidence": str(tune.confidence),
    }


def _dechirp_version() -> str:
    try:
        return version("dechirp")
    except PackageNotFoundError:  # imported from a folder, not installed
        return "not installed"


def _scenarios_and_recordings(tune: Tune) -> tuple[Scenario | LabelledRecording, ...]:
    return (*tune.scenarios, *tune.recordings)


def _unique_source_names(tune: Tune) -> tuple[str, ...]:
    """Return unique names of the sources."""
    names = [scenario_of_source(source).name for source in _scenarios_and_recordings(tune)]
    return tuple(
        name if names.count(name) == 1 else f"{name} ({number})"
        for number, name in enumerate(names, 1)
    )


def _source_as_yaml(source: Scenario | LabelledRecording) -> str:
    text = dump_yaml(scenario_of_source(source))
    if isinstance(source, LabelledRecording):
        text += f"{dump_yaml(source.truth)}empty_range: {source.empty_range_m}\n"
    return text


class _ConfirmationFailed(DechirpError):
    """Raised if settings that worked in the search fail in confirmation trials."""


class _Search:
    """Search in progress, and its ledger."""

    def __init__(
        self,
        tune: Tune,
        ledger: Ledger,
        workers: Workers,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self.tune, self.ledger, self.workers, self.progress = tune, ledger, workers, progress
        self.sources = _scenarios_and_recordings(tune)
        self.variants = [ScenarioVariants(scenario_of_source(source)) for source in self.sources]
        self.scores: tuple[Score, ...] = tuple(
            dict.fromkeys(tune.objective.objective_and_limit_scores)
        )
        ledger.check_sizes_of_sums_and_theory(n_columns=sum(score.n_sums for score in self.scores))
        self.saved = {
            (int(point), int(number)) for point, number in ledger.saved_point_and_block_numbers()
        }
        # The search uses the first half of a recording, the confirmation the second.
        self.trial_ranges = tuple(
            (range(tune.trials), range(tune.trials, tune.trials + tune.confirmation_trials))
            if n_frames is None
            else (range(n_frames // 2), range(n_frames // 2, n_frames))
            for n_frames in n_frames_per_source_or_none(self.sources)
        )
        for index, (search_range, _) in enumerate(self.trial_ranges):
            if len(search_range) < 2:
                raise InvalidSetting(
                    f"recordings.{_unique_source_names(tune)[index]}",
                    value="a recording of fewer than four frames",
                    expected="two or more to search on, and as many to confirm on",
                    fix="give a longer recording, or more of its frames",
                )
        per_candidate = sum(
            len(_split_trials_into_blocks(search_range)) for search_range, _ in self.trial_ranges
        )
        n_fresh = sum(
            len(_split_trials_into_blocks(fresh_range)) for _, fresh_range in self.trial_ranges
        )
        n_candidates = min(tune.candidates, tune.n_setting_combinations)
        self.n_done, self.n_blocks = 0, (1 + n_candidates) * per_candidate + 2 * n_fresh

    def run_search_and_confirmation(self) -> TuneResult:
        tune = self.tune
        default = self._evaluate_candidate(0, ())
        if default.failure is not None:
            raise DechirpError(
                Mistake(
                    setting="scenarios",
                    value=f"not able to run as they are ({default.failure})",
                    expected="scenarios whose trials work before settings are searched",
                    fix="mend them: `dechirp run` shows more",
                )
            )
        candidates, history = [default], list[tuple[Choice, Candidate]]()
        for number in range(1, tune.candidates + 1):
            choice = choose_next_untried_settings(
                tune.search,
                [
                    (previous, worth)
                    for (previous, _), worth in zip(
                        history, _rank_per_tried_candidate(tune, history), strict=True
                    )
                ],
                seed=tune.seed,
            )
            if choice is None:
                break
            candidate = self._evaluate_candidate(number, _settings_of_choice(tune, choice))
            candidates.append(candidate)
            history.append((choice, candidate))
        return self._confirm_best_and_build_result(candidates, history)

    def _confirm_best_and_build_result(
        self, candidates: Sequence[Candidate], history: Sequence[tuple[Choice, Candidate]]
    ) -> TuneResult:
        tune = self.tune
        default, default_sums = self._confirmed_candidate_and_trial_sums(candidates[0])
        best, gain, refuted, failures = None, None, list[ConfirmedCandidate](), list[Finding]()
        for candidate in _sort_admitted_candidates(tune, candidates)[:_MAX_CONFIRMATIONS]:
            try:
                confirmed, sums = self._confirmed_candidate_and_trial_sums(candidate)
            except _ConfirmationFailed as error:
                failures += [
                    Finding.from_mistake(mistake, level="warning") for mistake in error.mistakes
                ]
                continue
            if "not met" in confirmed.decisions:
                refuted.append(confirmed)
                continue
            best, gain = confirmed, self._gain_of_best_over_default(default_sums, sums)
            break
        settings = () if best is None else candidates[best.number].settings
        label = tune.objective.score.kind()
        measured = [(choice, item.scores[label].value) for choice, item in history if item.scores]
        self._report_finished_blocks(self.n_blocks)
        return TuneResult(
            tune=tune,
            candidates=tuple(candidates),
            default=default,
            best=best,
            refuted=tuple(refuted),
            gain=gain,
            scenarios=tuple(item.scenario_with_settings(dict(settings)) for item in self.variants),
            importances=setting_importances(
                tune.search, [(choice, worth) for choice, worth in measured if np.isfinite(worth)]
            ),
            n_trials=(
                sum(len(first) for first, _ in self.trial_ranges),
                sum(len(second) for _, second in self.trial_ranges),
            ),
            findings=(
                *self.ledger.environment_findings,
                *_unresolvable_limit_findings(tune, candidates[0]),
                *failures,
            ),
        )

    def _evaluate_candidate(self, number: int, settings: Settings) -> Candidate:
        try:
            sums = self._run_missing_and_load_trial_sums(settings, in_confirmation=False)
        except DechirpError as error:
            return Candidate(number, settings, {}, str(error), False)
        failure = self._first_failure_message(settings, in_confirmation=False)
        if failure is not None:
            return Candidate(number, settings, {}, failure, False)
        scores = self._estimate_scores_by_label(_add_trial_sums_of_sources(sums))
        objective_value = scores[self.tune.objective.score.kind()].value
        admitted = np.isfinite(objective_value) and all(
            limit.relative_excess(scores[limit.score.kind()]) == 0
            for limit in self.tune.objective.limits
        )
        return Candidate(number, settings, scores, None, bool(admitted))

    def _confirmed_candidate_and_trial_sums(
        self, candidate: Candidate
    ) -> tuple[ConfirmedCandidate, np.ndarray]:
        """Return the scores of a candidate in confirmation trials, and their sums."""
        sums = self._run_missing_and_load_trial_sums(candidate.settings, in_confirmation=True)
        failure = self._first_failure_message(candidate.settings, in_confirmation=True)
        if failure is not None:
            raise _ConfirmationFailed(
                Mistake(
                    setting=f"candidate {candidate.number}",
                    value=f"failing in trials after those of the search ({failure})",
                    expected="trials that work",
                    fix="take what leads there out of the search",
                )
            )
        together = _add_trial_sums_of_sources(sums)
        scores = self._estimate_scores_by_label(together)
        named = zip(_unique_source_names(self.tune), sums, strict=True)
        confirmed = ConfirmedCandidate(
            number=candidate.number,
            scores=scores,
            by_source={
                name: self._estimate_scores_by_label(source_sums) for name, source_sums in named
            },
            decisions=tuple(
                limit.decide(scores[limit.score.kind()]) for limit in self.tune.objective.limits
            ),
        )
        return confirmed, together

    def _gain_of_best_over_default(self, default_sums: np.ndarray, best_sums: np.ndarray) -> Gain:
        objective, confidence = self.tune.objective, self.tune.confidence
        objective_columns = slice(0, objective.score.n_sums)  # its columns come first

        def value_of(sums: np.ndarray) -> float:
            return (
                objective.direction_sign
                * objective.score.estimate_with_interval(sums, confidence=confidence).value
            )

        return estimate_paired_gain(
            default_sums[:, objective_columns],
            best_sums[:, objective_columns],
            value_of,
            confidence=confidence,
        )

    def _estimate_scores_by_label(self, sums: np.ndarray) -> dict[str, Estimate]:
        widths = [score.n_sums for score in self.scores]
        ends = list(itertools.accumulate(widths))
        return {
            score.kind(): score.estimate_with_interval(
                sums[:, end - score.n_sums : end], confidence=self.tune.confidence
            )
            for score, end in zip(self.scores, ends, strict=True)
        }

    def _first_failure_message(self, settings: Settings, *, in_confirmation: bool) -> str | None:
        """Return the message of the first failed trial of the search, or of the confirmation."""
        messages = {
            (point, key.trial): key.message
            for point, key in self.ledger.failed_trials_with_points()
        }
        keys = (
            (_ledger_point_number_by_hash(settings, source), trial)
            for source, part in enumerate(self.trial_ranges)
            for trial in part[in_confirmation]
        )
        return next((messages[key] for key in keys if key in messages), None) if messages else None

    def _run_missing_and_load_trial_sums(
        self, settings: Settings, *, in_confirmation: bool
    ) -> list[np.ndarray]:
        """Return the sums of the trials of each source; run the ones that are not saved yet."""
        wanted = [part[in_confirmation] for part in self.trial_ranges]
        points = [
            _ledger_point_number_by_hash(settings, source) for source in range(len(self.sources))
        ]
        jobs = [
            (source, point, block)
            for source, point in enumerate(points)
            for block in _split_trials_into_blocks(wanted[source])
        ]
        missing = [job for job in jobs if (job[1], job[2].start) not in self.saved]
        self._report_finished_blocks(len(jobs) - len(missing))
        if missing:
            sources = [
                source_with_scenario(source, variants.scenario_with_settings(dict(settings)))
                for source, variants in zip(self.sources, self.variants, strict=True)
            ]
            self._run_blocks_despite_worker_deaths(sources, missing)
        sums = []
        for point, trials in zip(points, wanted, strict=True):
            of_point = self.ledger.trial_numbers_of_point(point)
            is_wanted = (of_point >= trials.start) & (of_point < trials.stop)
            sums.append(self.ledger.trial_sums_of_point(point)[is_wanted])
        return sums

    def _run_blocks_despite_worker_deaths(
        self,
        sources: Sequence[Scenario | LabelledRecording],
        jobs: Sequence[tuple[int, int, range]],
    ) -> None:
        """Run and save blocks; repeat those of dead workers on new ones."""
        for deaths in itertools.count(1):
            try:
                self._submit_and_save_blocks(
                    sources, [job for job in jobs if (job[1], job[2].start) not in self.saved]
                )
                return
            except self.workers.death_errors as error:
                self.workers.check_alive()
                if self.workers.renew is None or deaths == _MAX_WORKER_DEATHS:
                    raise DechirpError(
                        Mistake(
                            setting="workers",
                            value=f"dead, {format_count_with_noun(deaths, 'time')}"
                            f" ({type(error).__name__})",
                            expected="workers that live: they may lack memory",
                            fix="take fewer with --workers, and call again to go on",
                        )
                    ) from None
                self.workers.renew()

    def _submit_and_save_blocks(
        self,
        sources: Sequence[Scenario | LabelledRecording],
        jobs: Sequence[tuple[int, int, range]],
    ) -> None:
        running = {
            self.workers.executor.submit(
                run_trial_block_of_source,
                sources[source],
                self.scores,
                self.tune.seed,
                point=point,
                block_number=trials.start,
                trials=trials,
            )
            for source, point, trials in jobs
        }
        try:
            while running:
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                blocks = [future.result() for future in finished]
                self.ledger.add_blocks(blocks)
                self.saved.update((block.point, block.number) for block in blocks)
                self._report_finished_blocks(len(blocks))
        finally:
            for future in running:
                future.cancel()

    def _report_finished_blocks(self, n_blocks: int) -> None:
        self.n_done = min(self.n_done + n_blocks, self.n_blocks)
        if self.progress is not None:
            self.progress(self.n_done, self.n_blocks)


def _split_trials_into_blocks(trials: range) -> list[range]:
    return [trials[first : first + BLOCK_SIZE] for first in range(0, len(trials), BLOCK_SIZE)]


def _add_trial_sums_of_sources(sums_by_source: Sequence[np.ndarray]) -> np.ndarray:
    """Add the sums of all sources in each trial: they share its random numbers.

    Trials so stay independent. Sources with fewer trials, such as recordings of few frames,
    contribute to the first trials alone.
    """
    added = np.zeros((max(map(len, sums_by_source)), sums_by_source[0].shape[1]))
    for rows in sums_by_source:
        added[: len(rows)] += rows
    return added


def _ledger_point_number_by_hash(settings: Settings, source_index: int) -> int:
    """Return the number under which the ledger stores a choice on a source: a hash of 63 bits.

    It depends on the settings, not on the number of the candidate: one that failed for lack of
    memory or disk space may work in the next call, after which other choices follow.
    """
    words = "\n".join([str(source_index), *(f"{path}={text}" for path, text in settings)])
    return int.from_bytes(blake2b(words.encode(), digest_size=8).digest()) >> 1


def _settings_of_choice(tune: Tune, choice: Choice) -> Settings:
    both = zip(tune.search, choice, strict=True)
    return tuple((setting.path, setting.texts[index]) for setting, index in both)


def _rank_per_tried_candidate(
    tune: Tune, history: Sequence[tuple[Choice, Candidate]]
) -> Iterator[float]:
    """Rank candidates, more is better: ones beyond limits below all others, by their excess."""
    label = tune.objective.score.kind()
    keys = []
    for _, candidate in history:
        excess = sum(
            limit.relative_excess(candidate.scores[limit.score.kind()])
            if candidate.scores
            else math.inf
            for limit in tune.objective.limits
        )
        rank_value = (
            tune.objective.direction_sign * candidate.scores[label].value
            if candidate.scores
            else -math.inf
        )
        keys.append((candidate.is_admitted, rank_value if candidate.is_admitted else -excess))
    ranks = {key: rank for rank, key in enumerate(sorted(set(keys)))}
    return (float(ranks[key]) for key in keys)


def _sort_admitted_candidates(tune: Tune, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Sort admitted candidates, best first; equal ones by the margin to their limits."""
    label = tune.objective.score.kind()

    def key(candidate: Candidate) -> tuple[float, ...]:
        used = (
            _value_signed_towards_limit(limit, candidate.scores[limit.score.kind()])
            for limit in tune.objective.limits
        )
        return (
            -tune.objective.direction_sign * candidate.scores[label].value,
            *used,
            candidate.number,
        )

    return sorted((candidate for candidate in candidates if candidate.is_admitted), key=key)


def _value_signed_towards_limit(limit: Limit, estimate: Estimate) -> float:
    return estimate.value if limit.at_most is not None else -estimate.value


def _unresolvable_limit_findings(tune: Tune, default: Candidate) -> Iterator[Finding]:
    """Yield a finding if a limit is finer than this number of trials can resolve."""
    for limit in tune.objective.limits:
        if not limit.at_most:
            continue
        estimate = default.scores[limit.score.kind()]
        if not estimate.low <= limit.at_most < estimate.high / 2:
            continue
        share = (estimate.high - estimate.low) / limit.at_most
        yield Finding(
            level="warning",
            setting="trials",
            value=f"{tune.trials}: {limit.score.kind()} of the settings as they are lies between"
            f" {estimate.low:.2g} and {estimate.high:.2g}",
            expected=f"enough to distinguish {limit.at_most:g} from twice as much",
            fix=f"give trials: {math.ceil(tune.trials * share**2)} or so; candidates up to"
            " the high end pass for it as it is",
        )
