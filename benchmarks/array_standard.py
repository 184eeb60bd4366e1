"""Processing chain in the array-API standard: agreement and time relative to dechirp kernels.

The chain consists of windows, transforms, power, cell averaging and peaks. It processes a frame of
the reference scene (2200 x 128) and one of eight channels (256 x 128 x 8), with code that runs on
any library of the standard: here NumPy, and PyTorch if installed. The mean of the training cells
is a difference of cumulative sums, which loses the noise next to a strong target in float32; sums
in float32 and float64 are measured.

The script prints the time in ms, the ratio to dechirp, the number of cells whose power deviates by
more than 1e-4 of the mean of the map, and the number of cells with different decisions. Times are
medians of nine pairs, each the fastest of five calls.

    pip install torch array-api-compat
    python benchmarks/array_standard.py
"""

import importlib
import json
import os
import sys
import warnings
from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter
from typing import Any

N_THREADS = int(os.environ.setdefault("NUMBA_NUM_THREADS", "1"))
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(pool, str(N_THREADS))

import numpy as np

import dechirp as dc
from dechirp.processing.peaks import strongest_local_maxima_and_n_dropped
from dechirp.processing.range_doppler_map import range_doppler_power


def standard_chain(
    xp: Any, samples: Any, tapers: tuple[Any, Any], cells: tuple[int, ...], factor: float, real: Any
) -> tuple[Any, Any, Any]:
    """Compute power, cells above the threshold, and peaks of samples (chirp, channel, sample)."""
    slow, fast = tapers
    n_v = samples.shape[0]
    spectrum = xp.fft.fft(samples * fast, axis=2)
    spectrum = xp.fft.fft(spectrum * slow[:, None, None], axis=0)
    power = xp.mean(xp.real(spectrum) ** 2 + xp.imag(spectrum) ** 2, axis=1)
    power = xp.roll(power, n_v // 2, axis=0)
    train_r, train_v, guard_r, guard_v = cells
    window_half, guard_half = (train_v + guard_v, train_r + guard_r), (guard_v, guard_r)
    outer_sum, outer_n = box_sums(xp, power, *window_half, real)
    inner_sum, inner_n = box_sums(xp, power, *guard_half, real)
    level = (outer_sum - inner_sum) / (outer_n - inner_n)
    exceeds = power > factor * xp.astype(level, power.dtype)
    is_peak = exceeds
    for steps in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        is_peak = is_peak & (power >= xp.roll(power, steps, axis=(0, 1)))
    return power, exceeds, is_peak


def box_sums(xp: Any, power: Any, half_v: int, half_r: int, real: Any) -> tuple[Any, Any]:
    """Sum boxes around each cell, periodic in velocity and cut in range; return sums and counts."""
    n_v, n_r = power.shape
    periodic = xp.concat([power[n_v - half_v :, :], power, power[:half_v, :]], axis=0)
    sums = xp.cumulative_sum(periodic, axis=0, dtype=real, include_initial=True)
    sums = sums[2 * half_v + 1 :, :] - sums[:n_v, :]
    sums = xp.cumulative_sum(sums, axis=1, dtype=real, include_initial=True)
    cells = np.arange(n_r)
    first, last = np.maximum(cells - half_r, 0), np.minimum(cells + half_r + 1, n_r)
    first_indices, last_indices = (xp.asarray(indices) for indices in (first, last))
    counts = xp.asarray((last - first) * (2 * half_v + 1.0), dtype=real)
    return xp.take(sums, last_indices, axis=1) - xp.take(sums, first_indices, axis=1), counts


def fastest(work: Callable[[], object]) -> float:
    """Return the shortest time of five calls, s."""
    times = []
    for _ in range(5):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def import_libraries() -> dict[str, Any]:
    """Import the installed libraries in their array-API versions."""
    modules = {}
    for name in ("numpy", "torch"):
        try:
            modules[name] = importlib.import_module(f"array_api_compat.{name}")
        except ImportError as error:
            print(f"without {name}: {error}", file=sys.stderr)
    if "torch" in modules:
        importlib.import_module("torch").set_num_threads(N_THREADS)
    return modules


def compare(name: str, radar: dc.Radar, scene: dc.Scene) -> dict[str, Any]:
    """Process one frame with dechirp and with each library."""
    chain = dc.Chain(range_window="hann", doppler_window="hann").fit_to_radar(radar)
    law = chain.map_noise_statistics(radar)
    samples = np.ascontiguousarray(dc.simulate(scene, radar, seed=1).values[0])
    window = chain.cfar.training_window
    sizes = (
        window.n_training.range,
        window.n_training.velocity,
        window.n_guard.range,
        window.n_guard.velocity,
    )
    factor = float(
        np.median(
            chain.cfar.threshold_at_cells(
                np.ones((samples.shape[0], samples.shape[2]), np.float32),
                np.array([[5, samples.shape[2] // 2]]),
                law,
            )
        )
    )

    def ours() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        power = range_doppler_power(samples, radar, chain)
        exceeds = chain.cfar.exceeds_threshold(power, law)
        return power, exceeds, strongest_local_maxima_and_n_dropped(power, exceeds)[0]

    power, exceeds, peaks = ours()
    inside = slice(sizes[0] + sizes[2], samples.shape[2] - sizes[0] - sizes[2])
    results: dict[str, Any] = {"cells": power.size, "peaks": len(peaks)}
    for library, xp in import_libraries().items():
        library_samples = xp.asarray(samples)
        tapers = tuple(
            xp.asarray(array.weights.astype(np.float32))
            for array in (law.doppler_transform, law.range_transform)
        )
        for precision in ("float32", "float64"):
            real = getattr(xp, precision)

            standard = partial(standard_chain, xp, library_samples, tapers, sizes, factor, real)
            arrays = [np.asarray(array) for array in standard()]
            scale = float(power.mean() / arrays[0].mean())
            n_deviating = int(
                np.count_nonzero(np.abs(arrays[0] * scale - power) > 1e-4 * power.mean())
            )
            n_different = int(np.count_nonzero((arrays[1] != exceeds)[:, inside]))
            pairs = [(fastest(standard), fastest(ours)) for _ in range(9)]
            ms, dechirp_ms = median(a for a, _ in pairs) * 1e3, median(b for _, b in pairs) * 1e3
            ratio = median(a / b for a, b in pairs)
            results[f"{library} {precision}"] = {
                "ms": ms,
                "ours_ms": dechirp_ms,
                "ratio": ratio,
                "powers_off": n_deviating,
                "decided_otherwise": n_different,
            }
            print(
                f"{name:10s} {library:6s} sums in {precision}: {ms:7.2f} ms,"
                f" dechirp {dechirp_ms:6.2f},"
                f" ratio {ratio:5.2f}; {n_deviating} cells with deviating power,"
                f" {n_different} cells with a different decision,"
                f" {int(arrays[2].sum())} peaks (dechirp {len(peaks)})",
                file=sys.stderr,
            )
    return results


def main() -> None:
    warnings.simplefilter("ignore", dc.PhysicsWarning)
    scenario = dc.reference()
    assert scenario.radar is not None and scenario.scene is not None
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=10e12,
        adc_start_s=2e-6,
        ramp_duration_s=15.5e-6,
        sample_rate_hz=20e6,
        n_samples=256,
        sampling="complex",
    )
    radar = dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=128, interval_s=16e-6),
        hardware=scenario.radar.hardware,
        array=dc.Array(rx_m=tuple((0.0, 2e-3 * i, 0.0) for i in range(8))),
    )
    print(
        json.dumps(
            {
                "threads": N_THREADS,
                "reference": compare("reference", scenario.radar, scenario.scene),
                "channels": compare("channels", radar, scenario.scene),
            }
        )
    )


if __name__ == "__main__":
    main()
