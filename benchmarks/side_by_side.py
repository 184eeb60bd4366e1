"""Speed and accuracy of all jobs relative to plain code and other packages.

Sides are implementations of a job:

ours       dechirp
plain      direct code with NumPy, SciPy, numba and FINUFFT
packages   other packages, each in its own virtual environment, which is created with pip if missing
octave     GNU Octave with the processing of the report, which loops over cells

Each side runs in its own process with one thread. All sides load the same arrays and run the job
once (imports and compilation). Then they run alternately (A B C A B C), so that other load affects
all of them. A turn repeats the call for 50 ms, at least once, and gives the shortest time. A ratio
is the median over turns, with its quartiles. Sides that cannot run are listed with the reason.

Accuracy by job:

echoes       RMSE of the samples relative to the direct sum in double precision, after removal of a
             common scale factor
maps         relative deviation of the cells from double precision
detectors    false-alarm rate in noise divided by its design value, in the middle and at the edges
directions   RMSE divided by the Cramer-Rao bound
clusters     adjusted Rand index
tracks       GOSPA

If another side is faster, a line below the table gives the minimum time of the job: the time that
its bytes and operations take at the rates of this machine, which are measured in the same run.

    python benchmarks/side_by_side.py [--quick] [--peers all|none|xwr,octave] [--jobs echoes]
        [--environments DIR] [--json FILE] [--markdown FILE]
"""

import argparse
import json
import os
import tempfile
import warnings
from datetime import UTC, datetime
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--quick", action="store_true", help="5 turns instead of 15")
parser.add_argument("--peers", default="all", help="all, none, or comma-separated names")
parser.add_argument("--jobs", default="", help="only jobs whose name contains this text")
parser.add_argument("--threads", type=int, default=1, help="threads of each side")
parser.add_argument(
    "--patience", type=float, default=20.0, help="time limit of a call of another package, s"
)
parser.add_argument(
    "--environments",
    type=Path,
    default=Path.home() / ".cache" / "dechirp-side-by-side",
    help="folder of the virtual environments",
)
parser.add_argument("--json", type=Path, help="file for the results as JSON")
parser.add_argument("--markdown", type=Path, help="file for the table as Markdown")
settings = parser.parse_args()
for pool in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
    os.environ[f"{pool}_NUM_THREADS"] = str(settings.threads)

import numpy as np
from scipy.io import loadmat, savemat
from sides import accuracy, available_sides, environments, machine, tables
from sides.jobs import Job, MinimumWork, jobs
from sides.side_processes import Absent, NoAnswer, Side, print_progress, time_alternately

from dechirp.core.findings import PhysicsWarning

TURN_S = 0.05


def selected_peers() -> list[str]:
    all_peers = [*environments.peer_names(), "octave"]
    if settings.peers in ("all", "none"):
        return all_peers if settings.peers == "all" else []
    selected = settings.peers.split(",")
    unknown = sorted(set(selected) - set(all_peers))
    if unknown:
        parser.error(
            f"--peers: unknown package: {', '.join(unknown)}; expected: {', '.join(all_peers)}"
        )
    return selected


def save_inputs(inputs: dict[str, np.ndarray], folder: Path, sides: list[Side]) -> dict[str, Path]:
    """Save the inputs of a job; return the file that each side reads."""
    arrays, matlab = folder / "inputs.npz", folder / "inputs.mat"
    np.savez(arrays, **inputs)
    if any(side.name == "octave" for side in sides):
        savemat(
            matlab, {k: v.astype(float) if v.dtype.kind in "iu" else v for k, v in inputs.items()}
        )
    return {side.name: matlab if side.name == "octave" else arrays for side in sides}


def measure_accuracy(
    job: Job, side: Side, inputs: dict[str, np.ndarray], folder: Path
) -> dict[str, float]:
    """Measure the accuracy of the last result of a side, or of a result for the accuracy inputs."""
    if job.make_accuracy_inputs is not None:
        inputs = job.make_accuracy_inputs()
        np.savez(folder / "accuracy.npz", **inputs)
        side.ask("load", job.kind, str(folder / "accuracy.npz"), patience_s=120.0)
    if side.name == "octave":
        side.ask("save", str(folder / "result.mat"))
        result = loadmat(folder / "result.mat")["mask"].astype(bool)
    else:
        side.ask("save", str(folder / "result.npy"))
        result = np.load(folder / "result.npy")
    return accuracy.ACCURACY_BY_KIND[job.kind](inputs, result)


def measure_job(job: Job, sides: list[Side], folder: Path, too_slow: set[str]) -> list[tables.Row]:
    """Measure the rows of a job; add sides that time out to `too_slow`."""
    inputs = job.make()
    files = save_inputs(inputs, folder, sides)
    times, absent = time_alternately(sides, job.kind, files, 5 if settings.quick else 15, TURN_S)
    rows = []
    for side in sides:
        if side.name in times:
            row = tables.build_row(
                job.name, side.name, times["ours"].turns_s, times[side.name].turns_s, job.n_items
            )
            try:
                row |= {"first_s": times[side.name].first_s}
                row |= {"accuracy": measure_accuracy(job, side, inputs, folder)}
            except Absent as error:
                row |= {"accuracy": {}, "not_judged": str(error)}
            rows.append(row)
        else:
            rows.append({"job": job.name, "side": side.name, "absent": str(absent[side.name])})
            if isinstance(absent[side.name], NoAnswer):
                too_slow.add(side.name)
    return rows


def describe_faster_sides(job: Job, rows: list[tables.Row], rates: machine.Machine) -> list[str]:
    """Describe the sides that are faster in three quarters of turns, and the minimum time."""
    ours_ms = next(row["ms"] for row in rows if row["side"] == "ours")
    n_bytes, n_operations, operation = job.minimum_work
    work_per_item = MinimumWork(n_bytes / job.n_items, n_operations / job.n_items, operation)
    limit_s, limiting_quantity = machine.limit_s(work_per_item, rates)
    limit_ms = 1e3 * limit_s
    return [
        f"{job.name}: {row['side']} takes {row['ms']:.3g} ms, dechirp {ours_ms:.3g} ms;"
        f" minimum on this machine {limit_ms:.2g} ms ({limiting_quantity})"
        + (f"; additional work of dechirp: {job.additional_work}" if job.additional_work else "")
        for row in rows
        if row.get("ratio_low", 0.0) > 1.0
    ]


def main() -> None:
    warnings.simplefilter("ignore", PhysicsWarning)
    rates = machine.measure_machine()
    print_progress("\n".join(tables.format_machine(rates)))
    sides, missing, versions = available_sides.create_sides(
        selected_peers(),
        settings.environments,
        threads=settings.threads,
        patience_s=settings.patience,
    )
    rows: list[tables.Row] = []
    faster_sides: list[str] = []
    too_slow: dict[str, set[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for job in jobs():
            if settings.jobs not in job.name:
                continue
            print_progress(job.name)
            slow_sides = too_slow.setdefault(job.kind, set())
            skipped_rows = [
                {
                    "job": job.name,
                    "side": name,
                    "absent": "not run: an earlier job timed out",
                }
                for name in sorted(slow_sides)
            ]
            able_sides = [
                side
                for side in sides
                if available_sides.can_do(side, job.kind) and side.name not in slow_sides
            ]
            job_rows = measure_job(job, able_sides, Path(folder), slow_sides)
            rows += job_rows + skipped_rows
            faster_sides += describe_faster_sides(job, job_rows, rates)
    for side in sides:
        side.end()
    rows += [{"job": "all", "side": name, "absent": reason} for name, reason in missing.items()]
    results = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "threads": settings.threads,
        "machine": rates,
        "versions": versions,
        "rows": rows,
        "slower": faster_sides,
    }
    print(tables.format_text(rows))
    print("\n".join(faster_sides))
    if settings.json:
        settings.json.write_text(json.dumps(results, indent=1))
    if settings.markdown:
        settings.markdown.write_text(tables.format_markdown(results))


if __name__ == "__main__":
    main()
