"""Notebooks: those of `examples/notebooks`, which the gate runs, and downloads of pages."""

import ast
import importlib
import re
import sys

import pytest

from guide.test_every_block_runs import DOCS, PAGES

pytest.importorskip("sphinx")  # comes with the group docs, as nbformat does
nbformat = pytest.importorskip("nbformat")
NOTEBOOKS = sorted((DOCS.parent / "examples" / "notebooks").glob("*.ipynb"))
PAGES_WITHOUT_CODE = {
    "benchmarks",
    "bibliography",
    "faults",
    "index",
    "old-and-new-words",
    "releasing",
    "supply",
    "witnesses",  # docs/figures, a part of another page
}


@pytest.fixture(scope="module")
def converter():
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        yield importlib.import_module("notebooks")
    finally:
        sys.path.remove(str(DOCS / "_ext"))


def python_code(notebook):
    """Return the code of a notebook, without shell commands and magics."""
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    lines = "\n".join(cell for cell in cells if not cell.startswith("%%")).splitlines()
    return "\n".join(
        line.replace("%", "pass  # %", 1) if line.lstrip().startswith("%") else line
        for line in lines
        if not line.lstrip().startswith("!")
    )


def test_five_notebooks_are_kept():
    names = {path.stem for path in NOTEBOOKS}

    assert names == {
        "first-radar",
        "four-phases",
        "own-recording",
        "cfar-comparison",
        "data-set-for-pytorch",
    }


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_kept_notebook_is_valid_links_to_itself_and_has_no_output(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)

    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells)
    ast.parse(python_code(notebook))
    for site in ("colab.research.google.com/github", "mybinder.org"):
        assert site in notebook.cells[0].source
    assert notebook.cells[0].source.count(f"examples/notebooks/{path.name}") == 2


def test_commands_of_kept_notebooks_run_with_python_of_kernel():
    """The command `dechirp` is not found if the environment of the kernel is not activated."""
    sources = [path.read_text(encoding="utf-8") for path in NOTEBOOKS]
    assert not [command for text in sources for command in re.findall(r"!dechirp.*|%%bash", text)]


def test_every_page_has_code_but_for_those_to_read(converter):
    notebooks = {page: converter.page_as_notebook(page) for page in PAGES}

    without_code = {
        page for page, notebook in notebooks.items() if not converter.has_code(notebook)
    }
    assert {page.stem for page in without_code} == PAGES_WITHOUT_CODE
    assert DOCS / "witnesses.md" not in without_code


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_becomes_notebook_with_all_its_code(page, converter):
    source = page.read_text(encoding="utf-8")
    notebook = converter.page_as_notebook(page)
    nbformat.validate(notebook)

    ast.parse(python_code(notebook))
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    n_named_settings = sum(cell.startswith("%%writefile") for cell in code)
    n_commands = sum(cell.startswith("%%bash") for cell in code)
    assert len(code) - n_named_settings - n_commands == source.count("```{code-cell}")
    assert n_commands == len(re.findall(r"```\{(?:command|family)\}", source))
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert not any("{code-cell}" in text or "{command}" in text for text in texts)


def test_command_and_settings_become_cells_that_run_in_order(tmp_path, converter):
    page = tmp_path / "page.md"
    page.write_text(
        "---\nfile_format: mystnb\n---\n# Title\n\nSee {cite:t}`rohling` {cite}`barton, kay`.\n\n"
        "```{settings}\n:name: short.yaml\nname: short\n```\n\n"
        "```{command}\n:returncode: 2\n:ellipsis: 0, -3\ndechirp run \\\n    short.yaml\n```\n",
        encoding="utf-8",
    )

    _, text, settings, command = converter.page_as_notebook(page).cells

    assert text.source == "# Title\n\nSee rohling (barton, kay)."
    assert settings.source == "%%writefile short.yaml\nname: short"
    assert command.source == "%%bash --no-raise-error\ndechirp run \\\n    short.yaml"
