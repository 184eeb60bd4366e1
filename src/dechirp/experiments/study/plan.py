"""Plan of a study: its numbered points, and the scenario of each."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.config.dumping import dump_node_on_one_line
from dechirp.config.error_messages import SettingNode
from dechirp.config.fields import ValueType
from dechirp.config.setting_paths import iter_referenced_files
from dechirp.config.yaml_tree import YamlNode, join_setting_path, parse_yaml
from dechirp.core.checks import check_integer
from dechirp.core.errors import quote_for_message
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.dumping import dump_study_as_yaml
from dechirp.experiments.study.study import RandomSetting, Study, SweptSetting
from dechirp.experiments.study.variants import (
    ABSOLUTE_CONTEXT,
    ScenarioVariants,
    check_settings_do_not_overlap,
)

TRIAL_DRAW_KEY = 2**31 + 1
"""Second spawn key of the settings drawn in each trial; the first is the number of the trial."""
POINT_DRAW_KEY = 2**31 + 2
"""Spawn key of the settings drawn once a point."""


@dataclass(frozen=True, eq=False)  # hashed by identity, as the key of caches
class Plan:
    """Numbered points of a study: small, picklable, and identical on every worker.

    Points count through the grid of swept settings, the last one of `vary` fastest, except that
    the points of `draw` are faster still. Points are not stored: each is computed from its number.
    """

    study: Study

    @classmethod
    def from_study(cls, study: Study) -> "Plan":
        """Plan a study.

        Raises
        ------
        InvalidSetting
            If a varied setting does not exist in the scenario, or lies within another varied one.
        """
        plan = cls(study)
        check_settings_do_not_overlap(
            plan._scenario_variants.locate_setting(axis.path) for axis in study.vary
        )
        return plan

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.study,)  # without cached values

    @property
    def swept_settings(self) -> tuple[SweptSetting, ...]:
        """Swept settings: the axes of the grid."""
        return tuple(axis for axis in self.study.vary if isinstance(axis, SweptSetting))

    @property
    def random_settings(self) -> tuple[RandomSetting, ...]:
        """Random settings, drawn once a point or in each trial."""
        return tuple(axis for axis in self.study.vary if isinstance(axis, RandomSetting))

    @cached_property
    def grid_shape(self) -> tuple[int, ...]:
        """Number of values of each of `swept_settings`; with `draw`, then its number of points."""
        draw = self.study.draw
        grid = tuple(len(axis.texts) for axis in self.swept_settings)
        return grid if draw is None else (*grid, draw.n)

    @property
    def n_points(self) -> int:
        """Number of points of the study; 1 where nothing is varied."""
        return prod(self.grid_shape)

    def grid_index_of_point(self, point: int) -> tuple[int, ...]:
        """Return the index of a point along each axis of `grid_shape`.

        Raises
        ------
        InvalidSetting
            If there is no such point.
        """
        check_integer("Plan.point", point, at_least=0, at_most=self.n_points - 1)
        return (
            tuple(int(k) for k in np.unravel_index(point, self.grid_shape))
            if self.grid_shape
            else ()
        )

    def setting_texts_of_point(self, point: int) -> tuple[tuple[str, str], ...]:
        """Return path and text of the varied settings of a point, in the order of `vary`.

        Settings drawn in each trial are excluded: see `drawn_setting_texts_of_trial`.
        """
        index = self.grid_index_of_point(point)
        settings: list[tuple[str, str]] = []
        indices = iter(index)
        draws = iter(
            self._drawn_numbers_of_all_points[index[-1]] if self.study.draw is not None else ()
        )
        for axis in self.study.vary:
            if isinstance(axis, SweptSetting):
                settings.append((axis.path, axis.texts[next(indices)]))
            elif self.study.draw is not None:
                settings.append((axis.path, _drawn_number_with_unit(axis, next(draws))))
        return tuple(settings)

    def setting_labels_of_point(self, point: int) -> tuple[tuple[str, str], ...]:
        """Return path and legend label of the varied settings of a point."""
        named = {
            axis.path: dict(zip(axis.texts, axis.labels, strict=True))
            for axis in self.swept_settings
        }
        return tuple(
            (path, named[path][text] if path in named else text)
            for path, text in self.setting_texts_of_point(point)
        )

    def numeric_settings_of_point(self, point: int) -> tuple[float | None, ...]:
        """Return the settings of a point as numbers in the units of their axes; None for texts."""
        index = self.grid_index_of_point(point)
        numbers: list[float | None] = []
        indices = iter(index)
        draws = iter(
            self._drawn_numbers_of_all_points[index[-1]] if self.study.draw is not None else ()
        )
        for axis in self.study.vary:
            if isinstance(axis, SweptSetting):
                value_index = next(indices)
                numbers.append(None if axis.numbers is None else axis.numbers[value_index])
            elif self.study.draw is not None:
                numbers.append(_round_to_12_digits(next(draws)))
        return tuple(numbers)

    @property
    def has_settings_drawn_per_trial(self) -> bool:
        """True if settings are drawn in each trial."""
        return self.study.draw is None and bool(self.random_settings)

    def drawn_setting_texts_of_trial(self, trial: int) -> dict[str, str]:
        """Return path and text of the settings drawn in a trial, equal at every point."""
        axes = self.random_settings if self.has_settings_drawn_per_trial else ()
        both = zip(axes, self.drawn_setting_numbers_of_trial(trial), strict=True)
        return {axis.path: _drawn_number_with_unit(axis, number) for axis, number in both}

    def drawn_setting_numbers_of_trial(self, trial: int) -> tuple[float, ...]:
        """Return the settings drawn in a trial as numbers, in the units of `random_settings`."""
        if not self.has_settings_drawn_per_trial:
            return ()
        axes = self.random_settings
        sequence = np.random.SeedSequence(self.study.seed, spawn_key=(trial, TRIAL_DRAW_KEY))
        shares = np.random.default_rng(sequence).random(len(axes))
        return tuple(
            _round_to_12_digits(_distribution_quantile(axis, u))
            for axis, u in zip(axes, shares, strict=True)
        )

    def scenario_of_point(
        self, point: int, trial_settings: Mapping[str, str] | None = None
    ) -> Scenario:
        """Return the scenario of a point, with the settings drawn in a trial.

        Raises
        ------
        DechirpError
            If the settings are invalid together.
        """
        return self._scenario_variants.scenario_with_settings(
            {**dict(self.setting_texts_of_point(point)), **(trial_settings or {})}
        )

    def study_identity_texts(self) -> dict[str, str]:
        """Return everything that must not change between calls that add to the same results.

        `study` and `scenario`, their texts; `version` of this package; and for each file that
        settings name, `file PATH`, the SHA-256 of its content.
        """
        # A stopped study may continue with larger limits: no result depends on them.
        comparable = replace(
            self.study,
            stop_after_failures=Study.stop_after_failures,
            at_most_bytes=Study.at_most_bytes,
        )
        digest = {
            "study": dump_study_as_yaml(comparable, with_scenario=False),
            "scenario": self._scenario_variants.scenario_yaml,
            "version": str(import_module("dechirp").__version__),
        }
        for path in sorted(set(self._iter_files_named_in_settings())):
            digest[f"file {path}"] = _file_sha256(Path(path))
        return digest

    @cached_property
    def _scenario_variants(self) -> ScenarioVariants:
        return ScenarioVariants(self.study.scenario)

    @cached_property
    def _drawn_numbers_of_all_points(self) -> np.ndarray:
        """Random settings of all points, (n, axis)."""
        draw, axes = self.study.draw, self.random_settings
        assert draw is not None
        sequence = np.random.SeedSequence(self.study.seed, spawn_key=(POINT_DRAW_KEY,))
        rng = np.random.default_rng(sequence)
        if draw.method == "sobol":
            shares = _sobol_points(draw.n, len(axes), rng)
        else:
            shares = rng.random((draw.n, len(axes)))
        columns = [
            _distribution_quantile(axis, shares[:, column]) for column, axis in enumerate(axes)
        ]
        return np.stack(columns, axis=1)

    def _iter_files_named_in_settings(self) -> Iterator[str]:
        yield from _iter_file_paths_in_value(
            parse_yaml(self._scenario_variants.scenario_yaml, ""), ValueType(Scenario)
        )
        for axis in self.swept_settings:
            for text in axis.texts if axis.numbers is None else ():
                yield from _iter_file_paths_in_value(
                    parse_yaml(text, ""),
                    self._scenario_variants.locate_setting(axis.path).leaf_value_type,
                )


def describe_identity_changes(
    saved_identity: Mapping[str, str], current_identity: Mapping[str, str]
) -> list[str]:
    """Describe the differences of two digests, one a setting: `seed: 1 -> 2`."""
    changes = []
    for key in dict.fromkeys([*saved_identity, *current_identity]):
        old_text, new_text = saved_identity.get(key), current_identity.get(key)
        if old_text == new_text:
            continue
        if key in ("study", "scenario") and old_text is not None and new_text is not None:
            prefix = "" if key == "study" else "scenario"
            old_settings = dict(_iter_leaf_setting_texts(parse_yaml(old_text, ""), prefix))
            new_settings = dict(_iter_leaf_setting_texts(parse_yaml(new_text, ""), prefix))
            for path in dict.fromkeys([*old_settings, *new_settings]):
                if old_settings.get(path) != new_settings.get(path):
                    changes.append(
                        f"{path}: {_quoted_text_or_not_set(old_settings.get(path))} ->"
                        f" {_quoted_text_or_not_set(new_settings.get(path))}"
                    )
        elif key.startswith("file "):
            change = (
                "other content"
                if old_text and new_text
                else "named now"
                if new_text
                else "not named"
            )
            changes.append(f"{key}: {change}")
        else:
            changes.append(
                f"{key}: {_quoted_text_or_not_set(old_text)} -> {_quoted_text_or_not_set(new_text)}"
            )
    return changes


def _iter_leaf_setting_texts(node: YamlNode, path: str) -> Iterator[tuple[str, str]]:
    """Yield path and text of each setting of a tree; a list of scalars is one setting."""
    content = node.content
    if isinstance(content, list):
        plain = not any(isinstance(member.content, dict) for member in content)
    else:
        plain = not (isinstance(content, dict) and content)
    if plain:
        yield path, dump_node_on_one_line(node)
        return
    for label, child in node.iter_children():
        yield from _iter_leaf_setting_texts(child, join_setting_path(path, label))


def _quoted_text_or_not_set(text: str | None) -> str:
    return "not set" if text is None else quote_for_message(text)


def _iter_file_paths_in_value(node: YamlNode, value_type: ValueType) -> Iterator[str]:
    for _, path in iter_referenced_files(SettingNode("", node, value_type), ABSOLUTE_CONTEXT):
        yield path


def _file_sha256(path: Path) -> str:
    try:
        return sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"not readable: {error.strerror}"


def _sobol_points(n: int, n_axes: int, rng: np.random.Generator) -> np.ndarray:
    """Draw points of a scrambled Sobol sequence, (n, axis), centred in their cells of 2^-30.

    Source: Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14, 1998.
    """
    from scipy.stats import qmc  # takes a second to import

    points = qmc.Sobol(n_axes, scramble=True, bits=30, seed=rng).random(n)
    return np.asarray(points + 2.0**-31)


def _distribution_quantile(random_setting: RandomSetting, probability: Any) -> Any:
    """Return the quantile of a distribution."""
    from scipy.special import ndtri

    if random_setting.distribution == "uniform":
        return random_setting.first + (random_setting.second - random_setting.first) * probability
    return random_setting.first + random_setting.second * ndtri(np.maximum(probability, 2.0**-54))


def _round_to_12_digits(number: float) -> float:
    return float(f"{number:.12g}")


def _drawn_number_with_unit(random_setting: RandomSetting, number: float) -> str:
    return f"{float(f'{number:.12g}')!r} {random_setting.unit}".strip()
