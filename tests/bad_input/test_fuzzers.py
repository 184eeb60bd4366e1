"""What fuzzers begin with is read, and a short while of them finds nothing.

A mutation of what is refused at once never comes to what decodes samples.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dechirp as dc
from bad_input.entries import CORPUS, ENTRIES, told_of
from dechirp.recordings.settings.read import read_settings
from nightly import nightly

FUZZ = Path(__file__).parents[2] / "fuzz"
_SPEC = importlib.util.spec_from_file_location("fuzz_readers", FUZZ / "readers.py")
READERS = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(READERS)


def is_read(file: Path, **told: object) -> bool:
    opened = dc.open(file, **told)
    if not opened.sizes:
        return opened.points is not None
    return len(list(opened.frames())) == opened.n_frames > 0


@pytest.mark.parametrize("entry", sorted(ENTRIES.keys() - {"recording", "command-line"}))
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_what_the_corpus_calls_good_is_taken(entry, tmp_path):
    names = ("good.", "good_")
    files = [file for file in (CORPUS / entry).iterdir() if file.name.startswith(names)]
    assert files
    for file in files:
        scratch = tmp_path / file.name
        scratch.mkdir()
        ENTRIES[entry](file, scratch)


def test_recordings_of_the_corpus_are_read_where_they_are_not_damaged():
    damaged = ("-cut", "-head", "-middle")
    for file in sorted((CORPUS / "recording").iterdir()):
        if file.stem != "empty" and not file.stem.endswith(damaged):
            told = {} if file.stem in READERS.OF_THEMSELVES else told_of(file)
            assert is_read(file, **told), file.name


def test_what_the_fuzzer_of_readers_begins_with_is_read(tmp_path):
    for kind, (content, told) in READERS.RECORDINGS.items():
        file = tmp_path / kind
        file.write_bytes(content())
        own = {} if kind in READERS.OF_THEMSELVES else {"radar": READERS.radar_of(kind, tmp_path)}
        assert is_read(file, **own, **told), kind
    for content, name in READERS.SETTINGS.values():
        (tmp_path / name).write_bytes(content())
        assert read_settings(tmp_path / name).radar


@nightly
def test_two_seconds_of_each_find_nothing(tmp_path):
    done = subprocess.run(
        [sys.executable, FUZZ / "all.py", "--seconds", "2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
