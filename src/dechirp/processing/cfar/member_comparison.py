"""Comparison of CFAR members: a masked target and a clutter edge."""

from dataclasses import MISSING, dataclass, fields

import numpy as np

from dechirp.processing.cfar.base import Cells, Cfar, MapNoise, NoiseEstimator
from dechirp.processing.spectrum import Transform

# The window is short along velocity, so that one strong target is a large part of it.
_TRAINING, _GUARD = Cells(range=8, velocity=1), Cells(range=2, velocity=1)


@dataclass(frozen=True)
class ExampleMap:
    """Map of independent cells with two close targets and a step of clutter."""

    power: np.ndarray
    """Power (velocity, range), relative to the mean noise."""
    row: int
    """Velocity row of the targets."""
    targets: tuple[int, int]
    """Range bins of the strong and of the weak target."""
    clutter_start: int
    """Range bin of the first clutter cell."""


def make_example_map(*, seed: int = 1) -> ExampleMap:
    """Make a map with targets of 30 and 20 dB six cells apart, and clutter 20 dB over the noise."""
    row, targets, clutter_start = 10, (60, 66), 120
    power = np.random.default_rng(seed).exponential(size=(21, 200)).astype(np.float32)
    power[:, clutter_start:] *= 100.0
    power[row, targets] = 1000.0, 100.0
    return ExampleMap(power=power, row=row, targets=targets, clutter_start=clutter_start)


def compare_thresholds(
    power: np.ndarray,
    velocity_row: int,
    *,
    n_training: Cells = _TRAINING,
    n_guard: Cells = _GUARD,
    false_alarm_probability: float = 1e-6,
) -> dict[str, np.ndarray]:
    """Return the threshold along range (range,) at one velocity for each member by kind.

    All members have the same training cells and the same false-alarm probability in independent
    noise; members with required settings are left out.
    """
    white = [Transform(window="rectangular", n_points=n, n_bins=n) for n in power.shape]
    noise = MapNoise(doppler_transform=white[0], range_transform=white[1])
    cells = np.stack([np.full(power.shape[1], velocity_row), np.arange(power.shape[1])], axis=1)
    thresholds = {}
    for kind, member in NoiseEstimator.members().items():
        if all(field.default is not MISSING for field in fields(member)):
            cfar = Cfar(
                estimator=member(),
                n_training=n_training,
                n_guard=n_guard,
                false_alarm_probability=false_alarm_probability,
            )
            thresholds[kind] = cfar.threshold_at_cells(power, cells, noise)
    return thresholds
