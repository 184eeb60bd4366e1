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
from dechirp.config.yaml_tree import YamlNode
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake, quote_for_message
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix

LEVEL_UNITS = {name for kind in DIMENSIONS.values() for name, _ in kind.db_units}
"""Units of levels, whose equal steps are equal ratios."""


class VaryMapping:
    """Mapping of the key `vary`, with the mistakes found in it."""

    def __init__(self, spot: SettingNode) -> None:
        assert isinstance(spot.node.content, dict)
        self.spot, self.path, self.content = spot, spot.path, spot.node.content
        self.mistakes: list[Mistake] = []

    def record_mistake(self, name: str, *, value: str, expected: str, fix: str) -> None:
        """Record a mistake of one of its settings."""
        node = self.content.get(name)
        place = node.location if node is not None else self.spot.location
        self.mistakes.append(
            place.create_mistake(f"{self.path}.{name}", value=value, expected=expected, fix=fix)
        )

    def raise_recorded_mistakes(self) -> None:
        """Raise `InvalidFile` with all mistakes recorded so far."""
        if self.mistakes:
            raise InvalidFile(*self.mistakes)

    def record_unknown_names(self, known_names: Sequence[str]) -> None:
        """Record a mistake for each unknown name."""
        for name, node in self.content.items():
            if name not in known_names:
                self.mistakes.append(unknown_name_mistake(self.spot, name, node, known_names))

    def record_if_missing(self, name: str, *, expected: str) -> None:
        """Record a mistake if a name is missing."""
        if name not in self.content:
            self.record_mistake(name, value="missing", expected=expected, fix=f"add {name}")

    def check_setting_takes_numbers(self, written_value: str) -> None:
        """Raise if the setting does not take numbers."""
        if not accepts_numbers(self.spot.value_type):
            self.mistakes.append(
                self.spot.location.create_mistake(
                    self.path,
                    value=written_value,
                    expected="a list: this setting takes "
                    + describe_accepted_values(self.spot.value_type),
                    fix="write the values in brackets",
                )
            )
            self.raise_recorded_mistakes()  # other checks need a numeric setting

    def find_first_written_unit(self, names: Sequence[str], setting_unit: str | None) -> str:
        """Return the unit of the first of the named values that has one."""
        symbol = ""
        for name in names:
            text = self._number_text_or_record_mistake(name)
            if text is None:
                continue
            with self._record_mistakes_raised_within(name):
                symbol = symbol or split_number_and_unit(text, setting_unit)[1]
        return symbol

    def read_number_in_unit(self, name: str, unit_symbol: str, setting_unit: str | None) -> Decimal:
        """Return the number of a quantity in a unit; 0 if it is invalid."""
        with self._record_mistakes_raised_within(name):
            number = convert_quantity_to_unit(unit_symbol, self.content[name].text, setting_unit)
            if number is not None:
                return number
            self.record_mistake(
                name,
                value=self.content[name].content_description,
                expected=f"a level in {unit_symbol}, as the other end has",
                fix="write it in dB, or both without",
            )
        return Decimal(0)

    def read_difference_in_unit(self, name: str, unit_symbol: str) -> Decimal:
        """Return the number of a difference; 0 if it is invalid."""
        if self._number_text_or_record_mistake(name) is not None:
            with self._record_mistakes_raised_within(name):
                return convert_difference_to_unit(
                    unit_symbol,
                    self.content[name].text,
                    unit_suffix_of_setting(self.spot.value_type),
                )
        return Decimal(0)

    def record_if_too_many_values(self, n_values: float, name: str, at_most: int) -> None:
        """Record a mistake if there are too many values."""
        if n_values >= at_most + 1:
            is_countable = n_values < 1e15
            n_text = f"{n_values:.0f}" if is_countable else f"{n_values:.0e}"
            self.record_mistake(
                name,
                value=f"{self.content[name].content_description}, which makes {n_text} values",
                expected=f"at most at_most_points, {at_most}",
                fix=f"take fewer, or confirm it: at_most_points: {n_text}"
                if is_countable
                else "take fewer",
            )

    def _number_text_or_record_mistake(self, name: str) -> str | None:
        node = self.content.get(name)
        if node is None:
            return None
        if isinstance(node.content, bool) or not isinstance(node.content, str | int | float):
            need = DIMENSIONS[unit_suffix_of_setting(self.spot.value_type)].description
            self.record_mistake(
                name, value=node.content_description, expected=need, fix="write one number"
            )
            return None
        return node.text

    @contextmanager
    def _record_mistakes_raised_within(self, name: str) -> Iterator[None]:
        try:
            yield
        except InvalidSetting as error:
            (mistake,) = error.mistakes
            self.record_mistake(
                name, value=mistake.value, expected=mistake.expected, fix=mistake.fix
            )


def accepts_numbers(value_type: ValueType) -> bool:
    """Return whether a setting takes numbers."""
    return float in value_type.types_without_none or int in value_type.types_without_none


def accepts_integers_only(value_type: ValueType) -> bool:
    """Return whether a setting takes integers only."""
    return float not in value_type.types_without_none


def unit_suffix_of_setting(value_type: ValueType) -> str | None:
    """Return the unit suffix of a setting's numbers; counts are bare, as probabilities are."""
    return "probability" if accepts_integers_only(value_type) else value_type.unit


def unit_of_difference(unit_symbol: str) -> str:
    """Return the unit of a difference of two values."""
    return {"degC": "K"}.get(unit_symbol, "dB" if unit_symbol in LEVEL_UNITS else unit_symbol)


def unknown_name_mistake(
    spot: SettingNode, name: str, node: YamlNode, known_names: Sequence[str]
) -> Mistake:
    """Return the mistake for a name that is not among the known ones."""
    return node.name_location.create_mistake(
        f"{spot.path}.{quote_for_message(name)}",
        value="unknown setting",
        expected=f"one of {', '.join(known_names)}",
        fix=did_you_mean_fix(name, known_names, CHOOSE_OR_OMIT),
    )
