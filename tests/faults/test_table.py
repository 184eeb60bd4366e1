"""`docs/faults.md` and its tests hold each other: a row for each test, a test for each row."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from dechirp.cli.main import build_app

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / "docs" / "faults.md"
NO_COMMANDS = {"any", "data set", "live stream", "Python"}


def _rows() -> list[tuple[str, str, str, str]]:
    """Fault, commands, what happens and tests of each row of the page."""
    rows, fault = [], ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        fault = line[3:] if line.startswith("## ") else fault
        if fault and line.startswith("| ") and not line.startswith(("| Command", "| ---")):
            commands, happens, tests = (cell.strip() for cell in line.strip("| ").split(" | "))
            rows.append((fault, commands, happens, tests))
    return rows


ROWS = _rows()


@cache
def _tests_in(file: Path) -> frozenset[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return frozenset(
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    )


def _named(tests: str) -> list[tuple[str, str]]:
    return re.findall(r"`([\w/]+\.py)::(\w+)`", tests)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[0]}, {row[1]}: {row[2][:40]}")
def test_a_row_names_its_commands_and_a_test_that_is_there(row):
    fault, commands, happens, tests = row

    assert fault
    assert happens.endswith(".")
    assert set(commands.split(", ")) <= {*build_app(), *NO_COMMANDS}
    assert _named(tests)
    for file, name in _named(tests):
        assert name in _tests_in(TESTS / file), f"{file} has no {name}"


def test_every_test_of_a_fault_has_its_row():
    named = {test for row in ROWS for test in _named(row[3])}
    there = {
        (f"faults/{file.name}", name)
        for file in (TESTS / "faults").glob("test_*.py")
        if file != Path(__file__)
        for name in _tests_in(file)
    }

    assert there <= named, f"without a row: {sorted(there - named)}"
    assert len(ROWS) == len(set(ROWS))
