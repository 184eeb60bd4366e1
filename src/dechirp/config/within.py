"""A setting of a value, found by its path and changed there: `--set` without the text between.

To write a scenario as text, change it and read it again takes 20 ms; to make the values along
the path of a setting anew takes as long as their own checks.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, Literal, TypeAlias, TypeVar, cast

from dechirp.config.fields import Setting, Slot, is_family, settings
from dechirp.config.files import value_of
from dechirp.config.mistakes import Spot
from dechirp.config.models import Context
from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.overrides import placed
from dechirp.config.texts import dump
from dechirp.config.tree import Node, Place, distinct, dotted, read_tree
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import PhysicsWarning

T = TypeVar("T")
Steps: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True)
class Way:
    """Where a setting lies in a value."""

    path: str
    """As `--set` takes it."""
    steps: Steps
    """Fields and indices, from the whole to the last of it that the value holds."""
    slot: Slot
    """What may stand there."""
    rest: tuple[str, ...]
    """Names below it: of settings of what is none as yet, or the kind of a member of a family."""
    leaf: Slot
    """What may stand at the setting itself."""

    def meets(self, other: "Way") -> bool:
        """Whether one of them changes what the other changes."""
        both = min(len(self.steps), len(other.steps))
        if self.steps[:both] != other.steps[:both]:
            return False
        if self.steps != other.steps or not (self.rest and other.rest):
            return True
        both = min(len(self.rest), len(other.rest))
        return self.rest[:both] == other.rest[:both] or "kind" in (self.rest[-1], other.rest[-1])


def way_to(whole: Any, path: str) -> Way:
    """Find a setting in a value.

    Raises
    ------
    InvalidSetting
        If there is none of that path, with the nearest name that there is.
    """
    slot = Slot(type(whole))
    at: Any = whole
    steps: Steps = ()
    names = path.split(".")
    for place, name in enumerate(names):
        before = ".".join(names[:place])
        if (is_dataclass(at) and name == "kind" and isinstance(at, Family)) or at is None:
            return Way(path, steps, slot, tuple(names[place:]), _leaf(slot, names[place:], before))
        if is_dataclass(at):
            setting = _setting(settings(cast(type, type(at))), name, before)
            at, slot, steps = getattr(at, setting.field), setting.slot, (*steps, setting.field)
        elif isinstance(at, tuple):
            index = _index(at, name, before)
            at, slot, steps = at[index], slot.member(), (*steps, index)
        else:
            raise InvalidSetting(
                dotted(before, name),
                got=f"inside {before}, which is one value",
                need="inside a mapping or a list",
                fix=f"Take {before} itself.",
            )
    return Way(path, steps, slot, (), slot)


def read_at(whole: Any, way: Way, node: Node, context: Context) -> Any:
    """What stands at the steps of a way once a setting is as written; see `files.value_of`."""
    if not way.rest:
        return value_of(Spot(way.path, node, way.slot), context)
    at = whole
    for step in way.steps:
        at = at[step] if isinstance(step, int) else getattr(at, step)
    nowhere = Place("")
    start = Node({}, nowhere, nowhere) if at is None else read_tree(dump(at), "")
    above = ".".join(way.path.split(".")[: -len(way.rest)])
    spot = Spot(above, start, way.slot)
    return value_of(replace(spot, node=placed(spot, list(way.rest), node, context)), context)


def changed(whole: T, changes: Mapping[Steps, Any]) -> T:
    """Make a value anew with others in some places, none of which lies in another.

    Raises
    ------
    InvalidSetting
        As the values do that cannot be so.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # findings of the run tell it
        return cast(T, _changed(whole, changes))


def files_in(spot: Spot, context: Context) -> Iterator[tuple[Steps, str]]:
    """Find the files that settings name: where in the tree, and their absolute paths."""
    for steps, node in _named(spot, context, ()):
        yield steps, str((context.base / str(node.content)).absolute())


def anchored(spot: Spot, context: Context) -> Node:
    """Give the same tree with absolute paths of files, which mean the same from everywhere."""
    node = spot.node
    for steps, path in files_in(spot, context):
        node = _replaced(node, steps, path)
    return node


def _changed(at: Any, changes: Mapping[Steps, Any]) -> Any:
    if () in changes:
        return changes[()]
    below: dict[str | int, dict[Steps, Any]] = {}
    for steps, made in changes.items():
        below.setdefault(steps[0], {})[steps[1:]] = made
    if is_dataclass(at):
        fields = {str(one): _changed(getattr(at, str(one)), of) for one, of in below.items()}
        return replace(cast(Any, at), **fields)
    members = list(at)
    for index, of in below.items():
        members[int(index)] = _changed(members[int(index)], of)
    return tuple(members)


def _setting(known: Mapping[str, Setting], name: str, before: str) -> Setting:
    if name not in known:
        raise InvalidSetting(
            dotted(before, name),
            got="not a known name",
            need=f"one of {', '.join(known)}" if known else "left out: there are no settings here",
            fix=did_you_mean(name, known, OR_NONE),
        )
    return known[name]


def _index(members: Sequence[Any], name: str, before: str) -> int:
    """Index of a member of a list, by its label or its index."""
    labels = distinct(_label(member, str(at)) for at, member in enumerate(members))
    if name in labels:
        return labels.index(name)
    if name.isdecimal() and len(name) < 10 and int(name) < len(labels):
        return int(name)
    raise InvalidSetting(
        dotted(before, name),
        got="not in the list",
        need=f"one of {', '.join(labels)}" if labels else "left out: the list is empty",
        fix=did_you_mean(name, labels),
    )


def _label(member: Any, index: str) -> str:
    """As `Node.labels` would have it of the text of the value."""
    name = getattr(member, "name", None) if is_dataclass(member) else None
    if isinstance(name, str):
        return name
    return member.kind() if isinstance(member, Family) else index


def _leaf(slot: Slot, names: Sequence[str], before: str) -> Slot:
    """Slot of a setting of what is none as yet, or of a kind."""
    for place, name in enumerate(names):
        path = dotted(before, ".".join(names[:place])) if place else before
        families = [choice for choice in slot.choices if is_family(choice)]
        classes = [choice for choice in slot.choices if is_dataclass(choice)]
        if families and name == "kind" and place == len(names) - 1:
            return Slot(Literal.__getitem__(tuple(families[0].members())))
        known = settings(cast(type, classes[0])) if classes and not families else {}
        if not known:
            raise InvalidSetting(
                dotted(path, name),
                got=f"inside {path}, which is none",
                need="inside a mapping or a list",
                fix=f"Take {path} itself, and give it whole.",
            )
        slot = _setting(known, name, path).slot
    return slot


def _named(spot: Spot, context: Context, steps: Steps) -> Iterator[tuple[Steps, Node]]:
    content = spot.node.content
    if isinstance(content, str):
        if spot.slot.is_path or any(one in context.readers for one in spot.slot.choices):
            yield steps, spot.node
        return
    keys: Iterable[str | int] = ()
    if isinstance(content, dict | list):
        keys = content if isinstance(content, dict) else range(len(content))
    for key in keys:
        inner = spot.step(key)
        assert inner is not None  # it is written
        yield from _named(inner, context, (*steps, key))


def _replaced(node: Node, steps: Steps, text: str) -> Node:
    if not steps:
        return replace(node, content=text, text=text)
    first, *rest = steps
    if isinstance(node.content, dict):
        inner = _replaced(node.content[str(first)], tuple(rest), text)
        return replace(node, content={**node.content, str(first): inner})
    assert isinstance(node.content, list)
    members = list(node.content)
    members[int(first)] = _replaced(members[int(first)], tuple(rest), text)
    return replace(node, content=members)
