"""Folders and files removed while a command uses them."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

import dechirp as dc
import tiny_study
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.experiments.study.executors import workers_from_executor
from faults.conftest import read_folder
from nightly import nightly


@nightly
def test_removed_results_folder_is_created_again(folder, call, monkeypatch):
    assert call("run", "small.yaml", "--out", "a/out", "--quiet")[0] == 0
    first_content = read_folder(folder / "a")
    from dechirp.report import page

    render = page.render_report

    def remove_and_render(*arguments, **options):
        shutil.rmtree("a")
        return render(*arguments, **options)

    monkeypatch.setattr(page, "render_report", remove_and_render)
    assert call("run", "small.yaml", "--out", "a/out", "--quiet")[0] == 0
    assert set(read_folder(folder / "a")) == set(first_content)


@pytest.mark.skipif(os.name != "posix", reason="Windows does not remove a working folder")
@pytest.mark.parametrize("arguments", [("run",), ("run", "../small.yaml", "--out", "{}/out")])
def test_removed_working_folder_is_reported_in_one_line(
    arguments, folder, call, tmp_path, monkeypatch
):
    (folder / "gone").mkdir()
    monkeypatch.chdir("gone")
    (folder / "gone").rmdir()

    status, _, errors = call(*(word.format(folder) for word in arguments))

    assert status == 2
    assert "No such file or directory" in errors or "working folder: removed" in errors
    assert len(errors.splitlines()) == 1
    monkeypatch.chdir(tmp_path)


def test_recording_removed_while_read_is_reported(folder, call):
    assert call("convert", "small.yaml", "three.npz", "--frames", "3", "--quiet")[0] == 0
    frames = iter(dc.open("three.npz").frames())
    next(frames)
    (folder / "three.npz").unlink()

    with pytest.raises(RecordingError, match="has changed since it was opened"):
        list(frames)


@pytest.mark.skipif(os.name != "posix", reason="Windows does not remove open files")
def test_removed_folder_of_running_study_ends_study(tmp_path):
    out = tmp_path / "study"

    def remove_folder(progress) -> None:
        shutil.rmtree(out, ignore_errors=True)

    with (
        ThreadPoolExecutor(1) as pool,
        workers_from_executor(pool) as workers,
        pytest.raises(DechirpError, match="removed or replaced while the study ran"),
    ):
        tiny_study.run_tiny_study(out, workers, progress=remove_folder)
    assert not out.exists()
