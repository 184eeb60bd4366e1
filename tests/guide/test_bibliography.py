"""Bibliography of the guide: authors cited in docstrings, and duplicates."""

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
"""Words after "J." that are part of a journal title."""


@pytest.fixture(scope="module")
def sources():
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        import sources
    finally:
        sys.path.pop(0)
    return sources


def read_citations() -> dict[str, str]:
    """Read the References sections of docstrings, by file and object."""
    citations = {}
    for path in sorted(ROOT.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "References\n" in text else ():
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                _, _, references = (ast.get_docstring(node) or "").partition("\nReferences\n")
                if references:
                    name = f"{path.relative_to(ROOT)}:{getattr(node, 'name', '')}"
                    citations[name] = " ".join(references.lstrip("-\n").split())
    return citations


def remove_accents(text: str) -> str:
    """Remove accents from a text."""
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def test_cited_authors_are_in_bibliography(sources):
    listed = (remove_accents(text) for text in sources.read().values())
    known_names = JOURNALS | {name for text in listed for name in sources.surnames(text)}
    missing = {
        where: names
        for where, text in read_citations().items()
        if (names := set(sources.surnames(text)) - known_names)
    }

    assert missing == {}


def test_each_source_is_listed_once(sources):
    page = (DOCS / "guide/bibliography.md").read_text(encoding="utf-8")
    listed = " ".join(re.findall(r"```{sources}\n(.*?)```", page, re.DOTALL)).split()

    assert sorted(listed) == sorted(sources.read())
