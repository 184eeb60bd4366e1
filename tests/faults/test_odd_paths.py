"""Unusual file names: spaces, Unicode, line breaks, invalid UTF-8, signs and 255 bytes."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.results.data_set import open_data_set_groups
from dechirp.results.parquet import read_parquet
from faults.conftest import command_arguments
from nightly import nightly, nightly_except

NAMES = {
    "spaces": b"two  spaces ",
    "Unicode": "Straße 東京 🚗".encode(),
    "line break": b"two\nlines",
    "not UTF-8": b"caf\xe9",
    "signs": b"a#b%20c?d&e=f;'\"$(g)",
    "255 bytes": b"L" * 255,
}
each_odd_name = pytest.mark.parametrize("kind", NAMES)
one_odd_name = pytest.mark.parametrize("kind", nightly_except(["not UTF-8"], NAMES))


@pytest.fixture
def odd_folder(kind, folder, monkeypatch) -> Path:
    """Change to a folder with an odd name and copies of the input files."""
    odd_path = folder / os.fsdecode(NAMES[kind])
    try:
        odd_path.mkdir()
    except OSError:
        pytest.skip("the file system does not allow this name")
    for name in ("small.yaml", "study.yaml", "in.npz", "still.npz"):
        shutil.copy(folder / name, odd_path)
    monkeypatch.chdir(odd_path)
    return odd_path


@one_odd_name
def test_run_document_names_files_that_exist(odd_folder, call):
    arguments = ("run", str(odd_folder / "small.yaml"), "--out", str(odd_folder / "out"), "--json")
    status, out, errors = call(*arguments)
    document = json.loads(out)

    assert (status, errors) == (0, "")
    assert Path(document["source"]) == odd_folder / "small.yaml"
    assert all(Path(file).exists() for file in document["files"].values())
    status, out, _ = call("convert", str(odd_folder / "out"), str(odd_folder / "out.h5"), "--json")
    assert status == 0
    assert dc.open(json.loads(out)["written"][0]).n_frames == 1


@one_odd_name
def test_written_scenario_of_recording_reproduces_run(odd_folder, call):
    arguments = ("run", str(odd_folder / "in.npz"), "--out", "out", "--quiet")
    assert call(*arguments)[0] == 0
    assert call("run", "out/scenario.yaml", "--out", "again", "--quiet")[0] == 0

    assert Path("out/detections.csv").read_bytes() == Path("again/detections.csv").read_bytes()


@nightly
@each_odd_name
@pytest.mark.parametrize("command", ["inspect", "calibrate", "fixed-point", "generate", "twin"])
def test_every_command_writes_to_odd_path(command, odd_folder, call):
    assert call(*command_arguments(command, odd_folder / "out"))[0] == 0


@nightly
@each_odd_name
def test_study_writes_data_set_to_odd_path(odd_folder, call):
    arguments = (
        "study",
        str(odd_folder / "study.yaml"),
        "--workers",
        "1",
        "--out",
        str(odd_folder / "out"),
    )
    status, out, errors = call(*arguments, "--json")

    assert (status, errors) == (0, "")
    assert json.loads(out)["done"] == 16
    assert open_data_set_groups(odd_folder / "out" / "data.zarr")[""].sizes["trial"] == 8
    assert read_parquet(odd_folder / "out" / "points.parquet")["trials"].tolist() == [8, 8]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX paths")
def test_name_that_is_too_long_is_reported(folder, call):
    for arguments in (("run", "x" * 300), ("run", "small.yaml", "--out", "x" * 300)):
        status, _, errors = call(*arguments)
        assert status == 2
        assert "too long" in errors
        assert len(errors.splitlines()) == 1
