"""Bibliography of the guide: authors cited in docstrings, subjects, and the reference report."""

import ast
import re
import unicodedata
from pathlib import Path

import pytest

import dechirp
from dechirp.certificate.paper import REFERENCES

database = pytest.importorskip("pybtex.database")
ROOT = Path(dechirp.__file__).parent
DOCS = Path(__file__).parents[2] / "docs"
JOURNALS = {"Sel", "Image", "Fourier", "Meteorology", "Infrared", "Oceanic"}
"""Words after "J." that are part of a journal title."""


AUTHOR = re.compile(r"\b(?:[A-Z]\.[ -]?)+(?:McK\. )?((?:Van )?[A-Z][\w'-]+)")
SOURCES = database.parse_file(DOCS / "references.bib").entries


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


def surnames(source) -> list[str]:
    """Return the surnames of the authors of a source, without accents."""
    people = source.persons["author"]
    return [remove_accents(" ".join(person.prelast_names + person.last_names)) for person in people]


def test_cited_authors_are_in_bibliography():
    known_names = JOURNALS | {name for source in SOURCES.values() for name in surnames(source)}
    missing = {
        where: names
        for where, text in read_citations().items()
        if (names := set(AUTHOR.findall(text)) - known_names)
    }

    assert missing == {}


def test_each_source_has_a_subject_that_the_page_lists():
    page = (DOCS / "guide/bibliography.md").read_text(encoding="utf-8")
    listed = re.findall(r'```{bibliography}\n:filter: keywords == "(\w+)"\n```', page)

    assert listed.count("detection") == 1
    assert sorted(listed) == sorted({source.fields["keywords"] for source in SOURCES.values()})


@pytest.mark.parametrize("key", REFERENCES)
def test_bibliography_agrees_with_reference_report(key):
    source, text = SOURCES[key], remove_accents(REFERENCES[key])

    assert AUTHOR.findall(text) == surnames(source)
    values = {
        name: re.sub(r"[{}\\]", "", value).replace("--", "-")
        for name, value in source.fields.items()
        if name != "keywords"
    }
    for name, value in values.items():
        parts = value.split(": ") if name == "title" else [value]
        assert all(part in text for part in parts), name
