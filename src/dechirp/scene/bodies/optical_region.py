"""Base class of bodies with an optical-region formula."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.bodies.base import AspectBody


class OpticalBody(AspectBody):
    """Body that is one scatterer at the origin, large relative to the wavelength."""

    @property
    def is_rigid(self) -> bool:
        return True

    def n_scatterers(self) -> int:
        return 1

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        return np.zeros((len(times_s), 1, 3))

    def check_optical_size(
        self, length_field: str, wavelength_m: float, *, min_wavelengths: float
    ) -> None:
        """Raise `InvalidSetting` if the named length is below a number of wavelengths."""
        size_m, least_m = getattr(self, length_field), min_wavelengths * wavelength_m
        if size_m < least_m:
            raise InvalidSetting(
                f"{type(self).__name__}.{length_field}",
                value=f"{size_m:.4g} m",
                expected=f"at least {least_m:.4g} m, {min_wavelengths:g} wavelengths, for the"
                " formula of its cross section",
                fix="enlarge it, or use a target with a measured rcs",
            )
