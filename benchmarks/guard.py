"""Regression guard: time relative to plain code, compared with the last release.

The guard measures the jobs of `side_by_side.py` that plain code also implements. dechirp and plain
code run alternately, so their ratio depends little on the load and the clock of the machine. Each
ratio is measured three times. A job fails if its ratio is more than 25 % above the ratio of the
release in two of the three measurements. Echoes are measured with ten targets only, because the
plain code for more targets depends on whether FINUFFT is installed.

`release/VERSION.json` contains the ratios of a release for each kind of processor on which they
were measured. They depend on it: by 40 % for the same echoes. On another kind, the guard shows
those of the first one, judges none, says so, and exits with the status 3. `added_work` lists jobs
that do more than at the release, with the accepted factor and its reason. `--write` measures the
ratios of this version and adds them; run it on an idle machine.

    python benchmarks/guard.py [--write]
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sides.jobs import Job

RELEASES = Path(__file__).with_name("release")
MAX_SLOWDOWN = 1.25
"""Largest accepted ratio relative to the release. Load changes medians by up to 10 %."""
REPEATS, MIN_SLOW_REPEATS = 3, 2
TURNS, TURN_S = 9, 0.05
NOT_COMPARED = 3
"""Exit status where the release was not measured on this kind of processor."""

Ratios = dict[str, float]


def find_slower_jobs(
    release: Ratios, repeats: list[Ratios], added_work: dict[str, dict[str, Any]] | None = None
) -> list[str]:
    """Return a message for each slower or missing job."""
    lines = []
    for job, release_ratio in release.items():
        if any(job not in ratios for ratios in repeats):
            lines.append(f"{job}: not measured; it was {release_ratio:.3g}")
            continue
        current_ratios = [ratios[job] for ratios in repeats]
        accepted_ratio = release_ratio * (added_work or {}).get(job, {"factor": 1.0})["factor"]
        n_slow = sum(ratio > MAX_SLOWDOWN * accepted_ratio for ratio in current_ratios)
        if n_slow >= MIN_SLOW_REPEATS:
            ratios_text = ", ".join(f"{ratio:.3g}" for ratio in current_ratios)
            lines.append(
                f"{job}: {ratios_text} of the time of plain code; it was {release_ratio:.3g}"
            )
    return lines


def load_last_release(folder: Path = RELEASES) -> dict[str, Any]:
    """Load the file of the highest version."""
    files = {tuple(map(int, file.stem.split("."))): file for file in folder.glob("*.json")}
    return dict(json.loads(files[max(files)].read_text(encoding="utf-8")))


def iter_guarded_jobs() -> Iterator["Job"]:
    """Iterate over the measured jobs."""
    from sides import plain
    from sides.jobs import echoes, jobs

    yield echoes(10)
    yield from (job for job in jobs() if job.kind != "echoes" and hasattr(plain, job.kind))


def measure_ratios() -> Ratios:
    """Measure the median ratio of dechirp to plain code for each job."""
    import numpy as np
    from sides import available_sides, tables
    from sides.side_processes import time_alternately

    sides, _, _ = available_sides.create_sides([], Path(), threads=1, patience_s=120.0)
    ratios = {}
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "inputs.npz"
            for job in iter_guarded_jobs():
                np.savez(file, **job.make())
                files = {side.name: file for side in sides}
                times, absent = time_alternately(sides, job.kind, files, TURNS, TURN_S)
                if absent:
                    raise SystemExit(f"{job.name}: {absent}")
                turns = (times[name].turns_s for name in ("ours", "plain"))
                ratios[job.name] = tables.build_row(job.name, "plain", *turns, job.n_items)["ratio"]
    finally:
        for side in sides:
            side.end()
    return ratios


def write_ratios(repeats: list[Ratios]) -> Path:
    """Write the median ratios to the release file of this version; return its path.

    Those of other kinds of processors, and the work added since the release, are kept.
    """
    import dechirp
    from dechirp.experiments.study.environment import versions_system_and_processor

    file = RELEASES / f"{dechirp.__version__}.json"
    environment = versions_system_and_processor()
    processor = environment.pop("processor")
    medians = {job: float(f"{median(ratios[job] for ratios in repeats):.4g}") for job in repeats[0]}
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    document = {
        "version": dechirp.__version__,
        "date": datetime.now(UTC).date().isoformat(),
        "environment": environment,
        "ratios": kept.get("ratios", {}) | {processor: medians},
        "added_work": kept.get("added_work", {}),
    }
    file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return file


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--write", action="store_true", help="store the ratios as those of this release"
    )
    options = parser.parse_args()
    repeats = [measure_ratios() for _ in range(REPEATS)]
    if options.write:
        print(write_ratios(repeats))
        return 0
    from dechirp.experiments.study.environment import versions_system_and_processor

    release, processor = load_last_release(), versions_system_and_processor()["processor"]
    measured_processor = (
        processor if processor in release["ratios"] else next(iter(release["ratios"]))
    )
    release_ratios = release["ratios"][measured_processor]
    print(f"{'dechirp / plain code':48} {release['version']:>8}   now")
    for job in release_ratios | repeats[0]:
        release_ratio = release_ratios.get(job)
        current_ratios = [f"{ratios[job]:8.3f}" for ratios in repeats if job in ratios]
        print(
            f"{job:48} {'new' if release_ratio is None else f'{release_ratio:8.3f}':>8}"
            f" {' '.join(current_ratios)}"
        )
    for job, added in release["added_work"].items():
        print(f"{job}: {added['factor']} times the ratio is accepted: {added['reason']}.")
    if measured_processor != processor:
        print(
            f"Nothing is compared: the release was not measured on this kind of processor,"
            f" {processor}. The ratios above are those of {measured_processor}."
        )
        return NOT_COMPARED
    lines = find_slower_jobs(release_ratios, repeats, release["added_work"])
    print("\n".join(lines) or "No job is more than 25 % above the ratio of the release.")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
