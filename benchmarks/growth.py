"""Exponents of time and memory over scatterers, chirps, channels, cells, detections and trials.

Each job runs at several sizes, on one thread, after compilation. Each of seven rounds times all
sizes, and a line fitted to the logarithms of times and sizes gives an exponent. The table shows:

law, exp.  complexity law, and its exponent fitted to the same sizes; about 1.1 for n log n
fitted     median exponent of the seven rounds
min, max   smallest and largest exponent; they enclose the true median with a probability of 98 %
end        exponent of the two largest sizes
ms         time at the largest size
peak MB    increase of the peak memory of the process during one call at the largest size (Linux)
mem. exp.  exponent of this increase over the two largest sizes, if it exceeds 1 MB

A job grows too fast if even its smallest exponent is more than 0.1 above the law. A constant part
of the time lowers the exponent.

    python benchmarks/growth.py [--job cfar] [--json] [--figure growth.svg]
"""

import argparse
import ctypes
import gc
import json
import os
import sys
import warnings
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import numpy as np

if TYPE_CHECKING:
    from growth_jobs import Job, Work

ROUNDS = 7
TOO_FAST = 0.1
"""Accepted excess over the exponent of the law, for the effect of caches and block sizes."""
SMALLEST_PEAK = 2**20

Measurement = dict[str, object]


def measure(job: "Job") -> Measurement:
    """Measure the exponents of a job, and compute the exponent of its law."""
    from growth_jobs import LAWS

    works = [job.make(n) for n in job.sizes]
    for work in works:
        work()
    calls = [int(np.clip(0.02 / time_once(work), 1, 7)) for work in works]
    rounds = np.array(
        [
            [min(time_once(work) for _ in range(n)) for work, n in zip(works, calls, strict=True)]
            for _ in range(ROUNDS)
        ]
    )
    sizes = np.array(job.sizes, float)
    slopes = sorted(fit_exponent(sizes, times) for times in rounds)
    expected = fit_exponent(sizes, LAWS[job.law](sizes)) if job.law != "1" else 0.0
    peaks = [measure_peak_bytes(work) for work in works[-2:]]
    return {
        "job": job.name,
        "along": job.growing_quantity,
        "law": job.law,
        "expected": expected,
        "exponent": median(slopes),
        "least": slopes[0],
        "largest": slopes[-1],
        "at_end": median(fit_exponent(sizes[-2:], times[-2:]) for times in rounds),
        "too_fast": slopes[0] > expected + TOO_FAST,
        "sizes": list(job.sizes),
        "ms": [1e3 * float(t) for t in rounds.min(axis=0)],
        "peak_mb": peaks[-1] / 1e6,
        "peak_exponent": fit_exponent(sizes[-2:], np.array(peaks))
        if min(peaks) > SMALLEST_PEAK
        else None,
    }


def fit_exponent(sizes: np.ndarray, values: np.ndarray) -> float:
    """Fit the slope of the logarithm of values over the logarithm of sizes."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def time_once(work: "Work") -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def measure_peak_bytes(work: "Work") -> float:
    """Measure the increase of the peak resident memory during a call; 0 without `/proc`."""
    clear, status = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    if not clear.exists():
        return 0.0
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # returns free memory, which the call could reuse unnoticed
    clear.write_text("5")  # resets the peak to the current resident memory
    resident_kb = _read_kilobytes(status, "VmRSS")
    work()
    return 1024.0 * max(_read_kilobytes(status, "VmHWM") - resident_kb, 0)


def _read_kilobytes(status: Path, name: str) -> int:
    (line,) = (line for line in status.read_text().splitlines() if line.startswith(name + ":"))
    return int(line.split()[1])


def format_row(row: Measurement) -> str:
    """Format a row of the table."""
    memory = "" if row["peak_exponent"] is None else f"{row['peak_exponent']:6.2f}"
    return (
        f"{row['job']:28} {row['along']:15} {row['law']:8} {row['expected']:5.2f}"
        f" {row['exponent']:6.2f} {row['least']:6.2f} {row['largest']:6.2f}"
        f" {row['at_end']:6.2f} {row['ms'][-1]:10.3f} {row['peak_mb']:8.1f} {memory:>9}"
        f" {'too fast' if row['too_fast'] else ''}"
    )


def draw_figure(rows: list[Measurement], file: Path) -> None:
    """Plot the ratio of time to law, normalised to the largest size; constant if the law holds."""
    from growth_jobs import LAWS
    from matplotlib.figure import Figure

    axes = list(dict.fromkeys(row["along"] for row in rows))
    n_rows = -(-len(axes) // 3)
    figure = Figure(figsize=(13, 3.4 * n_rows), layout="constrained")
    panels = figure.subplots(n_rows, 3, squeeze=False).flat
    for axis, panel in zip(axes, panels, strict=False):
        for row in (row for row in rows if row["along"] == axis):
            sizes = np.array(row["sizes"], float)
            time_over_law = np.array(row["ms"]) / LAWS[row["law"]](sizes)
            panel.loglog(
                sizes, time_over_law / time_over_law[-1], "o-", label=f"{row['job']} / {row['law']}"
            )
        panel.set_xlabel(axis)
        panel.set_ylabel("time / law, relative to largest size")
        panel.set_ylim(0.2, 20)
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7)
    for panel in panels:
        panel.set_visible(False)
    figure.savefig(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--job", default="", help="only jobs whose name contains this text")
    parser.add_argument("--json", action="store_true", help="also print the results as JSON")
    parser.add_argument("--figure", type=Path, help="file for a plot of time / law")
    options = parser.parse_args()
    from growth_jobs import jobs

    import dechirp as dc

    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print(
        f"{'job':28} {'over':15} {'law':8} {'exp.':>5} {'fitted':>6} {'min':>6} {'max':>6}"
        f" {'end':>6} {'ms':>10} {'peak MB':>8} {'mem. exp.':>9}",
        file=sys.stderr,
    )
    rows = []
    for job in jobs():
        if options.job in job.name:
            rows.append(measure(job))
            print(format_row(rows[-1]), file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps(rows))
    if options.figure:
        draw_figure(rows, options.figure)


if __name__ == "__main__":
    main()
