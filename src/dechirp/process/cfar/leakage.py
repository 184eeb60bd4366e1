"""What a guard that is too small costs: a target that raises its own threshold."""

import numpy as np

from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.spectrum import Transform
from dechirp.theory.cfar import cell_averaging_factor


def guard_loss(cfar: Cfar, noise: Noise) -> float:
    """The snr at which a target just exceeds its threshold, over that without its leakage.

    For a target on a bin, in noise of the mean power: with a_i the window's response in the
    training cells and Z the estimator, snr = factor Z(1 + snr a). A ratio of at least 1;
    infinite where a target raises its threshold as fast as it grows. Good to a few per cent, as
    the factor is that for independent cells.
    """
    ring = cfar.ring
    offsets = ring.offsets(ring.half_range)
    factor = cfar.offset or cell_averaging_factor(
        cfar.false_alarm_probability or 0.5, n_training=len(offsets), n_summed=noise.n_channels
    )
    response = _response(noise.over_velocity, offsets[:, 0])
    response *= _response(noise.over_range, offsets[:, 1])

    alone = needed = factor * float(cfar.estimator.statistic(np.ones(len(offsets)), offsets))
    while needed < 1e9 * alone:
        before = needed
        needed = factor * float(cfar.estimator.statistic(1 + before * response, offsets))
        if needed <= before * (1 + 1e-6):
            return needed / alone
    return np.inf


def _response(transform: Transform, bins: np.ndarray) -> np.ndarray:
    """Power so many bins from a tone on a bin, relative to the tone's."""
    turns = np.arange(transform.n_points)[:, None] * bins / transform.n_bins
    amplitude = transform.weights @ np.exp(2j * np.pi * turns) / transform.weights.sum()
    return np.asarray(abs(amplitude) ** 2)
