"""Overhead of running and storing trials, and limits of many workers.

Measured, warm, on this machine:

overhead    of the machinery, ms a trial: blocks of 50 trials of no work through one process, less
            nothing; the ledger alone, and the file system's fsync, below it. The bar is 0.2 ms.
two         trials/s of two workers over those of two processes that only work, with blocks of
            50 trials that compute for 5 ms each. The bar is 0.9.
dask        time of the same blocks by a scheduler and two workers on loopback over that of two
            local processes. The bar is 1.15.
tasks       blocks/s that the scheduler hands out and takes back, empty ones, by workers: what
            1,000 workers share.
bytes       of a block's result on the wire, by trials and columns.
million     1,000,000 finished trials in blocks of 50 and of 1, ten columns: seconds to open,
            list and add up; memory of the process.
start       s until the first block of a new pool is done.

Figures of pairs are medians of turns A B A B, so that they hold on a busy machine.

    python benchmarks/study_machinery.py [overhead two dask tasks bytes million start]
"""

import os
import pickle
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

import numpy as np

from dechirp.experiments.study.block import Block
from dechirp.experiments.study.executors import (
    Workers,
    dask_workers,
    local_workers,
    workers_from_executor,
)
from dechirp.experiments.study.ledger import Ledger
from dechirp.experiments.study.scheduler import run_missing_blocks
from dechirp.experiments.study.study import TrialBudget

BLOCK, COLUMNS = 50, 10


def compute_block(n_steps: int, point: int, number: int) -> Block:
    """Trials of so many steps of work each: transforms that fill a core."""
    rng = np.random.default_rng(number)
    x = np.ones(16384, np.complex128)
    for _ in range(BLOCK * n_steps):
        x = np.fft.fft(x) / 128
    sums = rng.random((BLOCK, COLUMNS)) + abs(x[0]) * 1e-300
    return Block(point, number, number * BLOCK, sums, 0.0)


def count_steps(seconds: float) -> int:
    """Estimate the number of steps that take the given time."""
    start = perf_counter()
    compute_block(10, 0, 0)
    return max(1, round(seconds / ((perf_counter() - start) / (10 * BLOCK))))


def study(workers: Workers, n_blocks: int, n_steps: int, n_points: int = 1) -> float:
    """Seconds that a study takes."""
    trials = TrialBudget(at_most=n_blocks // n_points * BLOCK, block=BLOCK)
    with tempfile.TemporaryDirectory() as folder:
        start = perf_counter()
        with Ledger.create_or_continue(Path(folder), identity={}, environment={}) as ledger:
            run_missing_blocks(
                compute_block,
                n_steps,
                n_points=n_points,
                trials=trials,
                ledger=ledger,
                workers=workers,
            )
        return perf_counter() - start


def overhead() -> None:
    n = 1000
    with local_workers(1) as workers:
        study(workers, 10, 0)
        process_times_s = [study(workers, n, 0) for _ in range(3)]
    with ThreadPoolExecutor(1) as executor, workers_from_executor(executor) as workers:
        in_thread = [study(workers, n, 0) for _ in range(3)]
    print(
        f"overhead: {1e3 * median(process_times_s) / n / BLOCK:.4f} ms a trial"
        " by a process (bar 0.2),"
    )
    print(f"          {1e3 * median(in_thread) / n / BLOCK:.4f} ms by a thread of this process")
    with tempfile.TemporaryDirectory() as folder:
        blocks = [compute_block(0, 0, number) for number in range(500)]
        with Ledger.create_or_continue(Path(folder), identity={}, environment={}) as ledger:
            start = perf_counter()
            for block in blocks:
                ledger.add_blocks([block])
            ledger_s = (perf_counter() - start) / len(blocks)
        with (Path(folder) / "file").open("wb") as file:
            start = perf_counter()
            for _ in range(200):
                file.write(bytes(4096))
                file.flush()
                os.fsync(file.fileno())
            sync = (perf_counter() - start) / 200
    print(
        f"          {1e3 * ledger_s:.2f} ms a block of it for the ledger; fsync {1e3 * sync:.2f} ms"
    )


def two() -> None:
    n_steps, n = count_steps(0.005), 24
    call = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from study_machinery import compute_block\n"
        "compute_block(0, 0, 0); print('ready', flush=True); sys.stdin.readline()\n"
        f"for number in range({n // 2}): compute_block({n_steps}, 0, number)"
    )

    def independent() -> float:
        pair = [
            subprocess.Popen(
                [sys.executable, "-c", call],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for _ in range(2)
        ]
        for process in pair:  # past imports
            assert process.stdout is not None
            process.stdout.readline()
        start = perf_counter()
        for process in pair:
            assert process.stdin is not None
            process.stdin.write("go\n")
            process.stdin.flush()
        for process in pair:
            process.communicate()
        return perf_counter() - start

    with local_workers(2) as workers:
        study(workers, 4, 0)
        ratios = [independent() / study(workers, n, n_steps) for _ in range(3)]
    print(f"two: {median(ratios):.3f} of two independent processes (bar 0.9), {sorted(ratios)}")


@contextmanager
def start_cluster(n_workers: int) -> Iterator[str]:
    """Address of a scheduler on loopback with so many workers."""
    with socket.socket() as port_socket:
        port_socket.bind(("127.0.0.1", 0))
        port = port_socket.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    module = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    call = [*module, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    python_path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "PYTHONPATH": python_path}
    processes = [subprocess.Popen([*call, "--no-dashboard", "--no-show"], env=env, **quiet)]
    call = [*module, "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    try:
        for _ in range(n_workers):
            processes.append(subprocess.Popen([*call, "--no-dashboard"], env=env, **quiet))
        yield address
    finally:
        for process in processes:
            process.kill()
            process.wait()


def loopback() -> None:
    n_steps, n = count_steps(0.005), 24
    with (
        start_cluster(2) as address,
        dask_workers(address, timeout_s=60) as dask_pool,
        local_workers(2) as local_pool,
    ):
        while dask_pool.capacity() < 2:
            pass
        for workers in (dask_pool, local_pool):
            study(workers, 8, 0)
        ratios = [study(dask_pool, n, n_steps) / study(local_pool, n, n_steps) for _ in range(3)]
        print(f"dask: {median(ratios):.3f} of the time of local (bar 1.15), {sorted(ratios)}")


def tasks() -> None:
    for n_workers in (1, 2):
        with start_cluster(n_workers) as address, dask_workers(address, timeout_s=60) as dask_pool:
            while dask_pool.capacity() < n_workers:
                pass
            study(dask_pool, 20, 0)
            n = 300
            seconds = median(study(dask_pool, n, 0) for _ in range(3))
            # As many out at once as 300 workers have: the scheduler is what is busy.
            oversized_pool = Workers(dask_pool.executor, lambda: 300)
            flooded = median(study(oversized_pool, n, 0) for _ in range(3))
            print(
                f"tasks: {n / seconds:.0f} blocks/s by {n_workers}, {n / flooded:.0f} with 900 out"
            )


def result_bytes() -> None:
    for trials, columns in ((1, 10), (50, 10), (50, 40), (500, 10)):
        block = Block(0, 0, 0, np.zeros((trials, columns)), 0.0)
        size = len(pickle.dumps(block, protocol=5))
        print(f"bytes: {size} of {trials} trials of {columns} columns")


def million() -> None:
    script = """
import resource, sys
from pathlib import Path
from time import perf_counter
from dechirp.experiments.study.ledger import Ledger
start = perf_counter()
with Ledger.open(Path(sys.argv[1]), identity={}, environment={}) as ledger:
    done = ledger.finished_blocks()
    total = sum(sums.sum(axis=0) for _, sums in ledger.iter_point_sums())
    ledger.count_failures()
used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
seconds = perf_counter() - start
print(f"million: {len(done)} blocks: {seconds:.2f} s (bar 5), {used:.2f} GiB (bar 1)")
"""
    n, n_points = 1_000_000, 100
    for size in (50, 1):
        with tempfile.TemporaryDirectory() as folder:
            rng = np.random.default_rng(1)
            with Ledger.create_or_continue(Path(folder), identity={}, environment={}) as ledger:
                for number in range(n // n_points // size):
                    ledger.add_blocks(
                        Block(point, number, number * size, rng.random((size, COLUMNS)), 0.1)
                        for point in range(n_points)
                    )
            subprocess.run([sys.executable, "-c", script, folder], check=True)


def start() -> None:
    for n_workers in (1, 2):
        begin = perf_counter()
        with local_workers(n_workers) as workers:
            study(workers, n_workers, 0)
            print(f"start: {perf_counter() - begin:.2f} s to the first blocks of {n_workers}")


PARTS: dict[str, Callable[[], None]] = {
    "overhead": overhead,
    "two": two,
    "dask": loopback,
    "tasks": tasks,
    "bytes": result_bytes,
    "million": million,
    "start": start,
}

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    import study_machinery  # by its name, so that workers find what they are sent

    compute_block = study_machinery.compute_block
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()
