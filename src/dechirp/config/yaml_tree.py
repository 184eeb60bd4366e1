"""YAML trees: the parsed text of settings files with the location of every node."""

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

from dechirp.core.errors import InvalidFile, Mistake, quote_for_message

Plain: TypeAlias = "str | int | float | bool | list[Plain] | dict[str, Plain] | None"

_MAX_DEPTH = 32  # levels; the deepest setting lies at 8
_CONSTANTS = {"": None, "~": None, "null": None, "true": True, "false": False}
_INT = re.compile(r"[-+]?\d{1,400}", re.ASCII)
_FLOAT = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Location:
    """Location in a file; line and column count from 1, None if unknown."""

    file: str
    line: int | None = None
    column: int | None = None

    def create_mistake(self, setting: str, *, value: str, expected: str, fix: str) -> Mistake:
        """Create a mistake at this location."""
        return Mistake(
            setting=setting,
            value=value,
            expected=expected,
            fix=fix,
            file=self.file,
            line=self.line,
            column=self.column,
        )


@dataclass(frozen=True)
class YamlNode:
    """Scalar, list or mapping with its location."""

    content: "str | int | float | bool | list[YamlNode] | dict[str, YamlNode] | None"
    location: Location
    name_location: Location
    """Location of its name; in a list, its own location."""
    text: str = ""
    """Text of a scalar in the file."""
    duplicate_keys: "tuple[tuple[str, Location], ...]" = ()
    """Repeated names of a mapping, with the location of each repetition."""

    @property
    def plain_data(self) -> Plain:
        """Tree without locations."""
        if isinstance(self.content, dict):
            return {name: node.plain_data for name, node in self.content.items()}
        if isinstance(self.content, list):
            return [node.plain_data for node in self.content]
        return self.content

    @property
    def content_description(self) -> str:
        """Description of the content for error messages."""
        if isinstance(self.content, dict):
            return "a mapping" if self.content else "an empty mapping"
        if isinstance(self.content, list):
            return f"a list of {len(self.content)}" if self.content else "an empty list"
        if self.content is None:
            return "null"
        number_in_quotes = self.content == self.text and not isinstance(
            parse_unquoted_scalar(self.text), str
        )
        return f"the text '{self.text[:60]}'" if number_in_quotes else quote_for_message(self.text)

    @cached_property
    def list_member_labels(self) -> list[str]:
        """Labels of list members in setting paths: their `name`, else `kind`, else index."""
        members = self.content if isinstance(self.content, list) else []
        return replace_repeated_labels_by_index(
            _label_of_list_member(node, str(index)) for index, node in enumerate(members)
        )

    def iter_children(self) -> "Iterator[tuple[str, YamlNode]]":
        """Yield the label and node of each child."""
        if isinstance(self.content, dict):
            yield from self.content.items()
        elif isinstance(self.content, list):
            yield from zip(self.list_member_labels, self.content, strict=True)


def replace_repeated_labels_by_index(labels: Iterable[str]) -> list[str]:
    """Return the labels of list members, with repeated labels replaced by the index."""
    labels = list(labels)
    counts = Counter(labels)
    return [label if counts[label] == 1 else str(index) for index, label in enumerate(labels)]


def parse_yaml(text: str, file: str) -> YamlNode:
    """Parse a YAML text to a tree.

    Raises
    ------
    InvalidFile
        If it is not YAML, not one document, nested deeper than 32 levels, or uses anchors or
        tags, with which ten lines could expand to gigabytes.
    """
    try:
        return _TreeBuilder(text, file).build_root_node()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Location(file, mark.line + 1, mark.column + 1) if mark else Location(file)
        got = error.problem or error.context
    except YAMLError as error:
        place, got = _location_of_character(text, getattr(error, "position", 0), file), str(error)
    except (ValueError, OverflowError) as error:
        # An escape in double quotes beyond the last character of Unicode.
        place, got = Location(file), str(error)
    problem = (got or "broken").partition("\n")[0]
    raise InvalidFile(
        place.create_mistake(
            "the text",
            value=f"not YAML: {quote_for_message(problem)}",
            expected="YAML",
            fix="correct it there, or just before",
        )
    )


def duplicate_key_mistakes(node: YamlNode, path: str = "") -> Iterator[Mistake]:
    """Find names that occur twice in a mapping, anywhere in a tree."""
    for name, location in node.duplicate_keys:
        assert isinstance(node.content, dict)
        first = node.content[name].name_location
        yield location.create_mistake(
            join_setting_path(path, name),
            value=f"given twice, first on line {first.line}" if first.line else "given twice",
            expected="one value",
            fix="keep one of them",
        )
    for label, child in node.iter_children():
        yield from duplicate_key_mistakes(child, join_setting_path(path, label))


def join_setting_path(path: str, name: str) -> str:
    """Append a name to the path of a setting."""
    name = quote_for_message(name)
    return f"{path}.{name}" if path else name


class _TreeBuilder:
    """Builder of the tree from parser events, which checks each event before using it."""

    def __init__(self, text: str, file: str) -> None:
        self.events: Iterator[Event] = YAML(typ="safe", pure=True).parse(text)
        self.file = file

    def build_root_node(self) -> YamlNode:
        start = Location(self.file, 1, 1)
        root = YamlNode(None, start, start)
        for event in self.events:
            if isinstance(event, DocumentStartEvent):
                root = self.build_node(next(self.events), None, 0)
            elif isinstance(event, DocumentEndEvent):
                break
        for event in self.events:
            if isinstance(event, DocumentStartEvent):
                raise self.error_at_event(
                    event, "more than one document", "one document", "remove the line ---"
                )
        return root

    def build_node(self, event: Event, name_location: Location | None, depth: int) -> YamlNode:
        place = self.location_of_event(event)
        name_location = name_location or place
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None) is not None:
            raise self.error_at_event(
                event,
                "an anchor or an alias (& or *)",
                "settings without anchors",
                "repeat the setting, or quote text that begins with & or *",
            )
        if getattr(event, "tag", None) is not None:
            raise self.error_at_event(event, "a tag (!)", "settings without tags", "remove the tag")
        if depth > _MAX_DEPTH:
            raise self.error_at_event(
                event,
                f"nested deeper than {_MAX_DEPTH} levels",
                "the nesting of the settings",
                "close open brackets",
            )
        if isinstance(event, MappingStartEvent):
            return self.build_mapping_node(place, name_location, depth)
        if isinstance(event, SequenceStartEvent):
            members = []
            while not isinstance(event := next(self.events), SequenceEndEvent):
                members.append(self.build_node(event, None, depth + 1))
            return YamlNode(members, place, name_location)
        assert isinstance(event, ScalarEvent)
        content = event.value if event.style else parse_unquoted_scalar(event.value)
        # The parser reports an empty value at the next token.
        place = place if event.value or event.style else name_location
        return YamlNode(content, place, name_location, event.value)

    def build_mapping_node(self, place: Location, name_location: Location, depth: int) -> YamlNode:
        members: dict[str, YamlNode] = {}
        duplicate_keys: list[tuple[str, Location]] = []
        while not isinstance(event := next(self.events), MappingEndEvent):
            key = self.build_node(event, None, depth + 1)
            if isinstance(key.content, dict | list):
                raise self.error_at_event(
                    event,
                    f"{key.content_description} for a name",
                    "text as a name",
                    "write NAME: VALUE",
                )
            child = self.build_node(next(self.events), key.location, depth + 1)
            if key.text in members:
                duplicate_keys.append((key.text, key.location))
            else:
                members[key.text] = child
        return YamlNode(members, place, name_location, duplicate_keys=tuple(duplicate_keys))

    def location_of_event(self, event: Event) -> Location:
        return Location(self.file, event.start_mark.line + 1, event.start_mark.column + 1)

    def error_at_event(self, event: Event, value: str, expected: str, fix: str) -> InvalidFile:
        return InvalidFile(
            self.location_of_event(event).create_mistake(
                "the text", value=value, expected=expected, fix=fix
            )
        )


def _label_of_list_member(node: YamlNode, index_text: str) -> str:
    if isinstance(node.content, dict):
        for key in ("name", "kind"):
            if key in node.content and isinstance(node.content[key].content, str):
                return node.content[key].text
    return index_text


def parse_unquoted_scalar(text: str) -> str | int | float | bool | None:
    """Convert an unquoted scalar by the core schema of YAML 1.2; `no` is a text."""
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _INT.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def _location_of_character(text: str, position: int, file: str) -> Location:
    preceding_text = text[:position]
    return Location(file, preceding_text.count("\n") + 1, position - preceding_text.rfind("\n"))
