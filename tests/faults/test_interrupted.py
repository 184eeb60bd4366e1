"""SIGINT, which Ctrl-C sends: it ends, says so, and leaves what was there."""

import os
import signal

import pytest

from faults.conftest import writing
from faults.signalled import struck

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")


@writing
def test_ctrl_c_leaves_what_was_there(command, folder, call, monkeypatch):
    assert struck(command, signal.SIGINT, folder, call, monkeypatch) == 130
