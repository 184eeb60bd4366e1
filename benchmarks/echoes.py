"""Speed of the echo kernels relative to a direct sum with `numpy.exp` in the same run.

`sides/scenes.py` defines radars and scenes; scatterers are drawn from the seed. Each line gives:

* the time of the kernel that `auto` selects, with a tolerance of 1e-5, to add echoes to a cube
* the time of the first call, with cached compiled code
* the time of the direct sum with `numpy.exp` in double precision, extrapolated from some chirps
* the relative RMSE against this direct sum
* times and errors of baselines: a low-rank product with NumPy, and FINUFFT, if installed, with five
  Taylor orders of range migration. Both neglect the curvature of paths.

    python benchmarks/echoes.py [--threads 2] [--seed 1] [--case A]
"""

import argparse
import json
import os
import resource
import sys
import warnings
from collections.abc import Callable
from statistics import median
from time import perf_counter

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--threads", type=int, default=2, help="threads of the kernels")
parser.add_argument("--seed", type=int, default=1, help="seed of the scatterers")
parser.add_argument("--case", default="", help="only cases whose name starts with this text")
options = parser.parse_args()
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[pool] = "1"
os.environ["NUMBA_NUM_THREADS"] = str(options.threads)

import numpy as np
from sides.plain_echoes import HAS_FINUFFT, direct_sum, low_rank_product, with_finufft
from sides.scenes import Case, cube_a, long_chirp, mimo

from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.simulation.engine import Engine
from dechirp.simulation.kernels import selection

use_compiled_kernels()  # warm from the first call on


def measure_baseline(
    work: Callable[..., np.ndarray], case: Case, exact: np.ndarray, chirps: np.ndarray
) -> dict[str, float]:
    scatterers, transmission, shape = case
    samples = work(scatterers, transmission, shape[2])
    times_s = time_calls(lambda: work(scatterers, transmission, shape[2]), 5)
    error = np.linalg.norm(samples[chirps] - exact[:, 0]) / np.linalg.norm(exact)
    return {"ms": 1e3 * median(times_s), "error": float(error)}


def time_calls(work: Callable[[], object], turns: int) -> list[float]:
    times_s = []
    for _ in range(turns):
        start = perf_counter()
        work()
        times_s.append(perf_counter() - start)
    return times_s


def measure_case(
    name: str, case: Case, bar_ms: float, rng: np.random.Generator
) -> dict[str, object]:
    scatterers, transmission, shape = case
    n = len(scatterers.amplitudes)
    engine = Engine()
    out = np.zeros(shape, np.complex64)
    predicted = selection.predict_kernel_times(shape, scatterers, transmission, 1e-5)
    (first_s,) = time_calls(
        lambda: selection.add_echoes(out, scatterers, transmission, engine=engine), 1
    )
    chirps = np.unique(rng.integers(shape[0], size=max(1, min(8, 4000 // n))))
    (plain_s,) = time_calls(lambda: direct_sum(scatterers, transmission, shape[2], chirps), 1)
    exact = direct_sum(scatterers, transmission, shape[2], chirps)
    error = np.linalg.norm(out[chirps] - exact) / np.linalg.norm(exact)
    baselines = {}
    if name.startswith("A "):
        if n <= 100:
            baselines["low-rank product, NumPy"] = measure_baseline(
                low_rank_product, case, exact, chirps
            )
        if n >= 100 and HAS_FINUFFT:
            baselines["finufft"] = measure_baseline(with_finufft, case, exact, chirps)
    turns = int(np.clip(0.5 / max(first_s, 1e-4), 5, 200))
    times_s = time_calls(
        lambda: selection.add_echoes(out, scatterers, transmission, engine=engine), turns
    )
    return {
        "case": name,
        "kernel": predicted.cheapest_kernel,
        "ms": 1e3 * median(times_s),
        "fastest_ms": 1e3 * min(times_s),
        "not_above_ms": bar_ms,
        "first_ms": 1e3 * first_s,
        "numpy_exp_over_ours": plain_s / len(chirps) * shape[0] / median(times_s),
        "error": float(error),
        "others": baselines,
    }


def measure_memory_mb() -> float:
    """Measure the growth of resident memory in the simulation of 100,000 scatterers, in cube A."""
    import dechirp as dc

    radar = dc.reference().radar
    dc.simulate(dc.Scene(), radar)  # imports
    initial_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rng = np.random.default_rng(options.seed)
    positions_m = rng.uniform([3, -50, -1], [200, 50, 3], (100_000, 3))
    cloud = dc.bodies.PointCloud(
        positions_m=positions_m, rcs_m2=rng.exponential(size=100_000) + 1e-6
    )
    scene = dc.Scene(
        targets=[dc.Target(position_m=(0, 0, 0), velocity_m_per_s=(9, 0, 0), body=cloud)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dc.simulate(scene, radar)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - initial_kb) / 1024


def main() -> None:
    # Memory comes first, before other cases raise the peak of the process.
    grown_mb = measure_memory_mb() if "memory".startswith(options.case) else None
    if grown_mb is not None:
        print(f"100,000 scatterers: {grown_mb:.0f} MB", file=sys.stderr)
    rng = np.random.default_rng(options.seed)
    cases: list[tuple[str, Callable[[], Case], float]] = [
        *((f"A {n}", lambda n=n: cube_a(n, 200.0, rng), ms) for n, ms in NEAR.items()),
        *((f"A full {n}", lambda n=n: cube_a(n, 2190.0, rng), ms) for n, ms in FULL.items()),
        ("MIMO 100", lambda: mimo(100, rng), 10.0),
        ("MIMO 10000", lambda: mimo(10_000, rng), 70.0),
        ("long 1000", lambda: long_chirp(1000, rng), 36.0),
    ]
    rows = []
    for name, make, bar_ms in cases:
        if not name.startswith(options.case):
            continue
        rows.append(measure_case(name, make(), bar_ms, rng))
        print(
            "{case:>14} {kernel:>10} {ms:8.2f} ms (fastest {fastest_ms:.2f}, bar {not_above_ms:g}),"
            " first {first_ms:.0f} ms, numpy.exp {numpy_exp_over_ours:6.0f} x,"
            " error {error:.1e} {others}".format(**rows[-1]),
            file=sys.stderr,
        )
    growth = [row["ms"] for row in rows if str(row["case"]).startswith("A full")]
    results = {
        "threads": options.threads,
        "seed": options.seed,
        "cases": rows,
        "memory_mb": grown_mb,
    }
    if len(growth) == len(FULL):
        # The slope of the fit t = a + b n is the additional time per scatterer.
        n = np.array(list(FULL))
        slope, constant = np.polyfit(n, np.array(growth, float), 1)
        results["growth"] = {"constant_ms": constant, "ns_per_scatterer": slope * 1e6}
    print(json.dumps(results))


NEAR = {1: 0.1, 10: 1.0, 100: 2.5, 1000: 3.0, 10_000: 4.0, 100_000: 15.0}
FULL = {1000: 15.0, 10_000: 18.0, 100_000: 40.0}

if __name__ == "__main__":
    main()
