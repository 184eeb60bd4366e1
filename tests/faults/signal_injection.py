"""Injection of a signal at the moment when results replace the old ones."""

import os
import signal
from pathlib import Path

from dechirp.core import atomic_files
from faults.conftest import command_arguments, read_folder


def run_with_signal(command: str, number: int, folder: Path, call, monkeypatch) -> int:
    """Run a command that gets a signal while replacing files; old files must be unchanged."""
    assert call(*command_arguments(command, "out"))[0] == 0
    content = read_folder(folder)
    for name in ("rename", "replace"):
        original = getattr(Path, name)

        def send_signal(path: Path, target: Path, original=original) -> Path:
            monkeypatch.undo()  # restoring the old files must not trigger the signal again
            os.chdir(folder)
            os.kill(os.getpid(), number)
            return original(path, target)

        monkeypatch.setattr(Path, name, send_signal)
    exchange = atomic_files._exchange_paths

    def send_signal_and_exchange(first: Path, second: Path) -> bool:
        monkeypatch.undo()
        os.chdir(folder)
        os.kill(os.getpid(), number)
        return exchange(first, second)

    monkeypatch.setattr(atomic_files, "_exchange_paths", send_signal_and_exchange)
    original_handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, _, errors = call(*command_arguments(command, "out"))
    finally:
        signal.signal(signal.SIGINT, original_handler)
    assert "Traceback" not in errors
    assert read_folder(folder) == content
    return status
