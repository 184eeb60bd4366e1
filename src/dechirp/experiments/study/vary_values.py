"""Values of a varied setting, as the key `vary` of a study file contains them.

A list of values, of any kind: `[hann, rectangular]`, `[null, {kind: fft}]`. With labels for
figures, a mapping: `{clear: [...], rain: [...]}`. A range by its step, including its end if a
step meets it, or by its number of values, evenly or in equal ratios: `{from: 10 cm, to: 2 m, step:
10 cm}`, `{from: 1 m, to: 200 m, n: 16, spacing: log}`. A distribution: `{uniform: [0 m, 1 m]}`,
`{normal: [0 m, 10 cm]}`. Steps and deviations of levels are in dB. To vary settings together, vary
the mapping or list that contains them.
"""

from collections.abc import Sequence
from dataclasses import replace
from decimal import Context as Digits
from decimal import Decimal
from typing import Any, Literal, NamedTuple

from dechirp.config.dumping import dump_node_on_one_line, quote_yaml_if_needed
from dechirp.config.error_messages import SettingNode
from dechirp.config.fields import ValueType, list_settings
from dechirp.config.loading import validate_and_build_value
from dechirp.config.quantities import (
    convert_quantity_to_unit,
    format_shortest_decimal,
    split_number_and_unit,
)
from dechirp.config.setting_paths import with_absolute_file_paths
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import Location, YamlNode, parse_unquoted_scalar, parse_yaml
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.errors import InvalidFile, Mistake, quote_for_message
from dechirp.core.suggestions import did_you_mean_fix, nearest_name
from dechirp.experiments.study.study import RandomSetting, SweptSetting
from dechirp.experiments.study.vary_mapping import (
    LEVEL_UNITS,
    VaryMapping,
    accepts_integers_only,
    accepts_numbers,
    unit_of_difference,
    unit_suffix_of_setting,
    unknown_name_mistake,
)

RANGE_KEYS = ("from", "to", "step", "n", "spacing")
DISTRIBUTIONS = ("uniform", "normal")

_MAX_RANGE_PROBES = 100  # values of a range to try on the scenario: 2 ms each
_MAX_LIST_PROBES = 1000  # values of a list to try
_MAX_MISTAKES = 10  # reported mistakes of one list
_EXACT_CONTEXT = Digits(prec=50)
_FORMS = (
    "a list of values, a mapping of labels and values, {from, to, step}, {from, to, n},"
    " {uniform: [LOW, HIGH]} or {normal: [MEAN, STD]}"
)


class ParsedAxis(NamedTuple):
    """Varied setting, and the values to try on the scenario."""

    axis: SweptSetting | RandomSetting
    probes: tuple[YamlNode, ...]
    """Values with their positions in the file: all of a list up to 1,000, 100 of a longer range,
    the ends of a distribution, 3 standard deviations on each side of a normal one."""


def parse_varied_setting(
    path: str, node: YamlNode, value_type: ValueType, context: ValidationContext, *, max_values: int
) -> ParsedAxis:
    """Parse the values of one varied setting.

    Parameters
    ----------
    path : str
        Path of the setting.
    node : Node
        Values in the file.
    value_type : ValueType
        Type that the setting accepts.
    context : Context
        Context of the file.
    max_values : int
        Largest number of values of a range.

    Raises
    ------
    InvalidFile
        With every mistake.
    """
    spot = SettingNode(f"vary.{path}", node, value_type)
    content = node.content
    if isinstance(content, list) and content:
        return _parse_listed_values(path, spot, [(None, member) for member in content], context)
    if isinstance(content, dict) and content:
        keys = (*RANGE_KEYS, *DISTRIBUTIONS)
        if any(name in keys for name in content):
            is_distribution = any(name in DISTRIBUTIONS for name in content)
            return (
                _parse_distribution(path, spot)
                if is_distribution
                else _parse_value_range(path, spot, max_values)
            )
        intended = nearest_name(next(iter(content)), keys) if len(content) == 1 else None
        if intended is not None:
            name, child = next(iter(content.items()))
            raise InvalidFile(unknown_name_mistake(spot, name, child, keys))
        cls = value_type.class_of_mapping(node)
        if not set(content) <= {"kind", *(list_settings(cls) if cls else ())}:
            return _parse_listed_values(path, spot, list(content.items()), context)
    empty = content is None or content in ([], {})
    raise InvalidFile(
        spot.location.create_mistake(
            spot.path,
            value=node.content_description
            if empty
            else f"one value, {quote_for_message(dump_node_on_one_line(node))}",
            expected=_FORMS,
            fix="give the values"
            if empty
            else f"write [{quote_for_message(dump_node_on_one_line(node))}]",
        )
    )


def stepped_values(low: Decimal, high: Decimal, step: Decimal) -> list[Decimal]:
    """Return values from low in steps; the last is high if a step meets it to a part in 1e9."""
    n = int((high - low) / step + Decimal("1e-9")) + 1
    values = [
        _EXACT_CONTEXT.add(low, _EXACT_CONTEXT.multiply(step, Decimal(index))) for index in range(n)
    ]
    return [*values[:-1], high] if abs(values[-1] - high) <= step * Decimal("1e-9") else values


def spaced_values(low: Decimal, high: Decimal, n: int, spacing: str) -> list[Decimal]:
    """Return n values from low to high inclusive, evenly or in equal ratios, to twelve digits."""
    if n == 1:
        return [low]
    if spacing == "log":
        ratio = (high / low).ln() / (n - 1)
        inner = [Digits(prec=12).plus(low * (ratio * k).exp()) for k in range(1, n - 1)]
    else:
        digit = Decimal(1).scaleb(max(low.adjusted(), high.adjusted()) - 11)
        inner = [
            ((low * (n - 1 - k) + high * k) / (n - 1)).quantize(digit) for k in range(1, n - 1)
        ]
    return [low, *inner, high]


def format_quantity(number: Decimal, unit: str) -> str:
    """Format a value as settings files write it."""
    return f"{format_shortest_decimal(number)} {unit}".strip()


def varied_setting_as_yaml(axis: SweptSetting | RandomSetting) -> str:
    """Format a varied setting as a line of YAML; `parse_varied_setting` reads an equal value."""
    if isinstance(axis, RandomSetting):
        first, second = (format_quantity(Decimal(repr(n)), "") for n in (axis.first, axis.second))
        apart = unit_of_difference(axis.unit) if axis.distribution == "normal" else axis.unit
        ends = f"{first} {axis.unit}".strip(), f"{second} {apart}".strip()
        return f"{{{axis.distribution}: [{ends[0]}, {ends[1]}]}}"
    labels = (
        [_legend_label_of_value(parse_yaml(text, "")) for text in axis.texts]
        if len(axis.texts) <= _MAX_RANGE_PROBES
        else []
    )
    ranged = _values_as_range_yaml(axis)
    if ranged is not None:
        return ranged
    if axis.labels in (axis.texts, _shortest_unique_labels(labels, axis.texts)):
        return f"[{', '.join(axis.texts)}]"
    both = zip(axis.labels, axis.texts, strict=True)
    return f"{{{', '.join(f'{quote_yaml_if_needed(label)}: {text}' for label, text in both)}}}"


def _values_as_range_yaml(axis: SweptSetting) -> str | None:
    """Format many values as the range that contains exactly them; None if there is none."""
    if axis.numbers is None or len(axis.texts) < _MAX_RANGE_PROBES or axis.labels != axis.texts:
        return None
    numbers = [Decimal(text.removesuffix(axis.unit).strip()) for text in axis.texts]
    low, high, n = numbers[0], numbers[-1], len(numbers)
    ends = f"from: {axis.texts[0]}, to: {axis.texts[-1]}"
    if not low < high:
        return None
    step = numbers[1] - low
    apart = format_quantity(step, unit_of_difference(axis.unit))
    if step > 0 and stepped_values(low, high, step) == numbers:
        return f"{{{ends}, step: {apart}}}"
    for spacing in ("linear", "log") if low > 0 else ("linear",):
        if spaced_values(low, high, n, spacing) == numbers:
            return f"{{{ends}, n: {n}, spacing: {spacing}}}"
    return None


def _parse_listed_values(
    path: str,
    spot: SettingNode,
    members: Sequence[tuple[str | None, YamlNode]],
    context: ValidationContext,
) -> ParsedAxis:
    """Parse values that are written out, with or without labels."""
    mistakes: list[Mistake] = []
    values: dict[Any, None] = {}  # a hash lookup keeps a list of 100,000 values linear
    for index, (label, node) in enumerate(members):
        inner = replace(spot, path=f"{spot.path}.{label or index}", node=node)
        try:
            value = validate_and_build_value(inner, context)
        except InvalidFile as error:
            mistakes += error.mistakes
            if len(mistakes) >= _MAX_MISTAKES:
                break
            continue
        if value in values:
            mistakes.append(
                node.location.create_mistake(
                    inner.path,
                    value=f"{_legend_label_of_value(node)}, the same once more",
                    expected="values that differ",
                    fix="take it out",
                )
            )
        values[value] = None
    if mistakes:
        raise InvalidFile(*mistakes)
    nodes = tuple(
        with_absolute_file_paths(replace(spot, node=node), context) for _, node in members
    )
    texts = tuple(dump_node_on_one_line(node) for node in nodes)
    if members[0][0] is None:
        labels = _shortest_unique_labels(
            [_legend_label_of_value(node) for _, node in members], texts
        )
    else:
        labels = tuple(str(label) for label, _ in members)
    unit, numbers = _unit_and_numbers_of_values(spot.value_type, [node for _, node in members])
    axis = SweptSetting(path=path, texts=texts, numbers=numbers, unit=unit, labels=labels)
    return ParsedAxis(
        axis, tuple(nodes[k] for k in _evenly_chosen_indices(len(nodes), _MAX_LIST_PROBES))
    )


def _unit_and_numbers_of_values(
    value_type: ValueType, nodes: Sequence[YamlNode]
) -> tuple[str, tuple[float, ...] | None]:
    """Return unit and numbers of a numeric setting, in the unit of the first value that has one."""
    scalar = all(isinstance(node.content, str | int | float) for node in nodes)
    if not (scalar and accepts_numbers(value_type)):
        return "", None
    unit = unit_suffix_of_setting(value_type)
    symbol = next(filter(None, (split_number_and_unit(node.text, unit)[1] for node in nodes)), "")
    numbers = [convert_quantity_to_unit(symbol, node.text, unit) for node in nodes]
    floats = tuple(float(number) for number in numbers if number is not None)
    return (symbol, floats) if len(floats) == len(numbers) else ("", None)


def _parse_value_range(path: str, spot: SettingNode, max_values: int) -> ParsedAxis:
    mapping = VaryMapping(spot)
    mapping.record_unknown_names(RANGE_KEYS)
    mapping.check_setting_takes_numbers("a range")
    mapping.record_if_missing("from", expected="the first value of the range")
    mapping.record_if_missing("to", expected="the last value of the range")
    content = mapping.content
    if ("step" in content) == ("n" in content):
        mapping.record_mistake(
            "step",
            value="cannot be combined with n" if "step" in content else "missing, and n as well",
            expected="a step, or n, the number of values",
            fix="keep one of them" if "step" in content else "add step or n",
        )
    unit = unit_suffix_of_setting(spot.value_type)
    symbol = mapping.find_first_written_unit(("from", "to"), unit)
    mapping.raise_recorded_mistakes()
    low, high = (mapping.read_number_in_unit(name, symbol, unit) for name in ("from", "to"))
    mapping.raise_recorded_mistakes()
    if not low < high:
        mapping.record_mistake(
            "from",
            value=f"{format_quantity(low, symbol)}, with to at {format_quantity(high, symbol)}",
            expected="below to",
            fix="swap them" if low > high else "write a list for one value",
        )
        mapping.raise_recorded_mistakes()
    numbers = (
        _parse_range_with_step(mapping, low, high, symbol, max_values)
        if "step" in content
        else _parse_range_with_number_of_values(mapping, low, high, symbol, max_values)
    )
    if accepts_integers_only(spot.value_type):
        if "n" in content:
            numbers = [number.to_integral_value() for number in numbers]
            if len(set(numbers)) < len(numbers):
                mapping.record_mistake(
                    "n",
                    value=f"{len(numbers)}, more than there are whole numbers",
                    expected=f"at most {len(set(numbers))}",
                    fix="take fewer",
                )
        elif any(number != number.to_integral_value() for number in (low, *numbers[1:2])):
            mapping.record_mistake(
                "step", value="no whole number", expected="whole numbers", fix="take whole steps"
            )
        mapping.raise_recorded_mistakes()
    texts = tuple(format_quantity(number, symbol) for number in numbers)
    axis = SweptSetting(
        path=path, texts=texts, numbers=tuple(float(number) for number in numbers), unit=symbol
    )
    return ParsedAxis(
        axis,
        tuple(
            _scalar_node(texts[k], spot.node.location)
            for k in _evenly_chosen_indices(len(texts), _MAX_RANGE_PROBES)
        ),
    )


def _evenly_chosen_indices(n: int, max_indices: int) -> list[int]:
    """Return at most this number of indices of n values, including the first and the last."""
    if n <= max_indices:
        return list(range(n))
    return [k * (n - 1) // (max_indices - 1) for k in range(max_indices)]


def _parse_range_with_step(
    mapping: VaryMapping, low: Decimal, high: Decimal, unit_symbol: str, max_values: int
) -> list[Decimal]:
    step = mapping.read_difference_in_unit("step", unit_symbol)
    mapping.raise_recorded_mistakes()
    if step <= 0:
        mapping.record_mistake(
            "step",
            value=format_quantity(step, unit_of_difference(unit_symbol)),
            expected="above 0",
            fix="give its size alone",
        )
    elif step > high - low:
        mapping.record_mistake(
            "step",
            value=f"{format_quantity(step, unit_of_difference(unit_symbol))}, which leads past to"
            " at once",
            expected=f"at most {format_quantity(high - low, unit_of_difference(unit_symbol))}",
            fix="take a smaller one",
        )
    else:
        mapping.record_if_too_many_values(float((high - low) / step) + 1, "step", max_values)
    mapping.raise_recorded_mistakes()
    return stepped_values(low, high, step)


def _parse_range_with_number_of_values(
    mapping: VaryMapping, low: Decimal, high: Decimal, unit_symbol: str, max_values: int
) -> list[Decimal]:
    n = mapping.content["n"].content
    spacing = mapping.content.get("spacing")
    if isinstance(n, bool) or not isinstance(n, int) or n < 2:
        mapping.record_mistake(
            "n",
            value=mapping.content["n"].content_description,
            expected="a whole number, at least 2: both ends",
            fix="write a list for one value",
        )
    else:
        mapping.record_if_too_many_values(n, "n", max_values)
    if spacing is not None and spacing.content not in ("linear", "log"):
        mapping.record_mistake(
            "spacing",
            value=spacing.content_description,
            expected="one of linear, log",
            fix=did_you_mean_fix(spacing.text, ["linear", "log"]),
        )
    elif spacing is not None and spacing.content == "log":
        if unit_symbol in LEVEL_UNITS:
            mapping.record_mistake(
                "spacing",
                value=f"log, of {unit_symbol}",
                expected="linear: equal steps in dB are equal ratios",
                fix="leave it out",
            )
        elif low <= 0:
            mapping.record_mistake(
                "from",
                value=format_quantity(low, unit_symbol),
                expected="above 0, where spacing is log",
                fix="start above 0, or take spacing: linear",
            )
    mapping.raise_recorded_mistakes()
    assert isinstance(n, int)
    return spaced_values(low, high, n, str(spacing.content) if spacing is not None else "linear")


def _parse_distribution(path: str, spot: SettingNode) -> ParsedAxis:
    mapping = VaryMapping(spot)
    mapping.record_unknown_names(DISTRIBUTIONS)
    mapping.check_setting_takes_numbers("a distribution")
    content = mapping.content
    name: Literal["uniform", "normal"] = "uniform" if "uniform" in content else "normal"
    if len(content) > 1 and not mapping.mistakes:
        mapping.record_mistake(
            name,
            value="cannot be combined with normal",
            expected="one distribution",
            fix="keep one of them",
        )
    pair = content[name].content
    expected = "two numbers, [LOW, HIGH]" if name == "uniform" else "two numbers, [MEAN, STD]"
    if not (isinstance(pair, list) and len(pair) == 2):
        mapping.record_mistake(
            name,
            value=content[name].content_description,
            expected=expected,
            fix="write both in brackets",
        )
    elif accepts_integers_only(spot.value_type):
        mapping.record_mistake(
            name, value="drawn, of whole numbers", expected="a list or a range", fix="list them"
        )
    mapping.raise_recorded_mistakes()
    assert isinstance(pair, list)
    mapping.content = {"0": pair[0], "1": pair[1]}
    mapping.path = f"{spot.path}.{name}"
    unit = unit_suffix_of_setting(spot.value_type)
    symbol = mapping.find_first_written_unit(("0", "1") if name == "uniform" else ("0",), unit)
    if not symbol and name == "normal" and not mapping.mistakes and DIMENSIONS[unit].si_unit:
        symbol = mapping.find_first_written_unit(("1",), unit)  # for a mean of 0 without unit
    mapping.raise_recorded_mistakes()
    first = mapping.read_number_in_unit("0", symbol, unit)
    second = (
        mapping.read_difference_in_unit("1", symbol)
        if name == "normal"
        else mapping.read_number_in_unit("1", symbol, unit)
    )
    mapping.raise_recorded_mistakes()
    if name == "normal" and second <= 0:
        mapping.record_mistake(
            "1",
            value=format_quantity(second, unit_of_difference(symbol)),
            expected="a standard deviation above 0",
            fix="write a list for one value",
        )
    elif name == "uniform" and not first < second:
        mapping.record_mistake(
            "0",
            value=f"{format_quantity(first, symbol)}, with the upper end at"
            f" {format_quantity(second, symbol)}",
            expected="below the upper end",
            fix="swap them" if first > second else "write a list for one value",
        )
    mapping.raise_recorded_mistakes()
    if name == "normal":
        probes = [first - 3 * second, first + 3 * second]
    else:
        inside = (second - first) * Decimal("1e-6")
        probes = [first + inside, second - inside]
    axis = RandomSetting(
        path=path, distribution=name, first=float(first), second=float(second), unit=symbol
    )
    return ParsedAxis(
        axis,
        tuple(
            _scalar_node(format_quantity(number, symbol), content[name].location)
            for number in probes
        ),
    )


def _scalar_node(text: str, place: Location) -> YamlNode:
    return YamlNode(parse_unquoted_scalar(text), place, place, text)


def _shortest_unique_labels(labels: Sequence[str], texts: Sequence[str]) -> tuple[str, ...]:
    """Return short labels where they are unique, else full ones, else the texts."""
    if len(set(labels)) == len(labels):
        return tuple(labels)
    full_labels = tuple(_legend_label_of_value(parse_yaml(text, ""), whole=True) for text in texts)
    return full_labels if len(set(full_labels)) == len(full_labels) else tuple(texts)


def _legend_label_of_value(node: YamlNode, *, whole: bool = False) -> str:
    """Return the legend label of a value: of a mapping its kind, or all of it."""
    content = node.content
    if isinstance(content, list):
        mappings = any(isinstance(member.content, dict) for member in content)
        inner = (_legend_label_of_value(member, whole=whole) for member in content)
        return (" + " if mappings else ", ").join(inner) or "none"
    if isinstance(content, dict):
        kind = content["kind"].text if "kind" in content else ""
        if kind and not whole:
            return kind
        rest = ", ".join(
            f"{name} {_legend_label_of_value(child, whole=whole)}"
            for name, child in content.items()
            if name != "kind"
        )
        return f"{kind} ({rest})" if kind and rest else kind or rest or "none"
    return "none" if content is None else node.text
