"""Notebooks of the guide's pages, which each page with code links at its end.

Texts become text cells, `code-cell` code, `command` and `family` cells of bash, and `settings` with
a name a cell that writes the file. Other directives and roles keep their text, citations their
keys.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from sphinx.application import Sphinx

_FENCE = re.compile(r"^(`{3,}|:{3,}) *\{([\w-]+)\} *(.*?)\n(.*?)^\1 *$", re.MULTILINE | re.DOTALL)
_OPTIONS = re.compile(r"(?:^:([\w-]+): *(.*)\n)", re.MULTILINE)
_FRONT_MATTER = re.compile(r"\A---\n.*?^---\n", re.MULTILINE | re.DOTALL)
_CITATION = re.compile(r"\{cite\}`(.+?)`")
_ROLE = re.compile(r"\{[\w:-]+\}`(.+?)`")
_FOLDER = "_notebooks"
_FIRST_CELL = (
    "This notebook is a page of the guide of dechirp. Its commands and files need the command "
    "`dechirp`, and the folder `examples` of the project beside it."
)


def page_as_notebook(page: Path) -> nbformat.NotebookNode:
    """Convert a page to a notebook without outputs."""
    source = _FRONT_MATTER.sub("", page.read_text(encoding="utf-8"))
    cells = [new_markdown_cell(_FIRST_CELL), *_iter_cells(source)]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"  # equal in each build
    kernel = {"name": "python3", "language": "python", "display_name": "Python 3"}
    return new_notebook(cells=cells, metadata={"kernelspec": kernel})


def has_code(notebook: nbformat.NotebookNode) -> bool:
    """Return whether a notebook has a cell that runs; others are not offered."""
    return any(cell.cell_type == "code" for cell in notebook.cells)


def _iter_cells(source: str) -> Iterator[nbformat.NotebookNode]:
    end = 0
    for fence in _FENCE.finditer(source):
        yield from _iter_text_cell(source[end : fence.start()])
        _, directive, argument, content = fence.groups()
        options = dict(_OPTIONS.findall(content))
        yield from _iter_directive_cell(
            directive, argument, options, _OPTIONS.sub("", content).strip("\n")
        )
        end = fence.end()
    yield from _iter_text_cell(source[end:])


def _iter_text_cell(text: str) -> Iterator[nbformat.NotebookNode]:
    if text.strip():
        text = _CITATION.sub(r"(\1)", text)
        yield new_markdown_cell(_ROLE.sub(r"\1", text).strip("\n"))


def _iter_directive_cell(
    directive: str, argument: str, options: dict[str, str], content: str
) -> Iterator[nbformat.NotebookNode]:
    if directive == "code-cell":
        yield new_code_cell(content)
    elif directive == "command":
        fails = " --no-raise-error" if options.get("returncode", "0") != "0" else ""
        yield new_code_cell(f"%%bash{fails}\n{options.get('ran', content)}")
    elif directive == "family":
        yield new_code_cell(f"%%bash\ndechirp list {argument}")
    elif directive == "settings" and "name" in options:
        yield new_code_cell(f"%%writefile {options['name']}\n{content}")
    elif directive == "settings":
        yield new_markdown_cell(f"```yaml\n{content}\n```")
    else:
        yield from _iter_text_cell(f"{argument}\n\n{content}")


def _link_notebook(
    app: Sphinx, page: str, _template: str, context: dict[str, Any], _doctree: object
) -> None:
    path = Path(app.env.doc2path(page))
    if app.builder.format != "html" or path.suffix != ".md" or not path.is_file():
        return
    notebook = page_as_notebook(path)
    if not has_code(notebook):
        return
    file = Path(app.outdir, _FOLDER, f"{page}.ipynb")
    file.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, file)
    context["notebook"] = f"{_FOLDER}/{page}.ipynb"


def setup(app: Sphinx) -> dict[str, Any]:
    """Write a notebook beside each page with code."""
    app.connect("html-page-context", _link_notebook)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
