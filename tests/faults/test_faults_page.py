"""Consistency of `docs/faults.md` with its tests: a row for each test, a test for each row."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from dechirp.cli.main import build_command_line_app

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / "docs" / "faults.md"
NO_COMMANDS = {"any", "data set", "live stream", "Python"}


def _read_rows() -> list[tuple[str, str, str, str]]:
    """Read fault, commands, outcome and tests of each row of the page."""
    rows, fault = [], ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        fault = line[3:] if line.startswith("## ") else fault
        if fault and line.startswith("| ") and not line.startswith(("| Command", "| ---")):
            commands, outcome, tests = (cell.strip() for cell in line.strip("| ").split(" | "))
            rows.append((fault, commands, outcome, tests))
    return rows


ROWS = _read_rows()


@cache
def _find_tests(file: Path) -> frozenset[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return frozenset(
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    )


def _find_test_ids(tests: str) -> list[tuple[str, str]]:
    return re.findall(r"`([\w/]+\.py)::(\w+)`", tests)


@cache
def _command_names() -> frozenset[str]:
    return frozenset(build_command_line_app())


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[0]}, {row[1]}: {row[2][:40]}")
def test_row_names_known_commands_and_existing_tests(row):
    fault, commands, outcome, tests = row

    assert fault
    assert outcome.endswith(".")
    assert set(commands.split(", ")) <= _command_names() | NO_COMMANDS
    assert _find_test_ids(tests)
    for file, name in _find_test_ids(tests):
        assert name in _find_tests(TESTS / file), f"{file} has no {name}"


def test_every_fault_test_has_a_row():
    listed_tests = {test for row in ROWS for test in _find_test_ids(row[3])}
    existing_tests = {
        (f"faults/{file.name}", name)
        for file in (TESTS / "faults").glob("test_*.py")
        if file != Path(__file__)
        for name in _find_tests(file)
    }

    assert existing_tests <= listed_tests, f"without a row: {sorted(existing_tests - listed_tests)}"
    assert len(ROWS) == len(set(ROWS))
