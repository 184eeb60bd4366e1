"""How fast echoes are summed, against the direct sum with `numpy.exp` in the same run.

Cube A is 77 GHz, 150 MHz, 300 MS/s complex, 128 chirps x 2200 samples; `MIMO` three transmitters
in turn, four receivers, 128 chirps of each x 256 samples, lengths exact for each pair; `long` a
chirp of 4 GHz in 50 us, 512 chirps x 256 samples. Scenes are drawn anew for each seed; targets fly
at up to 40 m/s (20 m/s before the MIMO radar).

Each line: time of the kernel that `auto` chooses, tolerance 1e-5, sum added to a cube in memory,
warm; the first call, when compiled code is at hand; the direct sum with `numpy.exp` in double
precision on some of the chirps, scaled; and the error against that, root mean square over root
mean square. Baselines beside it: a low-rank product with NumPy, and FINUFFT, where it is
installed, with five Taylor orders of range migration. Both leave out how echoes bend.

    python benchmarks/echoes.py [--threads 2] [--seed 1] [--case A]
"""

import argparse
import importlib.util
import json
import math
import os
import resource
import sys
import warnings
from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import NamedTuple

arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
arguments.add_argument("--threads", type=int, default=2)
arguments.add_argument("--seed", type=int, default=1)
arguments.add_argument("--case", default="")
asked = arguments.parse_args()
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[pool] = "1"
os.environ["NUMBA_NUM_THREADS"] = str(asked.threads)

import numpy as np

from dechirp.echoes.engine import Engine
from dechirp.echoes.kernels import choice
from dechirp.echoes.kernels.base import Scatterers, Sent

C = 299_792_458.0
Case = tuple[Scatterers, Sent, tuple[int, int, int]]


def cube_a(n: int, farthest_m: float, rng: np.random.Generator) -> Case:
    interval_s = 150e6 / 20.4545e12
    sent = Sent(
        centred(128, interval_s),
        np.ones((128, 1), complex),
        np.zeros((1, 3)),
        np.zeros((1, 3)),
        77e9,
        20.4545e12,
        0.0,
        300e6,
    )
    return scene(n, 3.0, farthest_m, 40.0, sent, rng), sent, (128, 1, 2200)


def mimo(n: int, rng: np.random.Generator) -> Case:
    n_chirps, wavelength_m = 3 * 128, C / 77e9
    weights = np.zeros((n_chirps, 3), complex)
    weights[np.arange(n_chirps), np.arange(n_chirps) % 3] = 1
    sent = Sent(
        centred(n_chirps, 30e-6),
        weights,
        np.array([[0, 2 * k * wavelength_m, 0] for k in range(3)]),
        np.array([[0, k * wavelength_m / 2, 0] for k in range(4)]),
        77e9,
        1e9 / 25.6e-6,
        3e-6,
        10e6,
    )
    return scene(n, 3.0, 38.0, 20.0, sent, rng), sent, (n_chirps, 4, 256)


def long_chirp(n: int, rng: np.random.Generator) -> Case:
    sent = Sent(
        centred(512, 60e-6),
        np.ones((512, 1), complex),
        np.zeros((1, 3)),
        np.zeros((1, 3)),
        77e9,
        4e9 / 50e-6,
        5e-6,
        256 / 45e-6,
    )
    return scene(n, 2.0, 9.0, 40.0, sent, rng), sent, (512, 1, 256)


def centred(n: int, interval_s: float) -> np.ndarray:
    return (np.arange(n) - (n - 1) / 2) * interval_s


def scene(
    n: int,
    nearest_m: float,
    farthest_m: float,
    fastest: float,
    sent: Sent,
    rng: np.random.Generator,
) -> Scatterers:
    """Scatterers ahead, evenly spread over range and azimuth, of exponential cross section."""
    range_m, azimuth = rng.uniform(nearest_m, farthest_m, n), rng.uniform(-1, 1, n)
    at_m = np.stack([range_m * np.cos(azimuth), range_m * np.sin(azimuth), rng.uniform(-1, 2, n)])
    velocity = rng.uniform(-fastest, fastest, (3, n)) * [[1.0], [0.5], [0.02]]
    return Scatterers(
        np.stack([at_m.T, velocity.T]),
        np.sqrt(rng.exponential(size=n)),
        np.ones((len(sent.tx_m), n)),
        np.ones((len(sent.rx_m), n)),
    )


def plain(scatterers: Scatterers, sent: Sent, n_samples: int, chirps: np.ndarray) -> np.ndarray:
    """The law as one writes it with NumPy, some of the chirps, (chirp, rx, sample)."""
    late_s = sent.adc_start_s + np.arange(n_samples) / sent.sample_rate_hz
    out = np.zeros((len(chirps), len(sent.rx_m), n_samples), complex)
    for row, m in zip(out, chirps, strict=True):
        times_s = sent.starts_s[m] + late_s
        for i in range(len(scatterers.amplitudes)):
            at_m = sum(term[i] * times_s[:, None] ** k for k, term in enumerate(scatterers.path_m))
            for k in np.flatnonzero(sent.weights[m]):
                there = np.linalg.norm(at_m - sent.tx_m[k], axis=1)
                for rx, rx_m in enumerate(sent.rx_m):
                    back = np.linalg.norm(at_m - rx_m, axis=1)
                    tau = (there + back) / C
                    cycles = sent.start_frequency_hz * tau
                    cycles += sent.slope_hz_per_s * tau * (late_s - tau / 2)
                    size = sent.weights[m, k] * scatterers.amplitudes[i] / (there * back)
                    row[rx] += size * np.exp(2j * np.pi * (cycles % 1))
    return out


def low_rank_product(scatterers: Scatterers, sent: Sent, n_samples: int) -> np.ndarray:
    """One matrix product with three Taylor orders of range migration, complex64; cube A alone."""
    tone, time_s, late_s = tones(scatterers, sent, n_samples)
    slow = tone.strength[:, None] * np.exp(2j * np.pi * tone.doppler_hz[:, None] * time_s)
    fast = np.exp(2j * np.pi * tone.range_hz[:, None] * late_s)
    cross = 2j * np.pi * tone.migration_hz_per_s
    left = [slow * (cross[:, None] * time_s) ** k / math.factorial(k) for k in range(3)]
    right = [fast * late_s**k for k in range(3)]
    return np.concatenate(left).astype(np.complex64).T @ np.concatenate(right).astype(np.complex64)


def with_finufft(scatterers: Scatterers, sent: Sent, n_samples: int) -> np.ndarray:
    """Two-dimensional transforms, five Taylor orders of range migration, double; cube A alone."""
    import finufft

    tone, time_s, late_s = tones(scatterers, sent, n_samples)
    step_s, interval_s = late_s[1] - late_s[0], time_s[1] - time_s[0]
    shape = (len(time_s), n_samples)
    # Modes count from -n / 2: half an interval from the middle of an even number of chirps.
    shift = np.exp(2j * np.pi * tone.doppler_hz * interval_s / 2)
    cross = 2j * np.pi * tone.migration_hz_per_s
    strengths = np.array([tone.strength * shift * cross**k / math.factorial(k) for k in range(5)])
    x, y = (
        np.mod(2 * np.pi * hz * step, 2 * np.pi)
        for hz, step in ((tone.doppler_hz, interval_s), (tone.range_hz, step_s))
    )
    fields = finufft.nufft2d1(x, y, strengths, shape, eps=1e-6, isign=1, nthreads=asked.threads)
    return sum(f * (time_s[:, None] * late_s) ** k for k, f in enumerate(fields))


class Tones(NamedTuple):
    """Echoes at the middle of the frame, both ways equal, straight paths."""

    strength: np.ndarray
    range_hz: np.ndarray
    doppler_hz: np.ndarray
    migration_hz_per_s: np.ndarray


def tones(
    scatterers: Scatterers, sent: Sent, n_samples: int
) -> tuple[Tones, np.ndarray, np.ndarray]:
    """Tones, times of chirps and of samples, both from the middle of the window and frame."""
    late_s = (np.arange(n_samples) - n_samples // 2) / sent.sample_rate_hz
    middle_s = sent.adc_start_s - late_s[0]
    frequency_hz = sent.start_frequency_hz + sent.slope_hz_per_s * middle_s
    position_m, velocity = (
        scatterers.path_m[0] + middle_s * scatterers.path_m[1],
        scatterers.path_m[1],
    )
    range_m = np.linalg.norm(position_m, axis=1)
    tau, rate = 2 * range_m / C, 2 * np.sum(position_m * velocity, axis=1) / range_m / C
    cycles = frequency_hz * tau - sent.slope_hz_per_s * tau**2 / 2
    doppler_hz = (frequency_hz - sent.slope_hz_per_s * tau) * rate
    strength = scatterers.amplitudes / range_m**2 * np.exp(2j * np.pi * (cycles % 1))
    return (
        Tones(
            strength,
            sent.slope_hz_per_s * tau + doppler_hz,
            doppler_hz,
            sent.slope_hz_per_s * rate,
        ),
        sent.starts_s,
        late_s,
    )


def baseline(
    work: Callable[..., np.ndarray], case: Case, exact: np.ndarray, chirps: np.ndarray
) -> dict[str, float]:
    scatterers, sent, shape = case
    got = work(scatterers, sent, shape[2])
    took = timed(lambda: work(scatterers, sent, shape[2]), 5)
    error = np.linalg.norm(got[chirps] - exact[:, 0]) / np.linalg.norm(exact)
    return {"ms": 1e3 * median(took), "error": float(error)}


def timed(work: Callable[[], object], turns: int) -> list[float]:
    took = []
    for _ in range(turns):
        start = perf_counter()
        work()
        took.append(perf_counter() - start)
    return took


def measured(name: str, case: Case, most_ms: float, rng: np.random.Generator) -> dict[str, object]:
    scatterers, sent, shape = case
    n = len(scatterers.amplitudes)
    engine = Engine()
    out = np.zeros(shape, np.complex64)
    predicted = choice.costs(shape, scatterers, sent, 1e-5)
    (first_s,) = timed(lambda: choice.add(out, scatterers, sent, engine=engine), 1)
    chirps = np.unique(rng.integers(shape[0], size=max(1, min(8, 4000 // n))))
    (plain_s,) = timed(lambda: plain(scatterers, sent, shape[2], chirps), 1)
    exact = plain(scatterers, sent, shape[2], chirps)
    error = np.linalg.norm(out[chirps] - exact) / np.linalg.norm(exact)
    others = {}
    if name.startswith("A "):
        if n <= 100:
            others["low-rank product, NumPy"] = baseline(low_rank_product, case, exact, chirps)
        if n >= 100 and importlib.util.find_spec("finufft"):
            others["finufft"] = baseline(with_finufft, case, exact, chirps)
    turns = int(np.clip(0.5 / max(first_s, 1e-4), 5, 200))
    took = timed(lambda: choice.add(out, scatterers, sent, engine=engine), turns)
    return {
        "case": name,
        "kernel": predicted.cheapest,
        "ms": 1e3 * median(took),
        "fastest_ms": 1e3 * min(took),
        "not_above_ms": most_ms,
        "first_ms": 1e3 * first_s,
        "numpy_exp_over_ours": plain_s / len(chirps) * shape[0] / median(took),
        "error": float(error),
        "others": others,
    }


def memory_mb() -> float:
    """Growth of resident memory while 100,000 scatterers are simulated, cube A included."""
    import dechirp as dc

    radar = dc.reference().radar
    dc.simulate(dc.Scene(), radar)  # imports
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rng = np.random.default_rng(asked.seed)
    at_m = rng.uniform([3, -50, -1], [200, 50, 3], (100_000, 3))
    cloud = dc.Cloud(positions_m=at_m, rcs_m2=rng.exponential(size=100_000) + 1e-6)
    scene = dc.Scene(
        targets=[dc.Target(position_m=(0, 0, 0), velocity_m_per_s=(9, 0, 0), body=cloud)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dc.simulate(scene, radar)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024


def main() -> None:
    # First, in a process that has summed nothing yet.
    grown_mb = memory_mb() if "memory".startswith(asked.case) else None
    print(f"100,000 scatterers: {grown_mb} MB", file=sys.stderr)
    rng = np.random.default_rng(asked.seed)
    cases: list[tuple[str, Callable[[], Case], float]] = [
        *((f"A {n}", lambda n=n: cube_a(n, 200.0, rng), ms) for n, ms in NEAR.items()),
        *((f"A full {n}", lambda n=n: cube_a(n, 2190.0, rng), ms) for n, ms in FULL.items()),
        ("MIMO 100", lambda: mimo(100, rng), 10.0),
        ("MIMO 10000", lambda: mimo(10_000, rng), 70.0),
        ("long 1000", lambda: long_chirp(1000, rng), 36.0),
    ]
    rows = []
    for name, make, most_ms in cases:
        if not name.startswith(asked.case):
            continue
        rows.append(measured(name, make(), most_ms, rng))
        print(
            "{case:>14} {kernel:>10} {ms:8.2f} ms (fastest {fastest_ms:.2f}, bar {not_above_ms:g}),"
            " first {first_ms:.0f} ms, numpy.exp {numpy_exp_over_ours:6.0f} x,"
            " error {error:.1e} {others}".format(**rows[-1]),
            file=sys.stderr,
        )
    growth = [row["ms"] for row in rows if str(row["case"]).startswith("A full")]
    found = {"threads": asked.threads, "seed": asked.seed, "cases": rows, "memory_mb": grown_mb}
    if len(growth) == len(FULL):
        # Least squares of t = a + b n: what a scatterer adds.
        n = np.array(list(FULL))
        slope, constant = np.polyfit(n, np.array(growth, float), 1)
        found["growth"] = {"constant_ms": constant, "ns_per_scatterer": slope * 1e6}
    print(json.dumps(found))


NEAR = {1: 0.1, 10: 1.0, 100: 2.5, 1000: 3.0, 10_000: 4.0, 100_000: 15.0}
FULL = {1000: 15.0, 10_000: 18.0, 100_000: 40.0}

if __name__ == "__main__":
    main()
