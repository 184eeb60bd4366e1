"""A study whose trials are a few numbers of chance: what runs and keeps blocks needs no radar.

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
from dechirp.experiments.study.scheduler import Progress, run_blocks

IDENTITY = {"study": "seed: 1\ntrials: 400", "dechirp": "0.1.0"}
ENVIRONMENT = {"numpy": np.__version__}


@dataclass(frozen=True)
class Tiny:
    """Points of rising spread; some trials of point 1 fail."""

    n_points: int = 4
    at_most: int = 403  # the last block is short
    block: int = 5
    fails: tuple[int, ...] = (17, 18, 222)
    pause_s: float = 0.0

    @property
    def trials(self) -> SimpleNamespace:
        return SimpleNamespace(at_most=self.at_most, block=self.block, until=None)


def work(tiny: Tiny, point: int, number: int) -> Block:
    """Normal numbers of spread 1 + point, three a trial."""
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
    said = Finding(
        level="warning", setting=f"point {point}", value="so", expected="other", fix="Mend it."
    )
    return Block(
        point,
        number,
        first,
        sums,
        0.0,
        tuple(Failure(t, f"ValueError: {t}") for t in failed),
        (said,) if number == 0 else (),
        np.arange(3.0) + point if number == 0 else None,
    )


def enough(sums: np.ndarray) -> bool:
    """Whether the mean of the first numbers is known to 0.2: of points 0, 1, 2, not of 3."""
    of_first = sums[np.isfinite(sums[:, 0]), 0]
    return bool(len(of_first) > 1 and of_first.std() / np.sqrt(len(of_first)) < 0.2)


def run(
    out: Path, workers: Workers, tiny: Tiny | None = None, *, until: bool = False, **told
) -> list[Progress]:
    """Run it, or go on with it; what its progress said."""
    tiny = tiny or Tiny()
    said: list[Progress] = []
    with Ledger.open(out, identity=IDENTITY, environment=ENVIRONMENT) as ledger:
        run_blocks(
            told.pop("work", work),
            tiny,
            n_points=tiny.n_points,
            trials=tiny.trials,
            ledger=ledger,
            workers=workers,
            enough=enough if until else None,
            **{"progress": said.append, "stop_after_failures": 0.5, **told},
        )
    return said


def fingerprint(out: Path) -> str:
    """Of all that is kept, to the bit, in the order of the trials; not of how long it took."""
    found = hashlib.sha256()
    connection = sqlite3.connect(out / LEDGER_NAME)
    for query in (
        "SELECT point, number, first, n_trials, sums FROM blocks ORDER BY point, number",
        "SELECT * FROM failures ORDER BY point, trial",
        "SELECT * FROM findings ORDER BY point",
        "SELECT * FROM theory ORDER BY point",
        "SELECT * FROM ended ORDER BY point",
    ):
        for row in connection.execute(query):
            found.update(repr(row).encode())
    connection.close()
    return found.hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--until", action="store_true")
    parser.add_argument("--file-limit", type=int)
    parser.add_argument("--pause", type=float, default=0.0)
    told = parser.parse_args()
    if told.file_limit:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (told.file_limit, told.file_limit))
    print("started", flush=True)
    try:
        if told.workers:
            with local_workers(told.workers) as workers:
                run(told.out, workers, Tiny(pause_s=told.pause), until=told.until)
        else:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
                run(told.out, workers, Tiny(pause_s=told.pause), until=told.until)
    except DechirpError as error:
        print(error)
        return 2
    except KeyboardInterrupt as interrupted:
        print(interrupted)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
