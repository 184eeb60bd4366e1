"""Read-only folders: commands are refused in one line, and recordings can be read."""

import os
import subprocess
from pathlib import Path

import pytest

from faults.conftest import WRITE_COMMANDS, command_arguments, read_folder


@pytest.fixture
def read_only(folder):
    """Return a folder with a recording that is read-only even for root."""
    read_only_folder = folder / "read-only"
    read_only_folder.mkdir()
    (read_only_folder / "in.npz").write_bytes((folder / "in.npz").read_bytes())
    read_only_folder.chmod(0o555)
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    bind = ["mount", "--bind", "-o", "ro", str(read_only_folder), str(read_only_folder)]
    if is_root and subprocess.run(bind, check=False, capture_output=True).returncode:
        pytest.skip("root can write to any folder and cannot mount here: run as another user")
    yield read_only_folder
    if is_root:
        subprocess.run(["umount", read_only_folder], check=True)
    read_only_folder.chmod(0o755)


@pytest.mark.parametrize("command", [*WRITE_COMMANDS, "study"])
def test_command_writing_to_read_only_folder_is_refused_in_one_line(
    command, folder, call, read_only
):
    out = read_only / "out"
    content = read_folder(folder)

    arguments = (
        ["study", "study.yaml", "--out", str(out)]
        if command == "study"
        else command_arguments(command, out)
    )
    status, _, errors = call(*arguments)

    assert status == 2
    assert "not writable" in errors
    assert len(errors.splitlines()) == 1
    assert read_folder(folder) == content


def test_recording_in_read_only_folder_is_read(folder, call, read_only):
    status, _, errors = call("run", str(read_only / "in.npz"), "--out", "out", "--quiet")

    assert (status, errors) == (0, "")
    assert Path("out/detections.csv").read_text().count("\n") >= 2
