"""Memory checks before a job starts."""

import math
from contextlib import suppress

from dechirp.core.errors import NotEnoughMemory

# Below this size no check: it takes 0.1 ms, a fortieth of the time of a frame of this size.
SMALL_BYTES = 2**25


def check_free_memory(job: str, *, needed_bytes: float, fix: str) -> None:
    """Raise `NotEnoughMemory` if the job needs more than the free memory."""
    if needed_bytes < SMALL_BYTES:
        return
    available_bytes = available_memory_bytes()
    if needed_bytes > available_bytes:
        raise NotEnoughMemory(
            job, needed_bytes=needed_bytes, available_bytes=available_bytes, fix=fix
        )


def available_memory_bytes() -> float:
    """Return the memory left to this process, by the machine and by its own limit.

    Infinite in a browser, which has no psutil.
    """
    try:
        import psutil
    except ImportError:
        return math.inf
    free: float = psutil.virtual_memory().available
    with suppress(ImportError):  # Windows has no resource limits
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            free = min(free, max(limit - psutil.Process().memory_info().vms, 0))
    return free
