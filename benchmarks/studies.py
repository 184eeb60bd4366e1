"""Trials per second of the reference scene, from noise generation to detections.

All stages run on one thread with 2200 x 128 samples of one receiver, after compilation, with cached
threshold factors and in reused memory:

noise     Circular Gaussian noise added to a cube. Reference: the ziggurat generator of NumPy.
cube      A trial of `MonteCarloSimulator`: the stored echo and new noise. Reference: `simulate`.
map       Power of each cell with `range_doppler_power`. Reference: the transforms of SciPy.
cfar      Cells above the threshold of `CellAveraging`.
columns   Samples to detections with `detect_columns`.
trial     `cube` followed by `columns`.
cells     Noise, map and threshold without a scene, as in a study of false alarms.

Then `trial` and `cells` run in two parallel processes with one thread each, to measure their
combined rate in trials/s and cells/s. Scoring, the ledger and the scheduler of blocks are not
measured. Each figure is the median of 15 measurements, each of which is the fastest of seven calls.
On a machine with other load, the shortest time is more meaningful.

    python benchmarks/studies.py
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from statistics import median
from time import perf_counter
from typing import NamedTuple

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

import numpy as np
import scipy.fft

import dechirp as dc
from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.processing.detect import detect_columns
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.simulation.monte_carlo import MonteCarloSimulator

use_compiled_kernels()  # warm from the first call on

TRIALS_PER_S, CELLS_PER_S = 600.0, 1e8
"""Required rates on two cores."""
PARALLEL_S = 3.0
"""Duration of the measurement with two processes."""


class Works(NamedTuple):
    """Timed functions and their references in plain code, by name."""

    ours: dict[str, Callable[[], object]]
    plain: dict[str, Callable[[], object]]
    n_cells: int


@cache
def build_works() -> Works:
    """Build the functions for the reference scene; they reuse their memory."""
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    scenario = dc.reference()
    scene, radar = scenario.scene, scenario.radar
    assert radar is not None
    chain = scenario.chain.fit_to_radar(radar)
    rng, law, trials = (
        np.random.default_rng(1),
        chain.map_noise_statistics(radar),
        MonteCarloSimulator(scene, radar),
    )
    reused_cube = trials.simulate_trial(rng)
    samples, noise_samples = reused_cube.values[0].copy(), np.zeros_like(reused_cube.values[0])
    power = range_doppler_power(samples, radar, chain)
    taper = np.outer(law.doppler_transform.weights, law.range_transform.weights).astype(np.float32)

    def cells() -> None:
        noise_samples[:] = 0
        add_white_noise(noise_samples, 1.0, rng)
        chain.cfar.exceeds_threshold(range_doppler_power(noise_samples, radar, chain), law)

    def plain_noise() -> None:
        numbers = samples.view(np.float32)
        numbers += np.float32(1e-10) * rng.standard_normal(numbers.shape, dtype=np.float32)

    def plain_map() -> None:
        spectrum = scipy.fft.fft(samples[:, 0] * taper, axis=1, overwrite_x=True)
        spectrum = scipy.fft.fft(spectrum, axis=0, overwrite_x=True)
        scipy.fft.fftshift(spectrum.real**2 + spectrum.imag**2, axes=0)

    return Works(
        {
            "noise": lambda: add_white_noise(samples, 1e-20, rng),
            "cube": lambda: trials.simulate_trial(rng, reused_cube),
            "map": lambda: range_doppler_power(samples, radar, chain),
            "cfar": lambda: chain.cfar.exceeds_threshold(power, law),
            "columns": lambda: detect_columns([reused_cube], radar, chain),
            "trial": lambda: detect_columns(
                [trials.simulate_trial(rng, reused_cube)], radar, chain
            ),
            "cells": cells,
        },
        {
            "noise": plain_noise,
            "cube": lambda: dc.simulate(scene, radar, seed=rng),
            "map": plain_map,
        },
        power.size,
    )


def fastest(work: Callable[[], object]) -> float:
    """Return the shortest time of seven calls, s."""
    times = []
    for _ in range(7):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure(name: str) -> dict[str, float]:
    """Measure the median and shortest time of a stage, and its ratio to plain code if available."""
    ours, plain = build_works().ours[name], build_works().plain.get(name)
    ours()
    pairs = [(fastest(ours), fastest(plain) if plain else np.nan) for _ in range(15)]
    result = {
        "ms": median(a for a, _ in pairs) * 1e3,
        "shortest_ms": min(a for a, _ in pairs) * 1e3,
    }
    if plain:
        result["ratio"] = median(a / b for a, b in pairs)
    ratio = f"{result['ratio']:8.3f}" if plain else ""
    print(f"{name:10s} {result['ms']:9.3f} {result['shortest_ms']:9.3f} {ratio}", file=sys.stderr)
    return result


def measure_rate(name: str, start: float) -> float:
    """Measure the calls per second in this process from a common start time on."""
    work = build_works().ours[name]
    for _ in range(5):
        work()
    while perf_counter() < start:
        pass
    n = 0
    while perf_counter() < start + PARALLEL_S:
        work()
        n += 1
    return n / (perf_counter() - start)


def measure_in_parallel(n_processes: int) -> dict[str, float]:
    """Sum the rates of parallel processes; `perf_counter` is common to all processes (Linux)."""
    rates = {}
    with ProcessPoolExecutor(n_processes, mp_context=get_context("spawn")) as pool:
        # Each process imports and compiles before the timed measurement.
        list(pool.map(partial(measure_rate, "trial"), [perf_counter() + 20.0] * n_processes))
        for name in ("trial", "cells"):
            begin = perf_counter() + 1.0
            rates[name] = sum(pool.map(partial(measure_rate, name), [begin] * n_processes))
    return rates


def main() -> None:
    print(f"{'one thread':10s} {'ms':>9s} {'shortest':>9s} {'ratio':>8s}", file=sys.stderr)
    results: dict[str, object] = {name: measure(name) for name in build_works().ours}
    together = measure_in_parallel(2)
    trials_per_s, cells_per_s = together["trial"], together["cells"] * build_works().n_cells
    for name, measured_rate, bar in (
        ("trials/s", trials_per_s, TRIALS_PER_S),
        ("cells/s", cells_per_s, CELLS_PER_S),
    ):
        verdict = "met" if measured_rate >= bar else "missed"
        print(
            f"two processes: {measured_rate:12.4g} {name} of {bar:.3g}: {verdict}", file=sys.stderr
        )
    results["two_processes"] = {
        "trials_per_s": trials_per_s,
        "cells_per_s": cells_per_s,
        "bars": {"trials_per_s": TRIALS_PER_S, "cells_per_s": CELLS_PER_S},
    }
    print(json.dumps(results))


if __name__ == "__main__":
    main()
