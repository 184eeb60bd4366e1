"""Additional map without static echoes, in which moving targets are sought.

Static echoes raise the threshold of the cells beside them, and the sidelobes of strong ones cover
slow targets. In a map from which a slow-time filter has removed them, the default training window
sees noise again. The map with all echoes keeps the static targets; detections of both are joined.
"""

from dataclasses import replace

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.mitigation.base import Mitigation
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.radar.radar import Radar

# Largest power of the residual of a static echo, relative to the echo: 10 dB below it, and 20 dB
# farther than a cell of velocity away, within the main lobe of the Doppler window, 2 cells.
_MAX_RESIDUAL = 0.1
_MAX_FAR_RESIDUAL = 0.01
_MAIN_LOBE_VELOCITY_CELLS = 2
# The filter shifts the ranges of echoes that overlap, by up to half a cell.
_RANGE_SHIFT_CELLS = 0.5
# Standard errors that the velocity of a static echo exceeds once in 10^6, as noise the threshold.
_MIN_VELOCITY_STDS = 4.9


@frozen_dataclass
class MovingTargetMap:
    """Settings of the map without static echoes."""

    filter: Mitigation = MeanSubtraction()
    """Method that removes static echoes."""
    cfar: Cfar = Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)

    def __post_init__(self) -> None:
        for name, kind in (("filter", Mitigation), ("cfar", Cfar)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidSetting(
                    f"MovingTargetMap.{name}",
                    value=getattr(self, name),
                    expected=f"a {kind.__name__}",
                    fix="leave it out for the default",
                )
        if not self.filter.filters_slow_time:
            raise InvalidSetting(
                "MovingTargetMap.filter",
                value=self.filter.kind(),
                expected="a filter over slow time, which removes static echoes",
                fix="give MeanSubtraction(), or leave it out for the default",
            )

    def fit_to_map(self, n_velocity: int, n_range: int) -> "MovingTargetMap":
        """Return the settings with default training cells that fit into a map."""
        cfar = self.cfar.fit_to_map(n_velocity, n_range)
        return self if cfar is self.cfar else replace(self, cfar=cfar)


def join_moving_detections(
    all_echoes: dict[str, np.ndarray],
    moving: dict[str, np.ndarray],
    radar: Radar,
    *,
    range_main_lobe_m: float,
) -> dict[str, np.ndarray]:
    """Join the detections of the map with all echoes and of that without static ones.

    Rows of the second map within a cell of range and of velocity of one of the first are left out:
    the filter shifts estimates. So are residuals of static echoes, which drift by less than a
    cell of velocity: rows within their main lobe of range (to each side) and a cell of velocity, at
    least 10 dB weaker. A linear drift of d in amplitude or phase (rad) leaves d^2 / 12 of the power
    after the mean, at 0.7 cells of velocity whatever its own: 10 dB are 1.1 rad in a frame. A
    quadratic drift of as much leaves 23 dB less than the echo at 2 cells, half the main lobe of a
    Hann window: rows up to there at least 20 dB weaker are residuals too. Those 10 to 20 dB weaker
    may be either: their motion is unknown.
    The column `moving` is 1 for targets of the second map: within half a cell of velocity, or
    within a cell where both are faster than a cell, since no static echo is there. It is 0 for
    those found only with all echoes, or with residuals, which are slower than a cell: static, or
    too slow for the filter. Faster ones that the second map does not confirm, because noise or
    thresholds differ, are unknown: NaN. So are targets whose velocity may be zero within its error.
    """
    range_offset_m = abs(moving["range"][:, None] - all_echoes["range"])
    velocity_offset = abs(moving["velocity"][:, None] - all_echoes["velocity"])
    cell_m, velocity_cell = (
        radar.frame.chirp.range_resolution_m,
        radar.frame.velocity_resolution_m_per_s,
    )
    is_beside_static = velocity_offset <= _MAIN_LOBE_VELOCITY_CELLS * velocity_cell
    is_beside_static &= abs(all_echoes["velocity"]) <= velocity_cell
    is_beside_static &= range_offset_m <= range_main_lobe_m + _RANGE_SHIFT_CELLS * cell_m
    level = moving["snr"][:, None] / all_echoes["snr"]
    is_unresolved = is_beside_static & (level < _MAX_RESIDUAL)
    is_residual = is_unresolved & ((velocity_offset <= velocity_cell) | (level < _MAX_FAR_RESIDUAL))
    near = (range_offset_m <= cell_m) & (velocity_offset <= velocity_cell)
    is_new = ~(near | is_residual).any(axis=1)
    joined = {
        name: np.concatenate([column, moving[name][is_new]]) for name, column in all_echoes.items()
    }
    is_fast = abs(all_echoes["velocity"]) > velocity_cell
    is_target = near & ~is_residual & ((velocity_offset <= velocity_cell / 2) | is_fast)
    motion = np.where(is_target.any(axis=0), 1.0, np.where(is_fast, np.nan, 0.0))
    new_motion = np.where(is_unresolved.any(axis=1), np.nan, 1.0)[is_new]
    joined["moving"] = motion_beyond_errors(
        np.concatenate([motion, new_motion]), joined["velocity"], joined["velocity_std"]
    )
    return joined


def motion_beyond_errors(
    motion: np.ndarray, velocity_m_per_s: np.ndarray, std_m_per_s: np.ndarray
) -> np.ndarray:
    """Return the column `moving`, with NaN for movers whose velocity may be zero within its error.

    A static echo with a phase that changes within the frame looks like them.
    """
    may_be_zero = (motion == 1) & ~(abs(velocity_m_per_s) > _MIN_VELOCITY_STDS * std_m_per_s)
    return np.where(may_be_zero, np.nan, motion)
