"""What SECURITY.md promises is what tests hold."""

import ast
import re

from release.pinned import ROOT


def test_every_promise_has_its_test():
    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    rows = [row for row in re.findall(r"^\| (.+) \|$", page, re.MULTILINE) if "|---" not in row]
    promises = [row for row in rows if row != "promise | test"]
    assert len(promises) > 20
    for row in promises:
        told = re.fullmatch(r"[^|]+ \| `(tests/[\w/]+\.py)::(test_\w+)`", row)
        assert told, row
        tree = ast.parse((ROOT / told[1]).read_text(encoding="utf-8"))
        assert told[2] in {one.name for one in tree.body if isinstance(one, ast.FunctionDef)}, row


def test_sizes_that_are_promised_are_those_of_the_server():
    from dechirp.studio.server import MAX_MESSAGE_BYTES, MAX_PAGES

    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    assert f"above {MAX_MESSAGE_BYTES // 2**20} MiB" in page
    assert f"more than {MAX_PAGES} pages" in page
