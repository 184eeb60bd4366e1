"""Members of families in `dechirp list`, in settings and in the guide."""

import re
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

import dechirp as dc
from dechirp.cli.commands.list import FamilyName, family_base_classes

DOCS = Path(dc.__file__).parents[2] / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)


@cache
def read_pages() -> str:
    return "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


def is_documented(kind: str) -> bool:
    """Return whether a page names the kind as code."""
    name = re.escape(kind)
    return re.search(rf"`{name}`|kind: {name}\b", read_pages()) is not None


def test_list_command_covers_every_family():
    assert get_args(FamilyName) == tuple(family_base_classes())


@pytest.mark.parametrize("family", family_base_classes())
def test_guide_documents_every_member(family):
    own_kinds = [
        kind
        for kind, member in family_base_classes()[family].members().items()
        if member.__module__.startswith("dechirp.")
    ]
    assert [kind for kind in own_kinds if not is_documented(kind)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_kinds_used_on_page_exist(page):
    text = page.read_text(encoding="utf-8")
    known_kinds = {kind for base in family_base_classes().values() for kind in base.members()}
    # Pages on adding a member show the file that has the name of the kind.
    example_kinds = {name.replace("_", "-") for name in re.findall(r"\b(\w+)\.py\b", text)}
    used_kinds = set(re.findall(r"\bkind: ([a-z][a-z0-9_-]*)\b", text))

    assert used_kinds - known_kinds - example_kinds == set()
