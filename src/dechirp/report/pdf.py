"""PDF output of pages, set by Typst."""

from collections.abc import Callable
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import matplotlib as mpl

from dechirp.core.atomic_files import atomic_file
from dechirp.core.errors import InvalidSetting
from dechirp.report.typst_source import html_to_typst


def check_typst_installed() -> None:
    """Raise `InvalidSetting` if the extra `pdf` is missing; call it before a long run."""
    if find_spec("typst") is None:
        raise InvalidSetting(
            "--pdf",
            value="the package typst is not installed",
            expected="the extra pdf",
            fix="run pip install 'dechirp[pdf]'",
        )


def html_to_pdf(html: str) -> bytes:
    """Return the PDF of a page of this package; equal pages give equal PDFs.

    It uses no system fonts, no files and no network.

    Parameters
    ----------
    html : str
        Result of a render function of this folder. Elements that its templates do not use raise
        `UnknownElementError`.
    """
    import typst

    body, drawings = html_to_typst(html)
    look = files("dechirp.report").joinpath("page.typ").read_text(encoding="utf-8")
    contents = {"main.typ": look + body, **drawings}
    # The type hints of typst do not cover several files in memory.
    compiled: Callable[..., bytes] = typst.compile
    return compiled(
        {name: text.encode() for name, text in contents.items()},
        font_paths=[str(Path(mpl.get_data_path(), "fonts", "ttf"))],  # fonts of the figures
        ignore_system_fonts=True,
    )


def write_or_remove_pdf(out: Path, html: str | None) -> None:
    """Write the PDF of a page, or remove an earlier one if `html` is None."""
    if html is None:
        out.unlink(missing_ok=True)
        return
    with atomic_file(out) as path:
        path.write_bytes(html_to_pdf(html))
