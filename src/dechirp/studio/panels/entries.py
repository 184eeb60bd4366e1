"""Settings as knobs: each with its words, what it is now, and the texts that change it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from typing import Any, Literal, cast, get_args, get_origin

from dechirp.config.fields import Setting, Slot, is_family, settings, words
from dechirp.config.help import field_help
from dechirp.config.texts import as_text, quoted
from dechirp.config.tree import distinct, dotted
from dechirp.config.within import Way, way_to
from dechirp.core.families import Family

NONE = "null"
_CAPITALS = {"adc", "dc", "if", "iq", "pll", "rcs", "rms", "rx", "snr", "tx"}


@dataclass(frozen=True)
class Entry:
    """One knob."""

    path: str
    """Of its setting, as `--set` takes it."""
    label: str
    help: str
    """What it means, and what it needs."""
    text: str
    """As settings files write what it is now; empty where it is none."""
    choices: tuple[tuple[str, str], ...] = ()
    """Texts that it may take, and how each is shown; empty where it is typed."""
    need: str = ""
    """Shown where nothing is written."""
    depth: int = 0
    """How far below the setting that was asked for."""

    @property
    def is_switch(self) -> bool:
        """Whether it is on or off."""
        return [shown for _, shown in self.choices] == ["off", "on"]


def entries(whole: Any, path: str) -> Iterator[Entry]:
    """Knobs of a setting and of all below it; none where it is inside what is not there.

    Raises
    ------
    InvalidSetting
        If there is no setting of that path.
    """
    way = way_to(whole, path)
    if way.rest:
        return
    owner, at = _at(whole, replace(way, steps=way.steps[:-1])), _at(whole, way)
    help = ""
    if is_dataclass(owner):
        help = meanings(cast(type, type(owner))).get(str(way.steps[-1]), "")
    name = path.rpartition(".")[2]
    yield from _below(Entry(path, label(name), help, ""), way.slot, at)


def of_member(family: type[Family], kind: str, path: str) -> list[Entry]:
    """Knobs of the settings without which a member of a family cannot be, all empty.

    None of a kind that there is not: reading it says so.
    """
    cls = members_of(family).get(kind)
    if cls is None:
        return []
    return [
        _leaf(_entry(cls, key, one, path, depth=1), one.slot, None)
        for key, one in settings(cls).items()
        if one.required
    ]


def value_at(whole: Any, path: str) -> Any:
    """What stands at a setting, or at the nearest above it that is there."""
    return _at(whole, way_to(whole, path))


def family_of(whole: Any, path: str) -> type[Family] | None:
    """Family that a setting is chosen from, or a member of a list by its kind."""
    above = list_above(whole, path)
    if above is not None:
        return above
    return next((one for one in way_to(whole, path).leaf.choices if is_family(one)), None)


def list_above(whole: Any, path: str) -> type[Family] | None:
    """Family of a list, where a path is that of a kind of its members, there or not."""
    above, _, kind = path.rpartition(".")
    way = way_to(whole, above) if above else None
    if way is None or way.rest:
        return None
    family = _members(way.slot)
    return family if family is not None and kind in members_of(family) else None


def options(whole: Any, path: str, text: str) -> tuple[str, ...]:
    """PATH=VALUE for a text of a knob: of a kind in a list, the whole list."""
    if list_above(whole, path) is None:
        return (f"{path}={text}",)
    above, _, kind = path.rpartition(".")
    others = [written(one) for one in _at(whole, way_to(whole, above)) if one.kind() != kind]
    return (f"{above}=[{', '.join(others if text == NONE else [*others, text])}]",)


def label_of(members: Iterable[Any], index: int) -> str:
    """How a path names a member of a list."""
    names = []
    for place, one in enumerate(members):
        own = one.kind() if isinstance(one, Family) else getattr(one, "name", None)
        names.append(own or str(place))
    name = distinct(names)[index]
    return str(index) if "." in name else name


def label(name: str) -> str:
    """Words for the name of a setting."""
    parts = name.removeprefix("n_").replace("-", "_").split("_")
    shown = " ".join(part.upper() if part in _CAPITALS else part for part in parts)
    return shown[:1].upper() + shown[1:]


def written(value: Any, unit: str | None = None) -> str:
    """As a settings file writes a value, on one line."""
    return _line(as_text(value, unit))


@cache
def members_of(family: type[Family]) -> dict[str, type]:
    """Members of a family, which take 2 ms to find, and a page has many knobs."""
    return family.members()


@cache
def meanings(cls: type) -> dict[str, str]:
    """Docstrings of the fields of a class, which take its source to find."""
    return field_help(cls)


def _at(whole: Any, way: Way) -> Any:
    for step in way.steps:
        whole = whole[step] if isinstance(step, int) else getattr(whole, step)
    return whole


def _members(slot: Slot) -> type[Family] | None:
    """Family of the members of a list in a slot."""
    return next((one for one in slot.member().choices if is_family(one)), None)


def _below(entry: Entry, slot: Slot, at: Any) -> Iterator[Entry]:
    """Knobs for what stands in a slot."""
    family = next((one for one in slot.choices if is_family(one)), None)
    in_list = _members(slot)
    if family is not None:
        none = ((NONE, "none"),) if slot.optional else ()
        kinds = tuple((chosen(kind), kind) for kind in members_of(family))
        text = NONE if at is None else chosen(at.kind())
        yield replace(entry, text=text, choices=(*none, *kinds))
        if at is not None:
            yield from _inside(entry, at)
    elif in_list is not None:
        for kind, cls in members_of(in_list).items():
            yield from _kind(entry, kind, cls, at)
    elif not any(is_dataclass(one) for one in slot.choices):
        yield _leaf(entry, slot, at)
    elif slot.optional:
        yield _switch(entry, "{}", on=at is not None)
        if at is not None:
            yield from _inside(entry, at)
    else:
        for inner in _inside(replace(entry, depth=entry.depth - 1), at):
            yield replace(inner, label=f"{entry.label}: {inner.label[:1].lower()}{inner.label[1:]}")


def _kind(entry: Entry, kind: str, cls: type, members: Sequence[Any]) -> Iterator[Entry]:
    """Knobs for one kind in a list, there or not."""
    there = [place for place, one in enumerate(members) if one.kind() == kind]
    help = " ".join((cls.__doc__ or "").partition("\n\n")[0].split())
    named = replace(entry, path=dotted(entry.path, kind), label=label(kind), help=help)
    yield _switch(named, chosen(kind), on=bool(there))
    for place in there:
        path = dotted(entry.path, label_of(members, place))
        yield from _inside(replace(named, path=path), members[place])


def _switch(entry: Entry, on_text: str, *, on: bool) -> Entry:
    return replace(entry, text=on_text if on else NONE, choices=((NONE, "off"), (on_text, "on")))


def _inside(entry: Entry, at: Any) -> Iterator[Entry]:
    cls = cast(type, type(at))
    for key, one in settings(cls).items():
        inner = _entry(cls, key, one, entry.path, depth=entry.depth + 1)
        yield from _below(inner, one.slot, getattr(at, one.field))


def _entry(cls: type, key: str, one: Setting, path: str, *, depth: int) -> Entry:
    return Entry(
        path=dotted(path, key),
        label=label(key),
        help=meanings(cls).get(one.field, ""),
        text="",
        depth=depth,
    )


def _leaf(entry: Entry, slot: Slot, at: Any) -> Entry:
    need = words(slot).removesuffix(" or null")
    help = f"{entry.help} Needs {need}{', or nothing' if slot.optional else ''}.".strip()
    text = "" if at is None else written(at, slot.unit)
    choices: list[tuple[str, str]] = []
    for one in slot.choices:
        if get_origin(one) is Literal:
            choices += [(quoted(str(name)), str(name)) for name in get_args(one)]
        elif one is bool:
            choices += [("false", "off"), ("true", "on")]
        else:
            return replace(entry, text=text, help=help, need=need)
    if slot.optional:
        choices = [(NONE, "none"), *choices]
    return replace(entry, text=text or NONE, help=help, choices=tuple(choices))


def chosen(kind: str) -> str:
    """Text that takes a member of a family with its defaults."""
    return f"{{kind: {kind}}}"


def _line(raw: Any) -> str:
    if isinstance(raw, dict):
        return f"{{{', '.join(f'{key}: {_line(one)}' for key, one in raw.items())}}}"
    if isinstance(raw, list):
        return f"[{', '.join(map(_line, raw))}]"
    if isinstance(raw, str):
        return quoted(raw)
    if raw is None:
        return NONE
    return str(raw).lower() if isinstance(raw, bool) else repr(raw)
