"""Error messages of a command under a memory limit (`ulimit -v`)."""

import errno
import os

from dechirp.core.errors import Mistake

# The libraries alone reserve 0.65 GB of addresses with one thread and 0.06 GB more per thread.
# With less, one of them retries for ever and raises no exception.
MIN_BYTES = 768 * 2**20
BYTES_PER_THREAD = 64 * 2**20
_FIX = (
    "raise the limit (`ulimit -v`), or process less at once: fewer frames, chirps, channels,"
    " workers or threads (OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1)"
)
_MEMORY_MESSAGES = ("can't start new thread", "cannot allocate memory", "failed to map segment")


def startup_memory_error() -> Mistake | None:
    """Return the mistake if the memory limit is too small to load the libraries, else None."""
    limit = _address_space_limit_bytes()
    least = MIN_BYTES + _n_library_threads() * BYTES_PER_THREAD
    if limit is None or limit >= least:
        return None
    return Mistake(
        setting="memory limit",
        value=_format_gib(limit),
        expected=f"at least {_format_gib(least)} for the libraries with {_n_library_threads()}"
        " threads",
        fix=_FIX,
    )


def memory_error(error: Exception) -> Mistake | None:
    """Return the mistake if an exception means a lack of memory, else None."""
    is_short = isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno == errno.ENOMEM
    )
    if not is_short and not any(words in str(error).lower() for words in _MEMORY_MESSAGES):
        return None
    limit = _address_space_limit_bytes()
    return Mistake(
        setting="memory",
        value=f"used up ({error})" if str(error) else "used up",
        expected="enough memory" + (f"; the limit is {_format_gib(limit)}" if limit else ""),
        fix=_FIX,
    )


def _address_space_limit_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def _n_library_threads() -> int:
    variable = os.environ.get("OPENBLAS_NUM_THREADS", "")
    return int(variable) if variable.isdecimal() else os.cpu_count() or 1


def _format_gib(n_bytes: float) -> str:
    return f"{n_bytes / 2**30:.3g} GiB"
