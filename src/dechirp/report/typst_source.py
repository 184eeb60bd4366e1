"""A page of ours as Typst source: what its templates use of HTML, and nothing else."""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby

from dechirp.report.html_tree import Element, tree
from dechirp.report.typst_table import Cell, laid_out
from dechirp.report.typst_words import INLINE, UnknownElement, Words, flat, look, string

_FINDINGS = {"warning": 'rgb("#e0a100")', "error": "orange", "note": "blue"}


def source(html: str) -> tuple[str, dict[str, str]]:
    """Return the Typst source of a page, without what `page.typ` says, and its drawings by name."""
    written = _Page(tree(html))
    return written.text, written.drawings


class _Page(Words):
    def __init__(self, page: Element) -> None:
        (title,), (main,) = page.all("title"), page.all("main")
        super().__init__(main)
        self.turned = False
        self.is_paper = "paper" in main.classes
        self.blocks: dict[str, Callable[[Element], str]] = {
            "header": self.all,
            "section": self.section,
            **dict.fromkeys(("h1", "h2", "h3"), self.heading),
            **dict.fromkeys(("ul", "ol"), self.list),
            "div": self.div,
            "p": self.paragraph,
            "table": self.table,
            "figure": self.figure,
            "details": self.details,
            "pre": lambda one: f"#file([], {string(one.text)})\n",
            "footer": lambda one: f"#colophon[{self.words(one)}]\n",
        }
        is_paper = "true" if self.is_paper else "false"
        head = f"#show: report.with({string(flat(title.text))}, {is_paper})\n"
        self.text = head + self.all(main)

    def all(self, parent: Element) -> str:
        """Blocks of an element; words between them are a paragraph."""
        made = []
        for is_inline, some in groupby(parent.children, _is_inline):
            if is_inline:
                words = self.words(Element("p", {}, list(some)))
                made += [f"#par[{words}]\n"] if words else []
            else:
                made += [self.block(one) for one in some if isinstance(one, Element)]
        return self.anchor(parent) + "".join(made)

    def block(self, one: Element) -> str:
        if one.tag not in self.blocks:
            raise UnknownElement(f"<{one.tag}> in {flat(one.text)[:60]!r}")
        return self.blocks[one.tag](one)

    def section(self, one: Element) -> str:
        """A section, on pages of its own where a table is as wide as they are high."""
        self.turned = False
        made = self.all(one)
        return f"#wide[{made}]\n" if self.turned else made

    def heading(self, one: Element) -> str:
        level = int(one.tag[1])
        plain = ", numbering: none" if level == 1 or "plain" in one.classes else ""
        return f"#heading(level: {level}{plain})[{self.words(one)}]\n"

    def paragraph(self, one: Element) -> str:
        words = self.words(one)
        if not words:
            return ""
        made = f"#par[{look(one, words)}]"
        return f"#block(sticky: true)[{made}]\n" if "caption" in one.classes else f"{made}\n"

    def list(self, one: Element) -> str:
        items = [child for child in one.children if isinstance(child, Element)]
        if "findings" in one.classes:
            return "".join(
                f"#finding({_FINDINGS[item.classes[0]]})[{self.words(item)}]\n" for item in items
            )
        kind = "list" if one.tag == "ul" else "enum"
        return f"#{kind}({', '.join(f'[{self.words(item)}]' for item in items)})\n"

    def div(self, one: Element) -> str:
        classes = one.classes
        children = [child for child in one.children if isinstance(child, Element)]
        if "cards" in classes:
            cards = (
                ", ".join(
                    f"[{self.words(part)}]" for part in card.children if isinstance(part, Element)
                )
                for card in children
            )
            return f"#cards({', '.join(f'card({card})' for card in cards)})\n"
        if "pair" in classes:
            return self.pair(children)
        if "sign" in classes:
            return f"#signed({', '.join(f'[{self.words(child)}]' for child in children)})\n"
        if "equation" in classes:
            formula, number = children
            words = f"[{self.words(formula)}], [{self.words(number)}]"
            return f"{self.anchor(one)}#equation({words})\n"
        made = self.all(one)
        return f"#kept[{made}]\n" if {"keep", "group"} & set(classes) else made

    def pair(self, children: Sequence[Element]) -> str:
        """Figures and groups two in a row, all else as wide as the page."""
        made = []
        for is_narrow, some in groupby(children, _is_narrow):
            blocks = [self.block(one) for one in some]
            if is_narrow and len(blocks) > 1:
                made.append(f"#two({', '.join(f'[{one}]' for one in blocks)})\n")
            else:
                made += [f"#narrow[{one}]\n" if is_narrow else one for one in blocks]
        return "".join(made)

    def figure(self, one: Element) -> str:
        drawn = next(one.all("svg"))  # those after it are formulas of the caption
        (caption,) = one.all("figcaption")
        file, alt = self.drawn(drawn)
        made = f"#drawing({file}, {alt}, [{self.words(caption)}])"
        return f"#narrow[{made}]\n" if self.is_paper else f"{made}\n"

    def details(self, one: Element) -> str:
        (summary,), (pre,) = one.all("summary"), one.all("pre")
        return f"#file([{self.words(summary)}], {string(pre.text)})\n"

    def table(self, one: Element) -> str:
        rows = [
            [
                Cell(
                    words=look(cell, self.words(cell)),
                    lines=tuple(_lines(cell)),
                    kinds=frozenset(cell.classes),
                    n_columns=int(cell.attributes.get("colspan", "1")),
                )
                for cell in row.all("th", "td")
            ]
            for row in one.all("tr")
        ]
        n_heads = sum(len(list(head.all("tr"))) for head in one.all("thead"))
        looks = [frozenset(row.classes) for row in one.all("tr")]
        kinds = frozenset(one.classes)
        made, turned = laid_out(rows, looks, n_heads, kinds, is_paper=self.is_paper)
        self.turned = self.turned or turned
        return made


def _lines(cell: Element) -> Iterator[str]:
    """What is written in a cell, line by line."""
    line = ""
    for child in cell.children:
        if isinstance(child, str):
            line += child
        elif child.tag in {"br", "small"}:
            yield flat(line)
            line = child.text
        else:
            line += child.text
    yield flat(line)


def _is_inline(one: Element | str) -> bool:
    return isinstance(one, str) or one.tag in INLINE


def _is_narrow(one: Element) -> bool:
    return one.tag == "figure" or "group" in one.classes
