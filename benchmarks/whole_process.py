"""Start-up time, run time and memory of the commands.

Each command runs in a new process. Compiled code is cached. A time is the median of five runs after
one warm-up run. Times are divided by the import time of the required libraries, measured in the
same minute.

times     Time of `--help` divided by `python -c "import numpy"`, at most 3. Time of `run` minus
          2 s, divided by the import of its libraries, at most 4. Times of `design`, `list` and a
          short `verify`. Peak memory of each.
memory    Additional peak memory of `dechirp run` with a cube of 288 MB, compared with a cube of
          2 MB, in multiples of the larger cube; at most 3.
imports   Import times by package, and by module of dechirp, from `python -X importtime`.
first     Processor time of the first `run` after an installation, at most 6 s, of the next one, at
          most 2.5 s, and of `list`, at most 1 s: cold with empty caches of compiled code, factors
          and fonts, then warm. And of a run of 20 frames, which compiles, with the functions that
          take the most processor time to compile, including the functions that they call.
factors   Time to compute the false-alarm factor of each detector for new settings: complex samples
          of the reference radar with one and with two receivers.

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
COMPILE_MODULES = "import compileall, dechirp; compileall.compile_dir(*dechirp.__path__, quiet=1)"
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
"""Largest number of rows in the tables of imports and functions."""

Measurement = dict[str, object]


class ProcessRun(NamedTuple):
    """Time, peak memory and standard error of one process."""

    seconds: float
    peak_bytes: float
    text: str
    """Text on standard error."""
    cpu_s: float = 0.0
    """Processor time, of the user and of the system."""


def run_process(*command: str, folder: str, **environment: str) -> ProcessRun:
    """Run a command; exit the script if it fails, except for a failed claim (status 1)."""
    start = perf_counter()
    with (
        tempfile.TemporaryFile("w+") as error_file,
        subprocess.Popen(
            command,
            cwd=folder,
            # Modules are compiled once, as pip compiles them when it installs a package.
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", **environment},
            stdout=subprocess.DEVNULL,
            stderr=error_file,
        ) as running,
    ):
        _, status, usage = os.wait4(running.pid, 0)
        seconds = perf_counter() - start
        running.returncode = os.waitstatus_to_exitcode(status)
        error_file.seek(0)
        text = error_file.read()
    if running.returncode not in (0, 1):  # 1: too few trials to confirm a claim of `verify`
        raise SystemExit(f"{' '.join(command)} failed:\n{text}")
    cpu_s = usage.ru_utime + usage.ru_stime
    return ProcessRun(seconds, usage.ru_maxrss * 1024.0, text, cpu_s)


def run_repeatedly(*command: str, folder: str) -> ProcessRun:
    """Return the median time and peak memory of five runs, after one warm-up run."""
    run_process(*command, folder=folder)
    runs = [run_process(*command, folder=folder) for _ in range(5)]
    return ProcessRun(median(run.seconds for run in runs), max(run.peak_bytes for run in runs), "")


def measure_commands(folder: str) -> Measurement:
    """Measure the commands and the import of their libraries."""
    commands = {
        "import numpy": (sys.executable, "-c", "import numpy"),
        "import libraries": (sys.executable, "-c", LIBRARIES),
        **{name: (*DECHIRP, *words) for name, words in COMMANDS.items()},
    }
    runs = {name: run_repeatedly(*command, folder=folder) for name, command in commands.items()}
    print(f"{'':20} {'s':>8} {'peak MB':>9}", file=sys.stderr)
    for name, run in runs.items():
        print(f"{name:20} {run.seconds:8.3f} {run.peak_bytes / 1e6:9.0f}", file=sys.stderr)
    seconds = {name: run.seconds for name, run in runs.items()}
    ratios = {
        "help_over_numpy": seconds["--help"] / seconds["import numpy"],
        "run_less_2_s_over_libraries": (seconds["run"] - 2) / seconds["import libraries"],
    }
    for (name, ratio), bar in zip(ratios.items(), (3, 4), strict=True):
        print(f"{name}: {ratio:.2f}, at most {bar}", file=sys.stderr)
    return {
        **ratios,
        "s": seconds,
        "peak_mb": {name: run.peak_bytes / 1e6 for name, run in runs.items()},
    }


def measure_memory(folder: str) -> Measurement:
    """Measure the additional peak memory of a large cube."""
    small = run_process(*DECHIRP, "run", "--quiet", folder=folder).peak_bytes
    large = run_process(*DECHIRP, "run", "--quiet", *LARGE, folder=folder).peak_bytes
    assert (Path(folder) / "large" / "report.html").exists()
    cubes = (large - small) / LARGE_BYTES
    print(f"memory_cubes: {cubes:.2f}, at most 3", file=sys.stderr)
    return {"memory_cubes": cubes, "small_mb": small / 1e6, "large_mb": large / 1e6}


class Import(NamedTuple):
    """Import times of a module: its own, and including the modules that it imports."""

    module: str
    own_s: float
    all_s: float


def parse_import_times(text: str) -> list[Import]:
    """Parse the lines of `-X importtime`: own and cumulative microseconds, and module name."""
    rows = []
    for line in text.splitlines():
        label, _, rest = line.partition(":")
        if label == "import time" and "[us]" not in rest:
            own_us, total_us, module = rest.split("|")
            rows.append(Import(module.strip(), int(own_us) / 1e6, int(total_us) / 1e6))
    return rows


def sum_by_package(rows: list[Import]) -> dict[str, float]:
    """Sum the own import times by package, in seconds, in descending order."""
    seconds_by_package: dict[str, float] = {}
    for row in rows:
        package = row.module.partition(".")[0]
        seconds_by_package[package] = seconds_by_package.get(package, 0.0) + row.own_s
    return dict(sorted(seconds_by_package.items(), key=lambda pair: -pair[1]))


def measure_imports(folder: str) -> Measurement:
    """Measure import times by package and module, including imports during the run."""
    import_times: Measurement = {}
    for name, words in COMMANDS.items():
        command = (sys.executable, "-X", "importtime", "-m", "dechirp", *words)
        run_process(*command, folder=folder)
        rows = parse_import_times(run_process(*command, folder=folder).text)
        packages = dict(list(sum_by_package(rows).items())[:MAX_ROWS])
        dechirp_rows = sorted(
            (r for r in rows if r.module.startswith("dechirp")), key=lambda r: -r.own_s
        )
        total = sum(row.own_s for row in rows)
        print(f"\n{name}: {len(rows)} modules, {total:.3f} s", file=sys.stderr)
        for package, seconds in packages.items():
            print(f"    {package:24} {1e3 * seconds:8.1f} ms", file=sys.stderr)
        print("  modules of dechirp: own time, cumulative time", file=sys.stderr)
        for row in dechirp_rows[:MAX_ROWS]:
            print(
                f"    {row.module:40} {1e3 * row.own_s:8.1f} {1e3 * row.all_s:8.1f} ms",
                file=sys.stderr,
            )
        import_times[name] = {
            "modules": len(rows),
            "s": total,
            "packages_s": packages,
            "ours": {row.module: [row.own_s, row.all_s] for row in dechirp_rows[:MAX_ROWS]},
        }
    return import_times


# numba emits an event at the start and the end of each compilation. Events of called functions
# are nested.
COMPILING = """
import json, sys
from time import thread_time
from numba.core import event

class Listener(event.Listener):
    running, finished = [], []
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        self.running.append((f"{function.__module__}.{function.__qualname__}", thread_time()))
    def on_end(self, event):
        name, start = self.running.pop()
        self.finished.append((name, thread_time() - start, len(self.running)))

event.register("numba:compile", Listener())
from dechirp.cli.main import main
try:
    main(["run", "--quiet", "--out", "first", "--set", "n_frames=20"])
finally:
    print(json.dumps(Listener.finished), file=sys.stderr)
"""


def measure_first_run(folder: str) -> Measurement:
    """Measure the first commands with empty caches, Python of the README, and one that compiles."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    commands = {name: (*DECHIRP, *COMMANDS[name]) for name in ("run", "list")}
    commands["README"] = (sys.executable, "-c", readme.split("```python\n")[1].split("```")[0])
    run_process(sys.executable, "-c", COMPILE_MODULES, folder=folder)
    cpu_s: dict[str, float] = {}
    for name, command in commands.items():
        with tempfile.TemporaryDirectory() as cache_folder:
            caches = ("NUMBA_CACHE_DIR", "DECHIRP_CACHE_DIR", "MPLCONFIGDIR")
            environment = {variable: f"{cache_folder}/{variable}" for variable in caches}
            for state in ("cold", "warm"):
                run = run_process(*command, folder=folder, **environment)
                cpu_s[f"{name}, {state}"] = run.cpu_s
    for name, seconds in cpu_s.items():
        print(f"{name:12} {seconds:6.2f} s of processor time", file=sys.stderr)
    with tempfile.TemporaryDirectory() as cache_folder:
        command = (sys.executable, "-c", COMPILING)
        first_run = run_process(*command, folder=folder, NUMBA_CACHE_DIR=cache_folder)
        second_run = run_process(*command, folder=folder, NUMBA_CACHE_DIR=cache_folder)
    compiled = json.loads(first_run.text.splitlines()[-1])
    compile_times: dict[str, float] = {}
    for name, seconds, depth in compiled:
        if depth == 0:
            compile_times[name] = compile_times.get(name, 0.0) + seconds
    compile_times = dict(sorted(compile_times.items(), key=lambda pair: -pair[1]))
    print(
        f"20 frames: first run {first_run.seconds:.1f} s, second run {second_run.seconds:.1f} s;"
        f" {len(compiled)} functions compiled in {sum(compile_times.values()):.1f} s"
        " of processor time",
        file=sys.stderr,
    )
    for name, seconds in list(compile_times.items())[:MAX_ROWS]:
        print(f"    {name:56} {seconds:6.2f} s", file=sys.stderr)
    return {
        "cpu_s": cpu_s,
        "first_s": first_run.seconds,
        "next_s": second_run.seconds,
        "n_functions": len(compiled),
        "compile_s": compile_times,
    }


def measure_factors(_folder: str) -> Measurement:
    """Measure the time to compute the false-alarm factor of each detector, after compilation."""
    from dataclasses import replace

    import numpy as np

    import dechirp as dc
    from dechirp.processing.cfar.base import NoiseEstimator, calibrate_row_factors

    noise = dc.Chain().map_noise_statistics(dc.reference().radar)
    factor_times: Measurement = {}
    print(f"{'':20} {'1 rx, s':>8} {'2 rx, s':>15} {'error':>8}", file=sys.stderr)
    for kind, member in NoiseEstimator.members().items():
        cfar = dc.Cfar(estimator=member(), false_alarm_probability=1e-6)
        power = np.ones((128, 2200), np.float32)
        replace(cfar, false_alarm_probability=None, offset=10.0).threshold(power, noise)  # compiles
        seconds, errors = [], []
        for n_channels in (1, 2):
            law = replace(noise, n_channels=n_channels)
            start = perf_counter()
            errors.append(calibrate_row_factors(cfar, law).relative_error)
            seconds.append(perf_counter() - start)
        factor_times[kind] = {
            "one_s": seconds[0],
            "two_s": seconds[1],
            "error": errors[0],
        }
        print(
            f"{kind:20} {seconds[0]:8.3f} {seconds[1]:15.3f} {errors[0]:8.4f}",
            file=sys.stderr,
        )
    return factor_times


PARTS: dict[str, Callable[[str], Measurement]] = {
    "times": measure_commands,
    "memory": measure_memory,
    "imports": measure_imports,
    "first": measure_first_run,
    "factors": measure_factors,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    parser.add_argument("--json", action="store_true", help="also print the results as JSON")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"unknown part: {', '.join(unknown)}; expected: {', '.join(PARTS)}")
    results = {}
    for name in options.parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            results[name] = PARTS[name](folder)
    if options.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
