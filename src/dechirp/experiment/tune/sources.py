"""Where candidates are tried: on scenes that are simulated anew, and on frames of recordings."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from time import perf_counter
from typing import Protocol

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import heard
from dechirp.core.threads import alone
from dechirp.evaluate.look import Case, Look, NoiseMap
from dechirp.evaluate.match import Matcher
from dechirp.evaluate.score.base import Score
from dechirp.experiment.followed import follow
from dechirp.experiment.run import opened_recording
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.study.block import Block, Failure
from dechirp.experiment.study.layout import Layout
from dechirp.experiment.study.trial import Prepared
from dechirp.experiment.tune.tune import Recorded
from dechirp.process.detect import detect_each
from dechirp.process.maps import power_map, threshold_map
from dechirp.scene.truth import truth


class _Tried(Protocol):
    layout: Layout

    def sums(self, trial: int) -> np.ndarray: ...


class PreparedRecording:
    """Frames of a recording as trials: frame t of those that are read is trial t."""

    def __init__(self, recorded: Recorded, scores: tuple[Score, ...]) -> None:
        self.recorded, self.scores = recorded, scores
        self.recording = opened_recording(recorded.scenario)
        self.radar = self.recording.radar
        self.chain = recorded.scenario.chain.fitted(self.radar)
        last = self.recording.frame_numbers[-1]
        self._truth = truth(recorded.truth, self.radar, n_frames=last + 1, noise_power_w=np.nan)
        first = self._case(0)
        for score in scores:
            _must_be_told_by_frames(score)
            score.check(first)
        self.layout = Layout.of_case(scores, first)
        self._needs = frozenset().union(*(score.needs for score in scores))
        if "noise" in self._needs and recorded.empty_m is None:
            raise InvalidSetting(
                "recordings.empty",
                got="absent",
                need="ranges where nothing was, to count false alarms in",
                fix="Give empty: [20 m, 60 m], or leave false alarms out of the aim.",
            )

    def sums(self, trial: int) -> np.ndarray:
        """Sums of all scores of one frame, (n_columns,), see `Layout`."""
        look, case = self._look(trial), self._case(trial)
        return np.concatenate([score.sums(look, case).ravel() for score in self.scores])

    def _case(self, trial: int) -> Case:
        known = self._truth.isel(frame=[self.recording.frame_numbers[trial]])
        return Case(
            scene=self.recorded.truth,
            radar=self.radar,
            chain=self.chain,
            truth=known,
            noise_power_w=np.nan,
            times_s=known.time.values,
        )

    def _look(self, trial: int) -> Look:
        number = self.recording.frame_numbers[trial]
        (cube,) = self.recording.part(number, number + 1).frames()
        started = perf_counter()
        rows = detect_each([cube], self.radar, self.chain, first=number)
        clusters = None
        if "clusters" in self._needs:
            untracked = replace(self.recorded.scenario, chain=self.chain, tracker=None)
            times_s = [float(one) for one in self._case(trial).times_s]
            rows, _, clusters, _, _ = follow(rows, times_s, untracked, self.radar, first=number)
        processing_s = perf_counter() - started
        columns = {str(name): column.values for name, column in rows.items()}
        case = self._case(trial)
        power = None
        if self._needs & {"maps", "noise"}:
            power = power_map(cube.isel(frame=0), self.radar.at(number), self.chain)
        return Look(
            detections=columns,
            match=Matcher(case.truth, self.radar, self.recorded.truth)(columns),
            maps=None if power is None else (power.values,),
            noise=self._empty(power, columns["range"], number) if "noise" in self._needs else None,
            clusters=clusters,
            processing_s=processing_s,
        )

    def _empty(self, power: xr.DataArray | None, detected_m: np.ndarray, number: int) -> NoiseMap:
        """The part of the map of a frame where nothing was, counted."""
        assert power is not None and self.recorded.empty_m is not None
        nearest_m, furthest_m = self.recorded.empty_m
        threshold = threshold_map(power, self.radar.at(number), self.chain)
        rows = (power.range.values >= nearest_m) & (power.range.values <= furthest_m)
        within = power.transpose("velocity", "range").values[:, rows]
        over = threshold.transpose("velocity", "range").values[:, rows]
        inside = (detected_m >= nearest_m) & (detected_m <= furthest_m)
        return NoiseMap(
            power=within,
            n_tested=int(np.isfinite(over).sum()),
            n_over=int((within > over).sum()),
            n_peaks=int(inside.sum()),
        )


def _must_be_told_by_frames(score: Score) -> None:
    """Raise `InvalidSetting` where frames of a recording, one by one, cannot tell a score."""
    if "tracks" in score.needs:
        of = "tracks"
    elif score.needs >= {"maps", "noise"}:
        of = "a map of noise beside the one of targets"
    else:
        return
    raise InvalidSetting(
        "aim",
        got=f"{score.label()}, of {of}",
        need="scores that single frames tell, for recordings",
        fix="Take scores of detections or clusters, or scenarios.",
    )


def scenario_of(source: Scenario | Recorded) -> Scenario:
    """The settings of a source."""
    return source if isinstance(source, Scenario) else source.scenario


def with_scenario(source: Scenario | Recorded, scenario: Scenario) -> Scenario | Recorded:
    """The same source under other settings."""
    return scenario if isinstance(source, Scenario) else replace(source, scenario=scenario)


def all_together(layout: Layout, sums: np.ndarray) -> np.ndarray:
    """Sums of each score of all its subjects, side by side, (n_trials, n)."""
    return np.hstack([layout.sums_of(sums, score.label()) for score in layout.scores])


@lru_cache(maxsize=4)
def prepared(source: Scenario | Recorded, scores: tuple[Score, ...], seed: int) -> _Tried:
    """A source ready to be tried; kept, as blocks of one come one after the other."""
    if isinstance(source, Scenario):
        return Prepared(source, scores, seed=seed)
    return PreparedRecording(source, scores)


def tried_block(
    source: Scenario | Recorded,
    scores: tuple[Score, ...],
    seed: int,
    *,
    point: int,
    number: int,
    trials: range,
) -> Block:
    """Some trials of a source, their sums of all subjects together, on one thread.

    A trial that raises ends the block: settings that fail once are not taken.
    """
    n_sums = sum(score.n_sums for score in scores)
    sums = np.full((len(trials), n_sums), np.nan)
    failures: tuple[Failure, ...] = ()
    started = perf_counter()
    with alone(), heard():
        for row, trial in enumerate(trials):
            try:
                ready = prepared(source, scores, seed)
                sums[row] = all_together(ready.layout, ready.sums(trial)[None])
            except Exception as error:  # whatever it is, these settings do not do
                failures = (Failure(trial, f"{type(error).__name__}: {error}"),)
                break
    seconds = perf_counter() - started
    return Block(point, number, trials.start, sums, seconds, failures)


def frames_of(sources: Sequence[Scenario | Recorded]) -> tuple[int | None, ...]:
    """Frames that each recording has; None for scenes, which have as many as are wanted."""
    return tuple(
        None if isinstance(one, Scenario) else opened_recording(one.scenario).n_frames
        for one in sources
    )
