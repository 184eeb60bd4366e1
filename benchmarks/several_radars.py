"""Time of two radars in traffic relative to the simulated time, on one core for each radar.

The radars, with 3 x 4 antennas and 20 frames a second, are at the front corners of a car among 20
others on four lanes, most of them partly hidden. Each run simulates ten seconds: detections from
samples or drawn by the statistical sensor, clusters, fused tracks, and the comparison of both with
the true objects. The radars run one after the other in one process, after a short run that loads
compiled loops. The ratio is (processor time of the slower radar + that of the rest of the run) /
simulated time: below 1, two cores run faster than real time. The table gives the least of all runs,
since other processes only add to it.

    python benchmarks/several_radars.py [--seconds 10] [--repeats 3] [--kind statistical]
"""

import argparse
import os
import tempfile
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from time import process_time
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


def measure_ratio(path: Path, seconds: float, kind: Any) -> float:
    """Return the time of a run on one core for each radar, over the simulated time."""
    radars = "radars=[{mount: front-left}, {mount: front-right, start_offset: 20 ms}]"
    scenario = dc.traffic.traffic_scenario(
        path, ["traffic.ego=1", f"traffic.duration={seconds} s", radars]
    )
    executor = TimedExecutor()
    start_s = process_time()
    dc.fusion.run_radars(scenario, kind=kind, executor=executor)
    rest_s = process_time() - start_s - sum(executor.times_s)
    return (max(executor.times_s) + rest_s) / seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each kind")
    parser.add_argument("--kind", choices=KINDS, help="only this kind of detections")
    options = parser.parse_args()
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print("detections     least ratio  all ratios         required")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "traffic.csv"
        write_traffic(path, options.seconds)
        for kind, largest in KINDS.items():
            if options.kind not in (None, kind):
                continue
            measure_ratio(path, 0.5, kind)
            ratios = [measure_ratio(path, options.seconds, kind) for _ in range(options.repeats)]
            text = ", ".join(f"{ratio:.2f}" for ratio in ratios)
            print(f"{kind:13}  {min(ratios):11.2f}  {text:17}  {largest:.0f}", flush=True)


if __name__ == "__main__":
    main()
