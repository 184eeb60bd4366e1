"""SIGTERM, by which systems and schedulers end a process: as Ctrl-C."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from dechirp.core.errors import DechirpError
from dechirp.experiments.study.ledger_reader import LedgerReader
from faults.conftest import writing
from faults.signalled import struck
from nightly import nightly

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")


@writing
def test_sigterm_leaves_what_was_there(command, folder, call, monkeypatch):
    assert struck(command, signal.SIGTERM, folder, call, monkeypatch) == 143


def n_blocks(out) -> int:
    try:
        with LedgerReader.open_existing(out) as record:
            return len(record.finished_blocks())
    except DechirpError:
        return 0


@nightly
def test_a_study_keeps_what_was_counted(folder):
    asked = ("study", "study.yaml", "--workers", "2", "--out", "out", "--quiet")
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    study = subprocess.Popen(
        [sys.executable, "-m", "dechirp", *asked, "--set", "trials.at_most=10000"],
        env=paths,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 120
    while not (counted := n_blocks(folder / "out")) and time.monotonic() < deadline:
        time.sleep(0.05)
    workers = psutil.Process(study.pid).children(recursive=True)
    study.terminate()
    out, err = study.communicate(timeout=120)

    assert (study.returncode, out, err) == (143, "", "")
    assert n_blocks(folder / "out") >= counted > 0
    _, left = psutil.wait_procs(workers, timeout=20)
    assert [one for one in left if one.status() != psutil.STATUS_ZOMBIE] == []
