"""SIGTERM, by which systems and schedulers end a process: as Ctrl-C."""

import os
import signal

import pytest

from faults.conftest import writing
from faults.signalled import struck

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")


@writing
def test_sigterm_leaves_what_was_there(command, folder, call, monkeypatch):
    assert struck(command, signal.SIGTERM, folder, call, monkeypatch) == 143
