"""The bibliography has every source that a docstring rests on."""

import ast
import re
import sys
import unicodedata
from pathlib import Path

import pytest

import dechirp

pytest.importorskip("sphinx")
ROOT = Path(dechirp.__file__).parent
DOCS = Path(__file__).parents[2] / "docs"
JOURNALS = {"Sel", "Image", "Fourier", "Meteorology", "Infrared", "Oceanic"}
"""What follows a J. that is no first name."""


@pytest.fixture(scope="module")
def sources():
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        import sources
    finally:
        sys.path.pop(0)
    return sources


def cited() -> dict[str, str]:
    """What stands under References in docstrings, by file."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "References\n" in text else ():
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                _, _, below = (ast.get_docstring(node) or "").partition("\nReferences\n")
                if below:
                    name = f"{path.relative_to(ROOT)}:{getattr(node, 'name', '')}"
                    found[name] = " ".join(below.lstrip("-\n").split())
    return found


def plain(text: str) -> str:
    """Without accents."""
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def test_every_author_under_references_is_in_the_bibliography(sources):
    listed = (plain(text) for text in sources.read().values())
    known = JOURNALS | {name for text in listed for name in sources.surnames(text)}
    missing = {
        where: names
        for where, text in cited().items()
        if (names := set(sources.surnames(text)) - known)
    }

    assert missing == {}


def test_every_source_is_listed_once_under_a_subject(sources):
    page = (DOCS / "guide/bibliography.md").read_text(encoding="utf-8")
    listed = " ".join(re.findall(r"```{sources}\n(.*?)```", page, re.DOTALL)).split()

    assert sorted(listed) == sorted(sources.read())
