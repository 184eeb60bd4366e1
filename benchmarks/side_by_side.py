"""Speed and accuracy of all jobs relative to plain code and other packages.

Sides: ours; plain, as one writes it with NumPy, SciPy, numba and FINUFFT; other packages, each in
a virtual environment of its own that is made where it is missing (pip must reach an index); and
GNU Octave with the chain of the report, a loop over cells. Each side is a process. All load the
same arrays, do the job once (imports and compilation), and then take turns A B C A B C, so that a
busy moment hits all. A turn is the fastest of the calls that fit into 50 ms, one at least; one
thread each. A ratio is the median over turns, with its quartiles. Sides that cannot run are
listed with the reason.

Accuracy: echoes, root mean square error of samples against the direct sum in double precision,
a common scale taken out; map, relative deviation of cells from double precision; detectors, false
alarms over design where the window fits and at the edges, on noise; directions, error over the
Cramer-Rao bound; clusters, adjusted Rand index; tracks, GOSPA.

Where another side is faster, the least time that bytes and operations take at the rates of this
machine, measured in the run, stands below the table.

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
parser.add_argument("--peers", default="all", help="all, none, or names with commas")
parser.add_argument("--jobs", default="", help="only jobs whose name contains this")
parser.add_argument("--threads", type=int, default=1)
parser.add_argument("--patience", type=float, default=20.0, help="seconds for a call of others")
parser.add_argument(
    "--environments", type=Path, default=Path.home() / ".cache" / "dechirp-side-by-side"
)
parser.add_argument("--json", type=Path)
parser.add_argument("--markdown", type=Path)
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


def peers() -> list[str]:
    every = [*environments.peer_names(), "octave"]
    if settings.peers in ("all", "none"):
        return every if settings.peers == "all" else []
    chosen = settings.peers.split(",")
    unknown = sorted(set(chosen) - set(every))
    if unknown:
        parser.error(f"no such peers: {', '.join(unknown)}; there are {', '.join(every)}")
    return chosen


def stored(inputs: dict[str, np.ndarray], folder: Path, sides: list[Side]) -> dict[str, Path]:
    """Inputs of a job as each side reads them."""
    arrays, matlab = folder / "inputs.npz", folder / "inputs.mat"
    np.savez(arrays, **inputs)
    if any(side.name == "octave" for side in sides):
        savemat(
            matlab, {k: v.astype(float) if v.dtype.kind in "iu" else v for k, v in inputs.items()}
        )
    return {side.name: matlab if side.name == "octave" else arrays for side in sides}


def judged(job: Job, side: Side, inputs: dict[str, np.ndarray], folder: Path) -> dict[str, float]:
    """Evaluate the accuracy of the last result of a side, or of its result for other inputs."""
    if job.judged_by is not None:
        inputs = job.judged_by()
        np.savez(folder / "judged.npz", **inputs)
        side.ask("load", job.kind, str(folder / "judged.npz"), patience_s=120.0)
    if side.name == "octave":
        side.ask("save", str(folder / "result.mat"))
        found = loadmat(folder / "result.mat")["mask"].astype(bool)
    else:
        side.ask("save", str(folder / "result.npy"))
        found = np.load(folder / "result.npy")
    return accuracy.ACCURACY_BY_KIND[job.kind](inputs, found)


def measured(job: Job, sides: list[Side], folder: Path, too_slow: set[str]) -> list[tables.Row]:
    """Rows of a job; sides that gave no answer join those that are too slow for its kind."""
    inputs = job.make()
    files = stored(inputs, folder, sides)
    times, absent = time_alternately(sides, job.kind, files, 5 if settings.quick else 15, TURN_S)
    rows = []
    for side in sides:
        if side.name in times:
            one = tables.build_row(
                job.name, side.name, times["ours"].turns_s, times[side.name].turns_s, job.n_items
            )
            try:
                one |= {"first_s": times[side.name].first_s}
                one |= {"accuracy": judged(job, side, inputs, folder)}
            except Absent as why:
                one |= {"accuracy": {}, "not_judged": str(why)}
            rows.append(one)
        else:
            rows.append({"job": job.name, "side": side.name, "absent": str(absent[side.name])})
            if isinstance(absent[side.name], NoAnswer):
                too_slow.add(side.name)
    return rows


def slower(job: Job, rows: list[tables.Row], rates: machine.Machine) -> list[str]:
    """Sides that are faster than ours, by three quarters of turns, and the limit of the machine."""
    ours_ms = next(row["ms"] for row in rows if row["side"] == "ours")
    n_bytes, n_operations, of = job.needs
    of_one = MinimumWork(n_bytes / job.n_items, n_operations / job.n_items, of)
    limit_s, what = machine.limit_s(of_one, rates)
    limit_ms = 1e3 * limit_s
    return [
        f"{job.name}: {row['side']} takes {row['ms']:.3g} ms, ours {ours_ms:.3g};"
        f" no code takes less than {limit_ms:.2g} ms here ({what})"
        + (f"; ours does also: {job.additional_work}" if job.additional_work else "")
        for row in rows
        if row.get("ratio_low", 0.0) > 1.0
    ]


def main() -> None:
    warnings.simplefilter("ignore", PhysicsWarning)
    rates = machine.measure_machine()
    print_progress("\n".join(tables.machine_lines(rates)))
    sides, missing, versions = available_sides.create_sides(
        peers(), settings.environments, threads=settings.threads, patience_s=settings.patience
    )
    rows: list[tables.Row] = []
    behind: list[str] = []
    too_slow: dict[str, set[str]] = {}
    with tempfile.TemporaryDirectory() as place:
        for job in jobs():
            if settings.jobs not in job.name:
                continue
            print_progress(job.name)
            slow = too_slow.setdefault(job.kind, set())
            passed_over = [
                {"job": job.name, "side": name, "absent": "not tried: no answer to a job before"}
                for name in sorted(slow)
            ]
            able = [
                side
                for side in sides
                if available_sides.can_do(side, job.kind) and side.name not in slow
            ]
            now = measured(job, able, Path(place), slow)
            rows += now + passed_over
            behind += slower(job, now, rates)
    for side in sides:
        side.end()
    rows += [{"job": "all", "side": name, "absent": why} for name, why in missing.items()]
    found = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "threads": settings.threads,
        "machine": rates,
        "versions": versions,
        "rows": rows,
        "slower": behind,
    }
    print(tables.plain_text(rows))
    print("\n".join(behind))
    if settings.json:
        settings.json.write_text(json.dumps(found, indent=1))
    if settings.markdown:
        settings.markdown.write_text(tables.markdown(found))


if __name__ == "__main__":
    main()
