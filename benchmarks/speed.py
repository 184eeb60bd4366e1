"""Speed of the processing chain relative to plain NumPy, SciPy and numba code.

All jobs run on one thread with arrays in memory, after compilation and with cached threshold
factors:

map     Power map of 2200 x 128 samples, padded to 4096 range bins, computed by the kernel and by
        `power_map`. Reference: SciPy, velocity transform before the padded range transform.
ca      Cells of a 2048 x 128 map above the threshold of `CellAveraging`, including the edges.
        Reference: running sums with numba, without the edges.
os      Cells above the exact threshold of `OrderedStatistic`, including the edges, in noise and
        with a step of 20 dB in the middle. Reference: a count of training cells with numba that
        stops as soon as the decision is certain, without the edges.
frame   `detect`: window, transforms, power, threshold, peaks, refinement, ambiguity and labelled
        detections of 3 targets, without and with directions. Sizes are samples x chirps x
        channels; several channels are a TDM array with three or four transmitters. A second
        line gives the time of each additional detection, measured with 10 targets. Reference:
        NumPy and SciPy from the window to the mask of a cell-averaging CFAR, which is wrong at
        the edges.

Simulation, files and the first call are not measured. dechirp and reference run alternately
(A B A B). Each figure is the median of 15 pairs, and each value of a pair is the fastest of seven
calls, so the ratios also hold on a busy machine. The bar is the largest accepted ratio.

    python benchmarks/speed.py
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

import numpy as np
from sides.frames import simulate_frame
from sides.plain_maps import (
    GUARD,
    N_TRAINING_CELLS,
    TRAINING,
    plain_cell_averaging,
    plain_chain,
    plain_map,
    plain_ordered_statistic,
    window_weights,
)

import dechirp as dc
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.spectrum import Transform, mean_range_doppler_power

FACTOR = 13.965
# The 3/4 quantile of exponential noise is log 4 = 1.386 times its mean: 13.965 / 1.386 = 10.08,
# within 1 % of the factor for rank 3/4 of 644 cells at a false-alarm probability of 1e-6.
RANK, RANK_FACTOR = 3 * N_TRAINING_CELLS // 4, 10.13


def compare(
    name: str, ours: Callable[[], object], plain: Callable[[], object], bar: float
) -> dict[str, float]:
    """Measure both times alternately; return their medians and the median ratio."""
    ours(), plain()
    pairs = [(fastest(ours), fastest(plain)) for _ in range(15)]
    result = {
        "ours_ms": median(a for a, _ in pairs) * 1e3,
        "plain_ms": median(b for _, b in pairs) * 1e3,
        "ratio": median(a / b for a, b in pairs),
        "bar": bar,
    }
    print(
        f"{name:32s} {result['ours_ms']:9.3f} {result['plain_ms']:9.3f}"
        f" {result['ratio']:8.3f} {bar:8.3f}  {'met' if result['ratio'] <= bar else 'missed'}",
        file=sys.stderr,
    )
    return result


def fastest(work: Callable[[], object]) -> float:
    """Return the shortest time of seven calls, s."""
    times = []
    for _ in range(7):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure_maps() -> dict[str, dict[str, float]]:
    scenario = dc.reference()
    cube = dc.run(scenario).cube
    samples = np.ascontiguousarray(cube.values[0])
    taper = window_weights((128, 2200))
    over_range = Transform(window="hann", n_points=2200, n_bins=4096)
    over_velocity = Transform(window="hann", n_points=128, n_bins=128)
    frame, chain = cube.isel(frame=0), dc.Chain(n_range_bins=4096)
    works: dict[str, Callable[[], object]] = {
        "map, kernel": lambda: mean_range_doppler_power(
            samples, "complex", over_range, over_velocity
        ),
        "map, power_map": lambda: dc.power_map(frame, scenario.radar, chain),
    }
    plain = partial(plain_map, samples[:, 0], taper, 4096)
    return {name: compare(name, work, plain, 2.6 / 3.0) for name, work in works.items()}


def measure_detectors() -> dict[str, dict[str, float]]:
    noise = np.random.default_rng(1).exponential(size=(128, 2048)).astype(np.float32)
    step = noise.copy()
    step[:, 1024:] *= 100
    training_window = TrainingWindow(
        n_training=dc.Cells(range=TRAINING[1], velocity=TRAINING[0]),
        n_guard=dc.Cells(range=GUARD[1], velocity=GUARD[0]),
    )
    cell_averaging, ordered_statistic = dc.cfar.CellAveraging(), dc.cfar.OrderedStatistic(rank=RANK)
    mean_factors = np.full(2048, FACTOR, np.float32)
    rank_factors = np.full(2048, RANK_FACTOR, np.float32)
    results = {
        "ca, noise": compare(
            "ca, noise",
            lambda: cell_averaging.exceeds_threshold(noise, training_window, mean_factors),
            lambda: plain_cell_averaging(noise, FACTOR),
            0.5 / 0.95,
        )
    }
    for name, power, bar in (("os, noise", noise, 1.5 / 32), ("os, step", step, 3 / 32)):
        results[name] = compare(
            name,
            partial(ordered_statistic.exceeds_threshold, power, training_window, rank_factors),
            partial(plain_ordered_statistic, power, RANK_FACTOR, RANK),
            bar,
        )
    return results


def measure_frames() -> dict[str, dict[str, float]]:
    results = {}
    sizes = (
        ("2200 x 128 x 1", (2200, 128, 1, 1), 5 / 9.5),
        ("256 x 128 x 12", (256, 128, 3, 4), 2.5 / 6.2),
        ("512 x 256 x 16", (512, 256, 4, 4), 14 / 42.7),
    )
    for size, shape, bar in sizes:
        cube, radar = simulate_frame(*shape, n_targets=3)
        crowded, _ = simulate_frame(*shape, n_targets=10)
        n_samples, n_chirps, n_tx, n_rx = shape
        samples = cube.values[0].reshape(n_chirps, n_tx * n_rx, n_samples)
        taper = window_weights((n_chirps, n_samples))
        chains = {"without directions": dc.Chain(angle=None)}
        if n_tx > 1:
            chains["with directions"] = dc.Chain()
        for label, chain in chains.items():
            name = f"frame {size}, {label.split()[0]}"
            frame_work, crowded_work = (
                partial(dc.detect, frames, radar, chain) for frames in (cube, crowded)
            )
            results[name] = compare(
                name, frame_work, partial(plain_chain, samples, taper, FACTOR), bar
            )
            n_more = crowded_work().sizes["detection"] - frame_work().sizes["detection"]
            spent = median(fastest(crowded_work) - fastest(frame_work) for _ in range(15)) / n_more
            results[name]["each_further_detection_ms"] = spent * 1e3
            print(f"    each further detection {spent * 1e3:.3f} ms", file=sys.stderr)
    return results


def main() -> None:
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    print(f"{'':32s} {'ms':>9s} {'plain ms':>9s} {'ratio':>8s} {'bar':>8s}", file=sys.stderr)
    print(json.dumps(measure_maps() | measure_detectors() | measure_frames()))


if __name__ == "__main__":
    main()
