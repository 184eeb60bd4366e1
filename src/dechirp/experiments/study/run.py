"""Run a study, from its settings to its estimates and verdicts."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.display import Displayable, Table
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding, findings_display_table
from dechirp.core.threads import exclusive_single_thread
from dechirp.evaluation.trial import TrialResult
from dechirp.experiments.run import Result, run
from dechirp.experiments.study import data_set
from dechirp.experiments.study.block_queue import StopCriterion
from dechirp.experiments.study.data_set_assembly import assemble_data_set
from dechirp.experiments.study.environment import versions_system_and_processor
from dechirp.experiments.study.executors import Workers, workers_from_executor
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.ledger import Ledger
from dechirp.experiments.study.ledger_reader import LEDGER_NAME as RECORD
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.plan import Plan, describe_identity_changes
from dechirp.experiments.study.requirements import Verdict, judge_requirements
from dechirp.experiments.study.results import (
    StudyResult,
    estimate_score,
    estimate_scores_of_points,
    iter_point_data_from_ledger,
)
from dechirp.experiments.study.scheduler import Progress, run_missing_blocks
from dechirp.experiments.study.study import Study
from dechirp.experiments.study.trial import (
    check_scores_and_targets_of_study,
    create_trial_runner,
    run_trial_block,
    score_column_layout_of_study,
    trial_rng,
)


@dataclass(frozen=True, repr=False)
class StudyOutcome(Displayable):
    """Results of a study, and the verdicts on its requirements."""

    result: StudyResult
    verdicts: tuple[Verdict, ...]
    """Verdicts on its requirements."""
    environment_findings: tuple[Finding, ...] = ()
    """Finding that earlier trials ran on other libraries or on another processor."""

    def _display_line(self) -> str:
        n_met = sum(verdict.is_met for verdict in self.verdicts)
        summary = f"; {n_met} of {len(self.verdicts)} requirements met" if self.verdicts else ""
        return f"{self.result._display_line()}{summary}"

    def _display_tables(self) -> Iterable[Table]:
        study = self.result.study
        texts = (
            text
            for requirement in study.require
            for text in study._requirement_limits_as_text(requirement)
        )
        decided = zip(texts, self.verdicts, strict=True)
        yield Table("Requirements", [(text, verdict.decision) for text, verdict in decided])
        yield findings_display_table(self.environment_findings)
        yield from self.result._display_tables()


@check_argument_types
def run_study(
    study: Study,
    out: str | Path,
    *,
    executor: Executor | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> StudyOutcome:
    """Run all missing trials of a study, and judge its requirements.

    Parameters
    ----------
    study : Study
        As `load_study` reads it, or built in Python.
    out : str or Path
        Folder of `study.sqlite`, to which each block is saved as soon as it is done: the same
        call continues where the last one ended, however it ended.
    executor : Executor, optional
        Where trials run: any executor of `concurrent.futures`, for example of
        `dask.distributed.Client.get_executor`; by default one process a core. The results do not
        depend on it.
    progress : callable, optional
        Called with the progress.

    Raises
    ------
    DechirpError
        If its scores do not fit its scenario, which is checked before any trial; if the folder
        belongs to another study, is written to by another process or is not writable; if too many
        trials failed or workers died. Finished blocks are kept.
    """
    plan = Plan.from_study(study)
    with create_or_continue_ledger(study, Path(out)) as ledger:
        with workers_from_executor(executor) as workers:
            run_missing_trials(plan, ledger, workers, progress)
        return estimate_and_judge_study(plan, ledger)


def create_or_continue_ledger(study: Study, out: Path) -> Ledger:
    """Create or continue the ledger of a study in a folder; raises as `run_study` does."""
    plan = Plan.from_study(study)
    check_scores_and_targets_of_study(plan)
    identity = plan.study_identity_texts()
    _check_existing_results_of_same_study(out, identity)
    if study.keep:
        data_set.check_item_shapes_and_total_size(plan)
        if not (out / RECORD).exists():  # a refused study leaves no folder
            data_set.check_disk_space(data_set.uncompressed_data_set_bytes(plan), out)
    ledger = Ledger.create_or_continue(
        out, identity=identity, environment=versions_system_and_processor()
    )
    try:
        layout = score_column_layout_of_study(plan)
        ledger.check_sizes_of_sums_and_theory(
            n_columns=layout.n_columns, n_theoretical_values=layout.n_theoretical_values
        )
    except BaseException:
        ledger.close()
        raise
    return ledger


def _check_existing_results_of_same_study(out: Path, identity: Mapping[str, str]) -> None:
    """Raise `DechirpError` with each setting that differs from those of the existing results.

    Unreadable or empty ledgers are left to `Ledger.create_or_continue`.
    """
    try:
        with LedgerReader.open_read_only(out) as record:
            saved = record.study_identity
    except DechirpError:
        return
    changed = [change.partition(": ") for change in describe_identity_changes(saved, identity)]
    renamed = [change for change in changed if change[0] == "name"]
    if changed:
        raise DechirpError(
            *(
                Mistake(
                    setting=setting,
                    value=now or then,
                    expected=f"{then}, as in the existing results",
                    fix="name another folder with --out, or remove this one to begin anew",
                    file=str(out),
                )
                # A study of another name differs in everything else too.
                for setting, _, change in renamed or changed
                for then, _, now in [change.partition(" -> ")]
            )
        )


def run_missing_trials(
    plan: Plan,
    ledger: Ledger,
    workers: Workers,
    progress: Callable[[Progress], None] | None = None,
) -> None:
    """Run the trials that a ledger does not contain; raises as `run_study` does."""
    study = plan.study
    work = run_trial_block
    if study.keep:
        data_set.check_saved_files_and_disk_space(plan, ledger, ledger.path.parent)
        work = partial(
            run_trial_block, writer=data_set.DataSetWriter.from_plan(plan, ledger.path.parent)
        )
    unneeded = run_missing_blocks(
        work,
        plan,
        n_points=plan.n_points,
        trials=study.trials,
        ledger=ledger,
        workers=workers,
        enough=_interval_width_stop_criterion(study, score_column_layout_of_study(plan)),
        stop_after_failures=study.stop_after_failures,
        progress=progress,
    )
    if study.keep:
        wait(unneeded)  # they would write while the data set is completed


def estimate_and_judge_study(plan: Plan, ledger: Ledger) -> StudyOutcome:
    """Estimate scores and judge requirements from a ledger; complete the data set, if any."""
    if plan.study.keep:
        assemble_data_set(plan, ledger, ledger.path.parent)
    result = estimate_scores_of_points(
        plan.study,
        score_column_layout_of_study(plan),
        iter_point_data_from_ledger(plan, score_column_layout_of_study(plan), ledger),
    )
    return StudyOutcome(
        result, judge_requirements(result, ledger.trial_sums_of_point), ledger.environment_findings
    )


def _interval_width_stop_criterion(study: Study, layout: ScoreColumnLayout) -> StopCriterion | None:
    """Return the test of the study's stop rule on the interval width, or None without one."""
    until = study.trials.until
    if until is None:
        return None
    label, target, width = until.score, until.target, until.width

    def enough(sums: np.ndarray) -> bool:
        estimate = estimate_score(layout, label, target, sums, confidence=study.confidence)
        return bool(estimate.high - estimate.low <= width)  # False for NaN

    return enough


@dataclass(frozen=True, eq=False)
class ReplayedTrial:
    """A single trial of one point, repeated."""

    point: int
    trial: int
    trial_result: TrialResult
    sums: np.ndarray
    """Sums as in the ledger, see `ScoreColumnLayout`."""
    result: Result
    """The same trial as a result of `run`."""


def replay_trial(study: Study, trial: int, *, point: int = 0) -> ReplayedTrial:
    """Repeat one trial alone, with the random numbers that it has in the study.

    Raises
    ------
    DechirpError
        The error of the trial, if it failed; or if there is no such point or trial.
    """
    check_integer("--trial", trial, at_least=0, at_most=study.trials.at_most - 1)
    plan = Plan.from_study(study)
    with exclusive_single_thread():  # as in the study
        runner = create_trial_runner(plan, point, trial)
        trial_result = runner.run_trial(trial)
        return ReplayedTrial(
            point=point,
            trial=trial,
            trial_result=trial_result,
            sums=runner.score_sums_of_result(trial_result),
            result=run(runner.scenario, rng=trial_rng(study.seed, trial)),
        )
