"""A place that cannot be written: told before the work begins, where it can be known."""

import os
import subprocess
from pathlib import Path

import pytest

from faults.conftest import WRITES, there, words


@pytest.fixture
def read_only(folder):
    """Give a folder with a recording that nobody can write to, root neither."""
    place = folder / "read-only"
    place.mkdir()
    (place / "in.npz").write_bytes((folder / "in.npz").read_bytes())
    place.chmod(0o555)
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    bind = ["mount", "--bind", "-o", "ro", str(place), str(place)]
    if is_root and subprocess.run(bind, check=False, capture_output=True).returncode:
        pytest.skip("root writes everywhere, and cannot mount here")
    yield place
    if is_root:
        subprocess.run(["umount", place], check=True)
    place.chmod(0o755)


@pytest.mark.parametrize("command", [*WRITES, "study"])
def test_it_is_refused_in_one_line(command, folder, call, read_only):
    out = read_only / "out"
    before = there(folder)

    asked = (
        ["study", "study.yaml", "--out", str(out)] if command == "study" else words(command, out)
    )
    status, _, said = call(*asked)

    assert status == 2
    assert "not writable" in said
    assert len(said.splitlines()) == 1
    assert there(folder) == before


def test_a_recording_in_it_is_read(folder, call, read_only):
    status, _, said = call("run", str(read_only / "in.npz"), "--out", "out", "--quiet")

    assert (status, said) == (0, "")
    assert Path("out/detections.csv").read_text().count("\n") >= 2
