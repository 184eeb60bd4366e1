"""What fits into memory, asked before a job starts."""

import psutil

from dechirp.core.errors import NotEnoughMemory


def must_fit(what: str, *, needed_bytes: float, fix: str) -> None:
    """Raise `NotEnoughMemory`, with both numbers, unless so much memory is free."""
    available_bytes = psutil.virtual_memory().available
    if needed_bytes > available_bytes:
        raise NotEnoughMemory(
            what, needed_bytes=needed_bytes, available_bytes=available_bytes, fix=fix
        )
