"""Checks of report pages: captions of figures, and completeness of the PDF."""

import re

import pytest

from dechirp.report.pdf import html_to_pdf
from html_tree import Element, parse_html


def figure_captions(page: str) -> list[tuple[str, str]]:
    """Return the title and the caption of each figure."""
    found_captions = []
    for figure in parse_html(page).descendants("figure"):
        (caption,) = figure.descendants("figcaption")
        title = next(caption.descendants("b"))
        found_captions.append((title.text, caption.text.replace(title.text, "", 1)))
    return found_captions


def check_captions(page: str) -> None:
    page_captions = figure_captions(page)
    assert page_captions
    assert page.count("<figure") == len(page_captions)
    for title, text in page_captions:
        assert title.strip()
        # A caption of fewer than five words cannot describe a figure.
        assert len(text.split()) >= 5, (title, text)


def extract_pdf_text(pdf: bytes) -> str:
    """Return the text of a PDF without spaces, since its lines differ from those of the page."""
    import pypdfium2

    pages = pypdfium2.PdfDocument(pdf)
    texts = (page.get_textpage().get_text_range() for page in pages)
    # A paragraph may continue on the next page, with the page number in between.
    return remove_spaces_and_dashes(
        "".join(re.sub(r"\s*\d+ / \d+\s*$|^\s*\d+ / \d+\s*", "", text) for text in texts)
    )


def skip_without_pdf() -> None:
    """Skip a test where WeasyPrint, or the library Pango that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        pytest.skip(f"no PDF: {error}")


def check_pdf_contains_page_text(page: str, pdf: bytes | None = None) -> bytes:
    """Check that the PDF of a page contains all of its text; by default convert the page.

    Folded figures, which a reader opens on demand, are left out.
    """
    skip_without_pdf()
    pdf = html_to_pdf(page) if pdf is None else pdf
    pdf_text = extract_pdf_text(pdf)
    tree = parse_html(re.sub(r'<details class="figures">.*?</details>', "", page, flags=re.S))
    for kind in ("h1", "h2", "h3", "figcaption", "th", "td", "p", "li", "pre"):
        for element in tree.descendants(kind):
            for part in _text_parts(element):
                assert remove_spaces_and_dashes(part) in pdf_text, (kind, part)
    return pdf


def _text_parts(element: Element) -> list[str]:
    """Return the text of an element, split at formulas and at children on separate lines."""
    parts = [""]
    for child in element.children:
        if isinstance(child, str):
            parts[-1] += child
        elif child.tag in {"svg", "br", "small", "code", "sup", "div"}:
            parts += [*_text_parts(child), ""]
        else:
            first, *others = _text_parts(child)
            parts[-1] += first
            parts += others
    return parts


def remove_spaces_and_dashes(text: str) -> str:
    """Remove the characters that a PDF does not preserve: spaces and line ends."""
    # Dashes too: at the end of a line, a PDF does not distinguish hyphens from dashes. The bullets
    # of lists follow the text of their page.
    return re.sub(r"[\s\u200b\u00ad\ufffe\x00-\x1f\N{HYPHEN}\N{EN DASH}\N{BULLET}-]+", "", text)
