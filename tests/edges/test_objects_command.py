"""`dechirp run --objects`: object lists of a run in several formats, and errors."""

import json
import subprocess
import sys

import pytest

import dechirp as dc
from dechirp.cli.main import main
from nightly import nightly

pytestmark = pytest.mark.usefixtures("without_figures")


SMALL_SETTINGS = ["--set", "n_frames=2", "--set", "radar.frame.n_chirps=32"]


def run_cli(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_info:
        main(["run", *arguments])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_run_writes_object_list_in_each_requested_format(tmp_path, capsys):
    files = [tmp_path / name for name in ("list.osi", "list.ply")]
    options = [word for file in files for word in ("--objects", str(file))]
    status, output, _ = run_cli(
        capsys, "--out", str(tmp_path / "run"), "--json", *SMALL_SETTINGS, *options
    )
    document = json.loads(output)

    assert status == 0
    for file in files:
        assert dc.object_lists.read_objects(file).sizes["object"] == len(document["detections"]) > 0
        assert document["files"][file.name] == str(file)
    # A single antenna measures no direction, so object positions are unknown.
    assert any("without azimuth" in finding["value"] for finding in document["findings"])


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("list.txt", "with the suffix .txt"),
        ("no folder/list.csv", "not writable"),
        ("list.blf", "pip install 'dechirp[io]'"),
    ],
)
def test_rejects_unwritable_object_list_before_run(tmp_path, capsys, monkeypatch, file, message):
    monkeypatch.setitem(sys.modules, "cantools", None)
    status, _, err = run_cli(
        capsys, "--out", str(tmp_path / "run"), "--objects", str(tmp_path / file)
    )

    assert status == 2 and message in err and "--objects: " in err and "Traceback" not in err
    assert not any(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_results_are_kept_when_writing_object_list_fails(tmp_path, capsys, monkeypatch):
    def fail_on_list(objects, path, **coding):
        if path != file:
            return  # check before the run
        raise dc.InvalidSetting("path", value="full", expected="a disk with room", fix="Make room.")

    out, file = tmp_path / "run", tmp_path / "list.csv"
    monkeypatch.setattr("dechirp.results.object_lists.files.write_objects", fail_on_list)
    status, _, err = run_cli(capsys, "--out", str(out), "--objects", str(file), *SMALL_SETTINGS)

    assert status == 2 and "a disk with room" in err
    assert (out / "run.json").exists() and not file.exists()


@nightly
def test_command_that_writes_parquet_prints_no_objects_that_remain(tmp_path):
    pytest.importorskip("duckdb")
    source = "from dechirp.cli.main import main; import sys; main(sys.argv[1:])"
    options = ["run", "--out", str(tmp_path / "out"), "--objects", str(tmp_path / "list.parquet")]

    process = subprocess.run(
        [sys.executable, "-c", source, *options], capture_output=True, text=True, check=True
    )

    assert "leaked" not in process.stderr
