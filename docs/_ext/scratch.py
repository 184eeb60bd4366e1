"""Scratch folders of the pages, in which their commands, settings and code cells run.

Each contains a link to `examples` of the project. All are deleted after the build. Figures of cells
have the style of the gallery.
"""

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

from myst_nb.core.execute import inline
from sphinx.application import Sphinx

_EXAMPLES = Path(__file__).parents[2] / "examples"


def folder_of(app: Sphinx, page: str) -> Path:
    """Return the folder of a page, created at the first call."""
    folder = Path(app.scratch) / page.replace("/", "-")  # type: ignore[attr-defined]
    if not folder.exists():
        folder.mkdir()
        (folder / "examples").symlink_to(_EXAMPLES)
    return folder


def _open(app: Sphinx) -> None:
    # Created before Sphinx forks its reading processes, so that all share one folder.
    app.scratch = tempfile.mkdtemp(prefix="guide-")  # type: ignore[attr-defined]
    _style(Path(app.scratch) / "ipython")


def _style(folder: Path) -> None:
    """Set the style and sharp figures in each kernel before its first cell."""
    at_start = folder / "profile_default" / "startup"
    at_start.mkdir(parents=True)
    lines = [
        "import sys",
        f"sys.path.append({str(Path(__file__).parent)!r})",
        "import gallery_style",
        "from matplotlib_inline.backend_inline import set_matplotlib_formats",
        "gallery_style.reset({}, '')",
        "set_matplotlib_formats('retina')",
        "del sys, gallery_style, set_matplotlib_formats",
    ]
    (at_start / "style.py").write_text("\n".join(lines), encoding="utf-8")
    # A kernel warns about its unencrypted port, which is open on this machine only.
    quiet = "c.IPKernelApp.log_level = 40\n"
    (at_start.parent / "ipython_kernel_config.py").write_text(quiet, encoding="utf-8")
    os.environ["IPYTHONDIR"] = str(folder)


def _enter(app: Sphinx, page: str, _: list[str]) -> None:
    # MyST-NB creates a folder for the cells of each page, and deletes it after the page.
    inline.mkdtemp = lambda: str(folder_of(app, page))


def _clear(app: Sphinx, _: Exception | None) -> None:
    shutil.rmtree(app.scratch, ignore_errors=True)  # type: ignore[attr-defined]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension: create the folder before the pages are read, delete it at the end."""
    app.connect("builder-inited", _open)
    app.connect("source-read", _enter)
    app.connect("build-finished", _clear)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
