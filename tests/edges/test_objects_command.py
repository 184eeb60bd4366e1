"""`dechirp run --objects`: the object list of a run beside its results."""

import json
import sys

import pytest

import dechirp as dc
from dechirp.cli.main import main

SMALL = ["--set", "n_frames=2", "--set", "radar.frame.n_chirps=32"]


def call(capsys, *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["run", *words])
    printed = capsys.readouterr()
    return int(ended.value.code or 0), printed.out, printed.err


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_a_run_writes_its_list_in_each_format_that_was_asked_for(tmp_path, capsys):
    files = [tmp_path / name for name in ("list.osi", "list.ply")]
    wanted = [word for file in files for word in ("--objects", str(file))]
    status, printed, _ = call(capsys, "--out", str(tmp_path / "run"), "--json", *SMALL, *wanted)
    told = json.loads(printed)

    assert status == 0
    for file in files:
        assert dc.object_lists.read_objects(file).sizes["object"] == len(told["detections"]) > 0
        assert told["files"][file.name] == str(file)
    # One antenna tells no direction, so nobody can say where the objects are.
    assert any("without azimuth" in finding["value"] for finding in told["findings"])


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("list.txt", "with the suffix .txt"),
        ("no folder/list.csv", "not writable"),
        ("list.blf", "pip install 'dechirp[io]'"),
    ],
)
def test_a_list_that_cannot_be_written_is_said_before_the_run(
    tmp_path, capsys, monkeypatch, file, says
):
    monkeypatch.setitem(sys.modules, "cantools", None)
    status, _, told = call(
        capsys, "--out", str(tmp_path / "run"), "--objects", str(tmp_path / file)
    )

    assert status == 2 and says in told and "--objects: " in told and "Traceback" not in told
    assert not any(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_the_results_are_kept_where_the_list_cannot_be_written_in_the_end(
    tmp_path, capsys, monkeypatch
):
    def full(objects, path):
        if path != file:
            return  # what is tried before the run
        raise dc.InvalidSetting("path", value="full", expected="a disk with room", fix="Make room.")

    out, file = tmp_path / "run", tmp_path / "list.csv"
    monkeypatch.setattr("dechirp.results.object_lists.files.write_objects", full)
    status, _, told = call(capsys, "--out", str(out), "--objects", str(file), *SMALL)

    assert status == 2 and "a disk with room" in told
    assert (out / "run.json").exists() and not file.exists()
