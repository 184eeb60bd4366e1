"""A signal that comes at the worst moment: when results are about to take their place."""

import os
import signal
from pathlib import Path

from faults.conftest import there, words


def struck(command: str, number: int, folder: Path, call, monkeypatch) -> int:
    """Status of a command that a signal hits there; all that was there must be as it was."""
    assert call(*words(command, "out"))[0] == 0
    before = there(folder)
    for name in ("rename", "replace"):
        usual = getattr(Path, name)

        def strikes(path: Path, target: Path, usual=usual) -> Path:
            monkeypatch.undo()  # what is put back is not hit again
            os.chdir(folder)
            os.kill(os.getpid(), number)
            return usual(path, target)

        monkeypatch.setattr(Path, name, strikes)
    usual_handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, _, said = call(*words(command, "out"))
    finally:
        signal.signal(signal.SIGINT, usual_handler)
    assert "Traceback" not in said
    assert there(folder) == before
    return status
