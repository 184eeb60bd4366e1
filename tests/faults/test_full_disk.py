"""Full disk: old results stay, no partial files remain, and the error is reported."""

import os
import subprocess

import pytest

from faults.conftest import WRITE_COMMANDS, command_arguments, each_write_command, read_folder
from nightly import nightly

resource = pytest.importorskip("resource")


@pytest.fixture
def limit_file_size():
    """Return a function that limits files to 64 bytes, as on a disk without free blocks."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def set_limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (64, limits[1]))

    yield set_limit
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@each_write_command
def test_full_disk_keeps_old_results_and_leaves_no_partial_files(
    command, folder, call, limit_file_size
):
    assert call(*command_arguments(command, "out"))[0] == 0
    content = read_folder(folder)

    limit_file_size()
    status, _, errors = call(*command_arguments(command, "out"))

    assert status == 2
    assert "not writable (File too large)" in errors
    assert len(errors.splitlines()) == 1
    assert read_folder(folder) == content


@nightly
@pytest.mark.parametrize("command", WRITE_COMMANDS)
def test_full_tmpfs_is_reported_in_message(command, folder, call):
    (folder / "disk").mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "none", "disk"]
    if os.name != "posix" or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("cannot mount a small disk: run as root")
    try:
        status, _, errors = call(*command_arguments(command, folder / "disk" / "out"))
        content = read_folder(folder / "disk")
    finally:
        subprocess.run(["umount", "disk"], check=True)
    if status == 0:  # a calibration fits into 16 kB
        assert command == "calibrate"
    else:
        assert (status, content) == (2, {})
        assert "No space left on device" in errors
