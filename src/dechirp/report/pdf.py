"""A page as PDF, for paper and for those who file it: our own HTML, set by Typst."""

from collections.abc import Callable
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import matplotlib as mpl

from dechirp.core.errors import InvalidSetting
from dechirp.report.typst_source import source
from dechirp.store.whole import whole_file


def check_pdf() -> None:
    """Raise `InvalidSetting` if the extra is missing; to be asked before a long run."""
    if find_spec("typst") is None:
        raise InvalidSetting(
            "--pdf",
            got="asked for without typst, which sets the pages",
            need="asked for with the extra pdf installed",
            fix="Run pip install 'dechirp[pdf]'.",
        )


def pdf_of(html: str) -> bytes:
    """Return the PDF of a page of this package; the same page always gives the same PDF.

    It takes no font of the machine, no file and nothing from the network.

    Parameters
    ----------
    html : str
        What a `render` of this folder returns. Elements that its templates do not use are an
        `UnknownElement`.
    """
    import typst

    body, drawings = source(html)
    look = files("dechirp.report").joinpath("page.typ").read_text(encoding="utf-8")
    contents = {"main.typ": look + body, **drawings}
    # Files in memory: its types know of one file alone.
    compiled: Callable[..., bytes] = typst.compile
    return compiled(
        {name: text.encode() for name, text in contents.items()},
        font_paths=[str(Path(mpl.get_data_path(), "fonts", "ttf"))],  # those that figures name
        ignore_system_fonts=True,
    )


def write_pdf(out: Path, html: str | None) -> None:
    """Write the PDF of a page; without one remove that of an earlier page."""
    if html is None:
        out.unlink(missing_ok=True)
        return
    with whole_file(out) as made:
        made.write_bytes(pdf_of(html))
