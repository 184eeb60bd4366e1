r"""Number of sources, by the criteria of Wax & Kailath (1985).

A model of k sources costs what it leaves unexplained, as minus the logarithm of the
likelihood, and a price for each real number that it has to tell: 1 by Akaike's criterion
(aic), half the logarithm of the numbers observed by the least description length (mdl). The
model of least cost is taken, of one source or more: what was detected is there.

The noise power is known from the cells around, which is worth more than its being alike in
all directions: with one snapshot, the windows of an array are too few to show that.

References
----------
M. Wax and T. Kailath, Detection of signals by information theoretic criteria, IEEE Trans.
ASSP 33(2), 1985.
"""

from typing import Literal

import numpy as np

from dechirp.process.angle import subspace
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.covariance import Smoothing, Windows, windows

Criterion = Literal["mdl", "aic"]

MOST = 4
"""Sources that a criterion tells at most."""
# Power that single precision leaves beside a strong source, where there is no noise.
_ROUNDING = 1e-12


def n_sources(
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    criterion: Criterion,
    over: Windows | None = None,
) -> np.ndarray:
    r"""How many sources are in each of snapshots (n, n_looks, n_elements): (n,), 1 to 4.

    .. math::

        C(k) = T \sum_{i>k} \left( \frac{\lambda_i}{\sigma^2} - 1
            - \ln\frac{\lambda_i}{\sigma^2} \right) + p\, k (2m - k)

    with lambda the eigenvalues of the covariance, m elements in a window, p the price and
    sigma^2 the `noise_power` (n,) of one element. Windows overlap: they are worth T snapshots,
    T m = (sum c)^2 / sum c^2 independent numbers a look, c being the windows that an element
    is in, for then the mean power has its true variance. Reading them backwards adds none.

    `over` are other windows than the usual ones. An array that is not uniform has but one, and
    a single look at it shows one source whatever is there.
    """
    over = over or windows(aperture, Smoothing())
    n_looks, m = snapshots.shape[1], over.size
    most = min(MOST, over.rank(n_looks))
    values, _ = subspace.strongest(over, snapshots, most)
    independent = n_looks * over.independent
    price = 1.0 if criterion == "aic" else 0.5 * np.log(independent)
    noise = np.fmax(noise_power[:, None], _ROUNDING * values[:, :1] + 1e-300)
    # What lies below the noise is no source, though its cost would rise again.
    ratio = np.maximum(values / noise, 1.0)
    explained = independent / m * (ratio - 1 - np.log(ratio))
    gain = np.cumsum(explained - price * (2 * (m - np.arange(most)) - 1), axis=1)
    return np.asarray(np.argmax(gain, axis=1) + 1)


def second_source(
    gain: np.ndarray,
    noise_power: np.ndarray,
    shape: tuple[int, ...],
    n_told: int,
    criterion: Criterion,
) -> np.ndarray:
    r"""Whether a second source explains enough of the snapshots, (n,).

    `gain` (n,) is the power that it explains, `shape` that of the snapshots, `n_told` the
    angles that the array tells. A source has 2 real numbers a look and its angles. Under mdl,
    amplitudes cost half the logarithm of the numbers observed each; the direction on a line of
    n elements, a phase that grows along it, costs 3/2 ln n (P. M. Djuric, IEEE Trans. SP
    44(7), 1996), and both angles together cost 2 ln n. aic counts an angle as 1: it takes
    noise for a second source in half of all single ones.
    """
    _, n_looks, n_elements = shape
    price = 2.0 * n_looks + n_told
    if criterion == "mdl":
        price = (n_looks + 1.0 + 0.5 * n_told) * np.log(n_elements * n_looks)
    return np.asarray(gain > price * noise_power)
