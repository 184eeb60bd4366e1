"""The jobs: what each is called, what is given, and the least that any code must move or count."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from sides import inputs, scenes
from sides.kinds import Inputs


class Needs(NamedTuple):
    """The least that a job takes of a machine, by whatever method."""

    n_bytes: float
    """Read once and written once."""
    n_operations: float = 0.0
    """Of the transforms or products in it, as they are usually counted."""
    of: str = "transforms"


class Job(NamedTuple):
    """One line of the table."""

    name: str
    kind: str
    """The function that a side has for it."""
    make: Callable[[], Inputs]
    needs: Needs
    each: int = 1
    """Detections, spectra or maps in a call: times are of one."""
    ours_also: str = ""
    """What ours does besides, which others leave out."""
    judged_by: Callable[[], Inputs] | None = None
    """Other inputs of the same kind, by which a result is judged."""


def jobs() -> list[Job]:
    """Those of a full run."""
    return [
        *(echoes(n) for n in (1, 10, 100)),
        Job(
            "echoes, 3 x 4 x 128 x 256, 100 targets",
            "echoes",
            lambda: inputs.echoes(scenes.mimo(100, np.random.default_rng(1))),
            Needs(8.0 * 384 * 4 * 256),
        ),
        *(echoes(n) for n in (1000, 10_000)),
        power_map(128, 2200, 4096),
        *detectors(1, 128, 2048),
        *frames((2200, 128, 1, 1), (256, 128, 3, 4), (512, 256, 4, 4)),
        *angles((12, 1000), (192, 100)),
        Job(
            "DBSCAN, 5,000 points",
            "dbscan",
            partial(inputs.points, 5000),
            Needs(8.0 * 5000 * 4),
            ours_also="velocities that go round, centroids with errors, labelled tables",
        ),
        Job("tracking, 50 frames", "tracking", partial(inputs.tracking, 50), Needs(0.0), each=50),
        Job(
            "decode 256 x 4 x 256",
            "decode",
            partial(inputs.words, 256, 4, 256),
            Needs((4.0 + 8) * 256 * 4 * 256),
        ),
    ]


def tiny_jobs() -> list[Job]:
    """The same kinds, each in milliseconds, to see that sides still agree."""
    return [
        echoes(10),
        Job(
            "echoes, three transmitters",
            "echoes",
            lambda: inputs.echoes(scenes.mimo(1, np.random.default_rng(1))),
            Needs(0.0),
        ),
        power_map(16, 60, 64),
        *detectors(1, 40, 48),
        *frames((64, 32, 1, 1), (64, 32, 2, 2)),
        *angles((12, 20)),
        Job("DBSCAN", "dbscan", partial(inputs.points, 500), Needs(0.0)),
        Job("decode", "decode", partial(inputs.words, 4, 2, 16), Needs(0.0)),
    ]


def echoes(n: int) -> Job:
    return Job(
        f"echoes, cube A, {n:,} target{'s' * (n > 1)}",
        "echoes",
        lambda: inputs.echoes(scenes.cube_a(n, 200.0, np.random.default_rng(n))),
        Needs(8.0 * 128 * 2200),
        ours_also="zeros, written first to add to; paths that bend; what is given is checked",
    )


def power_map(n_chirps: int, n_samples: int, n_bins: int) -> Job:
    operations = transform(n_samples, n_chirps) + transform(n_chirps, n_bins)
    return Job(
        f"power map, {n_chirps} x {n_bins}",
        "power_map",
        partial(inputs.power_map, n_chirps, n_samples, n_bins),
        Needs(8.0 * n_chirps * n_samples + 4.0 * n_chirps * n_bins, operations),
    )


def transform(n_times: int, n: int) -> float:
    """Operations of n_times transforms of n complex numbers."""
    return 5.0 * n_times * n * float(np.log2(n))


def detectors(n_maps: int, n_velocity: int, n_range: int) -> list[Job]:
    """Timed at one alarm in a million cells; rates are counted where alarms are common."""
    noise = partial(inputs.noise_maps, n_maps, n_velocity, n_range, 1e-6)
    few, small = min(n_range, 512), min(n_range, 256)
    needs = Needs(5.0 * n_maps * n_velocity * n_range)
    return [
        Job(
            f"cell averaging, {n_range} x {n_velocity}",
            "cell_averaging",
            noise,
            needs,
            ours_also="edges; sums in double precision, so that a target 120 dB up hides no noise",
            judged_by=partial(inputs.noise_maps, 20, n_velocity, few, 1e-2),
        ),
        *(
            Job(
                f"ordered statistic, {n_range} x {n_velocity}, {what}",
                "ordered_statistic",
                partial(noise, step),
                needs,
                judged_by=partial(inputs.noise_maps, 2, n_velocity, small, 1e-2),
            )
            for what, step in (("noise", 1.0), ("a step of 20 dB", 100.0))
        ),
    ]


def frames(*sizes: tuple[int, int, int, int]) -> list[Job]:
    return [
        Job(
            f"frame {n_samples} x {n_chirps} x {n_tx * n_rx}",
            "frame",
            partial(inputs.frame, n_samples, n_chirps, n_tx, n_rx),
            Needs(
                8.0 * n_samples * n_chirps * n_tx * n_rx,
                transform(n_chirps * n_tx * n_rx, n_samples)
                + transform(n_samples * n_tx * n_rx, n_chirps),
            ),
            ours_also="edges, peaks, refinement, folds, directions, labelled detections",
        )
        for n_samples, n_chirps, n_tx, n_rx in sizes
    ]


def angles(*sizes: tuple[int, int]) -> list[Job]:
    """Beams of 1,000 snapshots, and directions of so many detections one by one."""
    found = []
    for n_elements, n in sizes:
        found.append(
            Job(
                f"Bartlett, 1,000 x 181, {n_elements} channels",
                "bartlett",
                partial(inputs.snapshots, 1000, n_elements),
                Needs(
                    8.0 * 1000 * n_elements + 4.0 * 1000 * 181,
                    8.0 * 1000 * n_elements * 181,
                    "products",
                ),
            )
        )
        for kind, name in (("capon", "Capon"), ("music", "MUSIC")):
            found.append(
                Job(
                    f"{name} of a detection, {n_elements} channels",
                    kind,
                    partial(inputs.snapshots, n, n_elements),
                    Needs(8.0 * n * n_elements, 8.0 * n * n_elements * 181, "products"),
                    each=n,
                    ours_also="two sources of any phase told apart, refinement, standard errors",
                )
            )
    return found
