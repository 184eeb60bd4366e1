"""PDF output of pages, laid out by WeasyPrint with the style sheet that browsers print with."""

from copy import deepcopy
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import matplotlib as mpl

from dechirp.core.atomic_files import atomic_file
from dechirp.core.errors import InvalidSetting

_FACES = {
    "DejaVu Sans": ("DejaVuSans", "DejaVuSans-Bold", "DejaVuSans-Oblique"),
    "DejaVu Sans Mono": ("DejaVuSansMono", "DejaVuSansMono-Bold", "DejaVuSansMono-Oblique"),
    "STIX": ("STIXGeneral", "STIXGeneralBol", "STIXGeneralItalic"),
}
"""Files of matplotlib, the fonts of figures: regular, bold and italic."""


_MAX_COLUMNS = 16
"""Columns of a table on a landscape page: 17 mm each, 12 digits of 6 pt."""

_SMALL_FILL = 0.35
"""Share of the last page below which the text is set closer, to save that page."""

_CLOSE_SETTING = """@media print {
  @page { margin: 11mm 11mm 13mm }
  html, body { font-size: 8pt }
  body { line-height: 1.3 }
  h1 { font-size: 16pt }
  h2 { margin-top: 1rem; padding-top: .5rem }
  .pair.figures { gap: .6rem 1.4rem }
  table { font-size: 7.2pt }
  pre { font-size: 6.4pt }
}"""


def check_pdf_available() -> None:
    """Raise `InvalidSetting` if WeasyPrint cannot be used; call it before a long run."""
    try:
        import weasyprint  # noqa: F401
    except ModuleNotFoundError as error:
        raise _unavailable_error(
            f"the package {error.name or 'weasyprint'} is not installed",
            "run pip install 'dechirp[pdf]'",
        ) from None
    except Exception as error:
        message = str(error).partition("\n")[0] or type(error).__name__
        if isinstance(error, OSError) and "cannot load library" in message:
            raise _unavailable_error(
                f"weasyprint does not find the library Pango: {message}",
                "install it (apt install libpango-1.0-0 libpangoft2-1.0-0, brew install pango; on"
                " Windows as WeasyPrint's page of first steps says)",
            ) from None
        raise _unavailable_error(
            f"weasyprint cannot be imported: {message}",
            "run pip install --force-reinstall 'dechirp[pdf]'",
        ) from error


def _unavailable_error(value: str, fix: str) -> InvalidSetting:
    return InvalidSetting(
        "--pdf",
        value=value,
        expected="the extra pdf, and Pango",
        fix=f"{fix}; or leave out --pdf and print the .html file to PDF in a browser, which looks"
        " the same",
    )


def html_to_pdf(html: str) -> bytes:
    """Return the PDF of a page of this package; equal pages give equal PDFs.

    It opens no files but the fonts of matplotlib, and no network. System fonts are used only for
    letters that those lack.
    """
    document = _lay_out(html)
    if len(document.pages) > 1 and _filled_share(document.pages[-1]) < _SMALL_FILL:
        # Within the page: style sheets that are passed beside it have less weight.
        closer = _lay_out(html.replace("</style>", f"{_CLOSE_SETTING}</style>", 1))
        if len(closer.pages) < len(document.pages):
            document = closer
    # WeasyPrint has no type hints.
    pdf: bytes = document.write_pdf(pdf_tags=True)
    return pdf


def _lay_out(html: str) -> Any:
    """Return the document of WeasyPrint, with its pages."""
    from weasyprint import CSS, HTML
    from weasyprint.text.fonts import FontConfiguration
    from weasyprint.urls import URLFetcher

    fonts = FontConfiguration()
    styles = CSS(string=_font_style_sheet(), font_config=fonts)
    page = HTML(string=html, url_fetcher=URLFetcher(allowed_protocols=("data",)))
    _split_wide_tables(page.etree_element)
    return page.render(stylesheets=[styles], font_config=fonts)


def _filled_share(page: Any) -> float:
    """Return the share of the height of a page down to its lowest text or picture."""
    body = page._page_box.children[0]  # the others are margins, with the page number
    boxes = [box for box in body.descendants() if not getattr(box, "children", ())]
    bottoms = [box.position_y + box.height for box in boxes if isinstance(box.height, float | int)]
    return max(bottoms, default=0.0) / float(page.height)


def _split_wide_tables(root: Element) -> None:
    """Split tables of many columns into tables below one another that repeat the first column."""
    for parent in list(root.iter()):
        for index, table in reversed(list(enumerate(parent))):
            n_columns = max((len(row) for row in table.iter("tr")), default=0)
            has_spans = any("colspan" in cell.attrib for cell in table.iter("td"))
            if table.tag != "table" or has_spans or n_columns <= _MAX_COLUMNS:
                continue
            n_parts = -(-(n_columns - 1) // (_MAX_COLUMNS - 1))
            ends = [1 + (n_columns - 1) * part // n_parts for part in range(n_parts + 1)]
            parts = [deepcopy(table) for _ in range(n_parts)]
            for part, start, end in zip(parts, ends, ends[1:], strict=False):
                part.tail = None
                for row in part.iter("tr"):
                    row[:] = [row[0], *row[start:end]] if len(row) else []
            parts[-1].tail = table.tail
            parent[index : index + 1] = parts


def _font_style_sheet() -> str:
    """Return the style sheet that replaces system fonts by those of matplotlib."""
    folder = Path(mpl.get_data_path(), "fonts", "ttf").as_uri()
    looks = ("", "font-weight: bold;", "font-style: italic;")
    faces = [
        f'@font-face {{ font-family: "{family}"; {look} src: url("{folder}/{name}.ttf") }}'
        for family, names in _FACES.items()
        for name, look in zip(names, looks, strict=True)
    ]
    families = (
        ':root { --sans: "DejaVu Sans" !important; --mono: "DejaVu Sans Mono" !important; }'
        ' .paper { font-family: STIX, "DejaVu Sans" !important; }'
    )
    return "\n".join([*faces, families])


def write_or_remove_pdf(out: Path, html: str | None) -> None:
    """Write the PDF of a page, or remove an earlier one if `html` is None."""
    if html is None:
        out.unlink(missing_ok=True)
        return
    with atomic_file(out) as path:
        path.write_bytes(html_to_pdf(html))
