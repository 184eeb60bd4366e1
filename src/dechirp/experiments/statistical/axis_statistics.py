r"""Statistics of one axis of a map near a tone: cell amplitudes and noise covariances.

All that a detection needs of the samples are sums :math:`\sum_n f_n y_n` with few weights f: for
each cell beside the tone those of the window, shifted to the cell; and without a window, shifted to
the tone, :math:`1`, :math:`p = n - (N - 1) / 2` and :math:`p^2`, from which the
maximum-likelihood frequency follows. White noise makes them jointly Gaussian, with the covariance
of their weights. Over two axes weights multiply, and so do covariances: so noise in all cells about
a tone, and in its estimates, is a few white numbers times the Cholesky factor of each axis.

References
----------
D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time observations,
IEEE Trans. Information Theory 20(5), 1974, for the estimate.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.processing.spectrum import Transform

N_SUMS = 3
"""Number of sums without a window: of 1, p and p^2."""
N_OFFSETS = 32
"""Number of tabulated offsets from one cell to the next."""
POINTS_PER_BIN = 32
"""Points of a lobe per bin of the transform, and of its moments per unpadded bin."""
REFINEMENT_BINS = 1.5
"""Unpadded bins within which refinement separates no tones, see `processing.refine`."""
_ENERGY_POINTS_PER_BIN = 8
# Unpadded bins beyond which a lobe is neglected: 2 % of the power of a rectangular window.
_LOBE_REACH_BINS = 16
_JITTER = 1e-9  # a rectangular window on a bin equals the tone: the covariance is singular


class AxisStatistics(NamedTuple):
    """Tables of one axis; distances in bins of the transform, except for the moments."""

    half_width: int
    """Number of cells on each side of a tone's own cell in which its peak may be."""
    n_bins: int
    unpadded_per_bin: float
    """Unpadded bins per bin."""
    noise_bandwidth: float
    """Noise bandwidth of the window, in unpadded bins."""
    rms_index: float
    """Root mean square of p: sqrt((N^2 - 1) / 12), 1 for one point."""
    lobe: np.ndarray
    """Complex amplitude in a cell of a tone at an offset from -reach to reach; 1 at offset 0."""
    reach: float
    moments: np.ndarray
    """(3, n): means of 1, p / i spread and (p / spread)^2 over a tone at an offset of
    -REFINEMENT_BINS to REFINEMENT_BINS unpadded bins."""
    factors: np.ndarray
    """(N_OFFSETS + 1, N_SUMS + n_cells, the same), complex: Cholesky factors of the covariance of
    the sums without a window, of 1, p and p^2, and of the cells, for offsets -1/2 to 1/2."""
    centre_covariance: np.ndarray
    """(N_SUMS + n_cells,), complex: covariance of each with the centre cell, for a tone in it."""

    def tabulate_tone_power_in_window(self, half_width: int) -> "LobeEnergy":
        """Tabulate the share of a tone's power in 2 half + 1 cells at an offset."""
        offsets = (
            np.arange(
                -_half_length_of_power_table(half_width, self),
                _half_length_of_power_table(half_width, self) + 1,
            )
            / _ENERGY_POINTS_PER_BIN
        )
        cells = np.arange(-half_width, half_width + 1)
        return LobeEnergy(
            np.array([np.sum(self._interpolated_lobe_power(offset - cells)) for offset in offsets]),
            offsets[-1],
        )

    def _interpolated_lobe_power(self, offset_bins: np.ndarray) -> np.ndarray:
        offset_bins = (offset_bins + self.n_bins / 2) % self.n_bins - self.n_bins / 2
        grid = np.linspace(-self.reach, self.reach, self.lobe.size)
        return np.asarray(np.interp(abs(offset_bins), grid, abs(self.lobe) ** 2, right=0.0))


class LobeEnergy(NamedTuple):
    """Sums of a lobe's power over cells, at steps of 1 / 8 bin from -reach to reach."""

    table: np.ndarray
    reach: float


def _half_length_of_power_table(window_half_width: int, axis: AxisStatistics) -> int:
    far = min(window_half_width + _LOBE_REACH_BINS / axis.unpadded_per_bin, axis.n_bins / 2)
    return int(far * _ENERGY_POINTS_PER_BIN)


@lru_cache(maxsize=32)
def tabulate_lobe_and_noise_statistics(transform: Transform) -> AxisStatistics:
    """Compute the tables of a transform."""
    n, n_bins, weights = transform.n_points, transform.n_bins, transform.weights
    half = min(-(-n_bins // n), (n_bins - 1) // 2)
    p = np.arange(n) - (n - 1) / 2
    spread = np.sqrt((n**2 - 1) / 12) if n > 1 else 1.0
    reach = min(_LOBE_REACH_BINS * n_bins / n, n_bins / 2)
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(reach * POINTS_PER_BIN)) + 1)
    lobe = np.exp(2j * np.pi / n_bins * np.outer(offsets, p)) @ weights / weights.sum()
    moment_offsets = np.linspace(
        -REFINEMENT_BINS, REFINEMENT_BINS, 2 * int(REFINEMENT_BINS * POINTS_PER_BIN) + 1
    )
    phases = 2 * np.pi / n * np.outer(moment_offsets, p)
    moments = [np.cos(phases), p / spread * np.sin(phases), (p / spread) ** 2 * np.cos(phases)]
    cells = np.arange(-half, half + 1)
    cell_weights = weights * np.exp(-2j * np.pi / n_bins * np.outer(cells, p))
    cell_weights /= np.sqrt(np.sum(weights**2))
    factors = []
    for offset in np.linspace(-0.5, 0.5, N_OFFSETS + 1):
        sums = _sample_weights_of_moments_and_cells(offset, p, spread, n_bins, cell_weights)
        gram = sums @ sums.conj().T
        factors.append(np.linalg.cholesky(gram + _JITTER * np.eye(len(gram))))
    centre_weights = _sample_weights_of_moments_and_cells(0.0, p, spread, n_bins, cell_weights)
    return AxisStatistics(
        half_width=half,
        n_bins=n_bins,
        unpadded_per_bin=n / n_bins,
        noise_bandwidth=transform.noise_bandwidth_bins,
        rms_index=float(spread),
        lobe=lobe,
        reach=float(reach),
        moments=np.mean(moments, axis=2),
        factors=np.array(factors),
        centre_covariance=centre_weights @ cell_weights[half].conj(),
    )


def _sample_weights_of_moments_and_cells(
    tone_offset_bins: float,
    centred_indices: np.ndarray,
    rms_index: float,
    n_bins: int,
    cell_weights: np.ndarray,
) -> np.ndarray:
    tone = np.exp(-2j * np.pi / n_bins * tone_offset_bins * centred_indices) / np.sqrt(
        centred_indices.size
    )
    return np.array(
        [
            tone,
            centred_indices / rms_index * tone,
            (centred_indices / rms_index) ** 2 * tone,
            *cell_weights,
        ]
    )


def frequency_drift_amplitude_gain(window: np.ndarray, drift_bins: np.ndarray) -> np.ndarray:
    """Return the amplitude gain of a tone whose frequency drifts by bins over the frame."""
    drifts, gains = _frequency_drift_gain_table(tuple(window.tolist()))
    drift = abs(np.asarray(drift_bins))
    beyond = np.sqrt(drifts[-1] / np.maximum(drift, drifts[-1]))
    return np.interp(drift, drifts, gains) * beyond


def range_walk_amplitude_gain(
    doppler_window: np.ndarray, range_window: np.ndarray, walked_cells: np.ndarray
) -> np.ndarray:
    """Return the amplitude gain in the cell of a target that moves through cells in a frame."""
    walks, gains = _range_walk_gain_table(
        tuple(doppler_window.tolist()), tuple(range_window.tolist())
    )
    walk = abs(np.asarray(walked_cells))
    return np.interp(walk, walks, gains) * walks[-1] / np.maximum(walk, walks[-1])


# A sensor that steps through a simulation asks for the same tables in each frame: 0.7 s of 128
# chirps and 256 samples.
@lru_cache(maxsize=16)
def _frequency_drift_gain_table(window: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return drifts in bins, and the gain of each."""
    positions, weight = _centred_positions_and_weights(window)
    drifts = 64.0 * np.linspace(0, 1, 257) ** 2
    return drifts, abs(np.exp(1j * np.pi * np.outer(drifts, positions**2)) @ weight)


@lru_cache(maxsize=16)
def _range_walk_gain_table(
    doppler_window: tuple[float, ...], range_window: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return walks in cells, and the gain of each."""
    slow, slow_weight = _centred_positions_and_weights(doppler_window)
    fast, fast_weight = _centred_positions_and_weights(range_window)
    walks = 64.0 * np.linspace(0, 1, 129) ** 2
    gains = [
        abs(slow_weight @ np.exp(2j * np.pi * walk * np.outer(slow, fast)) @ fast_weight)
        for walk in walks
    ]
    return walks, np.array(gains)


def _centred_positions_and_weights(window: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return positions from -1/2 to 1/2, and weights of sum 1."""
    weight = np.array(window)
    return (np.arange(weight.size) - (weight.size - 1) / 2) / weight.size, weight / weight.sum()
