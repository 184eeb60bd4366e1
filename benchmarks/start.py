"""How soon the commands are there, how long a run takes, and what memory it holds.

Whole processes, compiled code cached, medians of five; each is set against the import of
the libraries it cannot do without, in the same minute.

help    `dechirp --help` over `python -c "import numpy"`; at most 3.
run     `dechirp run` less 2 s over the import of its libraries; at most 4.
memory  peak of `dechirp run` on a cube of 288 MB over that on one of 2 MB, in cubes of the
        larger; at most 3.

    python benchmarks/start.py
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

LIBRARIES = (
    "import numpy, scipy.fft, scipy.special, scipy.optimize, numba, xarray, zarr, pydantic,"
    " ruamel.yaml, pint, matplotlib.figure, jinja2, cyclopts, rich.table"
)


def process(*command: str, folder: str) -> tuple[float, float]:
    """Wall time, s, and peak memory, bytes, of one process."""
    start = perf_counter()
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL) as running:
        _, status, usage = os.wait4(running.pid, 0)
        running.returncode = os.waitstatus_to_exitcode(status)
    if running.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    return perf_counter() - start, usage.ru_maxrss * 1024.0


def time_s(*command: str, folder: str) -> float:
    """Median wall time of five processes, after one that is not counted."""
    process(*command, folder=folder)
    return median(process(*command, folder=folder)[0] for _ in range(5))


def main() -> None:
    dechirp = (sys.executable, "-m", "dechirp")
    large = ("--set", "radar.frame.n_chirps=16384", "--out", "large")
    with tempfile.TemporaryDirectory() as folder:
        numpy_s = time_s(sys.executable, "-c", "import numpy", folder=folder)
        help_s = time_s(*dechirp, "--help", folder=folder)
        libraries_s = time_s(sys.executable, "-c", LIBRARIES, folder=folder)
        run_s = time_s(*dechirp, "run", "--quiet", folder=folder)
        small_bytes = process(*dechirp, "run", "--quiet", folder=folder)[1]
        large_bytes = process(*dechirp, "run", "--quiet", *large, folder=folder)[1]
        assert (Path(folder) / "large" / "report.html").exists()
    cube_bytes = 2200 * 16384 * 8
    results = {
        "help_over_numpy": help_s / numpy_s,
        "run_less_2_s_over_libraries": (run_s - 2) / libraries_s,
        "memory_cubes": (large_bytes - small_bytes) / cube_bytes,
        "help_s": help_s,
        "numpy_s": numpy_s,
        "run_s": run_s,
        "libraries_s": libraries_s,
    }
    print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
