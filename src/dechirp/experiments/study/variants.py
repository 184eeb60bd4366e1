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
from dechirp.experiments.scenario import READERS, Scenario, keep_given_chain_settings

ABSOLUTE_CONTEXT = ValidationContext(folder=Path(), readers=READERS)
"""Context for texts that name files by absolute paths."""

_CACHE_SIZE = 10_000  # values, including those drawn in each trial


@dataclass(frozen=True)
class ScenarioVariants:
    """Scenarios that differ from one scenario in some settings."""

    scenario: Scenario

    def locate_setting(self, path: str) -> SettingPath:
        """Locate a setting by its path; raise `InvalidSetting` if it does not exist."""
        if path not in self._located_settings_by_path:
            self._located_settings_by_path[path] = find_setting(self.scenario, path)
        return self._located_settings_by_path[path]

    def scenario_with_settings(self, value_texts_by_path: Mapping[str, str]) -> Scenario:
        """Return the scenario with settings replaced by YAML texts, by path; equals `--set`.

        Raises
        ------
        DechirpError
            If a setting does not exist, or the settings are invalid together.
        """
        if not value_texts_by_path:
            return self.scenario
        options = [f"{path}={text}" for path, text in value_texts_by_path.items()]
        try:
            ways = [self.locate_setting(path) for path in value_texts_by_path]
            check_settings_do_not_overlap(ways)
            values = {
                way.steps: self._parse_setting_value_cached(way, value_texts_by_path[way.path])
                for way in ways
            }
            if len(values) == len(ways):
                return keep_given_chain_settings(replace_settings(self.scenario, values), options)
        except DechirpError:
            pass  # repeated as text, for its error messages
        try:
            changed = loading.parse_settings(
                self.scenario_yaml, Scenario, file="", overrides=options, readers=READERS
            )
            return keep_given_chain_settings(changed, options)
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
    def scenario_yaml(self) -> str:
        """YAML text of the scenario."""
        return dump_yaml(self.scenario)

    @cached_property
    def _located_settings_by_path(self) -> dict[str, SettingPath]:
        return {}

    @cached_property
    def _parsed_value_cache(self) -> dict[tuple[str, str], Any]:
        return {}

    def _parse_setting_value_cached(self, setting: SettingPath, text: str) -> Any:
        """Read the value of a setting from its text, with a cache for repeated texts."""
        key = (setting.path, text)
        if key in self._parsed_value_cache:
            return self._parsed_value_cache[key]
        value = build_value_with_replaced_setting(
            self.scenario, setting, parse_yaml(text, ""), ABSOLUTE_CONTEXT
        )
        if len(self._parsed_value_cache) < _CACHE_SIZE:
            self._parsed_value_cache[key] = value
        return value


def check_settings_do_not_overlap(settings: Iterable[SettingPath]) -> None:
    """Raise `InvalidSetting` if two settings are equal, or one lies within another."""
    previous: list[SettingPath] = []
    for path in settings:
        for other in previous:
            if path.overlaps(other):
                raise InvalidSetting(
                    f"vary.{path.path}",
                    value=f"cannot be combined with {other.path}, which sets the same values",
                    expected="settings of which none contains another",
                    fix="keep one of them",
                )
        previous.append(path)
