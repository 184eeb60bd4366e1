"""Compilation of the loops that a first frame needs: started with the server, and counted.

After an installation, compiled loops are not on disk yet, and the first frame takes a minute.
"""

from concurrent.futures import Executor
from functools import cache
from time import perf_counter

from dechirp.core.compiled_kernels import compilation_listeners
from dechirp.experiments.scenario import Scenario
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.scenario_edits import PageLimits


class CompilationCounter:
    """Counter of the loops that this process compiled instead of loading them from disk."""

    def __init__(self) -> None:
        self.n_compiled = 0
        self._first_start_s = 0.0
        self._is_stopped = False
        compilation_listeners.append(self)

    @property
    def progress_text(self) -> str:
        """Progress for the pages; empty if nothing was compiled."""
        if not self.n_compiled:
            return ""
        return (
            "Compiling loops, which are kept for later, for about a minute:"
            f" {self.n_compiled} loops in {perf_counter() - self._first_start_s:.0f} s."
        )

    def stop(self) -> None:
        """Let the next compilation fail, so that a server that ends does not wait for it."""
        self._is_stopped = True

    def start_compilation(self) -> None:
        """Note when the first one starts; fail if the server ends."""
        if self._is_stopped:
            raise RuntimeError("the studio has ended")
        self._first_start_s = self._first_start_s or perf_counter()

    def end_compilation(self) -> None:
        """Count a loop."""
        self.n_compiled += 1


@cache
def compilation_counter() -> CompilationCounter:
    """Return the counter of this process, which counts from the first call on."""
    return CompilationCounter()


def compile_in_background(worker: Executor, scenario: Scenario, limits: PageLimits) -> None:
    """Compile on the worker what the first frames of a page need; pages report its errors."""
    player = FramePlayer(scenario, limits)
    for step in (0, 1):
        worker.submit(player.process_frame_at_step, step, None)
