"""Interpolation of band-limited samples from every n-th one.

Between two known samples, a tone is a weighted sum of the ten around it. The weights minimise the
mean square error over the band,

    sum_b sinc(W (a - b)) h_b = sinc(W (a - x)),    sinc(y) = sin(pi y) / (pi y),

with W the width of the band over the rate of the known samples (Laakso et al. 1996, 4.3).
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel

TAPS = 10
_FIRST_TAP = 1 - TAPS // 2

MAX_OVERHANG = 1 / 4
"""Largest distance of known samples outside the window, over its half: echoes there follow from
a series about the middle, which needs more terms the farther it extends."""


class BandInterpolator(NamedTuple):
    """Interpolation weights for a band, and the spacing of the known samples."""

    step: int
    """Spacing of the known samples, one of which is the sample 0."""
    centre_frequency: float
    """Middle of the band in cycles per sample, removed from the known samples."""
    weights: np.ndarray
    """(step, TAPS) float32."""

    def required_known_sample_range(self, first_sample: int, stop_sample: int) -> tuple[int, int]:
        """Return start and stop of the known samples needed for `first_sample` to `stop_sample`."""
        return first_sample // self.step + _FIRST_TAP, (
            stop_sample - 1
        ) // self.step + TAPS // 2 + 1

    def add_interpolated(
        self, out: np.ndarray, rows: np.ndarray, known_samples: np.ndarray
    ) -> None:
        """Add interpolated samples to some rows of `out` (., n_samples), whose middle is sample 0.

        `known_samples` is (len(rows), n_known) complex64.
        """
        n = out.shape[1]
        samples = np.arange(n) - n // 2
        tone = np.exp(2j * np.pi * (self.centre_frequency * samples % 1)).astype(np.complex64)
        known_samples = np.ascontiguousarray(known_samples).view(np.float32)
        _add_interpolated_rows(out, rows, known_samples, self.weights, tone, samples[0] % self.step)


def make_sparsest_interpolator(
    low_frequency: float, high_frequency: float, *, n_samples: int, tolerance: float
) -> BandInterpolator | None:
    """Make the sparsest interpolator for a band in cycles per sample; None if all are needed.

    The known samples are denser if the window of `n_samples` is short.

    `tolerance` is the root mean square error over the band, for tones of amplitude 1.
    """
    step = int(_max_relative_bandwidth(tolerance) / max(high_frequency - low_frequency, 1e-3))
    step = min(step, int(MAX_OVERHANG * n_samples / TAPS))
    if step < 2:
        return None
    return BandInterpolator(
        step,
        (low_frequency + high_frequency) / 2,
        _interpolation_weights(step, round((high_frequency - low_frequency) * step + 5e-4, 3)),
    )


@lru_cache(64)
def _interpolation_weights(known_spacing: int, relative_bandwidth: float) -> np.ndarray:
    return _least_squares_weights_and_error(known_spacing, relative_bandwidth)[0].astype(np.float32)


@cache
def _max_relative_bandwidth(tolerance: float) -> float:
    """Return the band, in cycles per known sample, that meets the tolerance."""
    widths = np.linspace(0.5, 0.05, 91)
    return float(next(w for w in widths if _least_squares_weights_and_error(2, w)[1] <= tolerance))


def _least_squares_weights_and_error(
    known_spacing: int, relative_bandwidth: float
) -> tuple[np.ndarray, float]:
    taps = np.arange(TAPS) + _FIRST_TAP
    fractions = np.arange(known_spacing) / known_spacing
    overlaps = np.sinc(relative_bandwidth * (taps[:, None] - taps))
    targets = np.sinc(relative_bandwidth * (taps[:, None] - fractions))
    weights = np.linalg.lstsq(overlaps, targets, rcond=1e-13)[0]
    residual = 1 - 2 * np.sum(weights * targets, 0) + np.sum(weights * (overlaps @ weights), 0)
    return weights.T, float(np.sqrt(max(residual.max(), 0.0)))


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _add_interpolated_rows(
    out: np.ndarray,
    rows: np.ndarray,
    known_samples: np.ndarray,
    weights: np.ndarray,
    tone: np.ndarray,
    first_sample_phase: int,
) -> None:
    step, n_samples = len(weights), out.shape[1]
    n_groups = known_samples.shape[1] // 2 - TAPS + 1
    interpolated = np.empty(2 * n_groups, np.float32)
    for m in range(len(rows)):
        line, row = known_samples[m], rows[m]
        for r in range(step):
            w = weights[r]
            w0, w1, w2, w3, w4 = w[0], w[1], w[2], w[3], w[4]
            w5, w6, w7, w8, w9 = w[5], w[6], w[7], w[8], w[9]
            # Real and imaginary parts alternate: plain loops over numbers.
            for j in range(2 * n_groups):
                early = w0 * line[j] + w1 * line[j + 2] + w2 * line[j + 4] + w3 * line[j + 6]
                late = w6 * line[j + 12] + w7 * line[j + 14] + w8 * line[j + 16] + w9 * line[j + 18]
                interpolated[j] = early + w4 * line[j + 8] + w5 * line[j + 10] + late
            first = 1 if r < first_sample_phase else 0
            sample = np.uint64(first * step + r - first_sample_phase)
            for j in range(np.uint64(first), np.uint64(n_groups)):
                if sample >= n_samples:
                    break
                two = np.uint64(2) * j
                out[row, sample] += tone[sample] * complex(
                    interpolated[two], interpolated[two + np.uint64(1)]
                )
                sample += np.uint64(step)
