"""Processor time of a step of `SensorModel` behind 20 cars.

The host drives at 15 m/s; 20 cars on four lanes, 8 to 72 m ahead, drive at 10 to 14 m/s. The radar
is the default of traffic files, with 3 x 4 antennas and 384 chirps of 256 samples, at the front of
the host, with the tracker of a radar alone. The views are 50 ms apart. After three steps that load
compiled loops and start tracks, the table gives the least and the median of the next ones, on one
thread: other processes only add to them.

    python benchmarks/co_simulation.py [--steps 16]
"""

import argparse
import os
import warnings
from collections.abc import Iterator
from time import process_time
from typing import Any

for library in ("OMP", "OPENBLAS", "NUMBA"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import numpy as np
from osi3.osi_sensorview_pb2 import SensorView

import dechirp as dc

LANES_M = (-5.25, -3.5, 1.9, 5.4)
STEP_S = 0.05


def iter_cars(time_s: float) -> Iterator[tuple[int, float, float, float]]:
    """Yield number, x, y and speed of the host, which is car 1, and of the cars ahead."""
    yield 1, 15.0 * time_s, 0.0, 15.0
    for index in range(20):
        speed = 10.0 + index % 5
        yield index + 2, 8.0 + 16.0 * (index // 4) + speed * time_s, LANES_M[index % 4], speed


def make_view(step: int) -> Any:
    """Return the message of one step."""
    view = SensorView()
    view.timestamp.nanos, view.host_vehicle_id.value = round(step * STEP_S * 1e9), 1
    for number, x_m, y_m, speed in iter_cars(step * STEP_S):
        item = view.global_ground_truth.moving_object.add()
        item.id.value, item.type = number, item.TYPE_VEHICLE
        base = item.base
        base.position.x, base.position.y, base.position.z = x_m, y_m, 0.75
        base.velocity.x, base.velocity.y = speed, 0.0
        base.dimension.length, base.dimension.width, base.dimension.height = 4.5, 1.8, 1.5
    return view


def measure_times_s(kind: str, n_steps: int) -> np.ndarray:
    """Return the processor times of steps, (n_steps,)."""
    radar = dc.traffic.traffic_scenario("traffic.csv").radar
    model = dc.SensorModel(radar, mount="front", kind=kind, seed=1)
    times_s = []
    for step in range(3 + n_steps):
        view = make_view(step)
        start_s = process_time()
        model.step(view)
        times_s.append(process_time() - start_s)
    return np.array(times_s[3:])


def main() -> None:
    """Measure both kinds and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=16)
    n_steps = parser.parse_args().steps
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print(f"{'kind':12}  least (ms)  median (ms)")
    for kind in ("samples", "statistical"):
        times_ms = 1e3 * measure_times_s(kind, n_steps)
        print(f"{kind:12}  {times_ms.min():10.0f}  {np.median(times_ms):11.0f}")


if __name__ == "__main__":
    main()
