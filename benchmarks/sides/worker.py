"""One side in a process of its own: it loads a job, then runs it whenever it is told.

    python -m sides.worker sides.peers.xwr

Lines come in, tabs between words, empty ones between them. A line goes out for each: "ok" and
a number, or "no" and why:

load KIND FILE    arrays of FILE (.npz) to the module's function KIND; seconds of the first call
turn SECONDS      calls until so long is spent, one at least; seconds of the fastest
save FILE         what the last call returned, as .npy
"""

import importlib
import os
import sys
from collections.abc import Callable
from time import perf_counter
from types import ModuleType

import numpy as np


class Work:
    """The job that is loaded."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        self.call: Callable[[], object] | None = None
        self.result: object = None

    def load(self, kind: str, file: str) -> float:
        """See `load` above."""
        make = getattr(self.module, kind)
        self.call = self.result = None  # not in memory beside the next
        with np.load(file) as stored:
            inputs = {name: stored[name] for name in stored.files}
        self.call = make(inputs)
        return self.once()

    def once(self) -> float:
        """Seconds of a call."""
        start = perf_counter()
        self.result = self.call()
        return perf_counter() - start

    def turn(self, seconds: str) -> float:
        """See `turn` above."""
        times = [self.once()]
        while sum(times) < float(seconds):
            times.append(self.once())
        return min(times)

    def save(self, file: str) -> float:
        """See `save` above."""
        np.save(file, np.asarray(self.result))
        return 0.0


def main() -> None:
    # Packages print: their lines go to the standard error.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    work = None
    for line in sys.stdin:
        verb, *words = line.rstrip("\n").split("\t")
        if not verb:
            continue
        try:
            work = work or Work(importlib.import_module(sys.argv[1]))
            print("ok", repr(getattr(work, verb)(*words)), sep="\t", file=answers)
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            print("no", why, sep="\t", file=answers)


if __name__ == "__main__":
    main()
