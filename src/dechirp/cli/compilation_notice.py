"""Notice that a command compiles loops, which takes half a minute after an installation."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from dechirp.core.compiled_kernels import compilation_listeners


@contextmanager
def announced_compilation(*, quiet: bool) -> Iterator[None]:
    """Announce the compilations of the block on a terminal, as progress bars are."""
    notice = CompilationNotice()
    if quiet or not sys.stderr.isatty():
        yield
        return
    compilation_listeners.append(notice)
    try:
        yield
    finally:
        compilation_listeners.remove(notice)


class CompilationNotice:
    """Line on standard error, once a command has compiled loops for a second."""

    def __init__(self) -> None:
        self._depth, self._start_s, self._total_s = 0, 0.0, 0.0
        self._is_printed = False

    def start_compilation(self) -> None:
        """Note when the outermost loop starts to compile."""
        self._start_s = self._start_s if self._depth else perf_counter()
        self._depth += 1

    def end_compilation(self) -> None:
        """Print the line when a second has passed."""
        self._depth -= 1
        if self._depth == 0:
            self._total_s += perf_counter() - self._start_s
        if self._total_s > 1 and not self._is_printed:
            self._is_printed = True
            print(
                "Compiling loops for this processor, once after the installation: half a minute"
                " in all ...",
                file=sys.stderr,
            )
