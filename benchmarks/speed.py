"""How fast the chain is, as ratios to plain NumPy, SciPy and numba code in the same run.

Measured, on one thread, warm (compiled, factors known), arrays in memory:

chain   `detect` on the reference cube, 2200 x 128, no padding: window, transforms, power,
        threshold, peaks, refinement, labelled detections; against NumPy and SciPy from the
        window to the CFAR mask alone, edges wrong.
cfar    threshold of every cell on 2048 x 128 by `CellAveraging`, edges right; against plain
        numba running sums to the same map with the edges left out.

Not measured: simulation, files, the first call. Each figure is the median of 15 pairs of
turns A B A B, each turn the fastest of a few calls, so that it holds on a busy machine.

    python benchmarks/speed.py
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from statistics import median
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import numba
import numpy as np
import scipy.fft
from scipy.ndimage import uniform_filter

import dechirp as dc
from dechirp.process.cfar.base import Ring

TRAINING, GUARD = (8, 10), (4, 4)  # velocity, range: each side
WIDTH = tuple(2 * (t + g) + 1 for t, g in zip(TRAINING, GUARD, strict=True))
INNER = tuple(2 * g + 1 for g in GUARD)
N_RING = WIDTH[0] * WIDTH[1] - INNER[0] * INNER[1]
FACTOR = 13.965


def plain_chain(samples: np.ndarray, taper: np.ndarray) -> np.ndarray:
    """Window to CFAR mask as one writes it with NumPy and SciPy, (chirp, sample)."""
    spectrum = scipy.fft.fft(samples * taper, axis=1)
    spectrum = scipy.fft.fftshift(scipy.fft.fft(spectrum, axis=0), axes=0)
    power = spectrum.real**2 + spectrum.imag**2
    box = uniform_filter(power, WIDTH, mode="wrap") * (WIDTH[0] * WIDTH[1])
    guard = uniform_filter(power, INNER, mode="wrap") * (INNER[0] * INNER[1])
    return power > FACTOR / N_RING * (box - guard)


@numba.njit
def box_sums(power: np.ndarray, n_v: int, n_r: int) -> np.ndarray:
    """Sums over boxes by running sums along each axis; boxes that do not fit are left out."""
    rows, columns = power.shape
    along = np.zeros((rows, columns), np.float32)
    for v in range(rows):
        total = np.float32(0.0)
        for j in range(n_r):
            total += power[v, j]
        along[v, n_r // 2] = total
        for j in range(n_r, columns):
            total += power[v, j] - power[v, j - n_r]
            along[v, j - n_r // 2] = total
    out = np.zeros((rows, columns), np.float32)
    running = np.zeros(columns, np.float32)
    for v in range(rows):
        for j in range(columns):
            running[j] += along[v, j]
        if v >= n_v:
            for j in range(columns):
                running[j] -= along[v - n_v, j]
        if v >= n_v - 1:
            for j in range(columns):
                out[v - n_v // 2, j] = running[j]
    return out


@numba.njit
def plain_cfar(power: np.ndarray, factor: float) -> np.ndarray:
    """Thresholds of a cell-averaging CFAR by plain running sums, edges left out."""
    n_v, n_r, g_v, g_r = 25, 29, 9, 9
    scale = np.float32(factor / (n_v * n_r - g_v * g_r))
    box, guard = box_sums(power, n_v, n_r), box_sums(power, g_v, g_r)
    threshold = np.zeros(power.shape, np.float32)
    for v in range(n_v // 2, power.shape[0] - n_v // 2):
        for j in range(n_r // 2, power.shape[1] - n_r // 2):
            threshold[v, j] = scale * (box[v, j] - guard[v, j])
    return threshold


def compare(name: str, ours: Callable[[], object], plain: Callable[[], object]) -> dict[str, float]:
    """Median over pairs of turns of the ratio of the fastest calls, and both times."""
    ours(), plain()
    pairs = [(fastest(ours), fastest(plain)) for _ in range(15)]
    result = {
        "ours_ms": median(a for a, _ in pairs) * 1e3,
        "plain_ms": median(b for _, b in pairs) * 1e3,
        "ratio": median(a / b for a, b in pairs),
    }
    print(
        f"{name:8s} ours {result['ours_ms']:6.3f} ms   plain {result['plain_ms']:6.3f} ms"
        f"   ratio {result['ratio']:.2f}",
        file=sys.stderr,
    )
    return result


def fastest(work: Callable[[], object]) -> float:
    """Shortest of several calls, s."""
    times = []
    for _ in range(7):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def main() -> None:
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    scenario = dc.reference()
    cube = dc.run(scenario).cube
    samples = np.ascontiguousarray(cube.values[0, :, 0])
    hann = [0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n) for n in samples.shape]
    taper = np.outer(*hann).astype(np.float32)
    power = np.random.default_rng(1).exponential(size=(128, 2048)).astype(np.float32)
    estimator = dc.CellAveraging()
    ring = Ring(
        n_training=dc.Cells(range=TRAINING[1], velocity=TRAINING[0]),
        n_guard=dc.Cells(range=GUARD[1], velocity=GUARD[0]),
    )
    factors = np.full(2048, FACTOR, np.float32)

    results = {
        "chain": compare(
            "chain",
            lambda: dc.detect(cube, scenario.radar, scenario.chain),
            lambda: plain_chain(samples, taper),
        ),
        "cfar": compare(
            "cfar",
            lambda: estimator.threshold(power, ring, factors),
            lambda: plain_cfar(power, FACTOR),
        ),
    }
    print(json.dumps(results))


if __name__ == "__main__":
    main()
