"""Imports in the README, the guide, the gallery and the examples: public names only."""

import ast
import json
import re
import textwrap
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

import dechirp
from test_api import NAMESPACES

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "guide").glob("*.md")),
]
SCRIPTS = sorted([*(ROOT / "docs" / "gallery").glob("*/*.py"), *(ROOT / "examples").rglob("*.py")])
NOTEBOOKS = sorted((ROOT / "examples").rglob("*.ipynb"))
PUBLIC_MODULES = {"dechirp", *(f"dechirp.{name}" for name in NAMESPACES)}
PUBLIC_NAMES = set(dechirp.__all__)


def read_python_code(file):
    """Return the Python code of a script, or of the cells of a page or a notebook."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        return text
    if file.suffix == ".ipynb":
        cells = [c["source"] for c in json.loads(text)["cells"] if c["cell_type"] == "code"]
        lines = "".join(f"{''.join(cell)}\n" for cell in cells).splitlines()
    else:
        cells = [
            textwrap.dedent(token.content)
            for token in MarkdownIt().parse(text)
            if token.type == "fence" and token.info.split()[-1:] == ["python"]
        ]
        lines = "\n".join(cells).splitlines()
    text = "\n".join(lines)
    text = re.sub(r"^:.*$", "", text, flags=re.MULTILINE)  # options of a cell
    return re.sub(r"^(\s*)[%!].*$", r"\1pass", text, flags=re.MULTILINE)  # commands of IPython


def test_commands_of_certificates_import_no_private_module():
    text = (ROOT / "docs" / "verification" / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"from dechirp\.[\w.]+ import", text) == []


def find_private_imports(code):
    """Return the imports from dechirp that the public interface does not contain."""
    private = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            imported = {alias.name for alias in node.names}
            is_public = all(n in PUBLIC_MODULES for n in imported if n.split(".")[0] == "dechirp")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "dechirp":
            names = {alias.name for alias in node.names}
            is_public = node.module in PUBLIC_MODULES
            is_public &= node.module != "dechirp" or names <= PUBLIC_NAMES
        else:
            continue
        if not is_public:
            private.append(ast.unparse(node))
    return private


@pytest.mark.parametrize("file", [*PAGES, *SCRIPTS, *NOTEBOOKS], ids=lambda file: file.stem)
def test_code_imports_public_modules_only(file):
    assert find_private_imports(read_python_code(file)) == []


def test_code_of_each_kind_of_file_is_read():
    for files in (PAGES, SCRIPTS, NOTEBOOKS):
        assert "import dechirp" in "".join(map(read_python_code, files))


@pytest.mark.parametrize(
    "code",
    [
        "from dechirp.core.units import to_decibels",
        "import dechirp.processing.maps",
        "from dechirp import processing",
        "if True:\n    import numpy, dechirp.report",
    ],
)
def test_private_import_is_found(code):
    assert len(find_private_imports(code)) == 1
