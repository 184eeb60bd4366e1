"""Point cloud of fixed scatterers, from arrays: meshes, scans, clutter."""

from functools import cached_property

import numpy as np

from dechirp.core.checks import Vector, check_finite_array
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import MAX_RCS_M2, MIN_RCS_M2, Body


@frozen_dataclass
class PointCloud(Body):
    """Fixed scatterers from arrays; 100,000 points take a tenth of a second."""

    positions_m: tuple[Vector, ...]
    """(n_scatterers, 3), in the axes of the body."""
    rcs_m2: tuple[float, ...]
    """(n_scatterers,), dBsm in files."""

    def __post_init__(self) -> None:
        positions_m = check_finite_array(
            "PointCloud.positions_m", self.positions_m, above=-1e9, below=1e9
        )
        rcs_m2 = check_finite_array("PointCloud.rcs_m2", self.rcs_m2, above=0.0, below=MAX_RCS_M2)
        if positions_m.ndim != 2 or positions_m.shape[1] != 3 or not len(positions_m):
            raise InvalidSetting(
                "PointCloud.positions_m",
                value=f"an array of the shape {positions_m.shape}",
                expected="x, y and z of at least one scatterer, of the shape (n, 3)",
                fix="give a list of positions, or an array of that shape",
            )
        if rcs_m2.shape != positions_m.shape[:1] or rcs_m2.min() < MIN_RCS_M2:
            raise InvalidSetting(
                "PointCloud.rcs_m2",
                value=f"shape {rcs_m2.shape}, with a minimum of {rcs_m2.min(initial=1):.3g} m^2",
                expected=f"a cross section of at least {MIN_RCS_M2:g} m^2 for each of the"
                f" {len(positions_m)} positions",
                fix="give one cross section for each position, in the same order",
            )
        # Tuples can be compared and written to settings files: 100 bytes a scatterer.
        object.__setattr__(self, "positions_m", tuple(map(tuple, positions_m.tolist())))
        object.__setattr__(self, "rcs_m2", tuple(rcs_m2.tolist()))

    @property
    def is_rigid(self) -> bool:
        return True

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        positions_m, _ = self._position_and_rcs_arrays
        return np.broadcast_to(positions_m, (len(times_s), *positions_m.shape))

    def cross_sections_m2(self) -> np.ndarray:
        return self._position_and_rcs_arrays[1]

    @cached_property
    def _position_and_rcs_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        arrays = np.array(self.positions_m), np.array(self.rcs_m2)
        for array in arrays:
            array.flags.writeable = False
        return arrays
