"""SIGINT (Ctrl-C): status 130 and unchanged old results."""

import os
import signal

import pytest

from faults.conftest import each_write_command
from faults.signal_injection import run_with_signal

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")


@each_write_command
def test_sigint_leaves_old_results_unchanged(command, folder, call, monkeypatch):
    assert run_with_signal(command, signal.SIGINT, folder, call, monkeypatch) == 130
