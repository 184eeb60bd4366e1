"""Notice that a command compiles loops, which takes up to a minute after an installation."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

from dechirp.core.compiled_kernels import compilation_listeners

MIN_NOTED_S = 1.0
"""Time of compilation after which the line is printed."""


@contextmanager
def announced_compilation(*, quiet: bool, marker: Path | None = None) -> Iterator[None]:
    """Announce the compilations of the block, on a terminal and in a redirected stream.

    The first run of a recording compiles for up to 45 s of CPU time, and logs of build servers show
    nothing else in that time. Of processes with the same marker, a file that does not exist yet,
    the first one to print the line creates it, and the others stay silent. An inner block takes the
    place of an outer one.
    """
    outer = [notice for notice in compilation_listeners if isinstance(notice, CompilationNotice)]
    for notice in outer:
        compilation_listeners.remove(notice)
    notice = CompilationNotice(quiet=quiet, marker=marker)
    compilation_listeners.append(notice)
    try:
        yield
    finally:
        compilation_listeners.remove(notice)
        compilation_listeners.extend(outer)


class CompilationNotice:
    """Line on standard error, once a command has compiled loops for `MIN_NOTED_S`."""

    def __init__(self, *, quiet: bool, marker: Path | None) -> None:
        self._depth, self._start_s, self._total_s = 0, 0.0, 0.0
        self._is_finished, self._marker = quiet, marker

    def start_compilation(self) -> None:
        """Note when the outermost loop starts to compile."""
        self._start_s = self._start_s if self._depth else perf_counter()
        self._depth += 1

    def end_compilation(self) -> None:
        """Print the line when that time has passed, also within the compilation of a loop."""
        self._depth -= 1
        time_s = self._total_s + perf_counter() - self._start_s
        if self._depth == 0:
            self._total_s = time_s
        if time_s > MIN_NOTED_S and not self._is_finished:
            self._is_finished = True
            try:
                if self._marker is not None:
                    self._marker.touch(exist_ok=False)
            except FileExistsError:
                return
            print(
                "Compiling loops for this processor, which are kept for later runs: up to a"
                " minute of processor time ...",
                file=sys.stderr,
                flush=True,
            )
