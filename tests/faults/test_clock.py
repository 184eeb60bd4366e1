"""Clocks that are wrong, or are set while something runs: only dates that are shown know of it."""

import ast
import itertools
import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import dechirp
import tiny_study
from dechirp.experiments.study.executors import workers_from_executor
from faults.conftest import there

SOURCES = sorted(Path(dechirp.__file__).parent.rglob("*.py"))


@pytest.fixture
def jumping(monkeypatch):
    """Set the clock by ten years, back and forth, each time that somebody looks."""
    now_s = time.time()
    jumps = itertools.cycle((0.0, 3e8, -3e8, -now_s))
    monkeypatch.setattr(time, "time", lambda: now_s + next(jumps))


def test_results_and_durations_of_a_run_do_not_depend_on_it(folder, call, jumping, monkeypatch):
    assert call("run", "small.yaml", "--out", "jumping", "--quiet")[0] == 0
    assert call("convert", "jumping/cube.zarr", "out.npz", "--quiet")[0] == 0
    monkeypatch.undo()
    os.chdir(folder)
    assert call("run", "small.yaml", "--out", "steady", "--quiet")[0] == 0

    for name in ("detections.csv", "detections.json", "scenario.yaml"):
        assert (folder / "jumping" / name).read_bytes() == (folder / "steady" / name).read_bytes()
    timing_s = json.loads((folder / "jumping" / "run.json").read_text())["timing_s"]
    assert all(0 <= seconds < 300 for seconds in timing_s.values())


def test_a_study_keeps_its_blocks_by_number_and_its_pace_by_a_steady_clock(tmp_path, jumping):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        said = tiny_study.run(tmp_path / "jumping", workers)
        tiny_study.run(tmp_path / "again", workers)

    assert tiny_study.fingerprint(tmp_path / "jumping") == tiny_study.fingerprint(
        tmp_path / "again"
    )
    assert all(0 <= one.seconds_left < 300 for one in said)


def test_files_from_before_any_calendar_are_read_and_written(folder, call):
    for name in ("small.yaml", "in.npz"):
        os.utime(name, (0, 0))

    assert call("run", "in.npz", "--out", "out", "--quiet")[0] == 0
    assert call("convert", "in.npz", "out.zarr", "--quiet")[0] == 0
    assert "out.zarr" in there(folder)


def _calls(path: Path) -> list[str]:
    return [
        ast.unparse(node)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    ]


def test_nothing_takes_a_duration_or_a_local_date_from_the_wall_clock():
    looks = [
        (path.name, call)
        for path in SOURCES
        for call in _calls(path)
        if call.startswith(("time.time(", "time.localtime(", "time.strftime("))
        or (".now(" in call and call.startswith("datetime") and "UTC" not in call)
        or call.startswith(("datetime.today(", "datetime.utcnow(", "date.today("))
    ]
    assert looks == []
