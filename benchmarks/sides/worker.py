"""Worker process of one side: loads a job and times it on request.

    python -m sides.worker sides.peers.xwr

The worker reads requests from standard input, one per line, with fields separated by tabs; it
ignores empty lines. It answers each request with one line, "ok" and a number or "no" and a reason:

load KIND FILE    Pass the arrays of FILE (.npz) to function KIND of the module, and call the
                  result once; returns the time of this call, s.
turn SECONDS      Repeat the call for this duration, at least once; returns the shortest time, s.
save FILE         Save the result of the last call as .npy; returns 0.
"""

import importlib
import os
import sys
from collections.abc import Callable
from time import perf_counter
from types import ModuleType

import numpy as np


class Work:
    """Loaded job of a module."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        self.call: Callable[[], object] | None = None
        self.result: object = None

    def load(self, kind: str, file: str) -> float:
        """Load a job; return the time of its first call, s."""
        make = getattr(self.module, kind)
        self.call = self.result = None  # frees the memory of the previous job
        with np.load(file) as stored:
            inputs = {name: stored[name] for name in stored.files}
        self.call = make(inputs)
        return self.time_call()

    def time_call(self) -> float:
        """Return the time of one call, s."""
        start = perf_counter()
        self.result = self.call()
        return perf_counter() - start

    def turn(self, seconds: str) -> float:
        """Return the shortest time of calls that take a duration in total, s."""
        times = [self.time_call()]
        while sum(times) < float(seconds):
            times.append(self.time_call())
        return min(times)

    def save(self, file: str) -> float:
        """Save the result of the last call."""
        np.save(file, np.asarray(self.result))
        return 0.0


def main() -> None:
    # Some packages print to standard output; redirect it, so that answers stay separate.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    work = None
    for line in sys.stdin:
        command, *arguments = line.rstrip("\n").split("\t")
        if not command:
            continue
        try:
            work = work or Work(importlib.import_module(sys.argv[1]))
            print("ok", repr(getattr(work, command)(*arguments)), sep="\t", file=answers)
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            print("no", reason, sep="\t", file=answers)


if __name__ == "__main__":
    main()
