"""Trials per second of the reference scene, from noise generation to detections.

Measured, on one thread, warm (compiled, factors known), in memory that is used again, of 2200 x 128
samples of one receiver:

noise     circular Gaussian noise added to a cube; against NumPy's ziggurat.
cube      a trial of `MonteCarloSimulator`: kept echo and noise; against `simulate`.
map       power of each cell, `range_doppler_power`; against SciPy's transforms.
cfar      cells over the threshold of `CellAveraging`.
columns   `detect_columns`, from samples to columns.
trial     cube and columns: samples to detections.
cells     noise, map and threshold, without a scene: what a study of false alarms takes.

Then trial and cells in two processes at once, each on one thread: trials/s and cells/s of both.
Not measured: scores, the ledger, what hands out blocks. Each figure is the median over turns of
the fastest of a few calls; where other work shares the machine, the fastest of all says more.

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
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.processing.detect import detect_columns
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.simulation.monte_carlo import MonteCarloSimulator

TRIALS_PER_S, CELLS_PER_S = 600.0, 1e8
"""Asked for on two cores."""
SECONDS = 3.0
"""That two processes run side by side."""


class Works(NamedTuple):
    """Measured functions and their plain references, by name."""

    ours: dict[str, Callable[[], object]]
    plain: dict[str, Callable[[], object]]
    n_cells: int


@cache
def build_works() -> Works:
    """All of the reference scene, in memory that is used again."""
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
    """Shortest of several calls, s."""
    times = []
    for _ in range(7):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure(name: str) -> dict[str, float]:
    """Median and shortest time of a work, and its ratio to plain code if there is some."""
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
    """Calls a second in a process of its own, all of which begin at one time."""
    work = build_works().ours[name]
    for _ in range(5):
        work()
    while perf_counter() < start:
        pass
    n = 0
    while perf_counter() < start + SECONDS:
        work()
        n += 1
    return n / (perf_counter() - start)


def measure_in_parallel(n_processes: int) -> dict[str, float]:
    """Sum of the rates of so many processes at once; the clock is one for the whole machine."""
    rates = {}
    with ProcessPoolExecutor(n_processes, mp_context=get_context("spawn")) as pool:
        # Compiled and loaded in each before the first turn is timed.
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
