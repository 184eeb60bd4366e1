"""SIGKILL, which nobody can catch: what was there is whole at the next call."""

import os
import subprocess
import sys

import pytest

from faults.conftest import there, words
from nightly import nightly

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")

DIES = """
import os, signal, sys
from pathlib import Path
from dechirp.cli.main import main

def die(self, target):
    os.kill(os.getpid(), signal.SIGKILL)

Path.rename = Path.replace = die
main(sys.argv[1:])
"""


@pytest.mark.parametrize("command", [pytest.param("run", marks=nightly), "convert"])
def test_killed_before_the_new_takes_the_place_of_the_old(command, folder, call):
    assert call(*words(command, "out"))[0] == 0
    before = there(folder)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    dead = subprocess.run(
        [sys.executable, "-c", DIES, *words(command, "out")],
        env=paths,
        capture_output=True,
        text=True,
        check=False,
    )

    assert (dead.returncode, dead.stderr) == (-9, "")
    after = there(folder)
    litter = {name for name in after if name not in before}
    assert {name: after[name] for name in before} == before
    # What was half done is hidden, and in nobody's way.
    assert all(name.startswith(".out.") for name in litter)
    assert call(*words(command, "out"))[0] == 0
