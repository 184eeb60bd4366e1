"""Series-fed patch column, the usual antenna of single-board radars."""

import math
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    as_tuple_or_none,
    check_integer_fields,
    check_number,
    check_positive_fields,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.patterns.base import (
    MAX_GAIN,
    MIN_GAIN,
    Pattern,
    check_beam_direction,
    direction_in_beam_axes,
)


@frozen_dataclass
class PatchArray(Pattern):
    r"""Column of rectangular patches, each fed from the one below: narrow in elevation.

    The pattern of a patch times the array factor. With y to the left of the beam, z above
    it, x along it, each at most 1 (direction cosines), and k = 2 pi / lambda:

    .. math::

        U = (1 - y^2) \, \mathrm{sinc}^2\frac{k W y}{2} \, \mathrm{sinc}^2\frac{k h x}{2} \,
            \cos^2\frac{k L z}{2} \, \left| \sum_i a_i e^{j i (k d z - \psi)} \right|^2

    W and L are the width and the effective length that resonate at the design frequency.
    A line of one wavelength, longer by the tilt, feeds each patch from the one before:
    :math:`\psi = 2\pi (1 + (d/\lambda_0) \sin\theta_0) f/f_0`, so that off its design
    frequency the beam squints, by :math:`\sin\theta - \sin\theta_0 = (\lambda_0/d)
    (1 - f_0/f)`: up by about 1 deg for each percent.

    Notes
    -----
    Cavity model of a thin patch (h to 0.05 wavelengths) on an unbounded ground plane:
    nothing behind it, and near 90 deg more than an antenna of finite size has. The feed
    adds no loss along the column beyond `taper`, and no phase of the resonance of each
    patch; patches do not couple. One frequency, though a chirp sweeps over many: its
    squint from end to end is neglected.

    References
    ----------
    C. A. Balanis, Antenna Theory, 4th ed., 14.2 (patch, cavity model), 6.3 (array factor).
    """

    n_patches: int
    """Number of patches in the line."""
    design_frequency_hz: float
    """Resonance frequency of the patches, at which the beam points to its tilt."""
    frequency_hz: float | None = None
    """Operating frequency, best the middle of the sampling window; none: the design frequency."""
    relative_permittivity: float = 3.0
    """Relative permittivity of the substrate."""
    substrate_thickness_m: float = 127e-6
    """Thickness of the dielectric between the patches and the ground plane."""
    spacing_m: float | None = None
    """Distance from patch to patch; none: one wavelength in the line."""
    taper: tuple[float, ...] | None = None
    """Relative powers of the patches, from the lowest to the highest; none: equal."""
    tilt_rad: float = 0.0
    """Upward tilt of the beam by the feed line at the design frequency."""
    beam_azimuth_rad: float = 0.0
    """Azimuth to which the antenna is turned."""
    beam_elevation_rad: float = 0.0
    """Elevation to which the antenna is turned."""
    efficiency: float = 1.0
    """Radiated over fed power, a ratio of at most 1."""
    gain: float | None = None
    """Peak gain as a ratio (dBi in files); none: directivity times efficiency."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "n_patches", at_most=256)
        check_positive_fields(self, "design_frequency_hz", at_least=1e6, at_most=1e13)
        check_positive_fields(self, "relative_permittivity", at_least=1.0, at_most=100.0)
        check_positive_fields(self, "efficiency", at_least=1e-6, at_most=1.0)
        thickest_m = self._design_wavelength_m / 10
        check_positive_fields(self, "substrate_thickness_m", at_most=thickest_m)
        if self.frequency_hz is not None:
            # A patch resonates over a few percent of bandwidth.
            f0 = self.design_frequency_hz
            check_positive_fields(self, "frequency_hz", at_least=0.8 * f0, at_most=1.2 * f0)
        if self.spacing_m is not None:
            # From touching patches to a feed line of one wavelength in air.
            longest_m = self._design_wavelength_m
            check_positive_fields(
                self, "spacing_m", at_least=self.patch_length_m, at_most=longest_m
            )
        limit = math.pi / 3
        tilt_rad = check_number(
            "PatchArray.tilt_rad", self.tilt_rad, at_least=-limit, at_most=limit
        )
        object.__setattr__(self, "tilt_rad", tilt_rad)
        check_beam_direction(self)
        self._check_taper()
        if self.gain is not None:
            check_positive_fields(self, "gain", at_least=MIN_GAIN, at_most=MAX_GAIN)
            if self.efficiency != 1:
                raise InvalidSetting(
                    "PatchArray.efficiency",
                    value=f"{self.efficiency:.4g}, together with a gain",
                    expected="an efficiency without a gain, which already includes it",
                    fix="remove one of the two",
                )

    def _check_taper(self) -> None:
        if self.taper is None:
            return
        taper = as_tuple_or_none(self.taper) or ()
        if len(taper) != self.n_patches:
            raise InvalidSetting(
                "PatchArray.taper",
                value=f"{len(taper)} powers",
                expected=f"{self.n_patches} powers, one for each patch",
                fix="give the power of every patch, or remove the taper",
            )
        powers = tuple(
            check_number(f"PatchArray.taper.{index}", power, at_least=1e-12, at_most=1e12)
            for index, power in enumerate(taper)
        )
        object.__setattr__(self, "taper", powers)

    @property
    def patch_width_m(self) -> float:
        """Patch width across the column for good radiation, lambda_0 / 2 sqrt(2 / (er + 1))."""
        return self._design_wavelength_m / 2 * math.sqrt(2 / (self.relative_permittivity + 1))

    @property
    def patch_length_m(self) -> float:
        """Effective patch length with fringing fields: half a wavelength in the line."""
        return self._design_wavelength_m / (2 * math.sqrt(self.effective_permittivity))

    @property
    def effective_permittivity(self) -> float:
        """Effective permittivity of a line as wide as a patch, with part of its field in air."""
        er = self.relative_permittivity
        flatness = 1 + 12 * self.substrate_thickness_m / self.patch_width_m
        return (er + 1) / 2 + (er - 1) / 2 / math.sqrt(flatness)

    @property
    def peak_gain(self) -> float:
        """Largest gain: the given gain, or directivity times efficiency."""
        return self.efficiency * self.directivity if self.gain is None else self.gain

    @cached_property
    def directivity(self) -> float:
        """Ratio of the largest to the mean of the pattern, by quadrature to 1e-9."""
        # Uniform in z and in the angle about it, so the sphere needs no weight. The array
        # factor has fewer than 2 pi n_patches radians over z, and a patch few in both.
        z, z_weights = np.polynomial.legendre.leggauss(4 * self.n_patches + 40)
        angle, angle_weights = np.polynomial.legendre.leggauss(48)
        angle, angle_weights = angle * math.pi / 2, angle_weights * math.pi / 2
        y = np.sqrt(1 - z[:, None] ** 2) * np.sin(angle)
        total = float(z_weights @ self._relative_radiated_power(y, z[:, None]) @ angle_weights)
        return 4 * math.pi * self._peak_radiated_power / total

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Return the power gain towards directions, a ratio; zero behind the ground plane."""
        x, y, z = direction_in_beam_axes(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        shape = np.where(x > 0, self._relative_radiated_power(y, z), 0.0)
        return np.asarray(self.peak_gain / self._peak_radiated_power * shape)

    @property
    def _design_wavelength_m(self) -> float:
        return SPEED_OF_LIGHT / self.design_frequency_hz

    def _relative_radiated_power(self, y_cosine: np.ndarray, z_cosine: np.ndarray) -> np.ndarray:
        """Return the relative power radiated in front of the ground plane."""
        design_wavelength_m = self._design_wavelength_m
        frequency_ratio = (self.frequency_hz or self.design_frequency_hz) / self.design_frequency_hz
        wavelength_m = design_wavelength_m / frequency_ratio
        # Rounding goes below 0 at the rim.
        x = np.sqrt(np.maximum(1 - y_cosine**2 - z_cosine**2, 0.0))
        width_factor = np.sinc(self.patch_width_m / wavelength_m * y_cosine)
        thickness_factor = np.sinc(self.substrate_thickness_m / wavelength_m * x)
        length_factor = np.cos(math.pi * self.patch_length_m / wavelength_m * z_cosine)
        patch = (1 - y_cosine**2) * (width_factor * thickness_factor * length_factor) ** 2

        spacing_m = self.spacing_m or 2 * self.patch_length_m
        feed_phase = (
            2
            * math.pi
            * (1 + spacing_m / design_wavelength_m * math.sin(self.tilt_rad))
            * frequency_ratio
        )
        step = np.exp(1j * (2 * math.pi * spacing_m / wavelength_m * z_cosine - feed_phase))
        powers = self.taper or (1.0,) * self.n_patches
        total = np.zeros_like(step)
        for power in reversed(powers):  # Horner: no array of all patches
            total = total * step + math.sqrt(power)
        return np.asarray(patch * np.abs(total) ** 2)

    @cached_property
    def _peak_radiated_power(self) -> float:
        """Maximum of `_relative_radiated_power`: at y = 0, near the tilt or at a grating lobe."""

        def negative_power(z: float) -> float:
            return -float(self._relative_radiated_power(np.zeros(()), np.asarray(z)))

        z = np.linspace(-1, 1, 32 * self.n_patches + 33)
        peak_index = int(np.argmax(self._relative_radiated_power(np.zeros_like(z), z)))
        low, high = z[max(peak_index - 1, 0)], z[min(peak_index + 1, z.size - 1)]
        minimum = scipy.optimize.minimize_scalar(
            negative_power, bounds=(low, high), method="bounded", options={"xatol": 1e-9}
        )
        return max(-negative_power(float(minimum.x)), -negative_power(float(z[peak_index])))
