"""Variants of a scenario: settings replaced as by `--set`, at the cost of their checks alone."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from dechirp.config import loading
from dechirp.config.dumping import dump_yaml
from dechirp.config.setting_paths import (
    SettingPath,
    build_value_with_replaced_setting,
    find_setting,
    replace_settings,
)
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.experiments.scenario import READERS, Scenario

ABSOLUTE_CONTEXT = ValidationContext(folder=Path(), readers=READERS)
"""Context for texts that name files by absolute paths."""

_CACHE_SIZE = 10_000  # values, including those drawn in each trial


@dataclass(frozen=True)
class Variants:
    """Scenarios that differ from one scenario in some settings."""

    scenario: Scenario

    def resolve_path(self, path: str) -> SettingPath:
        """Locate a setting by its path; raise `InvalidSetting` if it does not exist."""
        if path not in self._resolved_paths:
            self._resolved_paths[path] = find_setting(self.scenario, path)
        return self._resolved_paths[path]

    def with_settings(self, texts: Mapping[str, str]) -> Scenario:
        """Return the scenario with settings replaced by YAML texts, by path; equals `--set`.

        Raises
        ------
        DechirpError
            If a setting does not exist, or the settings are invalid together.
        """
        if not texts:
            return self.scenario
        try:
            ways = [self.resolve_path(path) for path in texts]
            check_disjoint(ways)
            values = {way.steps: self._read_value(way, texts[way.path]) for way in ways}
            if len(values) == len(ways):
                return replace_settings(self.scenario, values)
        except DechirpError:
            pass  # repeated as text, for its error messages
        options = [f"{path}={text}" for path, text in texts.items()]
        try:
            return loading.parse_settings(
                self.text, Scenario, file="", overrides=options, readers=READERS
            )
        except InvalidFile as error:
            # Positions in a file that does not exist are dropped.
            raise InvalidFile(
                *(
                    replace(mistake, file=None, line=None, column=None)
                    if mistake.file in ("", "--set")
                    else mistake
                    for mistake in error.mistakes
                )
            ) from None

    @cached_property
    def text(self) -> str:
        """YAML text of the scenario."""
        return dump_yaml(self.scenario)

    @cached_property
    def _resolved_paths(self) -> dict[str, SettingPath]:
        return {}

    @cached_property
    def _value_cache(self) -> dict[tuple[str, str], Any]:
        return {}

    def _read_value(self, way: SettingPath, text: str) -> Any:
        """Read the value of a setting from its text, with a cache for repeated texts."""
        key = (way.path, text)
        if key in self._value_cache:
            return self._value_cache[key]
        value = build_value_with_replaced_setting(
            self.scenario, way, parse_yaml(text, ""), ABSOLUTE_CONTEXT
        )
        if len(self._value_cache) < _CACHE_SIZE:
            self._value_cache[key] = value
        return value


def check_disjoint(paths: Iterable[SettingPath]) -> None:
    """Raise `InvalidSetting` if two settings are equal, or one lies within another."""
    previous: list[SettingPath] = []
    for path in paths:
        for other in previous:
            if path.overlaps(other):
                raise InvalidSetting(
                    f"vary.{path.path}",
                    value=f"varied beside {other.path}, which changes it as well",
                    expected="settings that lie apart",
                    fix="keep one of them, with values that say both",
                )
        previous.append(path)
