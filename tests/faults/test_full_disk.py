"""A disk that fills: what was there stays, nothing half is left, and it is said."""

import os
import subprocess

import pytest

from faults.conftest import WRITES, there, words, writing
from nightly import nightly

resource = pytest.importorskip("resource")


@pytest.fixture
def no_room():
    """Let no file grow past 64 bytes, as on a disk that has no block left."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def begin() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))

    yield begin
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@writing
def test_what_was_there_stays_and_nothing_half_is_left(command, folder, call, no_room):
    assert call(*words(command, "out"))[0] == 0
    before = there(folder)

    no_room()
    status, _, said = call(*words(command, "out"))

    assert status == 2
    assert "not writable (File too large)" in said
    assert len(said.splitlines()) == 1
    assert there(folder) == before


@nightly
@pytest.mark.parametrize("command", WRITES)
def test_a_real_disk_that_is_full_is_told_as_such(command, folder, call):
    (folder / "disk").mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "none", "disk"]
    if os.name != "posix" or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("this user cannot mount a small disk")
    try:
        status, _, said = call(*words(command, folder / "disk" / "out"))
        left = there(folder / "disk")
    finally:
        subprocess.run(["umount", "disk"], check=True)
    if status == 0:  # a calibration has room in 16 kB
        assert command == "calibrate"
    else:
        assert (status, left) == (2, {})
        assert "No space left on device" in said
