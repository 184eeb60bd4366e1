"""A series-fed column of patches, the usual antenna of radars on one board."""

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from dechirp.core.checks import count, listed, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.radar.patterns.base import LEAST_GAIN, MOST_GAIN, Pattern, keep_beam, seen_from_beam


@value
class PatchArray(Pattern):
    r"""Rectangular patches in a column, fed from the one below: narrow in elevation.

    The pattern of a patch times the array factor. With y to the left of the beam, z above
    it, x along it, each at most 1 (direction cosines), and k = 2 pi / lambda:

    .. math::

        U = (1 - y^2) \, \mathrm{sinc}^2\frac{k W y}{2} \, \mathrm{sinc}^2\frac{k h x}{2} \,
            \cos^2\frac{k L z}{2} \, \left| \sum_i a_i e^{j i (k d z - \psi)} \right|^2

    W and L are the width and the effective length that resonate at the design frequency.
    A line of one wavelength feeds a patch from the last, with what the tilt takes more:
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
    design_frequency_hz: float
    """At which the patches resonate and the beam points to its tilt."""
    frequency_hz: float | None = None
    """At which it is fed, best the middle of the samples; none: the design frequency."""
    relative_permittivity: float = 3.0
    """Of the substrate."""
    substrate_thickness_m: float = 127e-6
    spacing_m: float | None = None
    """From patch to patch; none: one wavelength in the line."""
    taper: tuple[float, ...] | None = None
    """Powers of the patches to one another, from the lowest to the highest; none: equal."""
    tilt_rad: float = 0.0
    """How far the line steers the beam up at the design frequency."""
    beam_azimuth_rad: float = 0.0
    """Where the antenna as a whole is turned to."""
    beam_elevation_rad: float = 0.0
    """Where the antenna as a whole is turned to."""
    efficiency: float = 1.0
    """What is radiated of the power that is fed, a ratio of at most 1."""
    gain: float | None = None
    """At the peak, as a ratio (dBi in files); none: directivity times efficiency."""

    def __post_init__(self) -> None:
        count(self, "n_patches", at_most=256)
        positive(self, "design_frequency_hz", at_least=1e6, at_most=1e13)
        positive(self, "relative_permittivity", at_least=1.0, at_most=100.0)
        positive(self, "efficiency", at_least=1e-6, at_most=1.0)
        thickest_m = self._design_wavelength_m / 10
        positive(self, "substrate_thickness_m", at_most=thickest_m)
        if self.frequency_hz is not None:
            # A patch resonates over some percent; far off, there is no such antenna.
            f0 = self.design_frequency_hz
            positive(self, "frequency_hz", at_least=0.8 * f0, at_most=1.2 * f0)
        if self.spacing_m is not None:
            # From patches that touch to the line of one wavelength, in air, that feeds them.
            longest_m = self._design_wavelength_m
            positive(self, "spacing_m", at_least=self.patch_length_m, at_most=longest_m)
        limit = math.pi / 3
        tilt_rad = number("PatchArray.tilt_rad", self.tilt_rad, at_least=-limit, at_most=limit)
        object.__setattr__(self, "tilt_rad", tilt_rad)
        keep_beam(self)
        self._check_taper()
        if self.gain is not None:
            positive(self, "gain", at_least=LEAST_GAIN, at_most=MOST_GAIN)
            if self.efficiency != 1:
                raise InvalidSetting(
                    "PatchArray.efficiency",
                    got=f"{self.efficiency:.4g}, beside a gain",
                    need="given alone: the gain has it already",
                    fix="Leave out the one or the other.",
                )

    def _check_taper(self) -> None:
        if self.taper is None:
            return
        taper = listed(self.taper) or ()
        if len(taper) != self.n_patches:
            raise InvalidSetting(
                "PatchArray.taper",
                got=f"{len(taper)} powers",
                need=f"{self.n_patches} powers, one for each patch",
                fix="Give the power of every patch, or leave the taper out.",
            )
        powers = tuple(
            number(f"PatchArray.taper.{place}", power, at_least=1e-12, at_most=1e12)
            for place, power in enumerate(taper)
        )
        object.__setattr__(self, "taper", powers)

    @property
    def patch_width_m(self) -> float:
        """Width across the column that radiates well, lambda_0 / 2 sqrt(2 / (er + 1))."""
        return self._design_wavelength_m / 2 * math.sqrt(2 / (self.relative_permittivity + 1))

    @property
    def patch_length_m(self) -> float:
        """Length along the column with its fringing fields: half a wavelength in the line."""
        return self._design_wavelength_m / (2 * math.sqrt(self.effective_permittivity))

    @property
    def effective_permittivity(self) -> float:
        """Of a line as wide as a patch, part of whose field is in the air."""
        er = self.relative_permittivity
        flatness = 1 + 12 * self.substrate_thickness_m / self.patch_width_m
        return (er + 1) / 2 + (er - 1) / 2 / math.sqrt(flatness)

    @property
    def peak_gain(self) -> float:
        """The largest gain: as given, or directivity times efficiency."""
        return self.efficiency * self.directivity if self.gain is None else self.gain

    @cached_property
    def directivity(self) -> float:
        """Largest over mean of the pattern, a ratio, by quadrature to 1e-9."""
        # Uniform in z and in the angle about it, so the sphere needs no weight. The array
        # factor has fewer than 2 pi n_patches radians over z, and a patch few in both.
        z, over_z = np.polynomial.legendre.leggauss(4 * self.n_patches + 40)
        angle, over_angle = np.polynomial.legendre.leggauss(48)
        angle, over_angle = angle * math.pi / 2, over_angle * math.pi / 2
        y = np.sqrt(1 - z[:, None] ** 2) * np.sin(angle)
        total = float(over_z @ self._shape(y, z[:, None]) @ over_angle)
        return 4 * math.pi * self._peak / total

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Power gain towards directions, a ratio; zero behind the ground plane."""
        x, y, z = seen_from_beam(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        shape = np.where(x > 0, self._shape(y, z), 0.0)
        return np.asarray(self.peak_gain / self._peak * shape)

    @property
    def _design_wavelength_m(self) -> float:
        return SPEED_OF_LIGHT / self.design_frequency_hz

    def _shape(self, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Radiated power towards direction cosines before the ground plane, no unit."""
        longest_m = self._design_wavelength_m
        detuned = (self.frequency_hz or self.design_frequency_hz) / self.design_frequency_hz
        wavelength_m = longest_m / detuned
        x = np.sqrt(np.maximum(1 - y**2 - z**2, 0.0))  # rounding goes below 0 at the rim
        across = np.sinc(self.patch_width_m / wavelength_m * y)
        through = np.sinc(self.substrate_thickness_m / wavelength_m * x)
        along = np.cos(math.pi * self.patch_length_m / wavelength_m * z)
        patch = (1 - y**2) * (across * through * along) ** 2

        spacing_m = self.spacing_m or 2 * self.patch_length_m
        line = 2 * math.pi * (1 + spacing_m / longest_m * math.sin(self.tilt_rad)) * detuned
        step = np.exp(1j * (2 * math.pi * spacing_m / wavelength_m * z - line))
        powers = self.taper or (1.0,) * self.n_patches
        total = np.zeros_like(step)
        for power in reversed(powers):  # Horner: no array of all patches
            total = total * step + math.sqrt(power)
        return np.asarray(patch * np.abs(total) ** 2)

    @cached_property
    def _peak(self) -> float:
        """Largest of `_shape`: at y = 0, and near the tilt in z, or at a grating lobe."""

        def lost(z: float) -> float:
            return -float(self._shape(np.zeros(()), np.asarray(z)))

        z = np.linspace(-1, 1, 32 * self.n_patches + 33)
        about = int(np.argmax(self._shape(np.zeros_like(z), z)))
        low, high = z[max(about - 1, 0)], z[min(about + 1, z.size - 1)]
        found = minimize_scalar(lost, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
        return max(-lost(float(found.x)), -lost(float(z[about])))
