"""Root-MUSIC: roots of the null spectrum of a uniform linear array."""

import numpy as np
import scipy

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.uniform_linear_array import UlaEstimator

_MAX_STEPS = 60
# Smallest step: next to a root whose pair coincides, as without noise, steps never get smaller.
_LAST_STEP = 1e-9


@frozen_dataclass
class RootMusic(UlaEstimator):
    """Phases at which the null spectrum, a polynomial along a line, is nearest to zero.

    Two sources have two roots where the spectrum shows one peak. All roots are found together by
    about ten Aberth iterations, in a time quadratic in the number of elements: 12 take 20 us a
    detection, 192 take 4 ms, a fifteenth of which ESPRIT needs.

    References
    ----------
    A. J. Barabell, Improving the resolution performance of eigenstructure-based
    direction-finding algorithms, IEEE ICASSP, 1983. O. Aberth, Iteration methods for finding all
    zeros of a polynomial simultaneously, Mathematics of Computation 27, 1973.
    """

    def candidate_phase_factors(self, signal_basis: np.ndarray) -> np.ndarray:
        """Return the roots within the unit circle, the nearest to it first."""
        size = signal_basis.shape[1]
        # Sums along the diagonals of the identity less basis basis^H.
        spectrum = scipy.fft.fft(signal_basis, 2 * size, axis=1)
        diagonal_sums = scipy.fft.ifft(np.sum(np.abs(spectrum) ** 2, axis=2), axis=1)[:, :size]
        coefficients = -diagonal_sums.conj()
        coefficients[:, 0] += size
        roots = _polynomial_roots_within_unit_circle(coefficients)
        nearest = np.argsort(-np.abs(roots), axis=1)
        return np.take_along_axis(roots, nearest, axis=1)

    def phase_noise_weights(
        self, window_steering: np.ndarray, phase_factor: np.ndarray
    ) -> np.ndarray:
        """Return the left vectors of zeros of the null spectrum on the unit circle, as MUSIC."""
        slopes = 1j * np.arange(window_steering.shape[1])[:, None] * window_steering
        basis = np.linalg.qr(window_steering)[0]
        slopes = slopes - basis @ (np.swapaxes(basis, 1, 2).conj() @ slopes)
        slopes /= np.sum(np.abs(slopes) ** 2, axis=1, keepdims=True)
        return np.swapaxes(slopes, 1, 2)


@kernel(plain=AS_WRITTEN)
def _polynomial_roots_within_unit_circle(coefficients: np.ndarray) -> np.ndarray:
    """Return the roots within the unit circle of the sum of c_d z^d, d = 1 - size ... size - 1.

    `coefficients` (n, size) are those from c_0 on; c_-d = conj(c_d), so that roots come in pairs
    z, 1 / conj(z), of which one is followed, (n, size - 1).
    """
    n, size = coefficients.shape
    degree = size - 1
    out = np.empty((n, degree), np.complex128)
    for i in range(n):
        c, z = coefficients[i], out[i]
        for j in range(degree):
            z[j] = (1 - 0.5 / degree) * np.exp(2j * np.pi * (j + 0.25) / degree)
        for _ in range(_MAX_STEPS):
            longest = 0.0
            for j in range(degree):
                root = z[j]
                value, slope = c[degree], 0j
                for d in range(degree - 1, -size, -1):
                    slope = slope * root + value
                    value = value * root + (c[d] if d >= 0 else np.conj(c[-d]))
                others = 1 / (root - 1 / np.conj(root))
                for k in range(degree):
                    if k != j:
                        others += 1 / (root - z[k]) + 1 / (root - 1 / np.conj(z[k]))
                step = value / (slope - value * others)
                longest = max(longest, abs(step))
                root -= step
                if abs(root) > 1:
                    root = 1 / np.conj(root)
                # On the circle a pair coincides; at 0 its partner is infinite.
                z[j] = (
                    root * (1 - 1e-15)
                    if abs(root) > 1e-9
                    else 1e-9 * np.exp(2j * np.pi * j / degree)
                )
            if longest < _LAST_STEP:
                break
    return out
