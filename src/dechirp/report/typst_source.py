"""Conversion of a page of this package to Typst source."""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby

from dechirp.report.html_tree import Element, parse_html
from dechirp.report.typst_inline import (
    INLINE,
    InlineWriter,
    UnknownElementError,
    apply_class_style,
    collapse_whitespace,
    quote_typst_string,
)
from dechirp.report.typst_table import Cell, lay_out_table

_FINDINGS = {"warning": 'rgb("#e0a100")', "error": "orange", "note": "blue"}


def html_to_typst(html: str) -> tuple[str, dict[str, str]]:
    """Return the Typst source of a page, without `page.typ`, and its drawings by name."""
    page = _Page(parse_html(html))
    return page.text, page.drawings


class _Page(InlineWriter):
    def __init__(self, page: Element) -> None:
        (title,), (main,) = page.descendants("title"), page.descendants("main")
        super().__init__(main)
        self.turned = False
        self.is_paper = "paper" in main.classes
        self.blocks: dict[str, Callable[[Element], str]] = {
            "header": self.convert_child_blocks,
            "section": self.convert_section,
            **dict.fromkeys(("h1", "h2", "h3"), self.convert_heading),
            **dict.fromkeys(("ul", "ol"), self.convert_list),
            "div": self.convert_div,
            "p": self.convert_paragraph,
            "table": self.convert_table,
            "figure": self.convert_figure,
            "details": self.convert_details,
            "pre": lambda element: f"#file([], {quote_typst_string(element.text)})\n",
            "footer": lambda element: f"#colophon[{self.convert_inline_content(element)}]\n",
        }
        is_paper = "true" if self.is_paper else "false"
        title_text = quote_typst_string(collapse_whitespace(title.text))
        head = f"#show: report.with({title_text}, {is_paper})\n"
        self.text = head + self.convert_child_blocks(main)

    def convert_child_blocks(self, parent: Element) -> str:
        """Convert the blocks of an element; text between them becomes a paragraph."""
        blocks = []
        for is_inline, children_run in groupby(parent.children, _is_inline):
            if is_inline:
                words = self.convert_inline_content(Element("p", {}, list(children_run)))
                blocks += [f"#par[{words}]\n"] if words else []
            else:
                blocks += [
                    self.convert_block(element)
                    for element in children_run
                    if isinstance(element, Element)
                ]
        return self.typst_anchor(parent) + "".join(blocks)

    def convert_block(self, element: Element) -> str:
        if element.tag not in self.blocks:
            raise UnknownElementError(
                f"<{element.tag}> in {collapse_whitespace(element.text)[:60]!r}"
            )
        return self.blocks[element.tag](element)

    def convert_section(self, element: Element) -> str:
        """Convert a section, on landscape pages if it contains a wide table."""
        self.turned = False
        blocks = self.convert_child_blocks(element)
        return f"#wide[{blocks}]\n" if self.turned else blocks

    def convert_heading(self, element: Element) -> str:
        level = int(element.tag[1])
        plain = ", numbering: none" if level == 1 or "plain" in element.classes else ""
        return f"#heading(level: {level}{plain})[{self.convert_inline_content(element)}]\n"

    def convert_paragraph(self, element: Element) -> str:
        words = self.convert_inline_content(element)
        if not words:
            return ""
        blocks = f"#par[{apply_class_style(element, words)}]"
        return (
            f"#block(sticky: true)[{blocks}]\n" if "caption" in element.classes else f"{blocks}\n"
        )

    def convert_list(self, element: Element) -> str:
        items = [child for child in element.children if isinstance(child, Element)]
        if "findings" in element.classes:
            return "".join(
                f"#finding({_FINDINGS[item.classes[0]]})[{self.convert_inline_content(item)}]\n"
                for item in items
            )
        kind = "list" if element.tag == "ul" else "enum"
        return f"#{kind}({', '.join(f'[{self.convert_inline_content(item)}]' for item in items)})\n"

    def convert_div(self, element: Element) -> str:
        classes = element.classes
        children = [child for child in element.children if isinstance(child, Element)]
        if "cards" in classes:
            cards = (
                ", ".join(
                    f"[{self.convert_inline_content(part)}]"
                    for part in card.children
                    if isinstance(part, Element)
                )
                for card in children
            )
            return f"#cards({', '.join(f'card({card})' for card in cards)})\n"
        if "pair" in classes:
            return self.convert_blocks_side_by_side(children)
        if "sign" in classes:
            contents = [f"[{self.convert_inline_content(child)}]" for child in children]
            return f"#signed({', '.join(contents)})\n"
        if "equation" in classes:
            formula, number = children
            words = (
                f"[{self.convert_inline_content(formula)}], [{self.convert_inline_content(number)}]"
            )
            return f"{self.typst_anchor(element)}#equation({words})\n"
        blocks = self.convert_child_blocks(element)
        return f"#kept[{blocks}]\n" if {"keep", "group"} & set(classes) else blocks

    def convert_blocks_side_by_side(self, children: Sequence[Element]) -> str:
        """Convert a pair: figures and groups in two columns, other blocks at full width."""
        converted = []
        for is_narrow, children_run in groupby(children, _fits_half_page_width):
            blocks = [self.convert_block(element) for element in children_run]
            if is_narrow and len(blocks) > 1:
                converted.append(f"#two({', '.join(f'[{block}]' for block in blocks)})\n")
            else:
                converted += [f"#narrow[{block}]\n" if is_narrow else block for block in blocks]
        return "".join(converted)

    def convert_figure(self, element: Element) -> str:
        drawing = next(element.descendants("svg"))  # further ones are formulas of the caption
        (caption,) = element.descendants("figcaption")
        file, alt = self.store_drawing(drawing)
        blocks = f"#drawing({file}, {alt}, [{self.convert_inline_content(caption)}])"
        return f"#narrow[{blocks}]\n" if self.is_paper else f"{blocks}\n"

    def convert_details(self, element: Element) -> str:
        """Convert a folded file; folded figures, which a reader opens on demand, are left out."""
        if "figures" in element.classes:
            return ""
        (summary,), (pre,) = element.descendants("summary"), element.descendants("pre")
        return f"#file([{self.convert_inline_content(summary)}], {quote_typst_string(pre.text)})\n"

    def convert_table(self, element: Element) -> str:
        rows = [
            [
                Cell(
                    source=apply_class_style(cell, self.convert_inline_content(cell)),
                    lines=tuple(_table_cell_lines(cell)),
                    kinds=frozenset(cell.classes),
                    n_columns=int(cell.attributes.get("colspan", "1")),
                )
                for cell in row.descendants("th", "td")
            ]
            for row in element.descendants("tr")
        ]
        n_heads = sum(len(list(head.descendants("tr"))) for head in element.descendants("thead"))
        looks = [frozenset(row.classes) for row in element.descendants("tr")]
        kinds = frozenset(element.classes)
        blocks, turned = lay_out_table(rows, looks, n_heads, kinds, is_paper=self.is_paper)
        self.turned = self.turned or turned
        return blocks


def _table_cell_lines(cell: Element) -> Iterator[str]:
    """Yield the text of a cell line by line."""
    line = ""
    for child in cell.children:
        if isinstance(child, str):
            line += child
        elif child.tag in {"br", "small"}:
            yield collapse_whitespace(line)
            line = child.text
        else:
            line += child.text
    yield collapse_whitespace(line)


def _is_inline(element: Element | str) -> bool:
    return isinstance(element, str) or element.tag in INLINE


def _fits_half_page_width(element: Element) -> bool:
    return element.tag == "figure" or "group" in element.classes
