r"""Model order, the number of sources, by the criteria of Wax & Kailath (1985).

A model of k sources costs its negative log-likelihood and a penalty for each real parameter: 1 by
Akaike's criterion (aic), half the logarithm of the number of observations by the minimum
description length (mdl). The model of least cost is selected, of at least one source, since a
target was detected.

The noise power is known from the training cells, which is more informative than its isotropy:
with one snapshot, the windows of an array are too few for an isotropy test.

References
----------
M. Wax and T. Kailath, Detection of signals by information theoretic criteria, IEEE Trans.
ASSP 33(2), 1985.
"""

from typing import Literal

import numpy as np

from dechirp.processing.angle import subspace
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.covariance import SlidingWindows, Smoothing, array_smoothing_windows

Criterion = Literal["mdl", "aic"]

MAX_SOURCES = 4
"""Largest number of sources that a criterion selects."""
# Rounding error of single precision next to a strong source, without noise.
_ROUNDING = 1e-12


def estimate_n_sources(
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    criterion: Criterion,
    windows: SlidingWindows | None = None,
) -> np.ndarray:
    r"""Estimate the number of sources in snapshots (n, n_snapshots, n_elements): (n,), 1 to 4.

    .. math::

        C(k) = T \sum_{i>k} \left( \frac{\lambda_i}{\sigma^2} - 1
            - \ln\frac{\lambda_i}{\sigma^2} \right) + p\, k (2m - k)

    with lambda the eigenvalues of the covariance, m elements in a window, p the price and
    sigma^2 the `noise_power` (n,) of one element. Windows overlap: they are worth T snapshots,
    T m = (sum c)^2 / sum c^2 independent values in a snapshot, c being the windows that an element
    is in, for then the mean power has its true variance. Reading them backwards adds none.

    `windows` are other windows than the usual ones. An array that is not uniform has but one, and
    a single snapshot at it shows one source whatever is there.
    """
    windows = windows or array_smoothing_windows(aperture, Smoothing())
    n_snapshots, m = snapshots.shape[1], windows.n_window_points
    max_sources = min(MAX_SOURCES, windows.max_separable_sources(n_snapshots))
    values, _ = subspace.leading_eigenpairs(windows, snapshots, max_sources)
    independent = n_snapshots * windows.n_independent_values_per_snapshot
    price = 1.0 if criterion == "aic" else 0.5 * np.log(independent)
    noise = np.fmax(noise_power[:, None], _ROUNDING * values[:, :1] + 1e-300)
    # Eigenvalues below the noise are no sources, though their cost would rise again.
    ratio = np.maximum(values / noise, 1.0)
    explained = independent / m * (ratio - 1 - np.log(ratio))
    gain = np.cumsum(explained - price * (2 * (m - np.arange(max_sources)) - 1), axis=1)
    return np.asarray(np.argmax(gain, axis=1) + 1)


def significant_second_source_mask(
    power_gain: np.ndarray,
    noise_power: np.ndarray,
    snapshots_shape: tuple[int, ...],
    n_angles: int,
    criterion: Criterion,
) -> np.ndarray:
    r"""Return True where a second source explains enough of the snapshots, (n,).

    `power_gain` (n,) is the power that it explains, `snapshots_shape` that of the snapshots,
    `n_angles` the number of angles that the array resolves. A source has 2 real parameters for each
    snapshot and its angles. Under mdl, amplitudes cost half the logarithm of the numbers observed
    each; the direction on a line of n elements, a phase that grows along it, costs 3/2 ln n (P. M.
    Djuric, IEEE Trans. SP 44(7), 1996), and both angles together cost 2 ln n. aic counts an angle
    as 1: it takes noise for a second source in half of all single ones.
    """
    _, n_snapshots, n_elements = snapshots_shape
    price = 2.0 * n_snapshots + n_angles
    if criterion == "mdl":
        price = (n_snapshots + 1.0 + 0.5 * n_angles) * np.log(n_elements * n_snapshots)
    return np.asarray(power_gain > price * noise_power)
