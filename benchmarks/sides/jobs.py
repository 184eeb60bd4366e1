"""Benchmark jobs: names, inputs, and minimum numbers of bytes and operations."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from sides import inputs, scenes
from sides.job_types import Inputs


class MinimumWork(NamedTuple):
    """Minimum work of a job, independent of the method."""

    n_bytes: float
    """Bytes of the inputs and results, each read or written once."""
    n_operations: float = 0.0
    """Operations of its transforms or products, by the usual count."""
    operation: str = "transforms"


class Job(NamedTuple):
    """Benchmark job; one section of the table."""

    name: str
    kind: str
    """Name of the function that implements the job in each side."""
    make: Callable[[], Inputs]
    minimum_work: MinimumWork
    n_items: int = 1
    """Number of detections, spectra or maps in a call; reported times are per item."""
    additional_work: str = ""
    """Additional work of dechirp that other sides omit."""
    make_accuracy_inputs: Callable[[], Inputs] | None = None
    """Function that makes other inputs of the same kind, with which the accuracy is measured."""


def jobs() -> list[Job]:
    """List the jobs of a full run."""
    return [
        *(echoes(n) for n in (1, 10, 100)),
        Job(
            "echoes, 3 x 4 x 128 x 256, 100 targets",
            "echoes",
            lambda: inputs.echoes(scenes.mimo(100, np.random.default_rng(1))),
            MinimumWork(8.0 * 384 * 4 * 256),
        ),
        *(echoes(n) for n in (1000, 10_000)),
        power_map(128, 2200, 4096),
        *detectors(1, 128, 2048),
        *frames((2200, 128, 1, 1), (256, 128, 3, 4), (512, 256, 4, 4)),
        *angles((12, 1000), (192, 100)),
        Job(
            "DBSCAN, 5,000 points",
            "dbscan",
            partial(inputs.clustered_detections, 5000),
            MinimumWork(8.0 * 5000 * 4),
            additional_work="ambiguous velocities, centroids with errors, labelled tables",
        ),
        Job(
            "tracking, 50 frames",
            "tracking",
            partial(inputs.tracking, 50),
            MinimumWork(0.0),
            n_items=50,
        ),
        Job(
            "decode 256 x 4 x 256",
            "decode",
            partial(inputs.dca1000_codes, 256, 4, 256),
            MinimumWork((4.0 + 8) * 256 * 4 * 256),
        ),
    ]


def tiny_jobs() -> list[Job]:
    """List small jobs of the same kinds, to check that the sides agree."""
    return [
        echoes(10),
        Job(
            "echoes, three transmitters",
            "echoes",
            lambda: inputs.echoes(scenes.mimo(1, np.random.default_rng(1))),
            MinimumWork(0.0),
        ),
        power_map(16, 60, 64),
        *detectors(1, 40, 48),
        *frames((64, 32, 1, 1), (64, 32, 2, 2)),
        *angles((12, 20)),
        Job("DBSCAN", "dbscan", partial(inputs.clustered_detections, 500), MinimumWork(0.0)),
        Job("decode", "decode", partial(inputs.dca1000_codes, 4, 2, 16), MinimumWork(0.0)),
    ]


def echoes(n: int) -> Job:
    return Job(
        f"echoes, cube A, {n:,} target{'s' * (n > 1)}",
        "echoes",
        lambda: inputs.echoes(scenes.cube_a(n, 200.0, np.random.default_rng(n))),
        MinimumWork(8.0 * 128 * 2200),
        additional_work="initial zeros, curved paths, input checks",
    )


def power_map(n_chirps: int, n_samples: int, n_bins: int) -> Job:
    operations = count_transform_operations(n_samples, n_chirps) + count_transform_operations(
        n_chirps, n_bins
    )
    return Job(
        f"power map, {n_chirps} x {n_bins}",
        "power_map",
        partial(inputs.power_map, n_chirps, n_samples, n_bins),
        MinimumWork(8.0 * n_chirps * n_samples + 4.0 * n_chirps * n_bins, operations),
    )


def count_transform_operations(n_times: int, n: int) -> float:
    """Count the operations of n_times transforms of n complex numbers."""
    return 5.0 * n_times * n * float(np.log2(n))


def detectors(n_maps: int, n_velocity: int, n_range: int) -> list[Job]:
    """Build the detector jobs: timed at a false-alarm probability of 1e-6, counted at 1e-2."""
    noise = partial(inputs.noise_maps, n_maps, n_velocity, n_range, 1e-6)
    few, small = min(n_range, 512), min(n_range, 256)
    minimum_work = MinimumWork(5.0 * n_maps * n_velocity * n_range)
    return [
        Job(
            f"cell averaging, {n_range} x {n_velocity}",
            "cell_averaging",
            noise,
            minimum_work,
            additional_work="edges; sums in double precision, exact with targets of 120 dB",
            make_accuracy_inputs=partial(inputs.noise_maps, 20, n_velocity, few, 1e-2),
        ),
        *(
            Job(
                f"ordered statistic, {n_range} x {n_velocity}, {background}",
                "ordered_statistic",
                partial(noise, step),
                minimum_work,
                make_accuracy_inputs=partial(inputs.noise_maps, 2, n_velocity, small, 1e-2),
            )
            for background, step in (("noise", 1.0), ("a step of 20 dB", 100.0))
        ),
    ]


def frames(*sizes: tuple[int, int, int, int]) -> list[Job]:
    return [
        Job(
            f"frame {n_samples} x {n_chirps} x {n_tx * n_rx}",
            "frame",
            partial(inputs.frame, n_samples, n_chirps, n_tx, n_rx),
            MinimumWork(
                8.0 * n_samples * n_chirps * n_tx * n_rx,
                count_transform_operations(n_chirps * n_tx * n_rx, n_samples)
                + count_transform_operations(n_samples * n_tx * n_rx, n_chirps),
            ),
            additional_work="edges, peaks, refinement, ambiguity, directions, labelled tables",
        )
        for n_samples, n_chirps, n_tx, n_rx in sizes
    ]


def angles(*sizes: tuple[int, int]) -> list[Job]:
    """Build the jobs of beams of 1,000 snapshots and directions of single detections."""
    angle_jobs = []
    for n_elements, n in sizes:
        angle_jobs.append(
            Job(
                f"Bartlett, 1,000 x 181, {n_elements} channels",
                "bartlett",
                partial(inputs.snapshots, 1000, n_elements),
                MinimumWork(
                    8.0 * 1000 * n_elements + 4.0 * 1000 * 181,
                    8.0 * 1000 * n_elements * 181,
                    "products",
                ),
            )
        )
        for kind, name in (("capon", "Capon"), ("music", "MUSIC")):
            angle_jobs.append(
                Job(
                    f"{name} of a detection, {n_elements} channels",
                    kind,
                    partial(inputs.snapshots, n, n_elements),
                    MinimumWork(8.0 * n * n_elements, 8.0 * n * n_elements * 181, "products"),
                    n_items=n,
                    additional_work="coherent sources resolved, refinement, standard errors",
                )
            )
    return angle_jobs
