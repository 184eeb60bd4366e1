"""What cars, vans and trucks have in common: panels, corners, wheel arches, turning wheels."""

import math
from abc import abstractmethod
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.core.values import value
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.slow import must_be_slow


class _Lobe(NamedTuple):
    """What a panel reflects about its normal: a row of the table, elevation for zenith angle."""

    peak_m2: float
    azimuth_width_rad: float
    """Between the angles at which it is 3 dB less, as the next."""
    elevation_rad: float
    """Of the peak."""
    elevation_width_rad: float


def _lobe(peak_db: float, *angles_deg: float) -> _Lobe:
    return _Lobe(float(from_decibels(peak_db)), *(math.radians(angle) for angle in angles_deg))


# 3GPP TR 38.901 V19, table 7.9.2.1-4: the passenger car of TR 37.885, 5.0 x 2.0 x 1.6 m.
_FRONT = _lobe(15.52, 40.54, 90 - 71.75, 29.13)
_SIDE = _lobe(20.75, 26.90, 90 - 79.70, 44.42)
_REAR = _lobe(14.56, 36.32, 90 - 79.65, 36.73)
_EVEN = _Lobe(0.0, math.inf, 0.0, math.inf)
_LEAST_M2 = float(from_decibels(7.07))  # G_max - sigma_max, the same for all sides
_TABLE_LENGTH_M, _TABLE_WIDTH_M, _TABLE_HEIGHT_M = 5.0, 2.0, 1.6

# Of what the table has between its lobes. Between them three corners and the parts of one
# side add up to 0.75 of it (-1.2 dB); where a lobe has fallen to as much, to 1.75 (+2.4 dB).
_CORNER, _WHEELS, _ARCHES = 0.15, 0.2, 0.1

_SPACING_M = 0.4  # of the points of a panel: a range bin or less
_RIM_POINTS = 8
_LEVELS = (0.3, 0.6)  # of the height, on which the points of a panel take turns


class _Parts(NamedTuple):
    """Scatterers that reflect alike, each (n, ...)."""

    at_m: np.ndarray
    """(n, 3), of a point of a rim its hub."""
    rcs_m2: np.ndarray
    facing_rad: np.ndarray
    """Azimuth of the normal."""
    seen_rad: np.ndarray
    """How far from the normal the azimuth of the radar may be, both ways."""
    lobe: np.ndarray
    """(n, 3): width in azimuth, elevation of the peak, width in elevation."""


@value
class Vehicle(AspectBody):
    r"""A box on wheels, on the ground under its origin, the middle of the box.

    Points in a row on each side reflect in a lobe about the normal, as a gently curved panel
    does; corners and wheel arches reflect alike to all sides from which they are seen, the
    points of the wheels too. What faces away is hidden. Each point is seen from its own
    place: the flash of a side wanders along it as the radar passes. In all, with angles from
    the peak of the lobe of each panel over its width,

    .. math:: \sigma = \sum_i \sigma_i 10^{-1.2 \left((\Delta\varphi_i / \varphi_{3dB})^2 +
        (\Delta\theta_i / \theta_{3dB})^2\right)} + \sum_j \sigma_j

    Notes
    -----
    Panels and what is between them are those of a passenger car in the table below, within
    2.5 dB at all azimuths, from up to 40 deg above, without any smoothing. Panels reflect in
    proportion to their areas, the other parts to those of all sides: in the optical region,
    k times as large means k^2 times as much. That is all that is known here of vans and
    trucks. The roof's own flash, from within 30 deg of the zenith, is left out. Cross
    sections are means and do not depend on the wavelength; phases follow from the places, so
    that the sum fluctuates with the aspect as that of a car does.

    References
    ----------
    3GPP TR 38.901 V19 (2025), 7.9.2.1, eq. 7.9.2-2 and table 7.9.2.1-4 (up to 100 GHz).
    """

    length_m: float
    width_m: float
    height_m: float
    wheel_radius_m: float
    speed_m_per_s: float

    @property
    @abstractmethod
    def axles(self) -> tuple[float, ...]:
        """Where the axles are: 0 at the tail, 1 at the nose."""

    def __post_init__(self) -> None:
        # From a toy to a road train: outside, a unit is wrong.
        positive(self, "length_m", at_least=0.1, at_most=60.0)
        positive(self, "width_m", "height_m", at_least=0.05, at_most=10.0)
        positive(self, "wheel_radius_m")
        ends_m = np.array([0.0, *sorted(self.axles), 1.0]) * self.length_m
        gaps_m = np.diff(ends_m)
        largest_m = min(self.height_m / 2, gaps_m[0], gaps_m[-1], gaps_m[1:-1].min() / 2)
        name = type(self).__name__
        if self.wheel_radius_m > largest_m:
            raise InvalidSetting(
                f"{name}.wheel_radius_m",
                got=f"{self.wheel_radius_m:.4g} m",
                need=f"at most {largest_m:.4g} m, for wheels to fit beside each other under a"
                f" {name.lower()} of {self.length_m:.4g} m by {self.height_m:.4g} m",
                fix="Give the radius, not the diameter, or a larger vehicle.",
            )
        where = f"{name}.speed_m_per_s"
        object.__setattr__(self, "speed_m_per_s", number(where, self.speed_m_per_s))
        must_be_slow(where, 2 * abs(self.speed_m_per_s), of=" at the top of the wheels")

    @property
    def is_rigid(self) -> bool:
        """Whether its wheels stand."""
        return self.speed_m_per_s == 0

    def n_scatterers(self) -> int:
        """How many there are; the points of the wheels are the last."""
        return len(self._parts.rcs_m2)

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the scatterers at each time, (n_times, n_scatterers, 3), axes of the body."""
        offsets_m = np.repeat(self._parts.at_m[None], len(times_s), axis=0)
        turned_rad = self._rim_rad + times_s[:, None] * self.speed_m_per_s / self.wheel_radius_m
        rims_m = offsets_m[:, -len(self._rim_rad) :]
        rims_m[..., 0] += self.wheel_radius_m * np.sin(turned_rad)
        rims_m[..., 2] += self.wheel_radius_m * np.cos(turned_rad)
        return offsets_m

    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Mean cross section of each scatterer, (n_places, n_scatterers), 0 where it is hidden."""
        parts = self._parts
        x, y, z = np.moveaxis(radar_m[:, None] - parts.at_m, -1, 0)
        off_rad = np.arctan2(y, x) - parts.facing_rad
        off_rad = np.abs((off_rad + np.pi) % (2 * np.pi) - np.pi)
        width_rad, peak_rad, height_rad = parts.lobe.T
        above = (np.arctan2(z, np.hypot(x, y)) - peak_rad) / height_rad
        lobe = 10 ** (-1.2 * ((off_rad / width_rad) ** 2 + above**2))
        return np.where(off_rad < parts.seen_rad, parts.rcs_m2 * lobe, 0.0)

    @cached_property
    def _parts(self) -> _Parts:
        kinds = [*self._panels(), self._corners(), self._arches(), self._wheels()]
        return _Parts(*(np.concatenate(arrays) for arrays in zip(*kinds, strict=True)))

    @cached_property
    def _rim_rad(self) -> np.ndarray:
        """Angles of the points of all rims at time zero, from the top on forwards."""
        wheels = np.arange(2 * len(self.axles))[:, None]
        # No two wheels stand alike.
        turns = np.arange(_RIM_POINTS) + wheels / len(wheels)
        return (turns * (2 * np.pi / _RIM_POINTS)).ravel()

    def _panels(self) -> list[_Parts]:
        length_m, width_m = self.length_m, self.width_m
        size = self.height_m / _TABLE_HEIGHT_M
        along, across = size * length_m / _TABLE_LENGTH_M, size * width_m / _TABLE_WIDTH_M
        sides = [
            (0.0, _FRONT, across, length_m, width_m),
            (np.pi / 2, _SIDE, along, width_m, length_m),
            (np.pi, _REAR, across, length_m, width_m),
            (-np.pi / 2, _SIDE, along, width_m, length_m),
        ]
        return [self._panel(*side) for side in sides]

    def _panel(
        self, facing_rad: float, lobe: _Lobe, scale: float, apart_m: float, wide_m: float
    ) -> _Parts:
        """Points in a row, half of `apart_m` from the origin."""
        n = max(2, round(wide_m / _SPACING_M))
        place_m = (np.arange(n) + 0.5) / n * wide_m - wide_m / 2
        c, s = math.cos(facing_rad), math.sin(facing_rad)
        at_m = np.stack(
            [
                c * apart_m / 2 - s * place_m,
                s * apart_m / 2 + c * place_m,
                np.resize(_LEVELS, n) * self.height_m,
            ],
            axis=-1,
        )
        return _alike(at_m, scale * lobe.peak_m2, facing_rad, np.pi / 2, lobe)

    def _corners(self) -> _Parts:
        x, y = np.array([1, 1, -1, -1]), np.array([1, -1, 1, -1])
        facing_rad = np.repeat(np.arctan2(y, x), len(_LEVELS))
        at_m = np.stack(
            [
                np.repeat(x * self.length_m / 2, len(_LEVELS)),
                np.repeat(y * self.width_m / 2, len(_LEVELS)),
                np.tile(_LEVELS, 4) * self.height_m,
            ],
            axis=-1,
        )
        # From both sides that meet there.
        return _alike(at_m, 4 * _CORNER * self._even_m2, facing_rad, 3 * np.pi / 4, _EVEN)

    def _arches(self) -> _Parts:
        """The edges before and behind each wheel."""
        hubs_m, facing_rad = self._hubs(2)
        edges = np.array([1, 0, 0.5]) * self.wheel_radius_m
        signs = np.resize([[1, 1, 1], [-1, 1, 1]], hubs_m.shape)
        return _alike(
            hubs_m + signs * edges, 2 * _ARCHES * self._even_m2, facing_rad, np.pi / 2, _EVEN
        )

    def _wheels(self) -> _Parts:
        hubs_m, facing_rad = self._hubs(_RIM_POINTS)
        return _alike(hubs_m, 2 * _WHEELS * self._even_m2, facing_rad, np.pi / 2, _EVEN)

    def _hubs(self, times: int) -> tuple[np.ndarray, np.ndarray]:
        """Hubs of all wheels, so many times each, (n, 3), and to which side they face, (n,)."""
        x_m = (np.array(self.axles) - 0.5) * self.length_m
        sides = np.array([1.0, -1.0])
        x_m, sides = np.tile(x_m, 2), np.repeat(sides, len(x_m))
        hubs_m = np.stack(
            [x_m, sides * 0.45 * self.width_m, np.full(len(x_m), self.wheel_radius_m)], axis=-1
        )
        return np.repeat(hubs_m, times, axis=0), np.repeat(sides * np.pi / 2, times)

    @property
    def _even_m2(self) -> float:
        """What the table has between its lobes, for a vehicle of this size."""
        around_m2 = (self.length_m + self.width_m) * self.height_m
        table_m2 = (_TABLE_LENGTH_M + _TABLE_WIDTH_M) * _TABLE_HEIGHT_M
        return _LEAST_M2 * around_m2 / table_m2


def _alike(
    at_m: np.ndarray, rcs_m2: float, facing_rad: float | np.ndarray, seen_rad: float, lobe: _Lobe
) -> _Parts:
    """Parts that share a cross section evenly."""
    n = len(at_m)
    return _Parts(
        at_m,
        np.full(n, rcs_m2 / n),
        np.broadcast_to(facing_rad, n),
        np.full(n, seen_rad),
        np.tile(lobe[1:], (n, 1)),
    )
