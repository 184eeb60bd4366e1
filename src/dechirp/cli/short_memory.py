"""What a command says that cannot start under a limit of memory (`ulimit -v`), or ran into it."""

import errno
import os

from dechirp.core.errors import Mistake

# Libraries alone take 0.65 GB of addresses with one thread, and another 0.06 GB for each thread.
# With less, one of them tries for ever to have it, and no exception is raised.
LEAST_BYTES = 768 * 2**20
EACH_THREAD_BYTES = 64 * 2**20
_FIX = (
    "Raise the limit (`ulimit -v`), or take less at once: fewer frames, chirps, channels,"
    " workers or threads (OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1)."
)
_SAID = ("can't start new thread", "cannot allocate memory", "failed to map segment")


def too_little_to_start() -> Mistake | None:
    """What is wrong with the limit of this process, if its libraries cannot be loaded under it."""
    limit = _limit_bytes()
    least = LEAST_BYTES + _n_threads() * EACH_THREAD_BYTES
    if limit is None or limit >= least:
        return None
    return Mistake(
        setting="the limit of memory",
        got=_gib(limit),
        need=f"at least {_gib(least)}, which the libraries take with {_n_threads()} threads",
        fix=_FIX,
    )


def short_of_memory(error: Exception) -> Mistake | None:
    """What was wrong if memory was short, whatever a library made of it."""
    is_short = isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno == errno.ENOMEM
    )
    if not is_short and not any(words in str(error).lower() for words in _SAID):
        return None
    limit = _limit_bytes()
    return Mistake(
        setting="memory",
        got=f"used up ({error})" if str(error) else "used up",
        need="enough for what was asked" + (f": {_gib(limit)} are allowed" if limit else ""),
        fix=_FIX,
    )


def _limit_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def _n_threads() -> int:
    told = os.environ.get("OPENBLAS_NUM_THREADS", "")
    return int(told) if told.isdecimal() else os.cpu_count() or 1


def _gib(n_bytes: float) -> str:
    return f"{n_bytes / 2**30:.3g} GiB"
