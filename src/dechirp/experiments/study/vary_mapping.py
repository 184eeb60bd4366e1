"""Mapping of the key `vary`: its numbers, and all of its mistakes at once."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from decimal import Decimal

from dechirp.config.error_messages import SettingNode
from dechirp.config.fields import ValueType, describe_accepted_values
from dechirp.config.quantities import (
    convert_difference_to_unit,
    convert_quantity_to_unit,
    split_number_and_unit,
)
from dechirp.config.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix
from dechirp.config.yaml_tree import YamlNode
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake, quote_for_message

LEVEL_UNITS = {name for kind in DIMENSIONS.values() for name, _ in kind.db_units}
"""Units of levels, whose equal steps are equal ratios."""


class VaryMapping:
    """Mapping of the key `vary`, with the mistakes found in it."""

    def __init__(self, spot: SettingNode) -> None:
        assert isinstance(spot.node.content, dict)
        self.spot, self.path, self.content = spot, spot.path, spot.node.content
        self.mistakes: list[Mistake] = []

    def add_mistake(self, name: str, *, value: str, expected: str, fix: str) -> None:
        """Record a mistake of one of its settings."""
        node = self.content.get(name)
        place = node.location if node is not None else self.spot.location
        self.mistakes.append(
            place.create_mistake(f"{self.path}.{name}", value=value, expected=expected, fix=fix)
        )

    def raise_mistakes(self) -> None:
        """Raise `InvalidFile` with all mistakes recorded so far."""
        if self.mistakes:
            raise InvalidFile(*self.mistakes)

    def check_names(self, words: Sequence[str]) -> None:
        """Record a mistake for each unknown name."""
        for name, node in self.content.items():
            if name not in words:
                self.mistakes.append(unknown_name_mistake(self.spot, name, node, words))

    def check_present(self, name: str) -> None:
        """Record a mistake if a name is missing."""
        if name not in self.content:
            self.add_mistake(name, value="missing", expected="given", fix=f"add {name}")

    def check_numeric(self, what: str) -> None:
        """Raise if the setting does not take numbers."""
        if not is_numeric(self.spot.value_type):
            self.mistakes.append(
                self.spot.location.create_mistake(
                    self.path,
                    value=what,
                    expected="a list: this setting takes "
                    + describe_accepted_values(self.spot.value_type),
                    fix="write the values in brackets",
                )
            )
            self.raise_mistakes()  # other checks need a numeric setting

    def find_unit(self, names: Sequence[str], unit: str | None) -> str:
        """Return the unit of the first of the named values that has one."""
        symbol = ""
        for name in names:
            text = self._number_text(name)
            if text is None:
                continue
            with self._record_mistakes(name):
                symbol = symbol or split_number_and_unit(text, unit)[1]
        return symbol

    def read_number(self, name: str, symbol: str, unit: str | None) -> Decimal:
        """Return the number of a quantity in a unit; 0 if it is invalid."""
        with self._record_mistakes(name):
            number = convert_quantity_to_unit(symbol, self.content[name].text, unit)
            if number is not None:
                return number
            self.add_mistake(
                name,
                value=self.content[name].content_description,
                expected=f"a level in {symbol}, as the other end has",
                fix="write it in dB, or both without",
            )
        return Decimal(0)

    def read_difference(self, name: str, symbol: str) -> Decimal:
        """Return the number of a difference; 0 if it is invalid."""
        if self._number_text(name) is not None:
            with self._record_mistakes(name):
                return convert_difference_to_unit(
                    symbol, self.content[name].text, unit_suffix(self.spot.value_type)
                )
        return Decimal(0)

    def check_n_values(self, n: float, name: str, at_most: int) -> None:
        """Record a mistake if there are too many values."""
        if n >= at_most + 1:
            is_countable = n < 1e15
            n_text = f"{n:.0f}" if is_countable else f"{n:.0e}"
            self.add_mistake(
                name,
                value=f"{self.content[name].content_description}, which makes {n_text} values",
                expected=f"at most at_most_points, {at_most}",
                fix=f"take fewer, or confirm it: at_most_points: {n_text}"
                if is_countable
                else "take fewer",
            )

    def _number_text(self, name: str) -> str | None:
        node = self.content.get(name)
        if node is None:
            return None
        if isinstance(node.content, bool) or not isinstance(node.content, str | int | float):
            need = DIMENSIONS[unit_suffix(self.spot.value_type)].description
            self.add_mistake(
                name, value=node.content_description, expected=need, fix="write one number"
            )
            return None
        return node.text

    @contextmanager
    def _record_mistakes(self, name: str) -> Iterator[None]:
        try:
            yield
        except InvalidSetting as error:
            (mistake,) = error.mistakes
            self.add_mistake(name, value=mistake.value, expected=mistake.expected, fix=mistake.fix)


def is_numeric(slot: ValueType) -> bool:
    """Return whether a setting takes numbers."""
    return float in slot.types_without_none or int in slot.types_without_none


def is_integer(slot: ValueType) -> bool:
    """Return whether a setting takes integers only."""
    return float not in slot.types_without_none


def unit_suffix(slot: ValueType) -> str | None:
    """Return the unit suffix of a setting's numbers; counts are bare, as probabilities are."""
    return "probability" if is_integer(slot) else slot.unit


def difference_unit(symbol: str) -> str:
    """Return the unit of a difference of two values."""
    return {"degC": "K"}.get(symbol, "dB" if symbol in LEVEL_UNITS else symbol)


def unknown_name_mistake(
    spot: SettingNode, name: str, node: YamlNode, words: Sequence[str]
) -> Mistake:
    """Return the mistake for a name that is not among the known ones."""
    return node.name_location.create_mistake(
        f"{spot.path}.{quote_for_message(name)}",
        value="not a known name",
        expected=f"one of {', '.join(words)}",
        fix=did_you_mean_fix(name, words, CHOOSE_OR_OMIT),
    )
