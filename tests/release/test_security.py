"""Guarantees in SECURITY.md and their tests."""

import ast
import re

from release.pinned_requirements import ROOT


def test_every_guarantee_has_test():
    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    rows = [row for row in re.findall(r"^\| (.+) \|$", page, re.MULTILINE) if "|---" not in row]
    guarantees = [row for row in rows if row != "promise | test"]
    assert len(guarantees) > 20
    for row in guarantees:
        match = re.fullmatch(r"[^|]+ \| `(tests/[\w/]+\.py)::(test_\w+)`", row)
        assert match, row
        tree = ast.parse((ROOT / match[1]).read_text(encoding="utf-8"))
        assert match[2] in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, (
            row
        )


def test_stated_limits_equal_limits_of_server():
    from dechirp.studio.server import MAX_MESSAGE_BYTES, MAX_PAGES

    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    assert f"above {MAX_MESSAGE_BYTES // 2**20} MiB" in page
    assert f"more than {MAX_PAGES} pages" in page
