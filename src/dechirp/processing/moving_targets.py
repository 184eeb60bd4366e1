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
    all_echoes: dict[str, np.ndarray], moving: dict[str, np.ndarray], radar: Radar
) -> dict[str, np.ndarray]:
    """Join the detections of the map with all echoes and of that without static ones.

    Rows of the second map within a cell of range and of velocity of one of the first are left out:
    the filter shifts estimates, and leaves residuals of echoes that drift. The column `moving` is 1
    for targets of the second map, within half a cell of velocity, and 0 for those found only with
    all echoes: static, or too slow for the filter.
    """
    range_offset_m = abs(moving["range"][:, None] - all_echoes["range"])
    velocity_offset = abs(moving["velocity"][:, None] - all_echoes["velocity"])
    cell_m, velocity_cell = (
        radar.frame.chirp.range_resolution_m,
        radar.frame.velocity_resolution_m_per_s,
    )
    near = (range_offset_m <= cell_m) & (velocity_offset <= velocity_cell)
    is_new = ~near.any(axis=1)
    joined = {
        name: np.concatenate([column, moving[name][is_new]]) for name, column in all_echoes.items()
    }
    is_moving = (near & (velocity_offset <= velocity_cell / 2)).any(axis=0)
    joined["moving"] = np.concatenate([is_moving, np.ones(int(is_new.sum()))]).astype(float)
    return joined
