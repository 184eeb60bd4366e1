"""Start-up time, run time and memory of the commands.

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
MAX_ROWS = 12
"""Rows of each table of imports and functions."""

Measurement = dict[str, object]


class ProcessRun(NamedTuple):
    """Time, peak memory and error output of one process."""

    seconds: float
    peak_bytes: float
    text: str
    """Text on standard error."""


def run_process(*command: str, folder: str, **environment: str) -> ProcessRun:
    """Run one, quietly; ends the script where it fails by more than a claim."""
    start = perf_counter()
    with (
        tempfile.TemporaryFile("w+") as error_file,
        subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, **environment},
            stdout=subprocess.DEVNULL,
            stderr=error_file,
        ) as running,
    ):
        _, status, usage = os.wait4(running.pid, 0)
        seconds = perf_counter() - start
        running.returncode = os.waitstatus_to_exitcode(status)
        error_file.seek(0)
        text = error_file.read()
    if running.returncode not in (0, 1):  # 1: a claim of `verify` is not shown by few trials
        raise SystemExit(f"{' '.join(command)} failed:\n{text}")
    return ProcessRun(seconds, usage.ru_maxrss * 1024.0, text)


def run_repeatedly(*command: str, folder: str) -> ProcessRun:
    """The median of five, after one that is not counted."""
    run_process(*command, folder=folder)
    runs = [run_process(*command, folder=folder) for _ in range(5)]
    return ProcessRun(median(run.seconds for run in runs), max(run.peak_bytes for run in runs), "")


def times(folder: str) -> Measurement:
    """Measure the commands and the import of their libraries."""
    works = {
        "import numpy": (sys.executable, "-c", "import numpy"),
        "import libraries": (sys.executable, "-c", LIBRARIES),
        **{name: (*DECHIRP, *words) for name, words in COMMANDS.items()},
    }
    runs = {name: run_repeatedly(*command, folder=folder) for name, command in works.items()}
    print(f"{'':20} {'s':>8} {'peak MB':>9}", file=sys.stderr)
    for name, ran in runs.items():
        print(f"{name:20} {ran.seconds:8.3f} {ran.peak_bytes / 1e6:9.0f}", file=sys.stderr)
    seconds = {name: ran.seconds for name, ran in runs.items()}
    ratios = {
        "help_over_numpy": seconds["--help"] / seconds["import numpy"],
        "run_less_2_s_over_libraries": (seconds["run"] - 2) / seconds["import libraries"],
    }
    for (name, ratio), bar in zip(ratios.items(), (3, 4), strict=True):
        print(f"{name}: {ratio:.2f}, at most {bar}", file=sys.stderr)
    return {
        **ratios,
        "s": seconds,
        "peak_mb": {name: ran.peak_bytes / 1e6 for name, ran in runs.items()},
    }


def memory(folder: str) -> Measurement:
    """Measure the additional peak memory of a large cube."""
    small = run_process(*DECHIRP, "run", "--quiet", folder=folder).peak_bytes
    large = run_process(*DECHIRP, "run", "--quiet", *LARGE, folder=folder).peak_bytes
    assert (Path(folder) / "large" / "report.html").exists()
    cubes = (large - small) / LARGE_BYTES
    print(f"memory_cubes: {cubes:.2f}, at most 3", file=sys.stderr)
    return {"memory_cubes": cubes, "small_mb": small / 1e6, "large_mb": large / 1e6}


class Import(NamedTuple):
    """A module, the time of its own lines, and with what it imports, s."""

    module: str
    own_s: float
    all_s: float


def parse_import_times(text: str) -> list[Import]:
    """Lines of `-X importtime`: microseconds of its own, of all, and the module."""
    rows = []
    for line in text.splitlines():
        label, _, rest = line.partition(":")
        if label == "import time" and "[us]" not in rest:
            own_us, total_us, module = rest.split("|")
            rows.append(Import(module.strip(), int(own_us) / 1e6, int(total_us) / 1e6))
    return rows


def sum_by_package(rows: list[Import]) -> dict[str, float]:
    """Seconds of the lines of each package's modules, most first."""
    seconds_by_package: dict[str, float] = {}
    for row in rows:
        package = row.module.partition(".")[0]
        seconds_by_package[package] = seconds_by_package.get(package, 0.0) + row.own_s
    return dict(sorted(seconds_by_package.items(), key=lambda pair: -pair[1]))


def imports(folder: str) -> Measurement:
    """Measure import times by package and module, including late imports."""
    import_times: Measurement = {}
    for name, words in COMMANDS.items():
        command = (sys.executable, "-X", "importtime", "-m", "dechirp", *words)
        run_process(*command, folder=folder)
        rows = parse_import_times(run_process(*command, folder=folder).text)
        packages = dict(list(sum_by_package(rows).items())[:MAX_ROWS])
        ours = sorted((r for r in rows if r.module.startswith("dechirp")), key=lambda r: -r.own_s)
        total = sum(row.own_s for row in rows)
        print(f"\n{name}: {len(rows)} modules, {total:.3f} s", file=sys.stderr)
        for package, seconds in packages.items():
            print(f"    {package:24} {1e3 * seconds:8.1f} ms", file=sys.stderr)
        print("  of ours, own lines and with what they import", file=sys.stderr)
        for row in ours[:MAX_ROWS]:
            print(
                f"    {row.module:40} {1e3 * row.own_s:8.1f} {1e3 * row.all_s:8.1f} ms",
                file=sys.stderr,
            )
        import_times[name] = {
            "modules": len(rows),
            "s": total,
            "packages_s": packages,
            "ours": {row.module: [row.own_s, row.all_s] for row in ours[:MAX_ROWS]},
        }
    return import_times


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


def first(folder: str) -> Measurement:
    """The first run on a machine, and the second."""
    with tempfile.TemporaryDirectory() as empty:
        command = (sys.executable, "-c", COMPILING)
        cold = run_process(*command, folder=folder, NUMBA_CACHE_DIR=empty)
        warm = run_process(*command, folder=folder, NUMBA_CACHE_DIR=empty)
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
    for name, seconds in list(spent.items())[:MAX_ROWS]:
        print(f"    {name:56} {seconds:6.2f} s", file=sys.stderr)
    return {
        "first_s": cold.seconds,
        "next_s": warm.seconds,
        "n_functions": len(compiled),
        "compile_s": spent,
    }


def factors(_folder: str) -> Measurement:
    """Measure the false-alarm factor of each detector with compiled kernels, uncached."""
    from dataclasses import replace

    import numpy as np

    import dechirp as dc
    from dechirp.processing.cfar.base import NoiseEstimator

    noise = dc.Chain().map_noise_statistics(dc.reference().radar)
    factor_times: Measurement = {}
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
        factor_times[kind] = {
            "one_s": seconds[0],
            "two_s": seconds[1],
            "error": cfar.false_alarm_probability_error(noise),
        }
        print(
            f"{kind:20} {seconds[0]:8.3f} {seconds[1]:15.3f}"
            f" {cfar.false_alarm_probability_error(noise):8.4f}",
            file=sys.stderr,
        )
    return factor_times


PARTS: dict[str, Callable[[str], Measurement]] = {
    part.__name__: part for part in (times, memory, imports, first, factors)
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    results = {}
    for name in options.parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            results[name] = PARTS[name](folder)
    if options.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
