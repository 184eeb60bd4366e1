"""Bodies with a formula of their own, in the optical region: large to the wave."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.bodies.base import AspectBody


class OpticalBody(AspectBody):
    """One scatterer at the origin."""

    @property
    def is_rigid(self) -> bool:
        """It is."""
        return True

    def n_scatterers(self) -> int:
        """One."""
        return 1

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """The origin at each time, (n_times, 1, 3)."""
        return np.zeros((len(times_s), 1, 3))

    def must_be_large(self, name: str, wavelength_m: float, *, wavelengths: float) -> None:
        """Raise `InvalidSetting` where the named length is below so many wavelengths."""
        size_m, least_m = getattr(self, name), wavelengths * wavelength_m
        if size_m < least_m:
            raise InvalidSetting(
                f"{type(self).__name__}.{name}",
                got=f"{size_m:.4g} m",
                need=f"at least {least_m:.4g} m, {wavelengths:g} wavelengths, for the formula of"
                " its cross section",
                fix="Make it larger, or give a target its measured rcs.",
            )
