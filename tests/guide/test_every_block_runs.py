"""Executed blocks of the guide: the build runs every block that contains code.

Only the README may contain other code, in indented blocks: its commands need recordings, and
other sites display it without running it.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

DOCS = Path(__file__).parents[2] / "docs"
# Excluded: pages generated from Python, and certificates.
PAGES = sorted(
    page
    for page in DOCS.rglob("*.md")
    if not {"_build", "api", "gallery_built", "verification"} & set(page.relative_to(DOCS).parts)
)

EXECUTED_KINDS = {"{command}", "{code-cell}", "{settings}"}
INCLUDED_KINDS = {"{include}", "{literalinclude}"}
"""Directives that include project files, which other tests run or read."""
KINDS_WITHOUT_CODE = {
    "text",
    "{figure}",
    "{image}",
    "{math}",
    "{bibliography}",
    "{family}",
    "{toctree}",
    "{list-table}",
}
NESTED_KINDS = {
    "{note}",
    "{tip}",
    "{warning}",
    "{admonition}",
    "{dropdown}",
    "{tab-set}",
    "{tab-item}",
}
"""Directives whose content is parsed like a page."""

CODE_PATTERN = re.compile(
    r"^\s*(\$ |>>> |dechirp |python |import \w|from \w+ import )", re.MULTILINE
)
OPTION = re.compile(r"^:(\w+): *(.*)$", re.MULTILINE)


def iter_blocks(text: str) -> Iterator[tuple[str, str, int]]:
    """Iterate over kind, content and line of every code block or directive."""
    for token in MarkdownIt().parse(text):
        first = token.map[0] + 1 if token.map else 0
        if token.type == "code_block":
            yield "indented", token.content, first
        elif token.type == "fence":
            kind = token.info.split()[0] if token.info.strip() else ""
            if kind in NESTED_KINDS:
                yield from (
                    (*block, first + offset) for *block, offset in iter_blocks(token.content)
                )
            else:
                yield kind, token.content, first


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_page_blocks_are_executed_or_contain_no_code(page):
    for kind, content, line in iter_blocks(page.read_text(encoding="utf-8")):
        assert kind in EXECUTED_KINDS | INCLUDED_KINDS | KINDS_WITHOUT_CODE, (
            f"line {line}: block of kind {kind!r}"
        )
        if kind == "text":
            assert not CODE_PATTERN.search(content), f"line {line}: code in a text block"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_substituted_command_runs_shown_command(page):
    for kind, content, line in iter_blocks(page.read_text(encoding="utf-8")):
        assert "skip-execution" not in content, f"line {line}"
        options = dict(OPTION.findall(content)) if kind == "{command}" else {}
        if "ran" in options:
            command_lines = [row for row in content.splitlines() if not OPTION.match(row)]
            words = [word for word in " ".join(command_lines).split() if word[:1] != "#"]
            assert words[0] in options["ran"].split(), f"line {line}: {options['ran']}"
