"""Self-masking loss of a guard window that is too small."""

import numpy as np

from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.spectrum import Transform
from dechirp.theory.cfar import cell_averaging_factor


def self_masking_loss(cfar: Cfar, noise: MapNoise) -> float:
    """Return the SNR to exceed the threshold relative to that without self-masking.

    For a target on a bin, in noise of the mean power: with a_i the window's response in the
    training cells and Z the estimator, snr = factor Z(1 + snr a). A ratio of at least 1; infinite
    where a target raises its threshold as fast as its power. Accurate to a few per cent, as the
    factor is that for independent cells.
    """
    window = cfar.training_window
    offsets = window.offsets(window.half_range)
    factor = cfar.offset or cell_averaging_factor(
        cfar.false_alarm_probability or 0.5, n_training=len(offsets), n_summed=noise.n_channels
    )
    response = _window_response(noise.doppler_transform, offsets[:, 0])
    response *= _window_response(noise.range_transform, offsets[:, 1])

    unmasked_snr = required_snr = factor * float(
        cfar.estimator.statistic(np.ones(len(offsets)), offsets)
    )
    while required_snr < 1e9 * unmasked_snr:
        previous_snr = required_snr
        required_snr = factor * float(
            cfar.estimator.statistic(1 + previous_snr * response, offsets)
        )
        if required_snr <= previous_snr * (1 + 1e-6):
            return required_snr / unmasked_snr
    return np.inf


def _window_response(transform: Transform, bins: np.ndarray) -> np.ndarray:
    """Return the power at bins from a tone on a bin, relative to the tone's."""
    cycles = np.arange(transform.n_points)[:, None] * bins / transform.n_bins
    amplitude = transform.weights @ np.exp(2j * np.pi * cycles) / transform.weights.sum()
    return np.asarray(abs(amplitude) ** 2)
