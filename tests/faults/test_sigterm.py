"""SIGTERM, sent by systems and schedulers: same behaviour as Ctrl-C, with status 143."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import psutil
import pytest

from dechirp.cli.signals import interrupted_by_signals
from dechirp.core.atomic_files import atomic_folder
from dechirp.core.errors import DechirpError
from dechirp.experiments.study.ledger_reader import LedgerReader
from faults.conftest import each_write_command
from faults.signal_injection import run_with_signal
from nightly import nightly

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")


@each_write_command
def test_sigterm_leaves_old_results_unchanged(command, folder, call, monkeypatch):
    assert run_with_signal(command, signal.SIGTERM, folder, call, monkeypatch) == 143


@pytest.mark.parametrize("n_signals", [1, 2])
def test_sigterm_during_clean_up_leaves_no_hidden_folder(n_signals, tmp_path, monkeypatch):
    """A signal while old files are removed, also as the second one: `timeout` sends it twice."""
    out = tmp_path / "out"
    with atomic_folder(out) as folder:
        (folder / "file").write_text("old")
    remove_tree = shutil.rmtree

    def remove_tree_during_signal(path, **options):
        os.kill(os.getpid(), signal.SIGTERM)
        remove_tree(path, **options)

    monkeypatch.setattr(shutil, "rmtree", remove_tree_during_signal)
    with (
        pytest.raises(KeyboardInterrupt),
        interrupted_by_signals() as received,
        atomic_folder(out) as folder,
    ):
        (folder / "file").write_text("new")
        if n_signals == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    assert received == [signal.SIGTERM] * n_signals
    assert list(tmp_path.iterdir()) == [out]
    assert (out / "file").read_text() == ("old" if n_signals == 2 else "new")


def count_blocks(out) -> int:
    try:
        with LedgerReader.open_read_only(out) as record:
            return len(record.saved_point_and_block_numbers())
    except DechirpError:
        return 0


@nightly
def test_sigterm_keeps_finished_blocks_of_study(folder):
    arguments = ("study", "study.yaml", "--workers", "2", "--out", "out", "--quiet")
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    study = subprocess.Popen(
        [sys.executable, "-m", "dechirp", *arguments, "--set", "trials.at_most=10000"],
        env=paths,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 120
    while not (n_finished := count_blocks(folder / "out")) and time.monotonic() < deadline:
        time.sleep(0.05)
    workers = psutil.Process(study.pid).children(recursive=True)
    study.terminate()
    out, err = study.communicate(timeout=120)

    assert (study.returncode, out) == (143, "")
    assert re.fullmatch(r"Interrupted; \d+ of \d+ trials are kept .*\n", err)
    assert count_blocks(folder / "out") >= n_finished > 0
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert [worker for worker in alive if worker.status() != psutil.STATUS_ZOMBIE] == []
