"""Study whose trials are a few random numbers, to test the scheduler and ledger without a radar.

python tests/tiny_study.py OUT [--workers N] [--until] [--file-limit BYTES]
"""

import argparse
import hashlib
import sqlite3
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.experiments.study.block import Block, Failure
from dechirp.experiments.study.executors import Workers, local_workers, workers_from_executor
from dechirp.experiments.study.ledger import LEDGER_NAME, Ledger
from dechirp.experiments.study.scheduler import Progress, run_missing_blocks

IDENTITY = {"study": "seed: 1\ntrials: 400", "dechirp": "0.1.0"}
ENVIRONMENT = {"numpy": np.__version__}


@dataclass(frozen=True)
class TinyPlan:
    """Plan of points with increasing standard deviation; some trials of point 1 fail."""

    n_points: int = 4
    at_most: int = 403  # the last block is short
    block: int = 5
    fails: tuple[int, ...] = (17, 18, 222)
    pause_s: float = 0.0

    @property
    def trials(self) -> SimpleNamespace:
        return SimpleNamespace(at_most=self.at_most, block=self.block, until=None)


def run_tiny_block(tiny: TinyPlan, point: int, number: int) -> Block:
    """Return a block of normal numbers, three a trial, with standard deviation 1 + point."""
    time.sleep(tiny.pause_s)
    first = number * tiny.block
    numbers = range(first, min(first + tiny.block, tiny.at_most))
    sums = np.array(
        [
            (1 + point)
            * np.random.default_rng(np.random.SeedSequence(1, spawn_key=(t,))).normal(size=3)
            for t in numbers
        ]
    )
    failed = [t for t in numbers if point == 1 and t in tiny.fails]
    sums[[t - first for t in failed]] = np.nan
    finding = Finding(
        level="warning",
        setting=f"point {point}",
        value="a low value",
        expected="a high one",
        fix="raise it",
    )
    return Block(
        point,
        number,
        first,
        sums,
        0.0,
        tuple(Failure(t, f"ValueError: {t}") for t in failed),
        (finding,) if number == 0 else (),
        np.arange(3.0) + point if number == 0 else None,
    )


def is_mean_precise(sums: np.ndarray) -> bool:
    """Return whether the standard error of the first mean is below 0.2: for points 0 to 2."""
    first_numbers = sums[np.isfinite(sums[:, 0]), 0]
    return bool(len(first_numbers) > 1 and first_numbers.std() / np.sqrt(len(first_numbers)) < 0.2)


def run_tiny_study(
    out: Path, workers: Workers, tiny: TinyPlan | None = None, *, until: bool = False, **options
) -> list[Progress]:
    """Run or resume the study; return its progress reports."""
    tiny = tiny or TinyPlan()
    progress_reports: list[Progress] = []
    with Ledger.create_or_continue(out, identity=IDENTITY, environment=ENVIRONMENT) as ledger:
        run_missing_blocks(
            options.pop("work", run_tiny_block),
            tiny,
            n_points=tiny.n_points,
            trials=tiny.trials,
            ledger=ledger,
            workers=workers,
            enough=is_mean_precise if until else None,
            **{"progress": progress_reports.append, "stop_after_failures": 0.5, **options},
        )
    return progress_reports


def ledger_digest(out: Path) -> str:
    """Return the SHA-256 of all stored values in the order of trials, without run times."""
    digest = hashlib.sha256()
    connection = sqlite3.connect(out / LEDGER_NAME)
    for query in (
        "SELECT point, number, first, n_trials, sums FROM blocks ORDER BY point, number",
        "SELECT * FROM failures ORDER BY point, trial",
        "SELECT * FROM findings ORDER BY point",
        "SELECT * FROM theory ORDER BY point",
        "SELECT * FROM ended ORDER BY point",
    ):
        for row in connection.execute(query):
            digest.update(repr(row).encode())
    connection.close()
    return digest.hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--until", action="store_true")
    parser.add_argument("--file-limit", type=int)
    parser.add_argument("--pause", type=float, default=0.0)
    arguments = parser.parse_args()
    if arguments.file_limit:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (arguments.file_limit, arguments.file_limit))
    print("started", flush=True)
    try:
        if arguments.workers:
            with local_workers(arguments.workers) as workers:
                run_tiny_study(
                    arguments.out, workers, TinyPlan(pause_s=arguments.pause), until=arguments.until
                )
        else:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
                run_tiny_study(
                    arguments.out, workers, TinyPlan(pause_s=arguments.pause), until=arguments.until
                )
    except DechirpError as error:
        print(error)
        return 2
    except KeyboardInterrupt as interrupted:
        print(interrupted)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
