"""A search from start to end: candidates one by one, then the best on trials it has not seen."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from dechirp.config.texts import dump
from dechirp.core.displayed import several
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding
from dechirp.evaluate.score.base import Estimate, Score
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.study.environment import environment
from dechirp.experiment.study.executors import Workers, given
from dechirp.experiment.study.ledger import Ledger
from dechirp.experiment.study.variants import Variants
from dechirp.experiment.tune.choices import Choice, importances, must_have_optuna, next_choice
from dechirp.experiment.tune.gain import Gain, paired_gain
from dechirp.experiment.tune.sources import frames_of, scenario_of, tried_block, with_scenario
from dechirp.experiment.tune.tune import Limit, Recorded, Tune, Verdict

BLOCK = 50
"""Trials that are kept, or lost, at once."""

_MOST_DEATHS = 3
"""Times that workers may die over one candidate: settings may ask for more memory than there is."""

_MOST_FRESH = 5
"""Candidates that are tried on fresh trials, the best first, until one keeps the limits."""

Settings: TypeAlias = tuple[tuple[str, str], ...]
"""Path and text of each; none: as they are."""


class Candidate(NamedTuple):
    """A choice of settings, and what it came to in the trials of the search."""

    number: int
    """0: the settings as they are."""
    settings: Settings
    scores: Mapping[str, Estimate]
    """By label, over all sources; empty where it failed."""
    failure: str | None
    """Why it cannot be."""
    is_admitted: bool
    """Whether no limit is shown to be exceeded."""


class Confirmed(NamedTuple):
    """What settings came to in fresh trials."""

    number: int
    scores: Mapping[str, Estimate]
    by_source: Mapping[str, Mapping[str, Estimate]]
    """By the name of the source, then label."""
    verdicts: tuple[Verdict, ...]
    """Of the limits, in their order."""


class Tuned(NamedTuple):
    """What a search found."""

    tune: Tune
    candidates: tuple[Candidate, ...]
    """In the order in which they were tried, the settings as they are first."""
    default: Confirmed
    best: Confirmed | None
    """None: every candidate was shown to be beyond a limit, or failed."""
    refuted: tuple[Confirmed, ...]
    """Better in the search, but beyond a limit in fresh trials."""
    gain: Gain | None
    """Of the best over the settings as they are, positive where better; in fresh trials."""
    scenarios: tuple[Scenario, ...]
    """With the best settings, of scenarios and recordings; as they are without."""
    importances: Mapping[str, float]
    """Share of the scatter of the aim's score that each setting explains, by path."""
    n_looks: tuple[int, int]
    """Trials of each candidate in the search, and of fresh ones; all sources together."""
    findings: tuple[Finding, ...]


def run(
    tune: Tune,
    out: Path,
    *,
    workers: Workers,
    progress: Callable[[int, int], None] | None = None,
) -> Tuned:
    """Search, and confirm what was found.

    The choices follow from the seed and from what was measured, one after the other: the result
    does not depend on the number of workers. What is done is kept in `out`, and a later call goes
    on from there.

    Parameters
    ----------
    tune : Tune
        What is searched for.
    out : Path
        Folder of the record, made if it is not there.
    workers : Workers
        Where trials run; `executors.given` makes them of any executor.
    progress : callable, optional
        Called with the number of blocks of trials done and of all, fresh ones as for one candidate.

    Raises
    ------
    DechirpError
        If optuna is missing, the settings as they are fail, or the folder is another search's.
    """
    must_have_optuna()
    with Ledger.open(out, identity=identity(tune), environment=environment()) as ledger:
        return _Search(tune, ledger, workers, progress).result()


def run_tune(
    tune: Tune,
    out: str | Path,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tuned:
    """Search on any executor of `concurrent.futures`, or one process a core; else as `run`."""
    with given(executor) as workers:
        return run(tune, Path(out), workers=workers, progress=progress)


def identity(tune: Tune) -> dict[str, str]:
    """What a search depends on, as text by name; `candidates` may grow."""
    import optuna

    named = zip(_names(tune), _sources(tune), strict=True)
    return {
        "dechirp": _version(),
        "optuna": optuna.__version__,
        **environment(),  # another library could choose others, whose trials are not those kept
        **{f"source {name}": _written(source) for name, source in named},
        "search": "\n".join(f"{one.path}: {', '.join(one.texts)}" for one in tune.search),
        "aim": "\n".join(
            [
                f"{tune.aim.towards}: {tune.aim.score.label()}",
                *(
                    f"{limit.score.label()}: {limit.at_least} to {limit.at_most}"
                    for limit in tune.aim.limits
                ),
            ]
        ),
        **{name: str(getattr(tune, name)) for name in ("seed", "looks", "fresh_looks")},
        "confidence": str(tune.confidence),
    }


def _version() -> str:
    try:
        return version("dechirp")
    except PackageNotFoundError:  # imported from a folder, not installed
        return "not installed"


def _sources(tune: Tune) -> tuple[Scenario | Recorded, ...]:
    return (*tune.scenarios, *tune.recordings)


def _names(tune: Tune) -> tuple[str, ...]:
    """Of the sources, by which they are told apart."""
    names = [scenario_of(source).name for source in _sources(tune)]
    return tuple(
        name if names.count(name) == 1 else f"{name} ({number})"
        for number, name in enumerate(names, 1)
    )


def _written(source: Scenario | Recorded) -> str:
    text = dump(scenario_of(source))
    if isinstance(source, Recorded):
        text += f"{dump(source.truth)}empty: {source.empty_m}\n"
    return text


class _FailsLater(DechirpError):
    """Settings that worked in the trials of the search fail in fresh ones."""


class _Search:
    """One search and its record."""

    def __init__(
        self,
        tune: Tune,
        ledger: Ledger,
        workers: Workers,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self.tune, self.ledger, self.workers, self.progress = tune, ledger, workers, progress
        self.sources = _sources(tune)
        self.variants = [Variants(scenario_of(one)) for one in self.sources]
        self.scores: tuple[Score, ...] = tuple(dict.fromkeys(tune.aim.scores))
        ledger.must_have(n_columns=sum(score.n_sums for score in self.scores))
        self.kept = {(int(point), int(number)) for point, number in ledger.done()}
        # Of a recording, the first half of the frames is searched on, the other is fresh.
        self.parts = tuple(
            (range(tune.looks), range(tune.looks, tune.looks + tune.fresh_looks))
            if n_frames is None
            else (range(n_frames // 2), range(n_frames // 2, n_frames))
            for n_frames in frames_of(self.sources)
        )
        for at, (first, _) in enumerate(self.parts):
            if len(first) < 2:
                raise InvalidSetting(
                    f"recordings.{_names(tune)[at]}",
                    got="a recording of fewer than four frames",
                    need="two or more to search on, and as many to confirm on",
                    fix="Give a longer recording, or more of its frames.",
                )
        per_candidate = sum(len(_blocks(first)) for first, _ in self.parts)
        fresh = sum(len(_blocks(second)) for _, second in self.parts)
        n_candidates = min(tune.candidates, tune.n_choices)
        self.n_done, self.n_blocks = 0, (1 + n_candidates) * per_candidate + 2 * fresh

    def result(self) -> Tuned:
        tune = self.tune
        default = self._candidate(0, ())
        if default.failure is not None:
            raise DechirpError(
                Mistake(
                    setting="scenarios",
                    got=f"not able to run as they are ({default.failure})",
                    need="scenarios whose trials work before settings are searched",
                    fix="Mend them: `dechirp run` shows more.",
                )
            )
        candidates, tried = [default], list[tuple[Choice, Candidate]]()
        for number in range(1, tune.candidates + 1):
            choice = next_choice(
                tune.search,
                [
                    (past, worth)
                    for (past, _), worth in zip(tried, _worths(tune, tried), strict=True)
                ],
                seed=tune.seed,
            )
            if choice is None:
                break
            candidate = self._candidate(number, _settings(tune, choice))
            candidates.append(candidate)
            tried.append((choice, candidate))
        return self._confirmed(candidates, tried)

    def _confirmed(
        self, candidates: Sequence[Candidate], tried: Sequence[tuple[Choice, Candidate]]
    ) -> Tuned:
        tune = self.tune
        default, default_sums = self._fresh(candidates[0])
        best, gain, refuted, failing = None, None, list[Confirmed](), list[Finding]()
        for candidate in _promising(tune, candidates)[:_MOST_FRESH]:
            try:
                found, sums = self._fresh(candidate)
            except _FailsLater as error:
                failing += [Finding.of(mistake, level="warning") for mistake in error.mistakes]
                continue
            if "not met" in found.verdicts:
                refuted.append(found)
                continue
            best, gain = found, self._gain(default_sums, sums)
            break
        settings = () if best is None else candidates[best.number].settings
        label = tune.aim.score.label()
        possible = [(choice, one.scores[label].value) for choice, one in tried if one.scores]
        self._told(self.n_blocks)
        return Tuned(
            tune=tune,
            candidates=tuple(candidates),
            default=default,
            best=best,
            refuted=tuple(refuted),
            gain=gain,
            scenarios=tuple(one.of(dict(settings)) for one in self.variants),
            importances=importances(
                tune.search, [(choice, worth) for choice, worth in possible if np.isfinite(worth)]
            ),
            n_looks=(
                sum(len(first) for first, _ in self.parts),
                sum(len(second) for _, second in self.parts),
            ),
            findings=(*self.ledger.doubts, *_coarse(tune, candidates[0]), *failing),
        )

    def _candidate(self, number: int, settings: Settings) -> Candidate:
        try:
            sums = self._rows(settings, fresh=False)
        except DechirpError as error:
            return Candidate(number, settings, {}, str(error), False)
        failure = self._failure(settings, fresh=False)
        if failure is not None:
            return Candidate(number, settings, {}, failure, False)
        scores = self._estimates(_added(sums))
        own = scores[self.tune.aim.score.label()].value
        admitted = np.isfinite(own) and all(
            limit.excess(scores[limit.score.label()]) == 0 for limit in self.tune.aim.limits
        )
        return Candidate(number, settings, scores, None, bool(admitted))

    def _fresh(self, candidate: Candidate) -> tuple[Confirmed, np.ndarray]:
        """What a candidate comes to in fresh trials, and their sums."""
        sums = self._rows(candidate.settings, fresh=True)
        failure = self._failure(candidate.settings, fresh=True)
        if failure is not None:
            raise _FailsLater(
                Mistake(
                    setting=f"candidate {candidate.number}",
                    got=f"failing in trials after those of the search ({failure})",
                    need="trials that work",
                    fix="Take what leads there out of the search.",
                )
            )
        together = _added(sums)
        scores = self._estimates(together)
        named = zip(_names(self.tune), sums, strict=True)
        confirmed = Confirmed(
            number=candidate.number,
            scores=scores,
            by_source={name: self._estimates(of) for name, of in named},
            verdicts=tuple(
                limit.verdict(scores[limit.score.label()]) for limit in self.tune.aim.limits
            ),
        )
        return confirmed, together

    def _gain(self, before: np.ndarray, after: np.ndarray) -> Gain:
        aim, confidence = self.tune.aim, self.tune.confidence
        own = slice(0, aim.score.n_sums)  # the aim's own score comes first

        def value_of(sums: np.ndarray) -> float:
            return aim.sign * aim.score.estimate(sums, confidence=confidence).value

        return paired_gain(before[:, own], after[:, own], value_of, confidence=confidence)

    def _estimates(self, sums: np.ndarray) -> dict[str, Estimate]:
        widths = [score.n_sums for score in self.scores]
        ends = list(itertools.accumulate(widths))
        return {
            score.label(): score.estimate(
                sums[:, end - score.n_sums : end], confidence=self.tune.confidence
            )
            for score, end in zip(self.scores, ends, strict=True)
        }

    def _failure(self, settings: Settings, *, fresh: bool) -> str | None:
        """What the first trial said that failed, of those of the search or of the fresh ones."""
        failed = {(point, one.trial): one.message for point, one in self.ledger.failures()}
        asked = (
            (_point(settings, at), trial)
            for at, part in enumerate(self.parts)
            for trial in part[fresh]
        )
        return next((failed[one] for one in asked if one in failed), None) if failed else None

    def _rows(self, settings: Settings, *, fresh: bool) -> list[np.ndarray]:
        """Sums of the trials of each source, those that are not kept yet tried now."""
        wanted = [part[fresh] for part in self.parts]
        points = [_point(settings, at) for at in range(len(self.sources))]
        jobs = [
            (at, point, block) for at, point in enumerate(points) for block in _blocks(wanted[at])
        ]
        missing = [job for job in jobs if (job[1], job[2].start) not in self.kept]
        self._told(len(jobs) - len(missing))
        if missing:
            sources = [
                with_scenario(source, variants.of(dict(settings)))
                for source, variants in zip(self.sources, self.variants, strict=True)
            ]
            self._try(sources, missing)
        found = []
        for point, trials in zip(points, wanted, strict=True):
            of_point = self.ledger.trials(point)
            own = (of_point >= trials.start) & (of_point < trials.stop)
            found.append(self.ledger.sums(point)[own])
        return found

    def _try(
        self, sources: Sequence[Scenario | Recorded], jobs: Sequence[tuple[int, int, range]]
    ) -> None:
        """Try blocks and keep them; those of workers that died once more, on others."""
        for deaths in itertools.count(1):
            try:
                self._tried(
                    sources, [job for job in jobs if (job[1], job[2].start) not in self.kept]
                )
                return
            except self.workers.lost as error:
                self.workers.must_answer()
                if self.workers.renew is None or deaths == _MOST_DEATHS:
                    raise DechirpError(
                        Mistake(
                            setting="workers",
                            got=f"dead, {several(deaths, 'time')} ({type(error).__name__})",
                            need="workers that live: they may lack memory",
                            fix="Take fewer with --workers, and call again to go on.",
                        )
                    ) from None
                self.workers.renew()

    def _tried(
        self, sources: Sequence[Scenario | Recorded], jobs: Sequence[tuple[int, int, range]]
    ) -> None:
        running = {
            self.workers.executor.submit(
                tried_block,
                sources[at],
                self.scores,
                self.tune.seed,
                point=point,
                number=trials.start,
                trials=trials,
            )
            for at, point, trials in jobs
        }
        try:
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                blocks = [one.result() for one in done]
                self.ledger.add(blocks)
                self.kept.update((block.point, block.number) for block in blocks)
                self._told(len(blocks))
        finally:
            for one in running:
                one.cancel()

    def _told(self, n_blocks: int) -> None:
        self.n_done = min(self.n_done + n_blocks, self.n_blocks)
        if self.progress is not None:
            self.progress(self.n_done, self.n_blocks)


def _blocks(trials: range) -> list[range]:
    return [trials[first : first + BLOCK] for first in range(0, len(trials), BLOCK)]


def _added(sums: Sequence[np.ndarray]) -> np.ndarray:
    """Sums of all sources in each trial: they share its chance, so that trials are independent.

    Sources with fewer trials, as recordings of few frames, are in the first ones alone.
    """
    added = np.zeros((max(map(len, sums)), sums[0].shape[1]))
    for of in sums:
        added[: len(of)] += of
    return added


def _point(settings: Settings, source: int) -> int:
    """Where the record keeps the trials of settings on a source: a number of 63 bits.

    By the settings, not by the number of the candidate: one that failed for want of memory or of
    room on the disk may work in the next call, after which others are chosen.
    """
    words = "\n".join([str(source), *(f"{path}={text}" for path, text in settings)])
    return int.from_bytes(blake2b(words.encode(), digest_size=8).digest()) >> 1


def _settings(tune: Tune, choice: Choice) -> Settings:
    both = zip(tune.search, choice, strict=True)
    return tuple((one.path, one.texts[at]) for one, at in both)


def _worths(tune: Tune, tried: Sequence[tuple[Choice, Candidate]]) -> Iterator[float]:
    """Order of candidates, more is better: beyond limits below all others, by how far."""
    label = tune.aim.score.label()
    keys = []
    for _, one in tried:
        excess = sum(
            limit.excess(one.scores[limit.score.label()]) if one.scores else math.inf
            for limit in tune.aim.limits
        )
        own = tune.aim.sign * one.scores[label].value if one.scores else -math.inf
        keys.append((one.is_admitted, own if one.is_admitted else -excess))
    ranks = {key: rank for rank, key in enumerate(sorted(set(keys)))}
    return (float(ranks[key]) for key in keys)


def _promising(tune: Tune, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates that are admitted, best first; of equals the one that limits leave most room."""
    label = tune.aim.score.label()

    def key(one: Candidate) -> tuple[float, ...]:
        used = (_signed(limit, one.scores[limit.score.label()]) for limit in tune.aim.limits)
        return (-tune.aim.sign * one.scores[label].value, *used, one.number)

    return sorted((one for one in candidates if one.is_admitted), key=key)


def _signed(limit: Limit, estimate: Estimate) -> float:
    return estimate.value if limit.at_most is not None else -estimate.value


def _coarse(tune: Tune, default: Candidate) -> Iterator[Finding]:
    """What is said where a limit is finer than so many trials can tell."""
    for limit in tune.aim.limits:
        if not limit.at_most:
            continue
        estimate = default.scores[limit.score.label()]
        if not estimate.low <= limit.at_most < estimate.high / 2:
            continue
        share = (estimate.high - estimate.low) / limit.at_most
        yield Finding(
            level="warning",
            setting="looks",
            got=f"{tune.looks}: {limit.score.label()} of the settings as they are lies between"
            f" {estimate.low:.2g} and {estimate.high:.2g}",
            need=f"enough to tell {limit.at_most:g} from twice as much",
            fix=f"Give looks: {math.ceil(tune.looks * share**2)} or so; candidates up to"
            " the high end pass for it as it is.",
        )
