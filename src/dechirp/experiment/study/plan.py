"""The points of a study by their numbers, and the scenario of each."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.config.fields import Slot
from dechirp.config.mistakes import Spot
from dechirp.config.shown import shown
from dechirp.config.texts import line
from dechirp.config.tree import Node, dotted, read_tree
from dechirp.config.within import files_in
from dechirp.core.checks import whole
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.study.study import Drawn, Listed, Study
from dechirp.experiment.study.text import study_text
from dechirp.experiment.study.variants import HERE, Variants, must_be_apart

DRAWN_KEY = 2**31 + 1
"""Second spawn key of what is drawn anew in a trial; its first is the number of the trial."""
POINTS_KEY = 2**31 + 2
"""Spawn key of the points that are drawn together."""


@dataclass(frozen=True, eq=False)  # one in hand is its own key of what is kept beside
class Plan:
    """Numbered points of a study: small, and the same wherever it is unpacked.

    Points count through the grid of lists, the last list of `vary` fastest but for the points
    of `draw`, which are faster. None is kept: each is made of its number.
    """

    study: Study

    @classmethod
    def of(cls, study: Study) -> "Plan":
        """Plan of a study.

        Raises
        ------
        InvalidSetting
            If a setting that is varied is none of the scenario's, or lies in another.
        """
        plan = cls(study)
        must_be_apart(plan._variants.way(axis.path) for axis in study.vary)
        return plan

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.study,)  # without what is kept beside

    @property
    def axes(self) -> tuple[Listed, ...]:
        """Settings that take values in turn: the grid."""
        return tuple(axis for axis in self.study.vary if isinstance(axis, Listed))

    @property
    def drawn_axes(self) -> tuple[Drawn, ...]:
        """Settings that are drawn, with the points or in each trial."""
        return tuple(axis for axis in self.study.vary if isinstance(axis, Drawn))

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Values of each of `axes`; with `draw`, the number of its points at the end."""
        draw = self.study.draw
        grid = tuple(len(axis.texts) for axis in self.axes)
        return grid if draw is None else (*grid, draw.n)

    @property
    def n_points(self) -> int:
        """Points of the study; 1 where nothing is varied."""
        return prod(self.shape)

    def index(self, point: int) -> tuple[int, ...]:
        """Index of a point along each axis of `shape`.

        Raises
        ------
        InvalidSetting
            If there is no such point.
        """
        whole("Plan.point", point, at_least=0, at_most=self.n_points - 1)
        return tuple(int(k) for k in np.unravel_index(point, self.shape)) if self.shape else ()

    def settings(self, point: int) -> tuple[tuple[str, str], ...]:
        """Path and text of what is varied, in the order of `vary`.

        Without what is drawn in each trial: `drawn` has that.
        """
        index = self.index(point)
        found: list[tuple[str, str]] = []
        places = iter(index)
        draws = iter(self._draws[index[-1]] if self.study.draw is not None else ())
        for axis in self.study.vary:
            if isinstance(axis, Listed):
                found.append((axis.path, axis.texts[next(places)]))
            elif self.study.draw is not None:
                found.append((axis.path, _in_words(axis, next(draws))))
        return tuple(found)

    def labels(self, point: int) -> tuple[tuple[str, str], ...]:
        """The same settings, with what a legend says in the place of long texts."""
        named = {axis.path: dict(zip(axis.texts, axis.labels, strict=True)) for axis in self.axes}
        return tuple(
            (path, named[path][text] if path in named else text)
            for path, text in self.settings(point)
        )

    def numbers(self, point: int) -> tuple[float | None, ...]:
        """Numbers of the same settings, in the units of their axes; None where they are words."""
        index = self.index(point)
        found: list[float | None] = []
        places = iter(index)
        draws = iter(self._draws[index[-1]] if self.study.draw is not None else ())
        for axis in self.study.vary:
            if isinstance(axis, Listed):
                place = next(places)
                found.append(None if axis.numbers is None else axis.numbers[place])
            elif self.study.draw is not None:
                found.append(_rounded(next(draws)))
        return tuple(found)

    @property
    def draws_anew(self) -> bool:
        """Whether settings are drawn in each trial."""
        return self.study.draw is None and bool(self.drawn_axes)

    def drawn(self, trial: int) -> dict[str, str]:
        """Path and text of what is drawn anew in a trial, the same at every point."""
        axes = self.drawn_axes if self.draws_anew else ()
        both = zip(axes, self.numbers_drawn(trial), strict=True)
        return {axis.path: _in_words(axis, number) for axis, number in both}

    def numbers_drawn(self, trial: int) -> tuple[float, ...]:
        """The same as numbers, in the units of `drawn_axes`."""
        if not self.draws_anew:
            return ()
        axes = self.drawn_axes
        sequence = np.random.SeedSequence(self.study.seed, spawn_key=(trial, DRAWN_KEY))
        shares = np.random.default_rng(sequence).random(len(axes))
        return tuple(_rounded(_drawn(axis, u)) for axis, u in zip(axes, shares, strict=True))

    def scenario(self, point: int, drawn: Mapping[str, str] | None = None) -> Scenario:
        """Scenario of a point, with what is drawn in a trial.

        Raises
        ------
        DechirpError
            If its settings cannot be together.
        """
        return self._variants.of({**dict(self.settings(point)), **(drawn or {})})

    def digest(self) -> dict[str, str]:
        """What must not change between calls that add to the same results.

        `study` and `scenario`, their texts; `version` of this package; and for each file that
        settings name, `file PATH`, the SHA-256 of its content.
        """
        # A study that stopped may go on with a larger share, or more room: no number depends
        # on them.
        asked = replace(
            self.study,
            stop_after_failures=Study.stop_after_failures,
            at_most_bytes=Study.at_most_bytes,
        )
        found = {
            "study": study_text(asked, with_scenario=False),
            "scenario": self._variants.text,
            "version": str(import_module("dechirp").__version__),
        }
        for path in sorted(set(self._files())):
            found[f"file {path}"] = _sum_of(Path(path))
        return found

    @cached_property
    def _variants(self) -> Variants:
        return Variants(self.study.scenario)

    @cached_property
    def _draws(self) -> np.ndarray:
        """Numbers of the points that are drawn, (n, axis)."""
        draw, axes = self.study.draw, self.drawn_axes
        assert draw is not None
        sequence = np.random.SeedSequence(self.study.seed, spawn_key=(POINTS_KEY,))
        rng = np.random.default_rng(sequence)
        if draw.method == "sobol":
            shares = _sobol(draw.n, len(axes), rng)
        else:
            shares = rng.random((draw.n, len(axes)))
        columns = [_drawn(axis, shares[:, at]) for at, axis in enumerate(axes)]
        return np.stack(columns, axis=1)

    def _files(self) -> Iterator[str]:
        yield from _named(read_tree(self._variants.text, ""), Slot(Scenario))
        for axis in self.axes:
            for text in axis.texts if axis.numbers is None else ():
                yield from _named(read_tree(text, ""), self._variants.way(axis.path).leaf)


def differences(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Say in what two digests differ: `seed: 1 -> 2`, a setting each."""
    found = []
    for key in dict.fromkeys([*then, *now]):
        before, after = then.get(key), now.get(key)
        if before == after:
            continue
        if key in ("study", "scenario") and before is not None and after is not None:
            prefix = "" if key == "study" else "scenario"
            old = dict(_flat(read_tree(before, ""), prefix))
            new = dict(_flat(read_tree(after, ""), prefix))
            for path in dict.fromkeys([*old, *new]):
                if old.get(path) != new.get(path):
                    found.append(f"{path}: {_shown(old.get(path))} -> {_shown(new.get(path))}")
        elif key.startswith("file "):
            change = "other content" if before and after else "named now" if after else "not named"
            found.append(f"{key}: {change}")
        else:
            found.append(f"{key}: {_shown(before)} -> {_shown(after)}")
    return found


def _flat(node: Node, path: str) -> Iterator[tuple[str, str]]:
    """Settings of a tree with their paths; a list of plain values is one."""
    content = node.content
    if isinstance(content, list):
        plain = not any(isinstance(member.content, dict) for member in content)
    else:
        plain = not (isinstance(content, dict) and content)
    if plain:
        yield path, line(node)
        return
    for label, child in node.inside():
        yield from _flat(child, dotted(path, label))


def _shown(text: str | None) -> str:
    return "not set" if text is None else shown(text)


def _named(node: Node, slot: Slot) -> Iterator[str]:
    for _, path in files_in(Spot("", node, slot), HERE):
        yield path


def _sum_of(path: Path) -> str:
    try:
        return sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"not readable: {error.strerror}"


def _sobol(n: int, n_axes: int, rng: np.random.Generator) -> np.ndarray:
    """Points of a scrambled Sobol sequence, (n, axis), each in the middle of its cell of 2^-30.

    Source: Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14, 1998.
    """
    from scipy.stats import qmc  # takes a second to import

    points = qmc.Sobol(n_axes, scramble=True, bits=30, seed=rng).random(n)
    return np.asarray(points + 2.0**-31)


def _drawn(axis: Drawn, share: Any) -> Any:
    """Quantile of a distribution."""
    from scipy.special import ndtri

    if axis.distribution == "uniform":
        return axis.first + (axis.second - axis.first) * share
    return axis.first + axis.second * ndtri(np.maximum(share, 2.0**-54))


def _rounded(number: float) -> float:
    return float(f"{number:.12g}")


def _in_words(axis: Drawn, number: float) -> str:
    return f"{float(f'{number:.12g}')!r} {axis.unit}".strip()
