"""What sets the members apart: a target that another masks, and the edge of clutter."""

from dataclasses import MISSING, dataclass, fields

import numpy as np

from dechirp.process.cfar.base import Cells, Cfar, Noise, NoiseEstimator
from dechirp.process.spectrum import Transform

# Short along velocity, so that one strong target is a large part of the window.
_TRAINING, _GUARD = Cells(range=8, velocity=1), Cells(range=2, velocity=1)


@dataclass(frozen=True)
class Situation:
    """A map of independent cells with two close targets and, beyond, a step of clutter."""

    power: np.ndarray
    """(velocity, range), over the mean of the noise."""
    row: int
    """Velocity of the targets."""
    targets: tuple[int, int]
    """Ranges of the strong target and of the weak one."""
    clutter_from: int
    """Range of the first cell of clutter."""


def masking_and_clutter_edge(*, seed: int = 1) -> Situation:
    """Targets of 30 and 20 dB six cells apart, and clutter 20 dB over the noise from a range on."""
    row, targets, clutter_from = 10, (60, 66), 120
    power = np.random.default_rng(seed).exponential(size=(21, 200)).astype(np.float32)
    power[:, clutter_from:] *= 100.0
    power[row, targets] = 1000.0, 100.0
    return Situation(power=power, row=row, targets=targets, clutter_from=clutter_from)


def side_by_side(
    power: np.ndarray,
    row: int,
    *,
    n_training: Cells = _TRAINING,
    n_guard: Cells = _GUARD,
    false_alarm_probability: float = 1e-6,
) -> dict[str, np.ndarray]:
    """Threshold along range (range,) at one velocity of a map, for each member by its kind.

    All with the same training cells and the same false-alarm probability in noise that is
    independent from cell to cell; members that need settings are left out.
    """
    white = [Transform(window="rectangular", n_points=n, n_bins=n) for n in power.shape]
    noise = Noise(over_velocity=white[0], over_range=white[1])
    at = np.stack([np.full(power.shape[1], row), np.arange(power.shape[1])], axis=1)
    thresholds = {}
    for kind, member in NoiseEstimator.members().items():
        if all(field.default is not MISSING for field in fields(member)):
            cfar = Cfar(
                estimator=member(),
                n_training=n_training,
                n_guard=n_guard,
                false_alarm_probability=false_alarm_probability,
            )
            thresholds[kind] = cfar.threshold_at(power, at, noise)
    return thresholds
