"""Whether anything became slower than it was at the last release, beside plain code.

Jobs of `side_by_side.py` that plain code does too, ours and plain in turns: their ratio moves
little with the load and the clock of a machine. They are measured three times. A job fails whose
ratio is more than 25 % above that of the release in two of the three. Echoes are those of ten
targets: for more of them plain code is what is installed, FINUFFT or not.

`release/VERSION.json` holds the ratios of a release, with versions and processor; another kind of
processor may have others, and then that is told. `--write` measures them for this version; do it
on a machine where nothing else runs.

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
SLOWER = 1.25
"""Of the ratio of the release; busy machines move medians by a tenth."""
REPEATS, ENOUGH = 3, 2
TURNS, TURN_S = 9, 0.05

Ratios = dict[str, float]


def judged(release: Ratios, repeats: list[Ratios]) -> list[str]:
    """What is wrong, a line for each job; nothing where all is as it was."""
    lines = []
    for job, before in release.items():
        if any(job not in ratios for ratios in repeats):
            lines.append(f"{job}: not measured; it was {before:.3g}")
            continue
        now = [ratios[job] for ratios in repeats]
        if sum(ratio > SLOWER * before for ratio in now) >= ENOUGH:
            told = ", ".join(f"{ratio:.3g}" for ratio in now)
            lines.append(f"{job}: {told} of the time of plain code; it was {before:.3g}")
    return lines


def last_release(folder: Path = RELEASES) -> dict[str, Any]:
    """The file of the highest version."""
    files = {tuple(map(int, file.stem.split("."))): file for file in folder.glob("*.json")}
    return dict(json.loads(files[max(files)].read_text(encoding="utf-8")))


def guarded() -> Iterator["Job"]:
    """Jobs that are measured."""
    from sides import plain
    from sides.jobs import echoes, jobs

    yield echoes(10)
    yield from (job for job in jobs() if job.kind != "echoes" and hasattr(plain, job.kind))


def measured() -> Ratios:
    """Median over turns of the time of ours over that of plain code, of each job."""
    import numpy as np
    from sides import sides_of, told
    from sides.turns import interleaved

    sides, _, _ = sides_of.made([], Path(), threads=1, patience_s=120.0)
    found = {}
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "inputs.npz"
            for job in guarded():
                np.savez(file, **job.make())
                files = {side.name: file for side in sides}
                times, absent = interleaved(sides, job.kind, files, TURNS, TURN_S)
                if absent:
                    raise SystemExit(f"{job.name}: {absent}")
                turns = (times[name].turns_s for name in ("ours", "plain"))
                found[job.name] = told.row(job.name, "plain", *turns, job.each)["ratio"]
    finally:
        for side in sides:
            side.end()
    return found


def written(repeats: list[Ratios]) -> Path:
    """Keep the ratios as those of this version."""
    import dechirp
    from dechirp.experiments.study.environment import describe_environment

    file = RELEASES / f"{dechirp.__version__}.json"
    about = {
        "version": dechirp.__version__,
        "date": datetime.now(UTC).date().isoformat(),
        "environment": describe_environment(),
        "ratios": {
            job: float(f"{median(ratios[job] for ratios in repeats):.4g}") for job in repeats[0]
        },
    }
    file.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return file


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--write", action="store_true", help="keep them as those of a release")
    asked = arguments.parse_args()
    repeats = [measured() for _ in range(REPEATS)]
    if asked.write:
        print(written(repeats))
        return 0
    from dechirp.experiments.study.environment import describe_environment

    release = last_release()
    print(f"{'ours over plain':48} {release['version']:>8}   now")
    for job in release["ratios"] | repeats[0]:
        before = release["ratios"].get(job)
        now = [f"{ratios[job]:8.3f}" for ratios in repeats if job in ratios]
        print(f"{job:48} {'new' if before is None else f'{before:8.3f}':>8} {' '.join(now)}")
    lines = judged(release["ratios"], repeats)
    there, here = release["environment"]["processor"], describe_environment()["processor"]
    if lines and there != here:
        lines.append(f"The release was measured on another processor, {there}; this one is {here}.")
    print("\n".join(lines) or "Nothing is more than 25 % above.")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
