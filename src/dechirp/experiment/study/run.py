"""A study from its file to its estimates: the page that calls the rest of this folder."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dechirp.core.checks import whole
from dechirp.core.displayed import Displayed, Table
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding, findings
from dechirp.core.threads import alone
from dechirp.evaluate.look import Look
from dechirp.experiment.run import Result, run
from dechirp.experiment.study import data_set
from dechirp.experiment.study.assembled import complete
from dechirp.experiment.study.environment import environment
from dechirp.experiment.study.executors import Workers, given
from dechirp.experiment.study.layout import Layout
from dechirp.experiment.study.ledger import Ledger
from dechirp.experiment.study.plan import Plan, differences
from dechirp.experiment.study.queue import Enough
from dechirp.experiment.study.record import NAME as RECORD
from dechirp.experiment.study.record import Record
from dechirp.experiment.study.require import Judged, judge
from dechirp.experiment.study.results import StudyResult, collect, estimate, measured
from dechirp.experiment.study.running import Progress, run_blocks
from dechirp.experiment.study.study import Study
from dechirp.experiment.study.trial import check_study, generator, layout_of, prepared, run_block


@dataclass(frozen=True, repr=False)
class Finished(Displayed):
    """What a study gave."""

    result: StudyResult
    judged: tuple[Judged, ...]
    """Its requirements, decided."""
    doubts: tuple[Finding, ...] = ()
    """That it ran on other libraries or another processor before."""

    def _line(self) -> str:
        met = sum(one.met for one in self.judged)
        judged = f"; {met} of {len(self.judged)} requirements met" if self.judged else ""
        return f"{self.result._line()}{judged}"

    def _tables(self) -> Iterable[Table]:
        study = self.result.study
        asked = (text for one in study.require for text in study._asked(one))
        decided = zip(asked, self.judged, strict=True)
        yield Table("Requirements", [(text, one.decision) for text, one in decided])
        yield findings(self.doubts)
        yield from self.result._tables()


def run_study(
    study: Study,
    out: str | Path,
    *,
    executor: Executor | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Finished:
    """Run all trials of a study that its folder does not have yet, and judge.

    Parameters
    ----------
    study : Study
        As `load_study` reads it, or made in Python.
    out : str or Path
        Folder of `study.sqlite`, in which each block is kept as soon as it is done: the same
        call goes on where the last one ended, however it ended.
    executor : Executor, optional
        Where trials run: any of `concurrent.futures`, as `dask.distributed.Client.get_executor`
        gives one; without it, one process a core. The numbers do not depend on it.
    progress : callable, optional
        Called with how far it is.

    Raises
    ------
    DechirpError
        If its scores do not fit its scenario, which is told before any trial; if the folder is
        another study's, is written to by another process or cannot be written; if too many
        trials raised or workers died. What was done is kept.
    """
    plan = Plan.of(study)
    with open_ledger(study, Path(out)) as ledger:
        with given(executor) as workers:
            run_trials(plan, ledger, workers, progress)
        return finished(plan, ledger)


def open_ledger(study: Study, out: Path) -> Ledger:
    """The record of a study in a folder, begun or gone on with; raises as `run_study`."""
    plan = Plan.of(study)
    check_study(plan)
    identity = plan.digest()
    _must_be_same(out, identity)
    if study.keep:
        data_set.check(plan)
        if not (out / RECORD).exists():  # a folder of a study that is refused is not begun
            data_set.check_room(data_set.data_bytes(plan), out)
    ledger = Ledger.open(out, identity=identity, environment=environment())
    try:
        layout = layout_of(plan)
        ledger.must_have(n_columns=layout.n_columns, n_laws=layout.n_laws)
    except BaseException:
        ledger.close()
        raise
    return ledger


def _must_be_same(out: Path, identity: Mapping[str, str]) -> None:
    """Raise `DechirpError` with each setting that differs from those of the results that are there.

    What cannot be read, or was only begun, is left to `Ledger.open`.
    """
    try:
        with Record.read(out) as record:
            kept = record.identity
    except DechirpError:
        return
    changed = [one.partition(": ") for one in differences(kept, identity)]
    renamed = [one for one in changed if one[0] == "name"]
    if changed:
        raise DechirpError(
            *(
                Mistake(
                    setting=setting,
                    got=now or then,
                    need=f"{then}, as in the results that are there",
                    fix="Name another folder with --out, or remove this one to begin anew.",
                    file=str(out),
                )
                # Of a study of another name all else differs too.
                for setting, _, change in renamed or changed
                for then, _, now in [change.partition(" -> ")]
            )
        )


def run_trials(
    plan: Plan,
    ledger: Ledger,
    workers: Workers,
    progress: Callable[[Progress], None] | None = None,
) -> None:
    """Run the trials that a ledger does not have; raises as `run_study`."""
    study = plan.study
    work = run_block
    if study.keep:
        data_set.check_disk(plan, ledger, ledger.path.parent)
        work = partial(run_block, keeper=data_set.Keeper.of(plan, ledger.path.parent))
    needless = run_blocks(
        work,
        plan,
        n_points=plan.n_points,
        trials=study.trials,
        ledger=ledger,
        workers=workers,
        enough=_enough(study, layout_of(plan)),
        stop_after_failures=study.stop_after_failures,
        progress=progress,
    )
    if study.keep:
        wait(needless)  # they would write beside what is made whole


def finished(plan: Plan, ledger: Ledger) -> Finished:
    """What the trials of a ledger come to; its data set, where there is one, is made whole."""
    if plan.study.keep:
        complete(plan, ledger, ledger.path.parent)
    result = collect(plan.study, layout_of(plan), measured(plan, layout_of(plan), ledger))
    return Finished(result, judge(result, ledger.sums), ledger.doubts)


def _enough(study: Study, layout: Layout) -> Enough | None:
    """Whether the interval that the study waits for is narrow enough."""
    until = study.trials.until
    if until is None:
        return None
    label, target, width = until.score, until.target, until.width

    def enough(sums: np.ndarray) -> bool:
        found = estimate(layout, label, target, sums, confidence=study.confidence)
        return bool(found.high - found.low <= width)  # false where there is nothing to tell

    return enough


@dataclass(frozen=True, eq=False)
class Replayed:
    """One trial of one point, again."""

    point: int
    trial: int
    look: Look
    sums: np.ndarray
    """As the ledger has them, see `Layout`."""
    result: Result
    """The same trial as `run` shows one."""


def replay(study: Study, trial: int, *, point: int = 0) -> Replayed:
    """Run one trial alone, with the chance that it has in the study.

    Raises
    ------
    DechirpError
        What the trial raised, if it did; or if there is no such point or trial.
    """
    whole("--trial", trial, at_least=0, at_most=study.trials.at_most - 1)
    plan = Plan.of(study)
    with alone():  # as in the study
        ready = prepared(plan, point, trial)
        look = ready.look(trial)
        return Replayed(
            point=point,
            trial=trial,
            look=look,
            sums=ready.sums_of(look),
            result=run(ready.scenario, rng=generator(study.seed, trial)),
        )
