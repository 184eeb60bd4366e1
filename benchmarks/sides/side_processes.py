"""Side processes and their alternating timing (A B C A B C)."""

import contextlib
import os
import queue
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import NamedTuple

BENCHMARKS = Path(__file__).parents[1]
POOLS = ("OMP", "OPENBLAS", "MKL", "NUMBA")
# Large arrays are kept for the next: whether glibc hands them back to the system turns on what a
# process did before, and the plain frame of 12 channels took 3.9 ms in one and 6.1 in another.
KEEPS_MEMORY = {"MALLOC_MMAP_THRESHOLD_": "1073741824", "MALLOC_TRIM_THRESHOLD_": "4294967296"}


class Absent(Exception):
    """A side does not do this job; the message is why, in one line."""


class NoAnswer(Absent):
    """It may do it, but takes too long."""


class Side:
    """A process that answers line by line; started when first asked, again after it was ended."""

    def __init__(
        self, name: str, command: list[str], environment: dict[str, str], patience_s: float
    ) -> None:
        self.name, self.command, self.patience_s = name, command, patience_s
        self.environment = environment
        self.process: Process | None = None

    def ask(self, *words: str, patience_s: float | None = None) -> float:
        """The number that the process answers; `Absent` where it cannot, or takes too long."""
        patience_s = patience_s or self.patience_s
        self.process = self.process or Process(self.command, self.environment)
        try:
            answer = self.process.answer("\t".join(words), patience_s)
        except queue.Empty:
            self.end()
            raise NoAnswer(f"no answer in {patience_s:g} s") from None
        if not answer:
            why = self.process.last_words()
            self.end()
            raise Absent(why)
        verdict, word = answer.rstrip("\n").split("\t", 1)
        if verdict != "ok":
            raise Absent(word)
        return float(word)

    def end(self) -> None:
        """Kill the process; the next question starts another."""
        if self.process is not None:
            self.process.end()
            self.process = None


class Process:
    """A child, its answers in a queue that a thread fills: a pipe has no time-out."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self.child = subprocess.Popen(
            command,
            cwd=BENCHMARKS,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
        )
        self.lines: queue.Queue[str] = queue.Queue()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            self.lines.put(line)
        self.lines.put("")

    def answer(self, line: str, patience_s: float) -> str:
        """Its line, "" where it has ended; `queue.Empty` where it takes longer."""
        assert self.child.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            # An empty line too: Octave hands over a line once it has seen what comes next.
            self.child.stdin.write(line + "\n\n")
            self.child.stdin.flush()
        return self.lines.get(timeout=patience_s)

    def last_words(self) -> str:
        """The last line that it complained with, or its status."""
        status = self.child.wait()
        self.errors.seek(0)
        return self.errors.read().strip().rpartition("\n")[2] or f"it ended with status {status}"

    def end(self) -> None:
        """Kill it, and close what leads to it."""
        self.child.kill()
        self.child.wait()
        self.reader.join()
        with contextlib.suppress(BrokenPipeError):
            self.child.communicate()
        self.errors.close()


def build_environment(threads: int) -> dict[str, str]:
    """Variables of a side's process: so many threads, and memory as all others have it."""
    pools = {f"{pool}_NUM_THREADS": str(threads) for pool in POOLS}
    return dict(os.environ) | pools | KEEPS_MEMORY


def python_side(
    name: str, module: str, python: str, *, threads: int, patience_s: float, ours: bool = False
) -> Side:
    """A module of this folder in an interpreter; only ours sees where this package is."""
    environment = build_environment(threads) | {"PYTHONWARNINGS": "ignore"}
    path = os.environ.get("PYTHONPATH", "") if ours else ""
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(BENCHMARKS), path)))
    return Side(name, [python, "-m", "sides.worker", module], environment, patience_s)


class SideTimes(NamedTuple):
    """Times of one side: first call, and fastest call of each turn, s."""

    first_s: float
    turns_s: list[float]


def time_alternately(
    sides: list[Side], kind: str, inputs: dict[str, Path], n_turns: int, turn_s: float
) -> tuple[dict[str, SideTimes], dict[str, Absent]]:
    """Times of the sides that do a job, and why others do not.

    A side whose call takes above a second has three turns at most, above five seconds one.
    """
    times: dict[str, SideTimes] = {}
    absent: dict[str, Absent] = {}
    for side in sides:
        try:
            times[side.name] = SideTimes(side.ask("load", kind, str(inputs[side.name])), [])
        except Absent as why:
            absent[side.name] = why
    for turn in range(n_turns):
        for side in sides:
            if side.name not in times or turn >= max_turns(times[side.name].turns_s):
                continue
            try:
                times[side.name].turns_s.append(side.ask("turn", str(turn_s)))
            except Absent as why:
                del times[side.name]
                absent[side.name] = why
    return times, absent


def max_turns(spent_s: list[float]) -> float:
    if not spent_s or min(spent_s) < 1.0:
        return float("inf")
    return 1 if min(spent_s) > 5.0 else 3


def print_progress(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
