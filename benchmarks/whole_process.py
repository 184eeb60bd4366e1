"""How soon the commands are there, how long a run takes, and what memory it holds.

Whole processes. Times are medians of five after one that is not counted, compiled code cached,
each beside the import of the libraries it cannot do without, in the same minute.

times     `--help` over `python -c "import numpy"`, at most 3; `run` less 2 s over the import of its
          libraries, at most 4; `design`, `list` and a small `verify`; peak memory of each.
memory    peak of `dechirp run` on a cube of 288 MB over that on one of 2 MB, in cubes of the
          larger; at most 3.
imports   where the time of imports goes, by package and by module of ours, from
          `python -X importtime`.
first     `dechirp run` where nothing is compiled yet: its time, and the functions that take most
          of it, with what they call, by processor time.
factors   seconds for the false-alarm factor of each detector when its settings are new:
          complex samples of the reference radar, and a second receiver.

    python benchmarks/whole_process.py [times memory imports first factors] [--json]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import NamedTuple

LIBRARIES = (
    "import numpy, scipy.fft, scipy.special, scipy.optimize, numba, xarray, zarr, pydantic,"
    " ruamel.yaml, pint, matplotlib.figure, jinja2, cyclopts, rich.table"
)
DECHIRP = (sys.executable, "-m", "dechirp")
COMMANDS = {
    "--help": ("--help",),
    "run": ("run", "--quiet"),
    "design": ("design", "--max-range", "200m", "--range-resolution", "1m",
               "--max-velocity", "30 m/s"),
    "list": ("list",),
    "verify, 20 trials": ("verify", "--quiet", "--trials", "20"),
}  # fmt: skip
LARGE = ("--set", "radar.frame.n_chirps=16384", "--out", "large")
LARGE_BYTES = 2200 * 16384 * 8
SHOWN = 12
"""Rows of each table of imports and functions."""

Found = dict[str, object]


class Ran(NamedTuple):
    """What one process took."""

    seconds: float
    peak_bytes: float
    text: str
    """What it said on standard error."""


def process(*command: str, folder: str, **environment: str) -> Ran:
    """Run one, quietly; ends the script where it fails by more than a claim."""
    start = perf_counter()
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, **environment},
            stdout=subprocess.DEVNULL,
            stderr=said,
        ) as running,
    ):
        _, status, usage = os.wait4(running.pid, 0)
        seconds = perf_counter() - start
        running.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read()
    if running.returncode not in (0, 1):  # 1: a claim of `verify` is not shown by few trials
        raise SystemExit(f"{' '.join(command)} failed:\n{text}")
    return Ran(seconds, usage.ru_maxrss * 1024.0, text)


def repeated(*command: str, folder: str) -> Ran:
    """The median of five, after one that is not counted."""
    process(*command, folder=folder)
    runs = [process(*command, folder=folder) for _ in range(5)]
    return Ran(median(run.seconds for run in runs), max(run.peak_bytes for run in runs), "")


def times(folder: str) -> Found:
    """Of the commands, and of the libraries that they stand on."""
    works = {
        "import numpy": (sys.executable, "-c", "import numpy"),
        "import libraries": (sys.executable, "-c", LIBRARIES),
        **{name: (*DECHIRP, *words) for name, words in COMMANDS.items()},
    }
    found = {name: repeated(*command, folder=folder) for name, command in works.items()}
    print(f"{'':20} {'s':>8} {'peak MB':>9}", file=sys.stderr)
    for name, ran in found.items():
        print(f"{name:20} {ran.seconds:8.3f} {ran.peak_bytes / 1e6:9.0f}", file=sys.stderr)
    seconds = {name: ran.seconds for name, ran in found.items()}
    ratios = {
        "help_over_numpy": seconds["--help"] / seconds["import numpy"],
        "run_less_2_s_over_libraries": (seconds["run"] - 2) / seconds["import libraries"],
    }
    for (name, ratio), bar in zip(ratios.items(), (3, 4), strict=True):
        print(f"{name}: {ratio:.2f}, at most {bar}", file=sys.stderr)
    return {
        **ratios,
        "s": seconds,
        "peak_mb": {name: ran.peak_bytes / 1e6 for name, ran in found.items()},
    }


def memory(folder: str) -> Found:
    """What a large cube adds to the peak."""
    small = process(*DECHIRP, "run", "--quiet", folder=folder).peak_bytes
    large = process(*DECHIRP, "run", "--quiet", *LARGE, folder=folder).peak_bytes
    assert (Path(folder) / "large" / "report.html").exists()
    cubes = (large - small) / LARGE_BYTES
    print(f"memory_cubes: {cubes:.2f}, at most 3", file=sys.stderr)
    return {"memory_cubes": cubes, "small_mb": small / 1e6, "large_mb": large / 1e6}


class Import(NamedTuple):
    """A module, the time of its own lines, and with what it imports, s."""

    module: str
    own_s: float
    all_s: float


def imports_in(text: str) -> list[Import]:
    """Lines of `-X importtime`: microseconds of its own, of all, and the module."""
    rows = []
    for line in text.splitlines():
        label, _, rest = line.partition(":")
        if label == "import time" and "[us]" not in rest:
            own, every, module = rest.split("|")
            rows.append(Import(module.strip(), int(own) / 1e6, int(every) / 1e6))
    return rows


def by_package(rows: list[Import]) -> dict[str, float]:
    """Seconds of the lines of each package's modules, most first."""
    found: dict[str, float] = {}
    for row in rows:
        package = row.module.partition(".")[0]
        found[package] = found.get(package, 0.0) + row.own_s
    return dict(sorted(found.items(), key=lambda pair: -pair[1]))


def imports(folder: str) -> Found:
    """Where the time goes before a command does anything; imports that it makes later count."""
    found: Found = {}
    for name, words in COMMANDS.items():
        command = (sys.executable, "-X", "importtime", "-m", "dechirp", *words)
        process(*command, folder=folder)
        rows = imports_in(process(*command, folder=folder).text)
        packages = dict(list(by_package(rows).items())[:SHOWN])
        ours = sorted((r for r in rows if r.module.startswith("dechirp")), key=lambda r: -r.own_s)
        total = sum(row.own_s for row in rows)
        print(f"\n{name}: {len(rows)} modules, {total:.3f} s", file=sys.stderr)
        for package, seconds in packages.items():
            print(f"    {package:24} {1e3 * seconds:8.1f} ms", file=sys.stderr)
        print("  of ours, own lines and with what they import", file=sys.stderr)
        for row in ours[:SHOWN]:
            print(
                f"    {row.module:40} {1e3 * row.own_s:8.1f} {1e3 * row.all_s:8.1f} ms",
                file=sys.stderr,
            )
        found[name] = {
            "modules": len(rows),
            "s": total,
            "packages_s": packages,
            "ours": {row.module: [row.own_s, row.all_s] for row in ours[:SHOWN]},
        }
    return found


# Numba tells when it begins and ends to compile a function; functions that it calls come within.
COMPILING = """
import json, sys
from time import thread_time
from numba.core import event

class Listener(event.Listener):
    open, done = [], []
    def on_start(self, told):
        function = told.data["dispatcher"].py_func
        self.open.append((f"{function.__module__}.{function.__qualname__}", thread_time()))
    def on_end(self, told):
        name, start = self.open.pop()
        self.done.append((name, thread_time() - start, len(self.open)))

event.register("numba:compile", Listener())
from dechirp.cli.main import main
try:
    main(["run", "--quiet", "--out", "first"])
finally:
    print(json.dumps(Listener.done), file=sys.stderr)
"""


def first(folder: str) -> Found:
    """The first run on a machine, and the second."""
    with tempfile.TemporaryDirectory() as empty:
        command = (sys.executable, "-c", COMPILING)
        cold = process(*command, folder=folder, NUMBA_CACHE_DIR=empty)
        warm = process(*command, folder=folder, NUMBA_CACHE_DIR=empty)
    compiled = json.loads(cold.text.splitlines()[-1])
    spent: dict[str, float] = {}
    for name, seconds, depth in compiled:
        if depth == 0:
            spent[name] = spent.get(name, 0.0) + seconds
    spent = dict(sorted(spent.items(), key=lambda pair: -pair[1]))
    print(
        f"first run {cold.seconds:.1f} s, next {warm.seconds:.1f} s;"
        f" {len(compiled)} functions compiled in {sum(spent.values()):.1f} s of processor time",
        file=sys.stderr,
    )
    for name, seconds in list(spent.items())[:SHOWN]:
        print(f"    {name:56} {seconds:6.2f} s", file=sys.stderr)
    return {
        "first_s": cold.seconds,
        "next_s": warm.seconds,
        "n_functions": len(compiled),
        "compile_s": spent,
    }


def factors(_folder: str) -> Found:
    """Of each detector with its own settings, the kernels at hand but no factor known."""
    from dataclasses import replace

    import numpy as np

    import dechirp as dc
    from dechirp.processing.cfar.base import NoiseEstimator

    noise = dc.Chain().map_noise_statistics(dc.reference().radar)
    found: Found = {}
    print(f"{'':20} {'one':>8} {'two receivers':>15} {'error':>8}", file=sys.stderr)
    for kind, member in NoiseEstimator.members().items():
        cfar = dc.Cfar(estimator=member(), false_alarm_probability=1e-6)
        power = np.ones((128, 2200), np.float32)
        replace(cfar, false_alarm_probability=None, offset=10.0).threshold(power, noise)  # compiled
        seconds = []
        for n_channels in (1, 2):
            law = replace(noise, n_channels=n_channels)
            start = perf_counter()
            cfar.false_alarm_probability_error(law)
            seconds.append(perf_counter() - start)
        found[kind] = {
            "one_s": seconds[0],
            "two_s": seconds[1],
            "error": cfar.false_alarm_probability_error(noise),
        }
        print(
            f"{kind:20} {seconds[0]:8.3f} {seconds[1]:15.3f} {cfar.false_alarm_probability_error(noise):8.4f}",
            file=sys.stderr,
        )
    return found


PARTS: dict[str, Callable[[str], Found]] = {
    part.__name__: part for part in (times, memory, imports, first, factors)
}


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    arguments.add_argument("--json", action="store_true")
    asked = arguments.parse_args()
    if unknown := set(asked.parts) - set(PARTS):
        arguments.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    found = {}
    for name in asked.parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            found[name] = PARTS[name](folder)
    if asked.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
