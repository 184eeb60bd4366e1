"""SIGKILL, which cannot be caught: old results are complete at the next call."""

import os
import subprocess
import sys

import pytest

from faults.conftest import command_arguments, read_folder
from nightly import nightly

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")

KILLED_SCRIPT = """
import os, signal, sys
from pathlib import Path
from dechirp.cli.main import main
from dechirp.core import atomic_files

def die(self, target):
    os.kill(os.getpid(), signal.SIGKILL)

Path.rename = Path.replace = atomic_files._exchange_paths = die
main(sys.argv[1:])
"""


@nightly
@pytest.mark.parametrize("command", [pytest.param("run", marks=nightly), "convert"])
def test_sigkill_before_replacement_leaves_old_results(command, folder, call):
    assert call(*command_arguments(command, "out"))[0] == 0
    old_content = read_folder(folder)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    process = subprocess.run(
        [sys.executable, "-c", KILLED_SCRIPT, *command_arguments(command, "out")],
        env=paths,
        capture_output=True,
        text=True,
        check=False,
    )

    assert (process.returncode, process.stderr) == (-9, "")
    new_content = read_folder(folder)
    litter = {name for name in new_content if name not in old_content}
    assert {name: new_content[name] for name in old_content} == old_content
    # Partial results are hidden and do not disturb the next call.
    assert all(name.startswith(".out.") for name in litter)
    assert call(*command_arguments(command, "out"))[0] == 0
