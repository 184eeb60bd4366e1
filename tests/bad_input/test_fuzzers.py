"""Seed inputs of the fuzzers, which must be valid, and a short run of each fuzzer.

Mutations of an input that is rejected immediately never reach the decoders of samples.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import dechirp as dc
from bad_input.entries import CORPUS, ENTRIES, reading_options
from dechirp.recordings.settings.read import read_settings
from nightly import nightly, nightly_except

FUZZ = Path(__file__).parents[2] / "fuzz"


def load_fuzzer(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"fuzz_{name}", FUZZ / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


READERS = load_fuzzer("readers")


def is_readable(file: Path, **options: object) -> bool:
    recording = dc.open(file, **options)
    if not recording.sizes:
        return recording.points is not None
    return len(list(recording.frames())) == recording.n_frames > 0


@pytest.mark.parametrize(
    "entry", nightly_except(8, sorted(ENTRIES.keys() - {"recording", "command-line"}))
)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_good_corpus_files_are_accepted(entry, tmp_path):
    names = ("good.", "good_")
    files = [file for file in (CORPUS / entry).iterdir() if file.name.startswith(names)]
    assert files
    for file in files:
        scratch = tmp_path / file.name
        scratch.mkdir()
        ENTRIES[entry](file, scratch)


def test_undamaged_corpus_recordings_are_read():
    damaged = ("-cut", "-head", "-middle")
    for file in sorted((CORPUS / "recording").iterdir()):
        if file.stem != "empty" and not file.stem.endswith(damaged):
            options = {} if file.stem in READERS.SELF_DESCRIBING else reading_options(file)
            assert is_readable(file, **options), file.name


def test_seed_inputs_of_reader_fuzzer_are_read(tmp_path):
    for kind, (content, options) in READERS.RECORDINGS.items():
        folder = tmp_path / kind
        folder.mkdir()
        file = READERS.write_companion(kind, folder)
        file.write_bytes(content())
        radar_options = (
            {} if kind in READERS.SELF_DESCRIBING else {"radar": READERS.write_radar(kind, folder)}
        )
        assert is_readable(file, **radar_options, **options), kind
    for content, name in READERS.SETTINGS.values():
        (tmp_path / name).write_bytes(content())
        assert read_settings(tmp_path / name).radar
    for content, name in READERS.SLOW_TIME.values():
        (tmp_path / name).write_bytes(content())
        assert dc.slow_time_files.read_slow_time(tmp_path / name).sizes["time"] == 30


@pytest.mark.parametrize("name", ["readers", "entries"])
def test_end_of_a_fuzzer_keeps_the_folder_for_findings_of_others(name, tmp_path, monkeypatch):
    """Another run may be about to write the first file into the empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(FUZZ)
    fuzzer = load_fuzzer(name)
    passed = subprocess.CompletedProcess([], 0, "", "executed_units: 1")
    monkeypatch.setattr(fuzzer.subprocess, "run", lambda *_args, **_options: passed)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "dbc"])
    with pytest.raises(SystemExit, match="0"):
        fuzzer.main()
    assert (tmp_path / "fuzz-found").is_dir()


@nightly
def test_each_fuzzer_finds_nothing_in_two_seconds(tmp_path):
    process = subprocess.run(
        [sys.executable, FUZZ / "all.py", "--seconds", "2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stdout[-4000:] + process.stderr[-4000:]
