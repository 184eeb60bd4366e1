"""Many fixed scatterers, as lists of places and cross sections: meshes, scans, clutter."""

from functools import cached_property

import numpy as np

from dechirp.core.checks import Vector, numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import LEAST_RCS_M2, MOST_RCS_M2, Body


@value
class Cloud(Body):
    """Fixed scatterers; arrays are taken, and 100,000 points made in a tenth of a second."""

    positions_m: tuple[Vector, ...]
    """(n_scatterers, 3), in the axes of the body."""
    rcs_m2: tuple[float, ...]
    """(n_scatterers,), dBsm in files."""

    def __post_init__(self) -> None:
        at_m = numbers("Cloud.positions_m", self.positions_m, above=-1e9, below=1e9)
        rcs_m2 = numbers("Cloud.rcs_m2", self.rcs_m2, above=0.0, below=MOST_RCS_M2)
        if at_m.ndim != 2 or at_m.shape[1] != 3 or not len(at_m):
            raise InvalidSetting(
                "Cloud.positions_m",
                got=f"of the shape {at_m.shape}",
                need="x, y and z of each scatterer, of at least one: of the shape (n, 3)",
                fix="Give a list of places, or an array of that shape.",
            )
        if rcs_m2.shape != at_m.shape[:1] or rcs_m2.min() < LEAST_RCS_M2:
            raise InvalidSetting(
                "Cloud.rcs_m2",
                got=f"of the shape {rcs_m2.shape}, the least {rcs_m2.min(initial=1):.3g} m^2",
                need=f"a cross section of at least {LEAST_RCS_M2:g} m^2 for each of the {len(at_m)}"
                " positions",
                fix="Give as many of one as of the other, in the same order.",
            )
        # Tuples compare, and settings files have words for them: 100 bytes a scatterer.
        object.__setattr__(self, "positions_m", tuple(map(tuple, at_m.tolist())))
        object.__setattr__(self, "rcs_m2", tuple(rcs_m2.tolist()))

    @property
    def is_rigid(self) -> bool:
        """No part moves."""
        return True

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers, the same at each time, (n_times, n_scatterers, 3)."""
        at_m, _ = self._arrays
        return np.broadcast_to(at_m, (len(times_s), *at_m.shape))

    def cross_sections_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,)."""
        return self._arrays[1]

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        arrays = np.array(self.positions_m), np.array(self.rcs_m2)
        for array in arrays:
            array.flags.writeable = False
        return arrays
