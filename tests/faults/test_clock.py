"""Wrong or changing clocks: results and durations do not depend on the wall clock."""

import ast
import itertools
import json
import os
import re
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import dechirp
import tiny_study
from dechirp.experiments.study.executors import workers_from_executor
from faults.conftest import read_folder
from nightly import nightly

SOURCES = sorted(Path(dechirp.__file__).parent.rglob("*.py"))


@pytest.fixture
def jumping_clock(monkeypatch):
    """Move the wall clock by ten years, back and forth, at each reading."""
    now_s = time.time()
    jumps = itertools.cycle((0.0, 3e8, -3e8, -now_s))
    monkeypatch.setattr(time, "time", lambda: now_s + next(jumps))


@nightly
def test_results_and_durations_of_run_do_not_depend_on_clock(
    folder, call, jumping_clock, monkeypatch
):
    assert call("run", "small.yaml", "--out", "jumping", "--quiet")[0] == 0
    assert call("convert", "jumping/cube.zarr", "out.npz", "--quiet")[0] == 0
    monkeypatch.undo()
    os.chdir(folder)
    assert call("run", "small.yaml", "--out", "steady", "--quiet")[0] == 0

    for name in ("detections.csv", "detections.json", "scenario.yaml"):
        assert (folder / "jumping" / name).read_bytes() == (folder / "steady" / name).read_bytes()
    timing_s = json.loads((folder / "jumping" / "run.json").read_text())["timing_s"]
    assert all(0 <= seconds < 300 for seconds in timing_s.values())


def test_study_result_and_time_left_do_not_depend_on_clock(tmp_path, jumping_clock):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        progress = tiny_study.run_tiny_study(tmp_path / "jumping", workers)
        tiny_study.run_tiny_study(tmp_path / "again", workers)

    assert tiny_study.ledger_digest(tmp_path / "jumping") == tiny_study.ledger_digest(
        tmp_path / "again"
    )
    assert all(0 <= step.seconds_left < 300 for step in progress)


@nightly
def test_files_dated_1970_are_read_and_converted(folder, call):
    for name in ("small.yaml", "in.npz"):
        os.utime(name, (0, 0))

    assert call("run", "in.npz", "--out", "out", "--quiet")[0] == 0
    assert call("convert", "in.npz", "out.zarr", "--quiet")[0] == 0
    assert "out.zarr" in read_folder(folder)


def _find_calls(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    if not re.search(r"^\s*(import|from)\b.*\b(date)?time\b", text, re.MULTILINE):
        return []
    return [ast.unparse(node) for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]


def test_source_takes_no_duration_or_local_date_from_wall_clock():
    clock_calls = [
        (path.name, call)
        for path in SOURCES
        for call in _find_calls(path)
        if call.startswith(("time.time(", "time.localtime(", "time.strftime("))
        or (".now(" in call and call.startswith("datetime") and "UTC" not in call)
        or call.startswith(("datetime.today(", "datetime.utcnow(", "date.today("))
    ]
    assert clock_calls == []
