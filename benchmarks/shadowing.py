"""Cost of shadows between bodies, relative to the sum of the echoes.

The scene has 20 bodies in traffic on four lanes, so that most are partly hidden. The radar is that
of `examples/highway.yaml`, with two transmitters and four receivers; eight frames share the
findings on the scene. Each ratio is processor time with shadows over that without, in one process,
in turn. The benchmark fails if the ratio of a body is above 1.5.

    python benchmarks/shadowing.py [--repeats 8]
"""

import argparse
import os
import statistics
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from time import process_time

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

import dechirp as dc
from dechirp.scene.bodies.base import Body

EXAMPLES = Path(__file__).parents[1] / "examples"
N_FRAMES = 8
MAX_RATIO = 1.5
BODIES = {
    "trucks of 150 scatterers": dc.bodies.Truck(length_m=7.5, wheel_radius_m=0.28),
    "bicyclists of 157 scatterers": dc.bodies.Bicyclist(speed_m_per_s=8.0),
    "cars of 82 scatterers": dc.bodies.Car(),
}


def build_traffic(body: Body) -> dc.Scene:
    """Build five rows of four bodies, 22 m apart, a little out of line."""
    rng = np.random.default_rng(0)
    targets = [
        dc.Target(
            position_m=(
                12 + 22 * (index // 4) + rng.uniform(-3, 3),
                3.7 * (index % 4 - 1.5) + rng.uniform(-0.3, 0.3),
                -0.5,
            ),
            velocity_m_per_s=(20.0, 0.0, 0.0),
            body=body,
        )
        for index in range(20)
    ]
    return dc.Scene(targets=targets, ego=dc.Ego(velocity_m_per_s=(20.0, 0.0, 0.0)))


def measure_ratio(scene: dc.Scene, radar: dc.Radar, n_repeats: int) -> tuple[float, float]:
    """Return the median ratio, and the median time without shadows, s."""
    scenes = [replace(scene, shadowing=shadowing) for shadowing in (True, False)]
    times_s = []
    for _ in range(n_repeats + 2):
        row = []
        for item in scenes:
            start_s = process_time()
            dc.simulate(item, radar, impairments=[], n_frames=N_FRAMES)
            row.append(process_time() - start_s)
        times_s.append(row)
    ratios = [shadowed / plain for shadowed, plain in times_s[2:]]
    return statistics.median(ratios), statistics.median(plain for _, plain in times_s[2:])


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=8)
    n_repeats = parser.parse_args().repeats
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    radar = dc.load(EXAMPLES / "highway.yaml").radar
    slow_names = []
    for name, body in BODIES.items():
        scene = build_traffic(body)
        ratio, plain_s = measure_ratio(scene, radar, n_repeats)
        print(
            f"20 {name} ({scene.n_scatterers} in all): {ratio:.2f} times"
            f" the {plain_s * 1e3:.0f} ms without shadows"
        )
        if ratio > MAX_RATIO:
            slow_names.append(name)
    if slow_names:
        sys.exit(
            f"shadows of {', '.join(slow_names)} cost more than {MAX_RATIO:g} times the echoes"
        )


if __name__ == "__main__":
    main()
