"""Gains of the elements and errors of their places, from echoes of known directions."""

from dataclasses import dataclass

import numpy as np

_TURNS = 30
# A spread of directions, in sines, below which no place can be told from a phase: 1 degree.
_LEAST_SPREAD = 0.017
# Two axes along which directions vary alike tell one error between them.
_SAME = 0.05


@dataclass(frozen=True)
class ElementErrors:
    """What makes the elements of an array differ from what is believed of it."""

    channel: np.ndarray
    """(n,) complex: what each channel multiplies the echo by, but for a common factor."""
    channel_std: np.ndarray
    """(n,) standard deviation, relative: of the amplitude, and of the phase in radians."""
    position_m: np.ndarray
    """(n, 3); 0 along axes that the directions do not tell, and 0 in the mean."""
    position_std_m: np.ndarray
    """(n, 3); 0 where nothing was estimated."""
    residual: float
    """Root mean square of what does not fit, over the echo, unbiased; of noise alone where there
    are as many unknowns as numbers."""
    noise: float
    """The same of noise alone."""


def element_errors(
    snapshots: np.ndarray,
    noise_power: np.ndarray,
    believed: np.ndarray,
    towards: np.ndarray,
    wavelength_m: float,
) -> ElementErrors:
    r"""Least-squares fit of channels and places to echoes of known directions.

    .. math:: x_{k,i} = s_k\, c_i\, b_{k,i}\, e^{-2\pi\mathrm{i}\, u_k \cdot d_i / \lambda} + w

    with the echo's own amplitude s of each look k, the channel c and the place's error d of each
    element i. With d known, the leading singular vectors of x / b are s and c; with both known, d
    is a weighted least-squares fit to phases; both in turn, about the mean direction, so that
    channels and places hardly depend on each other. Errors are small: d across the spread of
    directions moves phases by less than half a turn.

    Not told by the numbers: a factor common to all channels and a shift common to all places, both
    of which are the echo's own phase; and places along an axis on which the directions do
    not differ, as on all of them where there is one direction. Forward errors are taken as
    0: across a board they are nothing, and directions hardly differ along x. An error common to
    all directions that were told, a turned table, seems a turned array.

    Parameters
    ----------
    snapshots : array (n_looks, n), complex
    noise_power : array (n_looks,)
        Noise in each of its numbers, E|w|^2.
    believed : array (n_looks, n), complex
        b: what the array should see, near-field and all.
    towards : array (n_looks, 3)
        u, unit vectors to the reflector.

    References
    ----------
    B. C. Ng and C. M. S. See, Sensor-array calibration using a maximum-likelihood approach, IEEE
    Trans. Antennas and Propagation 44(6), 1996.
    """
    n_looks, n = snapshots.shape
    per_m = 2 * np.pi / wavelength_m
    told = np.sqrt(np.mean((towards - towards.mean(axis=0)) ** 2, axis=0)) > _LEAST_SPREAD
    told[0] = False
    seen = snapshots / believed / np.sqrt(noise_power)[:, None]  # looks count by what stands out
    position_m, step_m = np.zeros((n, 3)), np.full((n, 3), np.inf)
    about = towards.mean(axis=0)
    for _ in range(_TURNS):
        turned = seen * np.exp(1j * per_m * (towards - about) @ position_m.T)
        left, size, right = np.linalg.svd(turned, full_matrices=False)
        echo, channel = left[:, 0] * size[0], right[0]
        if not told.any() or abs(step_m).max() * per_m < 1e-6:
            break
        weight = abs(echo) ** 2 / np.sum(abs(echo) ** 2)
        about = weight @ towards
        spread = (towards - about)[:, told] * np.sqrt(weight)[:, None]
        phases = np.angle(turned / np.outer(echo, channel)) * np.sqrt(weight)[:, None]
        step = np.linalg.pinv(spread, rcond=_SAME) @ phases / -per_m
        step_m = np.zeros((n, 3))
        step_m[:, told] = step.T - step.T.mean(axis=0)
        position_m += step_m
    misfit = abs(turned - np.outer(echo, channel)) ** 2 / abs(echo[:, None]) ** 2 * n

    snr = abs(np.outer(echo, channel)) ** 2
    phase_variance = 1 / (2 * snr.sum(axis=0))
    covariance, rank = np.zeros((3, 3)), 0
    if told.any():
        rank = int(np.linalg.matrix_rank(spread, tol=_SAME * np.linalg.norm(spread, 2)))
        covariance[np.ix_(told, told)] = np.linalg.pinv(spread.T @ spread, rcond=_SAME**2)
    n_free = 2 * n_looks * n - 2 * (n_looks + n - 1) - (n - 1) * rank
    noise = float(np.sqrt(np.mean(1 / snr)))
    return ElementErrors(
        # From the mean direction back to boresight.
        channel=channel * np.exp(1j * per_m * position_m @ about),
        channel_std=np.sqrt(phase_variance * (1 + about @ covariance @ about)),
        position_m=position_m,
        position_std_m=np.sqrt(np.outer(phase_variance, np.diag(covariance))) / per_m,
        residual=float(np.sqrt(2 * misfit.sum() / n_free)) if n_free > 0 else noise,
        noise=noise,
    )
