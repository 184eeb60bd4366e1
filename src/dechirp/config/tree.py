"""Settings as they are written: YAML text to a tree that knows where everything stands."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentEndEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from dechirp.config.shown import shown
from dechirp.core.errors import InvalidFile, Mistake

Plain: TypeAlias = "str | int | float | bool | list[Plain] | dict[str, Plain] | None"

_DEEPEST = 32  # levels; the deepest setting lies at 8
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}
_INT = re.compile(r"[-+]?\d{1,400}", re.ASCII)
_FLOAT = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Place:
    """Where something is written; line and column count from 1, None where there are none."""

    file: str
    line: int | None = None
    column: int | None = None

    def mistake(self, setting: str, *, got: str, need: str, fix: str) -> Mistake:
        """Tell a mistake that is made here."""
        return Mistake(
            setting=setting,
            got=got,
            need=need,
            fix=fix,
            file=self.file,
            line=self.line,
            column=self.column,
        )


@dataclass(frozen=True)
class Node:
    """A scalar, list or mapping, and where it is written."""

    content: "str | int | float | bool | list[Node] | dict[str, Node] | None"
    place: Place
    named_at: Place
    """Where its name is written; in a list, its own place."""
    text: str = ""
    """A scalar as it is written."""
    repeated: "tuple[tuple[str, Place], ...]" = ()
    """Names of a mapping that are given once more."""

    @property
    def plain(self) -> Plain:
        """The tree without the places."""
        if isinstance(self.content, dict):
            return {name: node.plain for name, node in self.content.items()}
        if isinstance(self.content, list):
            return [node.plain for node in self.content]
        return self.content

    @property
    def shown(self) -> str:
        """What a message says was got."""
        if isinstance(self.content, dict):
            return "a mapping" if self.content else "an empty mapping"
        if isinstance(self.content, list):
            return f"a list of {len(self.content)}" if self.content else "an empty list"
        if self.content is None:
            return "null"
        number_in_quotes = self.content == self.text and not isinstance(resolved(self.text), str)
        return f"the text '{self.text[:60]}'" if number_in_quotes else shown(self.text)

    @cached_property
    def labels(self) -> list[str]:
        """How settings name the members of a list: by `name`, else `kind`, else index."""
        members = self.content if isinstance(self.content, list) else []
        return distinct(_label(node, str(index)) for index, node in enumerate(members))

    def inside(self) -> "Iterator[tuple[str, Node]]":
        """Label and node of everything a list or mapping holds."""
        if isinstance(self.content, dict):
            yield from self.content.items()
        elif isinstance(self.content, list):
            yield from zip(self.labels, self.content, strict=True)


def distinct(labels: Iterable[str]) -> list[str]:
    """Labels of the members of a list, their indices in the place of those that are not alone."""
    labels = list(labels)
    times = Counter(labels)
    return [label if times[label] == 1 else str(index) for index, label in enumerate(labels)]


def read_tree(text: str, file: str) -> Node:
    """Read a YAML text as a tree.

    Raises
    ------
    InvalidFile
        If it is not YAML, not one document, nested deeper than 32 levels, or uses anchors or
        tags: a file of ten lines could stand for gigabytes with them.
    """
    try:
        return _Reader(text, file).document()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Place(file, mark.line + 1, mark.column + 1) if mark else Place(file)
        got = error.problem or error.context
    except YAMLError as error:
        place, got = _of_character(text, getattr(error, "position", 0), file), str(error)
    except (ValueError, OverflowError) as error:
        # An escape in double quotes beyond the last character of Unicode.
        place, got = Place(file), str(error)
    problem = (got or "broken").partition("\n")[0]
    raise InvalidFile(
        place.mistake(
            "the text",
            got=f"not YAML: {shown(problem)}",
            need="YAML",
            fix="Mend it there, or just before.",
        )
    )


def repeated(node: Node, path: str = "") -> Iterator[Mistake]:
    """Find the names that are given twice, anywhere in a tree."""
    for name, place in node.repeated:
        assert isinstance(node.content, dict)
        first = node.content[name].named_at
        yield place.mistake(
            dotted(path, name),
            got=f"given twice, first on line {first.line}" if first.line else "given twice",
            need="given once",
            fix="Keep one of them.",
        )
    for label, child in node.inside():
        yield from repeated(child, dotted(path, label))


def dotted(path: str, name: str) -> str:
    """Path of a setting within the one of the path."""
    name = shown(name)
    return f"{path}.{name}" if path else name


class _Reader:
    """From the events of the parser, so that nothing is built before it is looked at."""

    def __init__(self, text: str, file: str) -> None:
        self.events: Iterator[Event] = YAML(typ="safe", pure=True).parse(text)
        self.file = file

    def document(self) -> Node:
        start = Place(self.file, 1, 1)
        root = Node(None, start, start)
        for event in self.events:
            if isinstance(event, DocumentStartEvent):
                root = self.node(next(self.events), None, 0)
            elif isinstance(event, DocumentEndEvent):
                break
        for event in self.events:
            if isinstance(event, DocumentStartEvent):
                raise self.refused(
                    event, "more than one document", "one document", "Take out the line ---."
                )
        return root

    def node(self, event: Event, named_at: Place | None, depth: int) -> Node:
        place = self.place(event)
        named_at = named_at or place
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None) is not None:
            raise self.refused(
                event,
                "an anchor or an alias (& or *)",
                "written out",
                "Repeat the setting; put a text that begins with & or * in quotes.",
            )
        if getattr(event, "tag", None) is not None:
            raise self.refused(event, "a tag (!)", "without tags", "Leave the tag out.")
        if depth > _DEEPEST:
            raise self.refused(
                event,
                f"nested deeper than {_DEEPEST} levels",
                "as deep as the settings are",
                "Look for brackets that are not closed.",
            )
        if isinstance(event, MappingStartEvent):
            return self.mapping(place, named_at, depth)
        if isinstance(event, SequenceStartEvent):
            members = []
            while not isinstance(event := next(self.events), SequenceEndEvent):
                members.append(self.node(event, None, depth + 1))
            return Node(members, place, named_at)
        assert isinstance(event, ScalarEvent)
        content = event.value if event.style else resolved(event.value)
        # The parser sees that nothing is written only at what comes next.
        place = place if event.value or event.style else named_at
        return Node(content, place, named_at, event.value)

    def mapping(self, place: Place, named_at: Place, depth: int) -> Node:
        members: dict[str, Node] = {}
        again: list[tuple[str, Place]] = []
        while not isinstance(event := next(self.events), MappingEndEvent):
            key = self.node(event, None, depth + 1)
            if isinstance(key.content, dict | list):
                raise self.refused(
                    event, f"{key.shown} for a name", "named by a text", "Write NAME: VALUE."
                )
            child = self.node(next(self.events), key.place, depth + 1)
            if key.text in members:
                again.append((key.text, key.place))
            else:
                members[key.text] = child
        return Node(members, place, named_at, repeated=tuple(again))

    def place(self, event: Event) -> Place:
        return Place(self.file, event.start_mark.line + 1, event.start_mark.column + 1)

    def refused(self, event: Event, got: str, need: str, fix: str) -> InvalidFile:
        return InvalidFile(self.place(event).mistake("the text", got=got, need=need, fix=fix))


def _label(node: Node, index: str) -> str:
    if isinstance(node.content, dict):
        for key in ("name", "kind"):
            if key in node.content and isinstance(node.content[key].content, str):
                return node.content[key].text
    return index


def resolved(text: str) -> str | int | float | bool | None:
    """Give a scalar without quotes its meaning in the core of YAML 1.2; `no` is a text."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if _INT.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def _of_character(text: str, position: int, file: str) -> Place:
    before = text[:position]
    return Place(file, before.count("\n") + 1, position - before.rfind("\n"))
