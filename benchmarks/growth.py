"""Exponents of time and memory over scatterers, chirps, channels, cells, detections and trials.

Each job runs at several sizes, one thread, warm. In each of seven rounds all sizes take turns,
and a line through their times, both logarithmic, gives an exponent. Shown are the median of the
rounds and the least and largest, which hold the true median in 98 % of cases; the exponent from
the largest two sizes alone; and that of the law, fitted to the same sizes: n log n is 1.1 or so.
A job grows too fast where even the least is more than 0.1 above the law. A smaller exponent is a
constant part.

Memory: what the peak of the process grew by during one call at the largest size (Linux), and its
exponent over the largest two, where it is more than 1 MB.

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
"""Over the law: what caches and blocks do to an exponent."""
SMALLEST_PEAK = 2**20

Measurement = dict[str, object]


def measure(job: "Job") -> Measurement:
    """Measure the exponents of a job with intervals, and compute that of its law."""
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
    slopes = sorted(exponent(sizes, times) for times in rounds)
    expected = exponent(sizes, LAWS[job.law](sizes)) if job.law != "1" else 0.0
    peaks = [peak_bytes(work) for work in works[-2:]]
    return {
        "job": job.name,
        "along": job.along,
        "law": job.law,
        "expected": expected,
        "exponent": median(slopes),
        "least": slopes[0],
        "largest": slopes[-1],
        "at_end": median(exponent(sizes[-2:], times[-2:]) for times in rounds),
        "too_fast": slopes[0] > expected + TOO_FAST,
        "sizes": list(job.sizes),
        "ms": [1e3 * float(t) for t in rounds.min(axis=0)],
        "peak_mb": peaks[-1] / 1e6,
        "peak_exponent": exponent(sizes[-2:], np.array(peaks))
        if min(peaks) > SMALLEST_PEAK
        else None,
    }


def exponent(sizes: np.ndarray, values: np.ndarray) -> float:
    """Fit the slope of a line through the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def time_once(work: "Work") -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def peak_bytes(work: "Work") -> float:
    """Measure the growth of peak resident memory during a call; 0 if the system has no data."""
    clear, status = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    if not clear.exists():
        return 0.0
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # or what is free already would not be seen to be taken
    clear.write_text("5")  # the peak becomes what is held now
    resident_kb = _kilobytes(status, "VmRSS")
    work()
    return 1024.0 * max(_kilobytes(status, "VmHWM") - resident_kb, 0)


def _kilobytes(status: Path, name: str) -> int:
    (line,) = (line for line in status.read_text().splitlines() if line.startswith(name + ":"))
    return int(line.split()[1])


def format_row(row: Measurement) -> str:
    """Format a row of the table."""
    memory = "" if row["peak_exponent"] is None else f"{row['peak_exponent']:6.2f}"
    return (
        f"{row['job']:28} {row['along']:15} {row['law']:8} {row['expected']:5.2f}"
        f" {row['exponent']:6.2f} {row['least']:6.2f} {row['largest']:6.2f}"
        f" {row['at_end']:6.2f} {row['ms'][-1]:10.3f} {row['peak_mb']:8.1f} {memory:6}"
        f" {'too fast' if row['too_fast'] else ''}"
    )


def draw_figure(rows: list[Measurement], file: Path) -> None:
    """Plot time over law, normalised to the largest size; constant for expected growth."""
    from growth_jobs import LAWS
    from matplotlib.figure import Figure

    axes = list(dict.fromkeys(row["along"] for row in rows))
    n_rows = -(-len(axes) // 3)
    figure = Figure(figsize=(13, 3.4 * n_rows), layout="constrained")
    panels = figure.subplots(n_rows, 3, squeeze=False).flat
    for panel, axis in zip(panels, axes, strict=False):
        for row in (row for row in rows if row["along"] == axis):
            sizes = np.array(row["sizes"], float)
            time_over_law = np.array(row["ms"]) / LAWS[row["law"]](sizes)
            panel.loglog(
                sizes, time_over_law / time_over_law[-1], "o-", label=f"{row['job']} / {row['law']}"
            )
        panel.set_xlabel(axis)
        panel.set_ylabel("time over law, of the largest")
        panel.set_ylim(0.2, 20)
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7)
    for panel in panels:
        panel.set_visible(False)
    figure.savefig(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--job", default="", help="part of its name")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    from growth_jobs import jobs

    import dechirp as dc

    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print(
        f"{'job':28} {'along':15} {'law':8} {'of it':>5} {'fitted':>6} {'least':>6} {'most':>6}"
        f" {'end':>6} {'ms':>10} {'peak MB':>8} {'grows':>6}",
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
