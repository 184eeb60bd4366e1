"""Parser of the pages of this package to element trees; SVG drawings remain text."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

_DRAWING = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_EMPTY = frozenset({"br", "col", "meta"})


@dataclass
class Element:
    """Element of a page; an SVG drawing is stored as text."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    children: "list[Element | str]" = field(default_factory=list)
    svg: str = ""

    @property
    def classes(self) -> list[str]:
        """Names in the attribute `class`."""
        return self.attributes.get("class", "").split()

    def descendants(self, *tags: str) -> "Iterator[Element]":
        """Iterate over inner elements in document order, of the given tags or all."""
        for child in self.children:
            if isinstance(child, Element):
                if child.tag in tags or not tags:
                    yield child
                yield from child.descendants(*tags)

    @property
    def text(self) -> str:
        """Text content, with white space."""
        return "".join(child if isinstance(child, str) else child.text for child in self.children)


def parse_html(html: str) -> Element:
    """Parse a page.

    Raises
    ------
    ValueError
        If a closing tag does not match.
    """
    drawings: list[str] = []

    def store_drawing(match: re.Match[str]) -> str:
        # The parser would convert SVG names to lower case.
        drawings.append(match[0])
        return f'<svg at="{len(drawings) - 1}"></svg>'

    reader = _Reader()
    reader.feed(_DRAWING.sub(store_drawing, html))
    reader.close()
    for element in reader.root.descendants("svg"):
        element.svg = drawings[int(element.attributes["at"])]
    return reader.root


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = Element("page")
        self.open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self.open[-1].children.append(element)
        if tag not in _EMPTY:
            self.open.append(element)

    def handle_endtag(self, tag: str) -> None:
        if self.open[-1].tag != tag:
            raise ValueError(f"</{tag}> closes <{self.open[-1].tag}> at {self.getpos()}")
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.open[-1].children.append(data)
