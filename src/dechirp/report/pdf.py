"""PDF output of pages, laid out by WeasyPrint with the style sheet that browsers print with."""

from pathlib import Path

import matplotlib as mpl

from dechirp.core.atomic_files import atomic_file
from dechirp.core.errors import InvalidSetting

_FACES = {
    "DejaVu Sans": ("DejaVuSans", "DejaVuSans-Bold", "DejaVuSans-Oblique"),
    "DejaVu Sans Mono": ("DejaVuSansMono", "DejaVuSansMono-Bold", "DejaVuSansMono-Oblique"),
    "STIX": ("STIXGeneral", "STIXGeneralBol", "STIXGeneralItalic"),
}
"""Files of matplotlib, the fonts of figures: regular, bold and italic."""


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
    from weasyprint import CSS, HTML
    from weasyprint.text.fonts import FontConfiguration
    from weasyprint.urls import URLFetcher

    fonts = FontConfiguration()
    styles = CSS(string=_font_style_sheet(), font_config=fonts)
    page = HTML(string=html, url_fetcher=URLFetcher(allowed_protocols=("data",)))
    # WeasyPrint has no type hints.
    pdf: bytes = page.write_pdf(stylesheets=[styles], font_config=fonts, pdf_tags=True)
    return pdf


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
