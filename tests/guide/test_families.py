"""What `dechirp list` shows, what settings choose, and what the guide tells are the same."""

import re
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

import dechirp as dc
from dechirp.cli.commands.list import FamilyName, base_classes

DOCS = Path(dc.__file__).parents[2] / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)


@cache
def texts() -> str:
    return "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


def is_told(kind: str) -> bool:
    """Whether a page names it as code; a study file may write a score with underscores."""
    names = "|".join(map(re.escape, {kind, kind.replace("-", "_")}))
    return re.search(rf"`({names})`|kind: ({names})\b", texts()) is not None


def test_the_command_line_names_every_family():
    assert get_args(FamilyName) == tuple(base_classes())


@pytest.mark.parametrize("family", base_classes())
def test_the_guide_tells_of_every_member(family):
    own = [
        kind
        for kind, member in base_classes()[family].members().items()
        if member.__module__.startswith("dechirp.")
    ]
    assert [kind for kind in own if not is_told(kind)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_every_kind_that_a_page_chooses_exists(page):
    text = page.read_text(encoding="utf-8")
    known = {kind for base in base_classes().values() for kind in base.members()}
    known |= {kind.replace("-", "_") for kind in base_classes()["score"].members()}
    # A page on adding a member shows the file that the kind is called after.
    added = {name.replace("_", "-") for name in re.findall(r"\b(\w+)\.py\b", text)}
    chosen = set(re.findall(r"\bkind: ([a-z][a-z0-9_-]*)\b", text))

    assert chosen - known - added == set()
