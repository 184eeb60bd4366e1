"""CFAR thresholds: training window, base class of noise estimators, and false-alarm calibration."""

from abc import abstractmethod
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from dechirp.core.checks import check_integer_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.factor_cache import (
    RowFactors,
    correlation_hash,
    find_or_calibrate_factors,
)
from dechirp.processing.spectrum import Transform
from dechirp.theory.cfar_calibration import CalibratedFactor, calibrate_factor
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow

# Positions of the cell under test in the box at which the factor is calibrated. Between them the
# effect of correlation is interpolated, within 0.1 % of the factor.
MAX_CALIBRATED_ROWS = 16
# Fewest positions, and the number of training cells at which calibration takes half a second each.
_MIN_CALIBRATED_ROWS, _MANY_TRAINING_CELLS = 5, 2000
# Gathered training cells at a time, relative to the cells of a map: limits memory.
_MAX_GATHERED_MAPS = 0.1
# The exact law for correlated cells inverts a matrix with a row for each: 2 s at this size.
MAX_GUARD_CELLS = 2000


@frozen_dataclass
class Cells:
    """Numbers of cells on each side of the cell under test."""

    range: int
    velocity: int

    def __post_init__(self) -> None:
        check_integer_fields(self, "range", "velocity", at_least=0)


_DEFAULT_TRAINING = Cells(range=10, velocity=8)
_DEFAULT_GUARD = Cells(range=4, velocity=4)


@frozen_dataclass
class MapNoise:
    """White noise in a map: the transforms that shaped it, with channels summed."""

    range_transform: Transform
    doppler_transform: Transform
    n_channels: int = 1


@frozen_dataclass
class TrainingWindow:
    """Training cells around a cell under test: a box without the guard cells.

    Velocity wraps round, so the window is complete at both ends of that axis. Range ends: there
    the box stays within the map and the cell under test moves off its centre, so that the
    training cells are the nearest that exist.
    """

    n_training: Cells
    n_guard: Cells

    @property
    def half_range(self) -> int:
        """Number of rows from the cell under test to the edge of the box."""
        return self.n_training.range + self.n_guard.range

    @property
    def half_velocity(self) -> int:
        """Number of columns from the cell under test to the edge of the box."""
        return self.n_training.velocity + self.n_guard.velocity

    @property
    def training_and_guard_counts(self) -> tuple[int, int, int, int]:
        """Training cells along range and velocity, then guard cells, on each side."""
        training, guard = self.n_training, self.n_guard
        return training.range, training.velocity, guard.range, guard.velocity

    def training_cell_offsets(self, box_row: int) -> np.ndarray:
        """Return the training cells relative to the cell under test in a box row, (n_training, 2).

        Velocity and range; in order of range, then velocity.
        """
        return _training_cell_offsets(self, box_row)

    def guard_rows_of_box(self, box_row: int) -> slice:
        """Return the guard rows of the box for the cell under test in a row of it."""
        return slice(max(box_row - self.n_guard.range, 0), box_row + self.n_guard.range + 1)

    def noise_covariance_in_box(self, noise: MapNoise, box_row: int) -> CorrelatedWindow:
        """Return the covariance of the noise in the box for the cell under test in a row of it."""
        guard = self.guard_rows_of_box(box_row)
        n_rows = 2 * self.half_range + 1
        return CorrelatedWindow(
            range_covariance=noise.range_transform.noise_correlation_of_bins(n_rows),
            velocity_covariance=noise.doppler_transform.noise_correlation_of_bins(
                2 * self.half_velocity + 1
            ),
            guard_range=slice(guard.start, min(guard.stop, n_rows)),
            guard_velocity=slice(
                self.n_training.velocity, self.n_training.velocity + 2 * self.n_guard.velocity + 1
            ),
            cell_under_test=(box_row, self.half_velocity),
        )

    def tested_rows_in_training_box(self, n_range: int) -> np.ndarray:
        """Return the box row in which each of n_range rows of a map is tested, (n_range,)."""
        return _tested_row_in_box_per_map_row(self.half_range, n_range)

    def n_training_cells_per_row(self, n_range: int) -> np.ndarray:
        """Return the training cells of each of n_range rows, (n_range,): most near the ends."""
        box_row = self.tested_rows_in_training_box(n_range)
        width, guard = 2 * self.half_range + 1, self.n_guard.range
        n_rows = np.minimum(box_row + guard + 1, width) - np.maximum(box_row - guard, 0)
        n_guard = n_rows * (2 * self.n_guard.velocity + 1)
        return np.asarray(width * (2 * self.half_velocity + 1) - n_guard)

    def check_map_size(self, n_velocity: int, n_range: int) -> None:
        """Check that the box fits into a map of this size."""
        n_guard = (2 * self.n_guard.range + 1) * (2 * self.n_guard.velocity + 1)
        if n_guard > MAX_GUARD_CELLS:
            raise InvalidSetting(
                "Cfar.n_guard",
                value=f"{n_guard} cells with the cell under test",
                expected=f"at most {MAX_GUARD_CELLS}",
                fix="lower n_guard.range or n_guard.velocity; pad less if the main lobe is wide",
            )
        sizes = (
            ("range", self.half_range, n_range),
            ("velocity", self.half_velocity, n_velocity),
        )
        for name, half, n_cells in sizes:
            if 2 * half + 1 > n_cells:
                overlap = ": velocity wraps round, so its ends would overlap" * (name == "velocity")
                raise InvalidSetting(
                    "Cfar.n_training",
                    value=f"{2 * half + 1} {name} cells, {half} on each side of the cell under test"
                    " with the guard",
                    expected=f"at most {n_cells}, the {name} cells of the map{overlap}",
                    fix=f"lower n_training.{name} or n_guard.{name}",
                )


@lru_cache(maxsize=64)
def _tested_row_in_box_per_map_row(half_range: int, n_range: int) -> np.ndarray:
    rows = np.arange(n_range)
    start = np.clip(rows - half_range, 0, n_range - 1 - 2 * half_range)
    return _make_read_only(rows - start)


@lru_cache(maxsize=256)
def _training_cell_offsets(window: TrainingWindow, box_row: int) -> np.ndarray:
    rows = np.arange(2 * window.half_range + 1) - box_row
    columns = np.arange(2 * window.half_velocity + 1) - window.half_velocity
    is_training = (abs(rows)[:, None] > window.n_guard.range) | (
        abs(columns) > window.n_guard.velocity
    )
    row, column = np.nonzero(is_training)
    return _make_read_only(np.stack([columns[column], rows[row]], axis=1))


def _make_read_only(array: np.ndarray) -> np.ndarray:
    """Make a cached array read-only."""
    array.setflags(write=False)
    return array


class NoiseEstimator(Family):
    """Estimator of the noise power from training cells, the part in which CFAR detectors differ.

    A member must implement `statistic`, and thereby has a calibrated false-alarm law and a
    threshold map by brute force. Faster members override `threshold`; members whose law has a
    closed form for independent cells override `independent_cells_threshold_factor`.
    """

    group: ClassVar[str] = "dechirp.cfar"

    @abstractmethod
    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Return the noise power from the training cells of one box, (..., n_training) to (...).

        `offsets` (n_training, 2) are the velocity and range of the cells relative to the cell
        under test. The statistic must scale with the power of the cells.
        """

    def check_enough_training_cells(self, window: TrainingWindow) -> None:
        """Check that the window has the training cells that the statistic needs."""

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Return the noise power about each cell of a map times the factor of its row.

        `power` (velocity, range), `factors` (range,) and the result are float32.
        """
        cells = np.stack(np.unravel_index(np.arange(power.size), power.shape), axis=1)
        return self.threshold_at_cells(power, cells, window, factors).reshape(power.shape)

    def threshold_at_cells(
        self, power: np.ndarray, cells: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Return the threshold at cells (n, 2), velocity and range: (n,)."""
        levels = np.empty(len(cells), np.float32)
        box_rows = window.tested_rows_in_training_box(power.shape[1])[cells[:, 1]]
        for box_row in np.unique(box_rows):
            offsets = window.training_cell_offsets(int(box_row))
            indices = np.flatnonzero(box_rows == box_row)
            block_size = max(int(_MAX_GATHERED_MAPS * power.size / len(offsets)), 1)
            for block in np.split(indices, range(block_size, indices.size, block_size)):
                velocity, row = (cells[block, None] + offsets).transpose(2, 0, 1)
                levels[block] = self.statistic(power[velocity % len(power), row], offsets)
        return np.asarray(levels * factors[cells[:, 1]])

    def exceeds_threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Return a mask of the cells that exceed their threshold, bool (velocity, range)."""
        return np.asarray(power > self.threshold(power, window, factors))

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float | None:
        """Return the factor for independent cells, or None without a closed form."""
        return None

    def subsets_causing_false_alarms(self, offsets: np.ndarray) -> np.ndarray:
        """Return subsets of training cells whose low power causes false alarms, bool (n_sets, n).

        Importance sampling uses them: each subset alone causes a false alarm.
        """
        return np.ones((1, len(offsets)), bool)

    def threshold_factor(
        self, false_alarm_probability: float, box: CorrelatedWindow, *, n_channels: int
    ) -> CalibratedFactor:
        """Return the ratio of threshold to statistic for a false-alarm probability.

        The closed form where cells are independent, if there is one, otherwise calibrated by
        simulation, see `theory.cfar_calibration`.
        """
        offsets = box.training_offsets
        if box.is_white:
            closed_form = self.independent_cells_threshold_factor(
                false_alarm_probability, offsets, n_channels=n_channels
            )
            if closed_form is not None:
                return CalibratedFactor(value=closed_form)
        return calibrate_factor(
            false_alarm_probability,
            lambda cells: self.statistic(cells, offsets),
            box,
            n_summed=n_channels,
            low_cell_masks=self.subsets_causing_false_alarms(offsets),
        )


@frozen_dataclass
class Cfar:
    """CFAR detector: a threshold for every cell of a map from its training cells.

    Give either the false-alarm probability for each cell or an offset over the noise.
    """

    estimator: NoiseEstimator
    n_training: Cells = _DEFAULT_TRAINING
    n_guard: Cells = _DEFAULT_GUARD
    false_alarm_probability: float | None = None
    offset: float | None = None
    """Ratio of the threshold to the estimated noise power (dB of power in files)."""

    def __post_init__(self) -> None:
        if (self.false_alarm_probability is None) == (self.offset is None):
            raise InvalidSetting(
                "Cfar.false_alarm_probability",
                value="missing, and offset as well"
                if self.offset is None
                else "cannot be combined with offset",
                expected="exactly one of false_alarm_probability and offset",
                fix="give one of them" if self.offset is None else "set one of them to null",
            )
        if self.offset is not None:
            check_positive_fields(self, "offset")
        elif not 0 < (self.false_alarm_probability or 0.0) < 1:
            raise InvalidSetting(
                "Cfar.false_alarm_probability",
                value=self.false_alarm_probability,
                expected="between 0 and 1, both excluded",
                fix="give the probability for each cell, such as 1e-6",
            )
        if self.n_training.range + self.n_training.velocity < 1:
            raise InvalidSetting(
                "Cfar.n_training",
                value="0 cells on both axes",
                expected="training cells along range or velocity",
                fix="give at least one",
            )
        self.estimator.check_enough_training_cells(self.training_window)

    def fit_to_map(self, n_velocity: int, n_range: int) -> "Cfar":
        """Return the detector with smaller default windows if they do not fit into a map.

        Windows other than the defaults stay unchanged, whether they fit or not.
        """
        if not self.has_default_window:
            return self
        available = {"range": (n_range - 1) // 2, "velocity": (n_velocity - 1) // 2}
        if (
            available["range"] >= self.training_window.half_range
            and available["velocity"] >= self.training_window.half_velocity
        ):
            return self
        guard, training = {}, {}
        for axis, half in available.items():
            wanted = getattr(self.n_guard, axis) + getattr(self.n_training, axis)
            # Fewer than three cells on each side are too few for a window.
            half_width = min(half, wanted) if half > 1 else 0
            guard[axis] = min(getattr(self.n_guard, axis), half_width // 2)
            training[axis] = half_width - guard[axis]
        return replace(self, n_training=Cells(**training), n_guard=Cells(**guard))

    @property
    def has_default_window(self) -> bool:
        """True if the training and guard cells are the default ones."""
        return (self.n_training, self.n_guard) == (_DEFAULT_TRAINING, _DEFAULT_GUARD)

    @property
    def training_window(self) -> TrainingWindow:
        """Training window of the cell under test."""
        return TrainingWindow(n_training=self.n_training, n_guard=self.n_guard)

    def threshold(self, power: np.ndarray, noise: MapNoise) -> np.ndarray:
        """Return the threshold of each cell of a map, (velocity, range), edges included.

        Raises
        ------
        InvalidSetting
            If the training cells with the guard do not fit into the map, or the guard is
            too small for the window and the zero padding.
        """
        return self.estimator.threshold(
            power, self.training_window, self.threshold_factors_per_row(power, noise)
        )

    def threshold_at_cells(
        self, power: np.ndarray, cells: np.ndarray, noise: MapNoise
    ) -> np.ndarray:
        """Return the threshold at cells (n, 2), velocity and range: (n,)."""
        factors = self.threshold_factors_per_row(power, noise)
        return self.estimator.threshold_at_cells(power, cells, self.training_window, factors)

    def exceeds_threshold(self, power: np.ndarray, noise: MapNoise) -> np.ndarray:
        """Return a mask of the cells that exceed their threshold, bool (velocity, range)."""
        return self.estimator.exceeds_threshold(
            power, self.training_window, self.threshold_factors_per_row(power, noise)
        )

    def false_alarm_probability_error(self, noise: MapNoise) -> float:
        """Return the relative standard error of the false-alarm probability; 0 for an exact law."""
        return (
            0.0
            if self.offset is not None
            else _threshold_factors_per_box_row_and_error(self, noise)[1]
        )

    def threshold_factors_per_row(self, power: np.ndarray, noise: MapNoise) -> np.ndarray:
        """Return the factor of each row of a map, (n_range,); only the map's size is used.

        Cached: calibration takes seconds.
        """
        self.training_window.check_map_size(*power.shape)
        if self.offset is not None:
            return np.full(power.shape[1], self.offset, np.float32)
        return np.asarray(
            _threshold_factors_per_box_row_and_error(self, noise)[0][
                self.training_window.tested_rows_in_training_box(power.shape[1])
            ]
        )


@lru_cache(maxsize=64)
def _threshold_factors_per_box_row_and_error(
    cfar: Cfar, noise: MapNoise
) -> tuple[np.ndarray, float]:
    """Return the factor for each row of the cell under test in the box, and the largest error."""
    factors = find_or_calibrate_factors(
        factor_key(cfar, noise),
        type(cfar.estimator),
        2 * cfar.training_window.half_range + 1,
        lambda: calibrate_row_factors(cfar, noise),
    )
    return np.array(factors.values, np.float32), factors.relative_error


def factor_key(cfar: Cfar, noise: MapNoise) -> dict[str, object]:
    """Return everything on which the factors of a detector depend, apart from its code."""
    window, estimator = cfar.training_window, cfar.estimator
    return {
        "estimator": f"{type(estimator).__module__}.{estimator!r}",
        "window": list(window.training_and_guard_counts),
        "false_alarm_probability": cfar.false_alarm_probability,
        "n_channels": noise.n_channels,
        "range_correlation": correlation_hash(noise.range_transform, 2 * window.half_range + 1),
        "velocity_correlation": correlation_hash(
            noise.doppler_transform, 2 * window.half_velocity + 1
        ),
    }


def calibrate_row_factors(cfar: Cfar, noise: MapNoise) -> RowFactors:
    """Return the factor for each row of the cell under test in the box: seconds of computation."""
    pfa, window = cfar.false_alarm_probability, cfar.training_window
    assert pfa is not None
    last = window.half_range

    def calibrate(box_row: int) -> CalibratedFactor:
        return cfar.estimator.threshold_factor(
            pfa, window.noise_covariance_in_box(noise, box_row), n_channels=noise.n_channels
        )

    def independent_factor(box_row: int) -> float:
        offsets = window.training_cell_offsets(box_row)
        closed_form = cfar.estimator.independent_cells_threshold_factor(
            pfa, offsets, n_channels=noise.n_channels
        )
        return 1.0 if closed_form is None else closed_form

    middle = calibrate(last)
    n_calibrated = MAX_CALIBRATED_ROWS
    if middle.relative_error:
        n_calibrated = int(
            np.clip(
                _MANY_TRAINING_CELLS / len(window.training_cell_offsets(last)),
                _MIN_CALIBRATED_ROWS,
                MAX_CALIBRATED_ROWS,
            )
        )
    calibrated_rows = np.unique(
        np.linspace(0, last, min(last + 1, n_calibrated)).round().astype(int)
    )
    factors = [*(calibrate(int(box_row)) for box_row in calibrated_rows[:-1]), middle]
    # The ratio to independent cells is smooth, unlike the factor, whose cell counts go in steps.
    ratios = [
        factor.value / independent_factor(int(box_row))
        for factor, box_row in zip(factors, calibrated_rows, strict=True)
    ]
    all_rows = np.arange(last + 1)
    first_half = np.interp(all_rows, calibrated_rows, ratios) * [
        independent_factor(int(box_row)) for box_row in all_rows
    ]
    # Mirrored rows have mirrored covariances, and the same law.
    return RowFactors(
        values=tuple(np.concatenate([first_half, first_half[-2::-1]]).tolist()),
        relative_error=max(factor.relative_error for factor in factors),
    )
