"""Conversion of inline HTML content to Typst source.

All text becomes Typst strings, in which only backslash and quotation mark are special, so that
names of targets are never interpreted as markup.
"""

import re
from collections.abc import Iterator
from html import unescape
from itertools import pairwise

from dechirp.report.html_tree import Element

_LONG = re.compile(r"[^\s\u00a0]{25,}")  # longer than a column, such as digests
_BREAK = "\N{ZERO WIDTH SPACE}"
# Typst function of page.typ for each class.
_STYLE_OF_CLASS = {
    "failed": "failed",
    "fails": "failed",
    "not-met": "failed",
    "holds": "holds",
    "met": "holds",
    "undecided": "undecided",
    "nb": "whole",
    **dict.fromkeys(("interval", "formula", "about", "below", "lead", "name", "byline"), "quiet"),
}
_TYPST_FUNCTIONS = {"b": "strong", "i": "light", "sup": "super", "code": "code", "small": "tiny"}
INLINE = frozenset({*_TYPST_FUNCTIONS, "a", "br", "span", "svg"})
_HEAD = "http://www.w3.org/2000/svg"


class UnknownElementError(ValueError):
    """Page with an HTML element that the PDF conversion does not support."""


class InlineWriter:
    """Converter of inline content, which stores drawings and anchor ids of a page."""

    def __init__(self, page: Element) -> None:
        self.drawings: dict[str, str] = {}
        self.anchor_ids = {
            element.attributes["id"] for element in page.descendants() if "id" in element.attributes
        }

    def typst_anchor(self, element: Element) -> str:
        """Return a label for links to an element with an id."""
        place = element.attributes.get("id")
        return f"#[#metadata(none)#label({quote_typst_string(place)})]" if place else ""

    def convert_inline_content(self, parent: Element) -> str:
        """Return the inline content of an element."""
        parts = list(self._convert_inline_children(parent))
        while parts and parts[0] == _SPACE:
            parts.pop(0)
        while parts and parts[-1] == _SPACE:
            parts.pop()
        single = (
            part for part, following in pairwise([*parts, ""]) if not part == following == _SPACE
        )
        return self.typst_anchor(parent) + "".join(single)

    def _convert_inline_children(self, parent: Element) -> Iterator[str]:
        for child in parent.children:
            if isinstance(child, str):
                yield from _text_as_typst_strings(child)
            else:
                yield self._convert_inline_element(child, first=child is parent.children[0])

    def _convert_inline_element(self, element: Element, *, first: bool) -> str:
        if element.tag == "svg":
            return self._convert_formula_drawing(element)
        if element.tag == "div" and "bar" in element.classes:
            return _convert_bar(element)
        if element.tag not in INLINE:
            raise UnknownElementError(
                f"<{element.tag}> in inline content: {collapse_whitespace(element.text)[:60]!r}"
            )
        content = self.convert_inline_content(element)
        if element.tag == "small" and content and not first:
            return f"#linebreak();#tiny[{content}];"
        if element.tag == "a":
            place = element.attributes["href"].removeprefix("#")
            return (
                f"#link(label({quote_typst_string(place)}))[{content}];"
                if place in self.anchor_ids
                else content
            )
        if element.tag == "br":
            return "#linebreak();"
        if element.tag == "span":
            content = apply_class_style(element, content)
        return f"#{_TYPST_FUNCTIONS.get(element.tag, '')}[{content}];" if content else ""

    def _convert_formula_drawing(self, element: Element) -> str:
        style = dict(part.split(":") for part in _svg_attribute(element.svg, "style").split(";"))
        below = style["vertical-align"].removeprefix("-")
        file, alt = self.store_drawing(element)
        return f"#formula({file}, {alt}, {style['width']}, {below});"

    def store_drawing(self, element: Element) -> tuple[str, str]:
        """Store a drawing and return its file name and alternative text."""
        name = f"{len(self.drawings)}.svg"
        spaces = f'<svg xmlns="{_HEAD}" xmlns:xlink="http://www.w3.org/1999/xlink"'
        self.drawings[name] = element.svg.replace("<svg", spaces, 1)
        return quote_typst_string(name), quote_typst_string(
            _svg_attribute(element.svg, "aria-label")
        )


_SPACE = '#" ";'


def _text_as_typst_strings(text: str) -> Iterator[str]:
    """Yield text as Typst strings, with white space collapsed."""
    for part in re.split(r"([ \t\r\n]+)", text):
        if part and not part.strip(" \t\r\n"):
            yield _SPACE
        elif part:
            yield f"#{quote_typst_string(_LONG.sub(_insert_zero_width_breaks, part))};"


def _insert_zero_width_breaks(match: re.Match[str]) -> str:
    return re.sub(r"(.{8})", rf"\1{_BREAK}", match[0])


def _convert_bar(element: Element) -> str:
    (fill,) = [child for child in element.children if isinstance(child, Element)]
    offset, width = re.findall(r"[\d.]+%", fill.attributes["style"])
    return f"#bar({quote_typst_string(' '.join(fill.classes))}, {offset}, {width});"


def apply_class_style(element: Element, content: str) -> str:
    """Wrap content in the Typst function of its element's class."""
    style = next(
        (_STYLE_OF_CLASS[kind] for kind in element.classes if kind in _STYLE_OF_CLASS), None
    )
    return f"#{style}[{content}];" if style and content else content


def quote_typst_string(text: str) -> str:
    """Return a Typst string literal."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + escaped.replace("\r", "").replace("\n", "\\n").replace("\t", "\\t") + '"'


def collapse_whitespace(text: str) -> str:
    """Collapse white space to single spaces, except non-breaking spaces."""
    return re.sub(r"[ \t\r\n]+", " ", text).strip(" ")


def _svg_attribute(svg: str, name: str) -> str:
    match = re.search(rf'{name}="([^"]*)"', svg[: svg.index(">")])
    return unescape(match[1]) if match else ""
