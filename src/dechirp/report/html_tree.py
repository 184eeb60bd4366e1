"""Our own pages, read back as a tree of elements, their drawings as they are."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

_DRAWING = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_EMPTY = frozenset({"br", "meta"})


@dataclass
class Element:
    """An element of a page; of a drawing its SVG instead of what is in it."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    children: "list[Element | str]" = field(default_factory=list)
    svg: str = ""

    @property
    def classes(self) -> list[str]:
        """What `class` says."""
        return self.attributes.get("class", "").split()

    def all(self, *tags: str) -> "Iterator[Element]":
        """Elements of these tags, or of any, inside of it, in the order of the page."""
        for child in self.children:
            if isinstance(child, Element):
                if child.tag in tags or not tags:
                    yield child
                yield from child.all(*tags)

    @property
    def text(self) -> str:
        """All that is written in it, white space as it is."""
        return "".join(one if isinstance(one, str) else one.text for one in self.children)


def tree(html: str) -> Element:
    """Read a page.

    Raises
    ------
    ValueError
        If an element is closed that is not open: no page of ours does that.
    """
    drawings: list[str] = []

    def kept(found: re.Match[str]) -> str:
        # The parser would write their names in small letters, and SVG minds that.
        drawings.append(found[0])
        return f'<svg at="{len(drawings) - 1}"></svg>'

    reader = _Reader()
    reader.feed(_DRAWING.sub(kept, html))
    reader.close()
    for drawn in reader.root.all("svg"):
        drawn.svg = drawings[int(drawn.attributes["at"])]
    return reader.root


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = Element("page")
        self.open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        made = Element(tag, {name: of or "" for name, of in attrs})
        self.open[-1].children.append(made)
        if tag not in _EMPTY:
            self.open.append(made)

    def handle_endtag(self, tag: str) -> None:
        if self.open[-1].tag != tag:
            raise ValueError(f"</{tag}> closes <{self.open[-1].tag}> at {self.getpos()}")
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.open[-1].children.append(data)
