"""What fits into memory, asked before a job starts."""

import psutil

from dechirp.core.errors import NotEnoughMemory

# Asking takes 0.1 ms, a fortieth of the time that a frame of so little takes.
SMALL_BYTES = 2**25


def must_fit(what: str, *, needed_bytes: float, fix: str) -> None:
    """Raise `NotEnoughMemory`, with both numbers, unless so much memory is free."""
    if needed_bytes < SMALL_BYTES:
        return
    available_bytes = psutil.virtual_memory().available
    if needed_bytes > available_bytes:
        raise NotEnoughMemory(
            what, needed_bytes=needed_bytes, available_bytes=available_bytes, fix=fix
        )
