"""What fits into memory, asked before a job starts."""

from contextlib import suppress

import psutil

from dechirp.core.errors import NotEnoughMemory

# Asking takes 0.1 ms, a fortieth of the time that a frame of so little takes.
SMALL_BYTES = 2**25


def must_fit(what: str, *, needed_bytes: float, fix: str) -> None:
    """Raise `NotEnoughMemory`, with both numbers, unless so much memory is free."""
    if needed_bytes < SMALL_BYTES:
        return
    available_bytes = free_bytes()
    if needed_bytes > available_bytes:
        raise NotEnoughMemory(
            what, needed_bytes=needed_bytes, available_bytes=available_bytes, fix=fix
        )


def free_bytes() -> float:
    """Memory that this process may still take: what the machine has, or its own limit allows."""
    free: float = psutil.virtual_memory().available
    with suppress(ImportError):  # Windows has no such limits
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            free = min(free, max(limit - psutil.Process().memory_info().vms, 0))
    return free
