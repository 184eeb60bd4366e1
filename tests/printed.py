"""What every page keeps: its figures say what to see, and its PDF says all that it says."""

import re

from dechirp.report.html_tree import Element, parse_html
from dechirp.report.pdf import html_to_pdf


def captions(page: str) -> list[tuple[str, str]]:
    """Title and words of each figure."""
    made = []
    for figure in parse_html(page).descendants("figure"):
        (caption,) = figure.descendants("figcaption")
        title = next(caption.descendants("b"))
        made.append((title.text, caption.text.replace(title.text, "", 1)))
    return made


def check_captions(page: str) -> None:
    told = captions(page)
    assert told
    assert page.count("<figure") == len(told)
    for title, words in told:
        assert title.strip()
        # A name alone says nothing of what to see.
        assert len(words.split()) >= 5, (title, words)


def text_of(pdf: bytes) -> str:
    """All words of a PDF, without spaces: lines and columns are not those of the page."""
    import pypdfium2

    pages = pypdfium2.PdfDocument(pdf)
    texts = (one.get_textpage().get_text_range() for one in pages)
    # What begins on one page may end on the next, with the number of the page between.
    return squeezed("".join(re.sub(r"\s*\d+ / \d+\s*$|^\s*\d+ / \d+\s*", "", of) for of in texts))


def check_pdf(page: str) -> bytes:
    """The PDF of a page says all that the page says."""
    made = html_to_pdf(page)
    said, read = text_of(made), parse_html(page)
    for kind in ("h1", "h2", "h3", "figcaption", "th", "td", "p", "li", "pre"):
        for one in read.descendants(kind):
            for part in _parts(one):
                assert squeezed(part) in said, (kind, part)
    return made


def _parts(one: Element) -> list[str]:
    """What is written in an element, apart from formulas and what stands on lines of its own."""
    made = [""]
    for child in one.children:
        if isinstance(child, str):
            made[-1] += child
        elif child.tag in {"svg", "br", "small", "code", "sup", "div"}:
            made += [*_parts(child), ""]
        else:
            first, *others = _parts(child)
            made[-1] += first
            made += others
    return made


def squeezed(text: str) -> str:
    """Without what a PDF does not keep: spaces, and where lines end."""
    # Dashes too: at the end of a line a PDF does not say which it is.
    return re.sub(r"[\s\u200b\u00ad\ufffe\x00-\x1f\N{EN DASH}-]+", "", text)
