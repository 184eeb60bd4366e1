"""Trimmed-mean CFAR: mean of the training cells without the smallest and the largest.

It lies between cell averaging and an ordered statistic. P. P. Gandhi and S. A. Kassam, Analysis
of CFAR processors in nonhomogeneous background, IEEE Trans. AES 24(4), 1988.
"""

import numpy as np

from dechirp.core.checks import check_non_negative_fields
from dechirp.core.compiled_kernels import IN_CALLER, can_compile, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.rank_kernels import (
    SideCounts,
    candidate_detection_cells,
    gather_training_cells,
    kth_smallest,
    order_statistic_map,
)
from dechirp.theory.cfar_trimmed_mean import trimmed_mean_factor
from dechirp.theory.training_cells import (
    DEFAULT_N_LARGEST,
    DEFAULT_N_SMALLEST,
    cell_count_from_setting,
)


@frozen_dataclass
class TrimmedMean(NoiseEstimator):
    """Mean of the training cells after trimming both ends of their order."""

    n_smallest: float = DEFAULT_N_SMALLEST
    """Number of smallest cells trimmed; below 1, a share of the cells."""
    n_largest: float = DEFAULT_N_LARGEST
    """Number of largest cells trimmed; below 1, a share of the cells."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "n_smallest", "n_largest", at_most=2**31 - 1)
        for name in ("n_smallest", "n_largest"):
            number = getattr(self, name)
            if number >= 1 and number != int(number):
                raise InvalidSetting(
                    f"TrimmedMean.{name}",
                    value=number,
                    expected="a share below 1, or a whole number of cells",
                    fix="give 0.25 for a quarter of them",
                )

    def check_enough_training_cells(self, window: TrainingWindow) -> None:
        """Check that at least one training cell remains."""
        n_cells = len(window.training_cell_offsets(window.half_range))
        if sum(self._trim_counts(n_cells)) >= n_cells:
            raise InvalidSetting(
                "Cfar.estimator.n_largest",
                value=f"{self.n_largest:g}, with {self.n_smallest:g} of the smallest",
                expected=f"fewer than the {n_cells} training cells together",
                fix="trim fewer cells, or use more training cells",
            )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        n = cells.shape[-1]
        first, n_largest = self._trim_counts(n)
        last = n - n_largest
        partitioned = np.partition(cells, sorted({first, last - 1}), axis=-1)
        return partitioned[..., first:last].mean(axis=-1)

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        if not can_compile():
            return super().threshold(power, window, factors)
        n_cells, n_smallest, n_largest = self._training_and_trim_counts_per_row(power, window)
        if n_smallest.any():
            lowest = order_statistic_map(power, window.training_and_guard_counts, n_smallest + 1)
        else:
            lowest = np.zeros_like(power)
        highest = order_statistic_map(power, window.training_and_guard_counts, n_cells - n_largest)
        return _trimmed_mean_thresholds(
            power, window.training_and_guard_counts, factors, n_smallest, n_largest, lowest, highest
        )

    def exceeds_threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Compute the exact mean only for candidate cells.

        The mean without the smallest is no less than with them, which few cells of noise exceed
        by the factor: training cells are put in order only for those.
        """
        if not can_compile():
            return super().exceeds_threshold(power, window, factors)
        n_cells, n_smallest, n_largest = self._training_and_trim_counts_per_row(power, window)
        candidates = candidate_detection_cells(
            power, window.training_and_guard_counts, factors, n_cells, n_cells - n_largest
        )
        return _mask_of_exceeding_candidates(
            power, candidates, window.training_and_guard_counts, factors, n_smallest, n_largest
        )

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float | None:
        """Return Gandhi and Kassam's product; None for several channels."""
        if n_channels > 1:
            return None
        n_smallest, n_largest = self._trim_counts(len(offsets))
        return trimmed_mean_factor(
            false_alarm_probability,
            n_training=len(offsets),
            n_smallest=n_smallest,
            n_largest=n_largest,
        )

    def _trim_counts(self, n_cells: int) -> tuple[int, int]:
        """Return the numbers of cells trimmed at both ends."""
        number = np.array(n_cells)
        return int(cell_count_from_setting(number, self.n_smallest)), int(
            cell_count_from_setting(number, self.n_largest)
        )

    def _training_and_trim_counts_per_row(
        self, power: np.ndarray, window: TrainingWindow
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return training cells and trimmed cells at both ends for each row, (range,)."""
        n_cells = window.n_training_cells_per_row(power.shape[1])
        return (
            n_cells,
            cell_count_from_setting(n_cells, self.n_smallest),
            cell_count_from_setting(n_cells, self.n_largest),
        )


@kernel(plain=IN_CALLER)
def _trimmed_mean_thresholds(
    power: np.ndarray,
    side_counts: SideCounts,
    factors: np.ndarray,
    n_smallest: np.ndarray,
    n_largest: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
) -> np.ndarray:
    """Compute thresholds from the smallest and largest kept cells, in place of the latter."""
    width, height = (
        2 * (side_counts[0] + side_counts[2]) + 1,
        2 * (side_counts[1] + side_counts[3]) + 1,
    )
    cells = np.empty(width * height, np.float32)
    for v in range(power.shape[0]):
        for j in range(power.shape[1]):
            n = gather_training_cells(power, v, j, side_counts, cells)
            mean = _trimmed_mean(
                cells[:n], n_smallest[j], n_largest[j], lowest[v, j], highest[v, j]
            )
            highest[v, j] = mean * factors[j]
    return highest


@kernel(plain=IN_CALLER)
def _mask_of_exceeding_candidates(
    power: np.ndarray,
    candidates: np.ndarray,
    side_counts: SideCounts,
    factors: np.ndarray,
    n_smallest: np.ndarray,
    n_largest: np.ndarray,
) -> np.ndarray:
    """Return a mask of the candidates that exceed their thresholds."""
    width, height = (
        2 * (side_counts[0] + side_counts[2]) + 1,
        2 * (side_counts[1] + side_counts[3]) + 1,
    )
    cells, ordered = np.empty(width * height, np.float32), np.empty(width * height, np.float32)
    mask = np.zeros(power.shape, np.bool_)
    for c in range(len(candidates)):
        v, j = candidates[c, 0], candidates[c, 1]
        n = gather_training_cells(power, v, j, side_counts, cells)
        if _is_mean_without_largest_above(cells[:n], n_largest[j], power[v, j] / factors[j]):
            continue
        ordered[:n] = cells[:n]
        lowest = kth_smallest(ordered, n, n_smallest[j] + 1)
        highest = kth_smallest(ordered, n, n - n_largest[j])
        mean = _trimmed_mean(cells[:n], n_smallest[j], n_largest[j], lowest, highest)
        mask[v, j] = power[v, j] > mean * factors[j]
    return mask


@kernel(fastmath={"contract", "reassoc"})
def _is_mean_without_largest_above(cells: np.ndarray, n_largest: int, level: np.float32) -> bool:
    """Test if the mean without the largest exceeds a level, as in `candidate_detection_cells`.

    A few levels nearly always decide, in a tenth of the time of ordering the cells.
    """
    q, limit = level, np.float32((cells.size - n_largest) * level * (1 + 1e-4))
    for _ in range(8):
        total = np.float32(0.0)
        for i in range(cells.size):
            total += min(cells[i], q)
        if total - n_largest * q > limit:
            return True
        q *= np.float32(1.7)
    return False


@kernel()
def _trimmed_mean(
    cells: np.ndarray, n_smallest: int, n_largest: int, lowest: np.float32, highest: np.float32
) -> np.float32:
    """Return the mean of the kept cells: all cells clipped to their range, less those trimmed."""
    total = np.float64(0.0)
    for i in range(cells.size):
        total += min(max(cells[i], lowest), highest)
    total -= n_smallest * np.float64(lowest) + n_largest * np.float64(highest)
    return np.float32(total / (cells.size - n_smallest - n_largest))
