"""Jobs of growing size for `growth.py`, with their complexity laws.

A law follows from the number of operations and applies to large sizes. Constant parts and kernels
that are limited by memory bandwidth give smaller exponents at small sizes.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import angles
import numpy as np
import study_machinery
import xarray as xr
from sides.frames import simulate_frame
from sides.scenes import centred_times, cube_a

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cluster import cluster
from dechirp.processing.refine import refine_tones
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.simulation.engine import Engine
from dechirp.simulation.kernels import selection
from dechirp.theory.cfar_correlated_cells import correlated_factor

Work = Callable[[], object]

FACTOR = 13.965  # false-alarm probability 1e-6 with 644 training cells

LAWS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "1": lambda n: n**0,
    "n": lambda n: n,
    "n log n": lambda n: n * np.log(n),
    "n^2": lambda n: n**2,
    "n^3": lambda n: n**3,
}


class Job(NamedTuple):
    """Job of variable size with its complexity law."""

    name: str
    growing_quantity: str
    """Quantity that is varied."""
    law: str
    sizes: tuple[int, ...]
    make: Callable[[int], Work]


def jobs() -> Iterator[Job]:
    """Iterate over all jobs."""
    yield from _echoes()
    yield from _maps()
    yield from _detectors()
    yield from _estimates()
    yield Job(
        "clusters, constant density", "detections", "n log n", doubled_sizes(1000, 5), _clusters
    )
    yield Job("study, ledger", "trials", "n", tuple(50 * n for n in doubled_sizes(25, 4)), _study)


def doubled_sizes(first: int, count: int) -> tuple[int, ...]:
    """Return sizes that double from the first one."""
    return tuple(first << k for k in range(count))


def _echoes() -> Iterator[Job]:
    def work(
        kernel: str, n: int = 8, *, n_chirps: int = 128, n_rx: int = 1, n_samples: int = 2200
    ) -> Work:
        scatterers, transmission, _ = cube_a(n, 200.0, np.random.default_rng(1))
        half_wave_m = np.arange(n_rx)[:, None] * [0.0, 1.9e-3, 0.0]
        transmission = transmission._replace(
            starts_s=centred_times(n_chirps, transmission.starts_s[1] - transmission.starts_s[0]),
            weights=np.ones((n_chirps, 1), complex),
            rx_m=half_wave_m,
        )
        scatterers = scatterers._replace(rx_gains=np.ones((n_rx, n)))
        out = np.zeros((n_chirps, n_rx, n_samples), np.complex64)
        engine = Engine(kernel=kernel)
        return lambda: selection.add_echoes(out, scatterers, transmission, engine=engine)

    for kernel, first in (("direct", 2), ("low-rank", 8), ("nufft", 8000)):
        make = partial(work, kernel)
        yield Job(f"echoes, {kernel}", "scatterers", "n", doubled_sizes(first, 5), make)
    for kernel in ("direct", "low-rank"):
        yield Job(
            f"echoes, {kernel}", "chirps", "n", doubled_sizes(32, 5),
            lambda m, kernel=kernel: work(kernel, n_chirps=m),
        )  # fmt: skip
        yield Job(
            f"echoes, {kernel}", "channels", "n", doubled_sizes(1, 5),
            lambda m, kernel=kernel: work(kernel, n_chirps=32, n_rx=m),
        )  # fmt: skip


def _maps() -> Iterator[Job]:
    def work(n_chirps: int = 128, n_channels: int = 1, n_samples: int = 512) -> Work:
        rng = np.random.default_rng(1)
        shape = (n_chirps, n_channels, n_samples)
        samples = rng.normal(size=(2, *shape)).astype(np.float32)
        cube = (samples[0] + 1j * samples[1]).astype(np.complex64)
        over_range, over_velocity = (
            Transform(window="hann", n_points=n, n_bins=n) for n in (n_samples, n_chirps)
        )
        return lambda: mean_range_doppler_power(cube, "complex", over_range, over_velocity)

    yield Job("map", "chirps", "n log n", doubled_sizes(64, 5), lambda n: work(n_chirps=n))
    yield Job("map", "samples", "n log n", doubled_sizes(256, 5), lambda n: work(n_samples=n))
    yield Job("map", "channels", "n", doubled_sizes(1, 5), lambda n: work(n_channels=n))

    def frame(**counts: int) -> Work:
        shape = {"n_samples": 256, "n_chirps": 64, "n_tx": 1, "n_rx": 1} | counts
        cube, radar = simulate_frame(**shape, n_targets=3)
        chain = dc.Chain(angle=None)
        return lambda: dc.detect(cube, radar, chain)

    yield Job("detect", "chirps", "n log n", doubled_sizes(64, 5), lambda n: frame(n_chirps=n))
    yield Job("detect", "channels", "n", doubled_sizes(1, 5), lambda n: frame(n_rx=n))


def _detectors() -> Iterator[Job]:
    rng = np.random.default_rng(1)

    def work(
        estimator: NoiseEstimator, n_cells: int, *, n_velocity: int = 128, n_training: int = 8
    ) -> Work:
        shape = (n_velocity, n_cells // n_velocity)
        power = rng.exponential(size=shape).astype(np.float32)
        training_window = TrainingWindow(
            n_training=dc.Cells(range=n_training, velocity=n_training),
            n_guard=dc.Cells(range=4, velocity=4),
        )
        factors = np.full(power.shape[1], FACTOR, np.float32)
        return lambda: estimator.exceeds_threshold(power, training_window, factors)

    def work_for_window(estimator: NoiseEstimator, n: int) -> Work:
        # Half width of a training window that has about n cells outside its guard of 9 x 9 cells.
        half = round((np.sqrt(n + 81) - 1) / 2)
        # Cells at both ends of the range axis take longer, and a wide window has more of them.
        # A large map keeps their fraction small.
        return work(estimator, 2**20, n_velocity=512, n_training=half - 4)

    for kind, member in NoiseEstimator.members().items():
        estimator = member()
        yield Job(f"CFAR, {kind}", "cells", "n", doubled_sizes(2**16, 4), partial(work, estimator))
        yield Job(
            f"CFAR, {kind}", "training cells", TRAINING_CELL_LAWS.get(kind, "n"),
            doubled_sizes(256, 4),
            partial(work_for_window, estimator),
        )  # fmt: skip

    def exact(n: int) -> Work:
        noise = dc.Chain().map_noise_statistics(dc.reference().radar)
        training_window = TrainingWindow(
            n_training=dc.Cells(range=10, velocity=8),
            n_guard=dc.Cells(range=n // 9 // 2, velocity=4),
        )
        box = training_window.noise_covariance_in_box(noise, training_window.half_range)
        return lambda: correlated_factor(1e-6, box)

    yield Job("CFAR factor, exact", "guard cells", "n^3", (81, 171, 351, 711), exact)


# Detectors with running sums, over the whole window or its halves, take a time that does not depend
# on the number of training cells. The other detectors read each cell.
TRAINING_CELL_LAWS = dict.fromkeys(("cell-averaging", "greatest-of", "smallest-of"), "1")


def _estimates() -> Iterator[Job]:
    def tones(n: int) -> Work:
        rng = np.random.default_rng(1)
        samples = rng.normal(size=(128, 1, 512, 2)).astype(np.float32).view(np.complex64)[..., 0]
        slow, fast = rng.uniform(0, 2 * np.pi, (2, n))
        return lambda: refine_tones(samples, slow, fast, np.ones(n))

    yield Job("refinement", "detections", "n", doubled_sizes(32, 5), tones)

    def directions(kind: str, n: int) -> Work:
        aperture = Aperture(angles.linear_positions(n))
        estimator, x = (
            DirectionEstimator.members()[kind](),
            angles.simulate_one_source(aperture, 100),
        )
        return lambda: estimator.find_directions(x, aperture, np.ones(100))

    # Bartlett: grid points grow as n, and each takes a product of n terms. Capon and MUSIC: matrix
    # factorisation or eigenvectors, n^3.
    for kind, law in (("bartlett", "n^2"), ("capon", "n^3"), ("music", "n^3")):
        yield Job(
            f"directions, {kind}", "channels", law, doubled_sizes(16, 4), partial(directions, kind)
        )


def _clusters(n: int) -> Work:
    """Build a clustering job of n detections, 100 per frame."""
    rng = np.random.default_rng(1)
    columns = {
        "frame": np.arange(n) // 100,
        "range": rng.uniform(5, 200, n),
        "velocity": rng.uniform(-20, 20, n),
        "snr": rng.uniform(10, 1000, n),
    }
    detections = xr.Dataset({name: ("detection", column) for name, column in columns.items()})
    radar = dc.reference().radar
    return lambda: cluster(detections, radar)


def _study(n: int) -> Work:
    def work() -> None:
        with (
            ThreadPoolExecutor(1) as executor,
            study_machinery.workers_from_executor(executor) as workers,
        ):
            study_machinery.run_study(workers, n // study_machinery.BLOCK, 0)

    return work
