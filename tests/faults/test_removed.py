"""Folders and files that are removed while somebody works with them."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

import dechirp as dc
import tiny_study
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.experiments.study.executors import workers_from_executor
from faults.conftest import there


def test_the_place_for_results_is_made_again(folder, call, monkeypatch):
    assert call("run", "small.yaml", "--out", "a/out", "--quiet")[0] == 0
    first = there(folder / "a")
    from dechirp.report import page

    render = page.render_report

    def removes(*told, **named):
        shutil.rmtree("a")
        return render(*told, **named)

    monkeypatch.setattr(page, "render_report", removes)
    assert call("run", "small.yaml", "--out", "a/out", "--quiet")[0] == 0
    assert set(there(folder / "a")) == set(first)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere nobody can remove it")
@pytest.mark.parametrize("given_words", [("run",), ("run", "../small.yaml", "--out", "{}/out")])
def test_the_folder_one_is_in(given_words, folder, call, tmp_path, monkeypatch):
    (folder / "gone").mkdir()
    monkeypatch.chdir("gone")
    (folder / "gone").rmdir()

    status, _, said = call(*(word.format(folder) for word in given_words))

    assert status == 2
    assert "No such file or directory" in said or "working folder: removed" in said
    assert len(said.splitlines()) == 1
    monkeypatch.chdir(tmp_path)


def test_a_recording_while_its_frames_are_read(folder, call):
    assert call("convert", "small.yaml", "three.npz", "--frames", "3", "--quiet")[0] == 0
    frames = iter(dc.open("three.npz").frames())
    next(frames)
    (folder / "three.npz").unlink()

    with pytest.raises(RecordingError, match="has changed since it was opened"):
        list(frames)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere an open file cannot be removed")
def test_the_folder_of_a_study_that_runs(tmp_path):
    out = tmp_path / "study"

    def removes(said) -> None:
        shutil.rmtree(out, ignore_errors=True)

    with (
        ThreadPoolExecutor(1) as pool,
        workers_from_executor(pool) as workers,
        pytest.raises(DechirpError, match="removed or replaced while the study ran"),
    ):
        tiny_study.run(out, workers, progress=removes)
    assert not out.exists()
