"""Names of files that nobody expects: they are names, and nothing else."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.results.data_set import read_data_set
from dechirp.results.parquet import read_parquet
from faults.conftest import words
from nightly import nightly

NAMES = {
    "spaces": b"two  spaces ",
    "Unicode": "Straße 東京 🚗".encode(),
    "line break": b"two\nlines",
    "not UTF-8": b"caf\xe9",
    "signs": b"a#b%20c?d&e=f;'\"$(g)",
    "255 bytes": b"L" * 255,
}
odd = pytest.mark.parametrize("kind", NAMES)


@pytest.fixture
def place(kind, folder, monkeypatch) -> Path:
    """Be in a folder of an odd name, with the same files."""
    made = folder / os.fsdecode(NAMES[kind])
    try:
        made.mkdir()
    except OSError:
        pytest.skip("this file system has no such name")
    for name in ("small.yaml", "study.yaml", "in.npz", "still.npz"):
        shutil.copy(folder / name, made)
    monkeypatch.chdir(made)
    return made


@odd
def test_a_scene_is_run_and_converted_and_found_again_by_its_document(place, call):
    asked = ("run", str(place / "small.yaml"), "--out", str(place / "out"), "--json")
    status, out, said = call(*asked)
    document = json.loads(out)

    assert (status, said) == (0, "")
    assert Path(document["source"]) == place / "small.yaml"
    assert all(Path(file).exists() for file in document["files"].values())
    status, out, _ = call("convert", str(place / "out"), str(place / "out.h5"), "--json")
    assert status == 0
    assert dc.open(json.loads(out)["written"][0]).n_frames == 1


@pytest.mark.parametrize(
    "kind", [name if name == "not UTF-8" else pytest.param(name, marks=nightly) for name in NAMES]
)
def test_a_recording_is_run_again_from_the_scenario_that_was_written(place, call):
    asked = ("run", str(place / "in.npz"), "--out", "out", "--quiet")
    assert call(*asked)[0] == 0
    assert call("run", "out/scenario.yaml", "--out", "again", "--quiet")[0] == 0

    assert Path("out/detections.csv").read_bytes() == Path("again/detections.csv").read_bytes()


@nightly
@odd
@pytest.mark.parametrize("command", ["inspect", "calibrate", "fixed-point", "twin"])
def test_every_command_writes_there(command, place, call):
    assert call(*words(command, place / "out"))[0] == 0


@nightly
@odd
def test_a_study_with_a_data_set_is_made_there(place, call):
    asked = ("study", str(place / "study.yaml"), "--workers", "1", "--out", str(place / "out"))
    status, out, said = call(*asked, "--json")

    assert (status, said) == (0, "")
    assert json.loads(out)["done"] == 16
    assert read_data_set(place / "out" / "data.zarr")[""].sizes["trial"] == 8
    assert read_parquet(place / "out" / "points.parquet")["trials"].tolist() == [8, 8]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX paths")
def test_a_name_that_is_too_long_is_a_message(folder, call):
    for asked in (("run", "x" * 300), ("run", "small.yaml", "--out", "x" * 300)):
        status, _, said = call(*asked)
        assert status == 2
        assert "too long" in said
        assert len(said.splitlines()) == 1
