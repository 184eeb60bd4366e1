"""Interacting multiple model estimator: several motion models run side by side.

H. A. P. Blom and Y. Bar-Shalom, IEEE Transactions on Automatic Control 33(8), 1988.

Arrays have the axes (track, model, state). Models switch as a Markov chain in continuous time: a
model holds for `model_time_s` on average, and each other model follows with equal probability.
"""

import numpy as np


def switching_probabilities(n_models: int, interval_s: float, model_time_s: float) -> np.ndarray:
    """Compute the probabilities of model j (column) an interval after model i (row)."""
    # The generator has one eigenvalue besides 0: -n / ((n - 1) tau).
    if n_models == 1:
        return np.ones((1, 1))
    decay = np.exp(-interval_s * n_models / ((n_models - 1) * model_time_s))
    probabilities: np.ndarray = decay * np.eye(n_models) + (1 - decay) / n_models
    return probabilities


def mix_models(
    mean: np.ndarray, covariance: np.ndarray, probability: np.ndarray, switching: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the mean, covariance and probability with which each model enters an interval.

    Parameters
    ----------
    mean : array (track, model, state)
    covariance : array (track, model, state, state)
    probability : array (track, model)
        Probability of each model at the end of the interval before.
    switching : array (model, model)
        From `switching_probabilities`.
    """
    joint = probability[:, :, None] * switching  # (track, model before, model after)
    entered = joint.sum(axis=1)
    weight = joint / entered[:, None]
    mixed = np.einsum("tij,tis->tjs", weight, mean)
    offset = mean[:, :, None] - mixed[:, None]  # (track, before, after, state)
    spread = np.einsum("tij,tija,tijb->tjab", weight, offset, offset)
    return mixed, np.einsum("tij,tiab->tjab", weight, covariance) + spread, entered


def update_model_probabilities(probability: np.ndarray, log_likelihood: np.ndarray) -> np.ndarray:
    """Weigh models (track, model) by the likelihood of the measurements under each."""
    weight = probability * np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    normalised: np.ndarray = weight / weight.sum(axis=1, keepdims=True)
    return normalised


def combine_models(
    mean: np.ndarray, covariance: np.ndarray, probability: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute mean (track, state) and covariance of the mixture of all models."""
    combined = np.einsum("tm,tms->ts", probability, mean)
    offset = mean - combined[:, None]
    spread = covariance + offset[..., :, None] * offset[..., None, :]
    return combined, np.einsum("tm,tmab->tab", probability, spread)
