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
# glibc keeps large arrays instead of returning them to the system. Otherwise this depends on the
# earlier allocations of a process: the plain frame of 12 channels took 3.9 ms or 6.1 ms.
MEMORY_SETTINGS = {"MALLOC_MMAP_THRESHOLD_": "1073741824", "MALLOC_TRIM_THRESHOLD_": "4294967296"}


class Absent(Exception):
    """A side cannot run a job; the message is the reason, in one line."""


class NoAnswer(Absent):
    """A side exceeded the time limit."""


class Side:
    """Process of a side that answers requests line by line; starts and restarts on demand."""

    def __init__(
        self, name: str, command: list[str], environment: dict[str, str], patience_s: float
    ) -> None:
        self.name, self.command, self.patience_s = name, command, patience_s
        self.environment = environment
        self.process: Process | None = None

    def ask(self, *fields: str, patience_s: float | None = None) -> float:
        """Send a request and return the answered number; raise `Absent` on failure or time-out."""
        patience_s = patience_s or self.patience_s
        self.process = self.process or Process(self.command, self.environment)
        try:
            answer = self.process.answer("\t".join(fields), patience_s)
        except queue.Empty:
            self.end()
            raise NoAnswer(f"no answer within {patience_s:g} s") from None
        if not answer:
            reason = self.process.error_message()
            self.end()
            raise Absent(reason)
        status, value = answer.rstrip("\n").split("\t", 1)
        if status != "ok":
            raise Absent(value)
        return float(value)

    def end(self) -> None:
        """Kill the process; the next request starts a new one."""
        if self.process is not None:
            self.process.end()
            self.process = None


class Process:
    """Child process; a thread reads its answers into a queue, because pipes have no time-out."""

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
        """Return the answer to a line, "" if the process has ended; `queue.Empty` on time-out."""
        assert self.child.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            # Octave returns a line only after it has received the next one, here an empty line.
            self.child.stdin.write(line + "\n\n")
            self.child.stdin.flush()
        return self.lines.get(timeout=patience_s)

    def error_message(self) -> str:
        """Wait for the end of the process; return its last line of errors, or its status."""
        status = self.child.wait()
        self.errors.seek(0)
        return (
            self.errors.read().strip().rpartition("\n")[2] or f"process ended with status {status}"
        )

    def end(self) -> None:
        """Kill the process, and close its pipes and files."""
        self.child.kill()
        self.child.wait()
        self.reader.join()
        with contextlib.suppress(BrokenPipeError):
            self.child.communicate()
        self.errors.close()


def build_environment(threads: int) -> dict[str, str]:
    """Build the environment variables of a side: number of threads and memory settings."""
    pools = {f"{pool}_NUM_THREADS": str(threads) for pool in POOLS}
    return dict(os.environ) | pools | MEMORY_SETTINGS


def python_side(
    name: str, module: str, python: str, *, threads: int, patience_s: float, ours: bool = False
) -> Side:
    """Create a side from a module; only dechirp and plain code inherit `PYTHONPATH`."""
    environment = build_environment(threads) | {"PYTHONWARNINGS": "ignore"}
    path = os.environ.get("PYTHONPATH", "") if ours else ""
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(BENCHMARKS), path)))
    return Side(name, [python, "-m", "sides.worker", module], environment, patience_s)


class SideTimes(NamedTuple):
    """Time of the first call of a side, and shortest time of each turn."""

    first_s: float
    turns_s: list[float]


def time_alternately(
    sides: list[Side], kind: str, inputs: dict[str, Path], n_turns: int, turn_s: float
) -> tuple[dict[str, SideTimes], dict[str, Absent]]:
    """Time all sides alternately; return times, and errors of sides that cannot run the job.

    A side runs at most three turns if its call takes more than 1 s, and one turn above 5 s.
    """
    times: dict[str, SideTimes] = {}
    absent: dict[str, Absent] = {}
    for side in sides:
        try:
            times[side.name] = SideTimes(side.ask("load", kind, str(inputs[side.name])), [])
        except Absent as error:
            absent[side.name] = error
    for turn in range(n_turns):
        for side in sides:
            if side.name not in times or turn >= max_turns(times[side.name].turns_s):
                continue
            try:
                times[side.name].turns_s.append(side.ask("turn", str(turn_s)))
            except Absent as error:
                del times[side.name]
                absent[side.name] = error
    return times, absent


def max_turns(spent_s: list[float]) -> float:
    if not spent_s or min(spent_s) < 1.0:
        return float("inf")
    return 1 if min(spent_s) > 5.0 else 3


def print_progress(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
