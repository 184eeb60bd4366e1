"""Words of a page, and what stands among them, as Typst source.

All that is written goes as strings of Typst, where only the backslash and the quote mean
anything: what a target is called is never markup.
"""

import re
from collections.abc import Iterator
from html import unescape
from itertools import pairwise

from dechirp.report.html_tree import Element

_LONG = re.compile(r"[^\s\u00a0]{25,}")  # longer than a column, as digests are
_BREAK = "\N{ZERO WIDTH SPACE}"
# What a class means for words: a function of page.typ.
_LOOKS = {
    "failed": "failed",
    "fails": "failed",
    "not-met": "failed",
    "holds": "holds",
    "met": "holds",
    "undecided": "undecided",
    "nb": "whole",
    **dict.fromkeys(("interval", "formula", "about", "below", "lead", "name", "byline"), "quiet"),
}
_WORDS = {"b": "strong", "i": "light", "sup": "super", "code": "code", "small": "tiny"}
INLINE = frozenset({*_WORDS, "a", "br", "span", "svg"})
_HEAD = "http://www.w3.org/2000/svg"


class UnknownElement(ValueError):
    """A page has an element that no PDF can have: its template, or this file, is to be mended."""


class Words:
    """Inline content of a page, whose drawings and places it keeps."""

    def __init__(self, page: Element) -> None:
        self.drawings: dict[str, str] = {}
        self.places = {one.attributes["id"] for one in page.all() if "id" in one.attributes}

    def anchor(self, one: Element) -> str:
        """Write a place that links lead to, where an element has a name."""
        place = one.attributes.get("id")
        return f"#[#metadata(none)#label({string(place)})]" if place else ""

    def words(self, parent: Element) -> str:
        """Write the inline content of an element."""
        parts = list(self._inline(parent))
        while parts and parts[0] == _SPACE:
            parts.pop(0)
        while parts and parts[-1] == _SPACE:
            parts.pop()
        single = (one for one, after in pairwise([*parts, ""]) if not one == after == _SPACE)
        return self.anchor(parent) + "".join(single)

    def _inline(self, parent: Element) -> Iterator[str]:
        for child in parent.children:
            if isinstance(child, str):
                yield from _spaced(child)
            else:
                yield self._element(child, first=child is parent.children[0])

    def _element(self, one: Element, *, first: bool) -> str:
        if one.tag == "svg":
            return self._formula(one)
        if one.tag == "div" and "bar" in one.classes:
            return _bar(one)
        if one.tag not in INLINE:
            raise UnknownElement(f"<{one.tag}> among words: {flat(one.text)[:60]!r}")
        words = self.words(one)
        if one.tag == "small" and words and not first:
            return f"#linebreak();#tiny[{words}];"
        if one.tag == "a":
            place = one.attributes["href"].removeprefix("#")
            return f"#link(label({string(place)}))[{words}];" if place in self.places else words
        if one.tag == "br":
            return "#linebreak();"
        if one.tag == "span":
            words = look(one, words)
        return f"#{_WORDS.get(one.tag, '')}[{words}];" if words else ""

    def _formula(self, one: Element) -> str:
        style = dict(part.split(":") for part in _attribute(one.svg, "style").split(";"))
        below = style["vertical-align"].removeprefix("-")
        file, alt = self.drawn(one)
        return f"#formula({file}, {alt}, {style['width']}, {below});"

    def drawn(self, one: Element) -> tuple[str, str]:
        """Name of the file of a drawing, and what it is for those who do not see it."""
        name = f"{len(self.drawings)}.svg"
        spaces = f'<svg xmlns="{_HEAD}" xmlns:xlink="http://www.w3.org/1999/xlink"'
        self.drawings[name] = one.svg.replace("<svg", spaces, 1)
        return string(name), string(_attribute(one.svg, "aria-label"))


_SPACE = '#" ";'


def _spaced(text: str) -> Iterator[str]:
    """Words as strings of Typst, white space between them as one space each."""
    for part in re.split(r"([ \t\r\n]+)", text):
        if part and not part.strip(" \t\r\n"):
            yield _SPACE
        elif part:
            yield f"#{string(_LONG.sub(_with_breaks, part))};"


def _with_breaks(found: re.Match[str]) -> str:
    return re.sub(r"(.{8})", rf"\1{_BREAK}", found[0])


def _bar(one: Element) -> str:
    (fill,) = [child for child in one.children if isinstance(child, Element)]
    left, width = re.findall(r"[\d.]+%", fill.attributes["style"])
    return f"#bar({string(' '.join(fill.classes))}, {left}, {width});"


def look(one: Element, words: str) -> str:
    """Write words as the class of their element says."""
    said = next((_LOOKS[kind] for kind in one.classes if kind in _LOOKS), None)
    return f"#{said}[{words}];" if said and words else words


def string(text: str) -> str:
    """Write a string of Typst."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + escaped.replace("\r", "").replace("\n", "\\n").replace("\t", "\\t") + '"'


def flat(text: str) -> str:
    """Write a text in one line; spaces at which no line is broken stay."""
    return re.sub(r"[ \t\r\n]+", " ", text).strip(" ")


def _attribute(svg: str, name: str) -> str:
    found = re.search(rf'{name}="([^"]*)"', svg[: svg.index(">")])
    return unescape(found[1]) if found else ""
