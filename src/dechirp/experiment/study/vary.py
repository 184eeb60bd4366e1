"""What `vary` says of a setting: values in turn, or a distribution.

A list of values, of any kind: `[hann, rectangular]`, `[null, {kind: fft}]`. With labels for
figures, a mapping: `{clear: [...], rain: [...]}`. A range by its step, its end included where a
step meets it, or by its number of values, evenly or in equal ratios: `{from: 10 cm, to: 2 m, step:
10 cm}`, `{from: 1 m, to: 200 m, n: 16, spacing: log}`. A distribution: `{uniform: [0 m, 1 m]}`,
`{normal: [0 m, 10 cm]}`. Steps and deviations of levels are in dB. Settings that go together are
one value of the mapping or list about them.
"""

from collections.abc import Sequence
from dataclasses import replace
from decimal import Context as Digits
from decimal import Decimal
from typing import Any, Literal, NamedTuple

from dechirp.config.fields import Slot, settings
from dechirp.config.files import value_of
from dechirp.config.mistakes import Spot
from dechirp.config.models import Context
from dechirp.config.nearest import did_you_mean, nearest
from dechirp.config.quantities import digits_of, number_in, written
from dechirp.config.shown import shown
from dechirp.config.texts import line, quoted
from dechirp.config.tree import Node, Place, read_tree, resolved
from dechirp.config.within import anchored
from dechirp.core.errors import InvalidFile, Mistake
from dechirp.core.kinds import KINDS
from dechirp.experiment.study.mapping import (
    LEVELS,
    Told,
    is_numeric,
    is_whole,
    suffix_of,
    unit_apart,
    unknown,
)
from dechirp.experiment.study.study import Drawn, Listed

RANGE = ("from", "to", "step", "n", "spacing")
DISTRIBUTIONS = ("uniform", "normal")

_EACH = 100  # values of a range that are tried on the scenario: 2 ms each
_MOST = 1000  # the same of a list
_AT_ONCE = 10  # mistakes of one list that are told
_EXACT = Digits(prec=50)
_FORMS = (
    "a list of values, a mapping of labels and values, {from, to, step}, {from, to, n},"
    " {uniform: [LOW, HIGH]} or {normal: [MEAN, STD]}"
)


class Values(NamedTuple):
    """What is varied, and what of it to try on the scenario."""

    axis: Listed | Drawn
    tried: tuple[Node, ...]
    """Values, where they are written: all of a list up to 1,000, 100 of a longer range, the
    ends of a distribution, 3 standard deviations on each side of a normal one."""


def values_of(path: str, node: Node, slot: Slot, context: Context, *, at_most: int) -> Values:
    """Values of one setting.

    Parameters
    ----------
    path : str
        Of the setting.
    node : Node
        What the file says of it.
    slot : Slot
        What the setting takes.
    context : Context
        Of the file.
    at_most : int
        Values that a range may have.

    Raises
    ------
    InvalidFile
        With every mistake.
    """
    spot = Spot(f"vary.{path}", node, slot)
    content = node.content
    if isinstance(content, list) and content:
        return _listed(path, spot, [(None, member) for member in content], context)
    if isinstance(content, dict) and content:
        known = (*RANGE, *DISTRIBUTIONS)
        if any(name in known for name in content):
            drawn = any(name in DISTRIBUTIONS for name in content)
            return _drawn(path, spot) if drawn else _range(path, spot, at_most)
        meant = nearest(next(iter(content)), known) if len(content) == 1 else None
        if meant is not None:
            name, child = next(iter(content.items()))
            raise InvalidFile(unknown(spot, name, child, known))
        cls = slot.value_class(node)
        if not set(content) <= {"kind", *(settings(cls) if cls else ())}:
            return _listed(path, spot, list(content.items()), context)
    empty = content is None or content in ([], {})
    raise InvalidFile(
        spot.place.mistake(
            spot.path,
            got=node.shown if empty else f"one value, {shown(line(node))}",
            need=_FORMS,
            fix="Give the values." if empty else f"Write [{shown(line(node))}].",
        )
    )


def spread(low: Decimal, high: Decimal, step: Decimal) -> list[Decimal]:
    """Values from low on by steps: high is the last where they meet it, to a part in 1e9."""
    n = int((high - low) / step + Decimal("1e-9")) + 1
    made = [_EXACT.add(low, _EXACT.multiply(step, Decimal(index))) for index in range(n)]
    return [*made[:-1], high] if abs(made[-1] - high) <= step * Decimal("1e-9") else made


def spaced(low: Decimal, high: Decimal, n: int, spacing: str) -> list[Decimal]:
    """Values from low to high, both included, evenly or in equal ratios, to twelve digits."""
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


def in_words(number: Decimal, unit: str) -> str:
    """Write a value as settings files do."""
    return f"{digits_of(number)} {unit}".strip()


def written_axis(axis: Listed | Drawn) -> str:
    """YAML of what is varied, on one line, that `values_of` reads as an equal value."""
    if isinstance(axis, Drawn):
        first, second = (in_words(Decimal(repr(n)), "") for n in (axis.first, axis.second))
        apart = unit_apart(axis.unit) if axis.distribution == "normal" else axis.unit
        ends = f"{first} {axis.unit}".strip(), f"{second} {apart}".strip()
        return f"{{{axis.distribution}: [{ends[0]}, {ends[1]}]}}"
    labels = (
        [_label(read_tree(text, "")) for text in axis.texts] if len(axis.texts) <= _EACH else []
    )
    ranged = _range_of(axis)
    if ranged is not None:
        return ranged
    if axis.labels in (axis.texts, _distinct(labels, axis.texts)):
        return f"[{', '.join(axis.texts)}]"
    both = zip(axis.labels, axis.texts, strict=True)
    return f"{{{', '.join(f'{quoted(label)}: {text}' for label, text in both)}}}"


def _range_of(axis: Listed) -> str | None:
    """Write many values as the range that gives them, if one does."""
    if axis.numbers is None or len(axis.texts) < _EACH or axis.labels != axis.texts:
        return None
    numbers = [Decimal(text.removesuffix(axis.unit).strip()) for text in axis.texts]
    low, high, n = numbers[0], numbers[-1], len(numbers)
    ends = f"from: {axis.texts[0]}, to: {axis.texts[-1]}"
    if not low < high:
        return None
    step = numbers[1] - low
    apart = in_words(step, unit_apart(axis.unit))
    if step > 0 and spread(low, high, step) == numbers:
        return f"{{{ends}, step: {apart}}}"
    for spacing in ("linear", "log") if low > 0 else ("linear",):
        if spaced(low, high, n, spacing) == numbers:
            return f"{{{ends}, n: {n}, spacing: {spacing}}}"
    return None


def _listed(
    path: str, spot: Spot, members: Sequence[tuple[str | None, Node]], context: Context
) -> Values:
    """Values that are written out, with labels or without."""
    wrong: list[Mistake] = []
    read: dict[Any, None] = {}  # values are frozen; a list of 100,000 takes no square of it
    for index, (label, node) in enumerate(members):
        inner = replace(spot, path=f"{spot.path}.{label or index}", node=node)
        try:
            made = value_of(inner, context)
        except InvalidFile as error:
            wrong += error.mistakes
            if len(wrong) >= _AT_ONCE:
                break
            continue
        if made in read:
            wrong.append(
                node.place.mistake(
                    inner.path,
                    got=f"{_label(node)}, the same once more",
                    need="a value of its own",
                    fix="Take it out.",
                )
            )
        read[made] = None
    if wrong:
        raise InvalidFile(*wrong)
    nodes = tuple(anchored(replace(spot, node=node), context) for _, node in members)
    texts = tuple(line(node) for node in nodes)
    if members[0][0] is None:
        labels = _distinct([_label(node) for _, node in members], texts)
    else:
        labels = tuple(str(label) for label, _ in members)
    unit, numbers = _numbers(spot.slot, [node for _, node in members])
    axis = Listed(path=path, texts=texts, numbers=numbers, unit=unit, labels=labels)
    return Values(axis, tuple(nodes[k] for k in _some(len(nodes), _MOST)))


def _numbers(slot: Slot, nodes: Sequence[Node]) -> tuple[str, tuple[float, ...] | None]:
    """Unit and numbers of values of a numeric setting, in the unit of the first that has one."""
    scalar = all(isinstance(node.content, str | int | float) for node in nodes)
    if not (scalar and is_numeric(slot)):
        return "", None
    unit = suffix_of(slot)
    symbol = next(filter(None, (written(node.text, unit)[1] for node in nodes)), "")
    numbers = [number_in(symbol, node.text, unit) for node in nodes]
    found = tuple(float(number) for number in numbers if number is not None)
    return (symbol, found) if len(found) == len(numbers) else ("", None)


def _range(path: str, spot: Spot, at_most: int) -> Values:
    told = Told(spot)
    told.only(RANGE)
    told.must_be_numeric("a range")
    for name in ("from", "to"):
        told.need(name)
    content = told.content
    if ("step" in content) == ("n" in content):
        told.add(
            "step",
            got="given beside n" if "step" in content else "missing, and n as well",
            need="given, or n: one of the two",
            fix="Keep one of them." if "step" in content else "Add step or n.",
        )
    unit = suffix_of(spot.slot)
    symbol = told.symbol(("from", "to"), unit)
    told.stop()
    low, high = (told.number(name, symbol, unit) for name in ("from", "to"))
    told.stop()
    if not low < high:
        told.add(
            "from",
            got=f"{in_words(low, symbol)}, with to at {in_words(high, symbol)}",
            need="below to",
            fix="Swap them." if low > high else "Write a list for one value.",
        )
        told.stop()
    numbers = (
        _stepped(told, low, high, symbol, at_most)
        if "step" in content
        else _counted(told, low, high, symbol, at_most)
    )
    if is_whole(spot.slot):
        if "n" in content:
            numbers = [number.to_integral_value() for number in numbers]
            if len(set(numbers)) < len(numbers):
                told.add(
                    "n",
                    got=f"{len(numbers)}, more than there are whole numbers",
                    need=f"at most {len(set(numbers))}",
                    fix="Take fewer.",
                )
        elif any(number != number.to_integral_value() for number in (low, *numbers[1:2])):
            told.add("step", got="no whole number", need="whole numbers", fix="Take whole steps.")
        told.stop()
    texts = tuple(in_words(number, symbol) for number in numbers)
    axis = Listed(
        path=path, texts=texts, numbers=tuple(float(number) for number in numbers), unit=symbol
    )
    return Values(axis, tuple(_node(texts[k], spot.node.place) for k in _some(len(texts), _EACH)))


def _some(n: int, at_most: int) -> list[int]:
    """Indices of so many of n values, the first and the last among them."""
    if n <= at_most:
        return list(range(n))
    return [k * (n - 1) // (at_most - 1) for k in range(at_most)]


def _stepped(told: Told, low: Decimal, high: Decimal, symbol: str, at_most: int) -> list[Decimal]:
    step = told.difference("step", symbol)
    told.stop()
    if step <= 0:
        told.add(
            "step",
            got=in_words(step, unit_apart(symbol)),
            need="above 0",
            fix="Give its size alone.",
        )
    elif step > high - low:
        told.add(
            "step",
            got=f"{in_words(step, unit_apart(symbol))}, which leads past to at once",
            need=f"at most {in_words(high - low, unit_apart(symbol))}",
            fix="Take a smaller one.",
        )
    else:
        told.few(float((high - low) / step) + 1, "step", at_most)
    told.stop()
    return spread(low, high, step)


def _counted(told: Told, low: Decimal, high: Decimal, symbol: str, at_most: int) -> list[Decimal]:
    n = told.content["n"].content
    spacing = told.content.get("spacing")
    if isinstance(n, bool) or not isinstance(n, int) or n < 2:
        told.add(
            "n",
            got=told.content["n"].shown,
            need="a whole number, at least 2: both ends",
            fix="Write a list for one value.",
        )
    else:
        told.few(n, "n", at_most)
    if spacing is not None and spacing.content not in ("linear", "log"):
        told.add(
            "spacing",
            got=spacing.shown,
            need="one of linear, log",
            fix=did_you_mean(spacing.text, ["linear", "log"]),
        )
    elif spacing is not None and spacing.content == "log":
        if symbol in LEVELS:
            told.add(
                "spacing",
                got=f"log, of {symbol}",
                need="linear: equal steps in dB are equal ratios",
                fix="Leave it out.",
            )
        elif low <= 0:
            told.add(
                "from",
                got=in_words(low, symbol),
                need="above 0, where spacing is log",
                fix="Start above 0, or take spacing: linear.",
            )
    told.stop()
    assert isinstance(n, int)
    return spaced(low, high, n, str(spacing.content) if spacing is not None else "linear")


def _drawn(path: str, spot: Spot) -> Values:
    told = Told(spot)
    told.only(DISTRIBUTIONS)
    told.must_be_numeric("a distribution")
    content = told.content
    name: Literal["uniform", "normal"] = "uniform" if "uniform" in content else "normal"
    if len(content) > 1 and not told.wrong:
        told.add(name, got="given beside normal", need="alone", fix="Keep one of them.")
    pair = content[name].content
    need = "two numbers, [LOW, HIGH]" if name == "uniform" else "two numbers, [MEAN, STD]"
    if not (isinstance(pair, list) and len(pair) == 2):
        told.add(name, got=content[name].shown, need=need, fix="Write both in brackets.")
    elif is_whole(spot.slot):
        told.add(name, got="drawn, of whole numbers", need="a list or a range", fix="List them.")
    told.stop()
    assert isinstance(pair, list)
    told.content = {"0": pair[0], "1": pair[1]}
    told.path = f"{spot.path}.{name}"
    unit = suffix_of(spot.slot)
    symbol = told.symbol(("0", "1") if name == "uniform" else ("0",), unit)
    if not symbol and name == "normal" and not told.wrong and KINDS[unit].base:
        symbol = told.symbol(("1",), unit)  # beside a mean of 0
    told.stop()
    first = told.number("0", symbol, unit)
    second = told.difference("1", symbol) if name == "normal" else told.number("1", symbol, unit)
    told.stop()
    if name == "normal" and second <= 0:
        told.add(
            "1",
            got=in_words(second, unit_apart(symbol)),
            need="a standard deviation above 0",
            fix="Write a list for one value.",
        )
    elif name == "uniform" and not first < second:
        told.add(
            "0",
            got=f"{in_words(first, symbol)}, with the upper end at {in_words(second, symbol)}",
            need="below the upper end",
            fix="Swap them." if first > second else "Write a list for one value.",
        )
    told.stop()
    if name == "normal":
        tried = [first - 3 * second, first + 3 * second]
    else:
        inside = (second - first) * Decimal("1e-6")
        tried = [first + inside, second - inside]
    axis = Drawn(
        path=path, distribution=name, first=float(first), second=float(second), unit=symbol
    )
    return Values(axis, tuple(_node(in_words(one, symbol), content[name].place) for one in tried))


def _node(text: str, place: Place) -> Node:
    return Node(resolved(text), place, place, text)


def _distinct(labels: Sequence[str], texts: Sequence[str]) -> tuple[str, ...]:
    """Give short labels where they tell the values apart, else all that the values say."""
    if len(set(labels)) == len(labels):
        return tuple(labels)
    whole = tuple(_label(read_tree(text, ""), whole=True) for text in texts)
    return whole if len(set(whole)) == len(whole) else tuple(texts)


def _label(node: Node, *, whole: bool = False) -> str:
    """What a legend says of a value: of a mapping its kind, or all of it."""
    content = node.content
    if isinstance(content, list):
        mappings = any(isinstance(member.content, dict) for member in content)
        inner = (_label(member, whole=whole) for member in content)
        return (" + " if mappings else ", ").join(inner) or "none"
    if isinstance(content, dict):
        kind = content["kind"].text if "kind" in content else ""
        if kind and not whole:
            return kind
        rest = ", ".join(
            f"{name} {_label(child, whole=whole)}"
            for name, child in content.items()
            if name != "kind"
        )
        return f"{kind} ({rest})" if kind and rest else kind or rest or "none"
    return "none" if content is None else node.text
