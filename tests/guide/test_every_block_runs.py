"""The guide shows nothing that is not run: what is wrong in it does not build.

The README alone may show more, in indented blocks: it has commands for recordings that one must
have, and a copy of it is shown where nothing is run.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

DOCS = Path(__file__).parents[2] / "docs"
# Built from Python, or of the long certificates.
PAGES = sorted(
    page
    for page in DOCS.rglob("*.md")
    if not {"_build", "api", "gallery_built", "verification"} & set(page.relative_to(DOCS).parts)
)

RUN = {"{command}", "{code-cell}", "{settings}"}
INCLUDED = {"{literalinclude}"}
"""Files of the project, which other tests run or read."""
HOLD_NO_CODE = {
    "text",
    "{figure}",
    "{image}",
    "{math}",
    "{sources}",
    "{family}",
    "{toctree}",
    "{list-table}",
}
HOLD_PAGES = {
    "{note}",
    "{tip}",
    "{warning}",
    "{admonition}",
    "{dropdown}",
    "{tab-set}",
    "{tab-item}",
}
"""Their content is read as a page is."""

LOOKS_RUN = re.compile(r"^\s*(\$ |>>> |dechirp |python |import \w|from \w+ import )", re.MULTILINE)
OPTION = re.compile(r"^:(\w+): *(.*)$", re.MULTILINE)


def blocks(text: str) -> Iterator[tuple[str, str, int]]:
    """Kind, content and line of every block of code or directive."""
    for token in MarkdownIt().parse(text):
        first = token.map[0] + 1 if token.map else 0
        if token.type == "code_block":
            yield "indented", token.content, first
        elif token.type == "fence":
            kind = token.info.split()[0] if token.info.strip() else ""
            if kind in HOLD_PAGES:
                yield from ((*one, first + at) for *one, at in blocks(token.content))
            else:
                yield kind, token.content, first


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_every_block_of_a_page_is_run_or_is_no_code(page):
    for kind, content, line in blocks(page.read_text(encoding="utf-8")):
        assert kind in RUN | INCLUDED | HOLD_NO_CODE, f"line {line}: a block of the kind {kind!r}"
        if kind == "text":
            assert not LOOKS_RUN.search(content), f"line {line}: code that is shown as text"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_what_is_run_in_place_of_a_command_is_the_same_command(page):
    for kind, content, line in blocks(page.read_text(encoding="utf-8")):
        assert "skip-execution" not in content, f"line {line}"
        options = dict(OPTION.findall(content)) if kind == "{command}" else {}
        if "ran" in options:
            shown = [one for one in content.splitlines() if not OPTION.match(one)]
            typed = [word for word in " ".join(shown).split() if word[:1] != "#"]
            assert typed[0] in options["ran"].split(), f"line {line}: {options['ran']}"
