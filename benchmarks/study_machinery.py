"""Overhead of running and storing trials, and limits of many workers.

All parts run after imports and compilation:

overhead    Overhead per trial, ms: blocks of 50 empty trials in one worker process. The lines below
            it give the same for a thread, and the time of the ledger and of `fsync`. Bar: 0.2 ms.
two         Trials per second of two workers, divided by the rate of two independent processes, with
            blocks of 50 trials that compute for 5 ms each. Bar: 0.9.
dask        Time of the same blocks with a Dask scheduler and two workers on loopback, divided by
            the time of two local processes. Bar: 1.15.
tasks       Empty blocks per second that the Dask scheduler distributes and collects, with one and
            two workers. This rate limits large clusters, for example 1,000 workers.
bytes       Size of the serialised result of a block, by numbers of trials and columns.
million     1,000,000 finished trials in blocks of 50 and of 1, with ten columns: time to open, list
            and sum the ledger, and memory of the process. Bars: 5 s and 1 GiB.
start       Time until a new pool has finished its first block, s.

Ratios are medians of pairs that run alternately (A B A B), so they also hold on a busy machine.

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
    """Compute a block of trials with n_steps transforms each, which use one core fully."""
    rng = np.random.default_rng(number)
    x = np.ones(16384, np.complex128)
    for _ in range(BLOCK * n_steps):
        x = np.fft.fft(x) / 128
    sums = rng.random((BLOCK, COLUMNS)) + abs(x[0]) * 1e-300
    return Block(point, number, number * BLOCK, sums, 0.0)


def count_steps(seconds: float) -> int:
    """Estimate the number of steps per trial for a given time."""
    start = perf_counter()
    compute_block(10, 0, 0)
    return max(1, round(seconds / ((perf_counter() - start) / (10 * BLOCK))))


def run_study(workers: Workers, n_blocks: int, n_steps: int, n_points: int = 1) -> float:
    """Run a study; return its duration, s."""
    trial_budget = TrialBudget(at_most=n_blocks // n_points * BLOCK, block=BLOCK)
    with tempfile.TemporaryDirectory() as folder:
        start = perf_counter()
        with Ledger.create_or_continue(Path(folder), identity={}, environment={}) as ledger:
            run_missing_blocks(
                compute_block,
                n_steps,
                n_points=n_points,
                trials=trial_budget,
                ledger=ledger,
                workers=workers,
            )
        return perf_counter() - start


def measure_overhead() -> None:
    n = 1000
    with local_workers(1) as workers:
        run_study(workers, 10, 0)
        process_times_s = [run_study(workers, n, 0) for _ in range(3)]
    with ThreadPoolExecutor(1) as executor, workers_from_executor(executor) as workers:
        thread_times_s = [run_study(workers, n, 0) for _ in range(3)]
    print(
        f"overhead: {1e3 * median(process_times_s) / n / BLOCK:.4f} ms per trial"
        " in a worker process (bar 0.2),"
    )
    print(
        f"          {1e3 * median(thread_times_s) / n / BLOCK:.4f} ms in a thread of this process"
    )
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
            sync_s = (perf_counter() - start) / 200
    print(
        f"          {1e3 * ledger_s:.2f} ms per block for the ledger; fsync {1e3 * sync_s:.2f} ms"
    )


def measure_two_workers() -> None:
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
        for process in pair:  # waits for the imports
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
        run_study(workers, 4, 0)
        ratios = [independent() / run_study(workers, n, n_steps) for _ in range(3)]
    print(
        f"two: {median(ratios):.3f} times the rate of two independent processes (bar 0.9),"
        f" {sorted(ratios)}"
    )


@contextmanager
def start_cluster(n_workers: int) -> Iterator[str]:
    """Start a Dask scheduler with workers on loopback; yield its address."""
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


def measure_dask_loopback() -> None:
    n_steps, n = count_steps(0.005), 24
    with (
        start_cluster(2) as address,
        dask_workers(address, timeout_s=60) as dask_pool,
        local_workers(2) as local_pool,
    ):
        while dask_pool.capacity() < 2:
            pass
        for workers in (dask_pool, local_pool):
            run_study(workers, 8, 0)
        ratios = [
            run_study(dask_pool, n, n_steps) / run_study(local_pool, n, n_steps) for _ in range(3)
        ]
        print(
            f"dask: {median(ratios):.3f} times the time of local processes (bar 1.15),"
            f" {sorted(ratios)}"
        )


def measure_task_rate() -> None:
    for n_workers in (1, 2):
        with start_cluster(n_workers) as address, dask_workers(address, timeout_s=60) as dask_pool:
            while dask_pool.capacity() < n_workers:
                pass
            run_study(dask_pool, 20, 0)
            n = 300
            seconds = median(run_study(dask_pool, n, 0) for _ in range(3))
            # A pool that claims 300 workers has 900 blocks in flight: the scheduler is the limit.
            oversized_pool = Workers(dask_pool.executor, lambda: 300)
            flooded_s = median(run_study(oversized_pool, n, 0) for _ in range(3))
            print(
                f"tasks: {n / seconds:.0f} blocks/s with a pool of {n_workers},"
                f" {n / flooded_s:.0f} with 900 blocks in flight"
            )


def measure_result_size() -> None:
    for trials, columns in ((1, 10), (50, 10), (50, 40), (500, 10)):
        block = Block(0, 0, 0, np.zeros((trials, columns)), 0.0)
        size = len(pickle.dumps(block, protocol=5))
        print(f"bytes: {size} for {trials} trials with {columns} columns")


def measure_million_trials() -> None:
    script = """
import resource, sys
from pathlib import Path
from time import perf_counter
from dechirp.experiments.study.ledger import Ledger
start = perf_counter()
with Ledger.open(Path(sys.argv[1]), identity={}, environment={}) as ledger:
    finished = ledger.finished_blocks()
    total = sum(sums.sum(axis=0) for _, sums in ledger.iter_point_sums())
    ledger.count_failures()
used_gib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
seconds = perf_counter() - start
print(f"million: {len(finished)} blocks: {seconds:.2f} s (bar 5), {used_gib:.2f} GiB (bar 1)")
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


def measure_start() -> None:
    for n_workers in (1, 2):
        begin = perf_counter()
        with local_workers(n_workers) as workers:
            run_study(workers, n_workers, 0)
            elapsed_s = perf_counter() - begin
            print(f"start: {elapsed_s:.2f} s to the first blocks of a pool of {n_workers}")


PARTS: dict[str, Callable[[], None]] = {
    "overhead": measure_overhead,
    "two": measure_two_workers,
    "dask": measure_dask_loopback,
    "tasks": measure_task_rate,
    "bytes": measure_result_size,
    "million": measure_million_trials,
    "start": measure_start,
}

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    # Workers unpickle functions by module name, which must not be __main__.
    import study_machinery

    compute_block = study_machinery.compute_block
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()
