"""Windows: what they cost, and how they tie neighbouring bins together.

All are periodic (DFT-even), w[n] = sum_k (-1)^k a_k cos(2 pi k n / N). F. J. Harris, "On
the use of windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE
66(1), 1978.
"""

from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from dechirp.core.errors import InvalidSetting

Window = Literal["rectangular", "hann", "hamming", "blackman", "blackman-harris"]

_COEFFICIENTS: dict[Window, tuple[float, ...]] = {
    "rectangular": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
    "blackman-harris": (0.35875, 0.48829, 0.14128, 0.01168),
}


@lru_cache(maxsize=64)
def taper(window: Window, n: int) -> np.ndarray:
    """Weights of the window, (n,), read-only."""
    if window not in _COEFFICIENTS:
        raise InvalidSetting(
            "window", got=window, need=" or ".join(get_args(Window)), fix="Choose one of them."
        )
    phase = 2 * np.pi * np.arange(n) / n
    weights = np.zeros(n)
    for k, coefficient in enumerate(_COEFFICIENTS[window]):
        weights += (-1) ** k * coefficient * np.cos(k * phase)
    weights.flags.writeable = False
    return weights


def main_lobe_bins(window: Window) -> int:
    """Half the width of the main lobe, in unpadded bins: from its peak to its first null."""
    return len(_COEFFICIENTS[window])


def coherent_gain(weights: np.ndarray) -> float:
    """What is left of a tone's amplitude: sum(w) / N."""
    return float(weights.mean())


def noise_bandwidth_bins(weights: np.ndarray) -> float:
    """Equivalent noise bandwidth, N sum(w^2) / sum(w)^2: the loss of SNR as a ratio."""
    return float(weights.size * np.sum(weights**2) / np.sum(weights) ** 2)


def scalloping_loss(weights: np.ndarray) -> float:
    """Power of a tone half a bin off, relative to one on a bin: a ratio of at least 1."""
    off = np.exp(1j * np.pi * np.arange(weights.size) / weights.size)
    return float(np.sum(weights) ** 2 / abs(np.sum(weights * off)) ** 2)


def bin_correlation(weights: np.ndarray, n_bins: int, lags: np.ndarray) -> np.ndarray:
    """Correlation of white noise between bins of its windowed, zero-padded transform.

    rho(k) = sum_n w[n]^2 exp(-2 pi i k n / n_bins) / sum_n w[n]^2 for each lag k (bins, any
    shape); periodic in n_bins, as the bins are.
    """
    n = np.arange(weights.size)
    lags = np.asarray(lags)
    # Whole turns are taken out in integers: k n reaches 1e7 and a float phase 1e-9 errors.
    turns = (lags[..., None] * n) % n_bins / n_bins
    return np.asarray(np.exp(-2j * np.pi * turns) @ (weights**2 / np.sum(weights**2)))
