"""A scenario with other settings, as `--set` would change it, in the time of its own checks."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from dechirp.config import files
from dechirp.config.models import Context
from dechirp.config.texts import dump
from dechirp.config.tree import read_tree
from dechirp.config.within import Way, changed, read_at, way_to
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.experiment.scenario import READERS, Scenario

HERE = Context(base=Path(), readers=READERS)
"""Where texts are read that name files by absolute paths."""

_KEPT = 10_000  # values, those that are drawn anew in each trial among them


@dataclass(frozen=True)
class Variants:
    """What a scenario becomes when some of its settings are others."""

    scenario: Scenario

    def way(self, path: str) -> Way:
        """Where a setting lies; raises `InvalidSetting` where there is none of that path."""
        if path not in self._ways:
            self._ways[path] = way_to(self.scenario, path)
        return self._ways[path]

    def of(self, texts: Mapping[str, str]) -> Scenario:
        """Scenario with settings by path as YAML texts say; equal to what `--set` makes of them.

        Raises
        ------
        DechirpError
            If there are no such settings, or they cannot be so together.
        """
        if not texts:
            return self.scenario
        try:
            ways = [self.way(path) for path in texts]
            must_be_apart(ways)
            read = {way.steps: self._value(way, texts[way.path]) for way in ways}
            if len(read) == len(ways):
                return changed(self.scenario, read)
        except DechirpError:
            pass  # once more as text, for the words of what is wrong
        options = [f"{path}={text}" for path, text in texts.items()]
        try:
            return files.parse(self.text, Scenario, file="", overrides=options, readers=READERS)
        except InvalidFile as error:
            # Nobody can look into a file that is not there.
            raise InvalidFile(
                *(
                    replace(one, file=None, line=None, column=None)
                    if one.file in ("", "--set")
                    else one
                    for one in error.mistakes
                )
            ) from None

    @cached_property
    def text(self) -> str:
        """The scenario as a settings file."""
        return dump(self.scenario)

    @cached_property
    def _ways(self) -> dict[str, Way]:
        return {}

    @cached_property
    def _kept(self) -> dict[tuple[str, str], Any]:
        return {}

    def _value(self, way: Way, text: str) -> Any:
        """Value at the steps of a way, kept where the text comes again."""
        key = (way.path, text)
        if key in self._kept:
            return self._kept[key]
        made = read_at(self.scenario, way, read_tree(text, ""), HERE)
        if len(self._kept) < _KEPT:
            self._kept[key] = made
        return made


def must_be_apart(ways: Iterable[Way]) -> None:
    """Raise `InvalidSetting` where two settings are the same, or one lies in another."""
    before: list[Way] = []
    for way in ways:
        for other in before:
            if way.meets(other):
                raise InvalidSetting(
                    f"vary.{way.path}",
                    got=f"varied beside {other.path}, which changes it as well",
                    need="settings that lie apart",
                    fix="Keep one of them, with values that say both.",
                )
        before.append(way)
