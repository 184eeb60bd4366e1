"""Time of two radars in traffic relative to the simulated time, on two cores.

The radars, with 3 x 4 antennas and 20 frames a second, are at the front corners of a car among 20
others on four lanes, most of them partly hidden. Each run simulates ten seconds: detections from
samples or drawn by the statistical sensor, clusters, fused tracks, and the comparison of both with
the true objects. All times are divided by the simulated time: below 1, the run is faster than real
time. The table has the least of all runs, since other processes only add to it:

wall      elapsed time of the whole run with one process for each radar, their start included
CPU       processor time of these processes and of the run together
one core  processor time of the slower radar and of the rest of the run, where both radars run one
          after the other in one process: the wall time of two idle cores without start

    python benchmarks/several_radars.py [--seconds 10] [--repeats 3] [--kind statistical]
"""

import argparse
import os
import resource
import tempfile
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

for library in ("OMP", "OPENBLAS", "NUMBA"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import numpy as np

import dechirp as dc

KINDS = {"samples": 10.0, "statistical": 1.0}  # with the largest ratio that is required
STEP_S = 0.1
LANES_M = (-3.5, 0.0, 3.5, 7.0)


class TimedExecutor(Executor):
    """Executor that runs calls at once, and measures their processor times."""

    def __init__(self) -> None:
        self.times_s: list[float] = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        start_s = process_time()
        future: Future[Any] = Future()
        future.set_result(function(*args, **kwargs))
        self.times_s.append(process_time() - start_s)
        return future


def write_traffic(path: Path, seconds: float) -> None:
    """Write 20 cars on four lanes at about 25 m/s, and car 1 among them."""
    rng = np.random.default_rng(3)
    starts_m, speeds = np.linspace(-60, 90, 20), 25 + rng.normal(0, 2, 20)
    cars = [(1, 0.0, 0.0, 25.0)]
    for index, (x_m, speed) in enumerate(zip(starts_m, speeds, strict=True)):
        cars.append((index + 2, x_m, LANES_M[index % 4], speed))
    rows = ["time,id,class,x,y,heading,length,width,height"]
    rows += [
        f"{time_s:.1f},{number},car,{x_m + speed * time_s:.3f},{y_m},0,4.5,1.8,1.5"
        for number, x_m, y_m, speed in cars
        for time_s in np.arange(0, seconds + 1.5 * STEP_S, STEP_S)
    ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def build_scenario(path: Path, seconds: float) -> dc.Scenario:
    """Return the scenario of two corner radars on car 1."""
    radars = "radars=[{mount: front-left}, {mount: front-right, start_offset: 20 ms}]"
    return dc.traffic.traffic_scenario(
        path, ["traffic.ego=1", f"traffic.duration={seconds} s", radars]
    )


def measure_one_core_ratio(path: Path, seconds: float, kind: Any) -> float:
    """Return the processor time of the slower radar and of the rest, over the simulated time."""
    executor = TimedExecutor()
    start_s = process_time()
    dc.fusion.run_radars(build_scenario(path, seconds), kind=kind, executor=executor)
    rest_s = process_time() - start_s - sum(executor.times_s)
    return (max(executor.times_s) + rest_s) / seconds


def measure_wall_and_cpu_ratios(path: Path, seconds: float, kind: Any) -> tuple[float, float]:
    """Return elapsed and processor time of a run in processes, over the simulated time."""
    start_s, start_cpu_s = perf_counter(), _cpu_time_s()
    dc.fusion.run_radars(build_scenario(path, seconds), kind=kind)
    return (perf_counter() - start_s) / seconds, (_cpu_time_s() - start_cpu_s) / seconds


def _cpu_time_s() -> float:
    """Return the processor time of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each kind")
    parser.add_argument("--kind", choices=KINDS, help="only this kind of detections")
    options = parser.parse_args()
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print(f"{len(os.sched_getaffinity(0))} cores; all times over the simulated time")
    print("detections      wall   CPU  one core  required  wall of all runs")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "traffic.csv"
        write_traffic(path, options.seconds)
        for kind, largest in KINDS.items():
            if options.kind not in (None, kind):
                continue
            measure_one_core_ratio(path, 0.5, kind)  # loads compiled loops
            runs = [
                (
                    *measure_wall_and_cpu_ratios(path, options.seconds, kind),
                    measure_one_core_ratio(path, options.seconds, kind),
                )
                for _ in range(options.repeats)
            ]
            wall, cpu, one_core = (min(values) for values in zip(*runs, strict=True))
            text = ", ".join(f"{run[0]:.2f}" for run in runs)
            print(
                f"{kind:13} {wall:6.2f} {cpu:5.2f} {one_core:9.2f} {largest:9.0f}  {text}",
                flush=True,
            )


if __name__ == "__main__":
    main()
