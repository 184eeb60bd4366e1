"""Vehicles: cars, vans and trucks with panels, corners, wheel arches and turning wheels."""

import math
from abc import abstractmethod
from dataclasses import fields
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.speed_limit import check_speed_limit


class _PanelLobe(NamedTuple):
    """Lobe of a panel about its normal: a row of the table, with elevation for zenith angle."""

    peak_m2: float
    azimuth_width_rad: float
    """Width between the angles at which it is 3 dB less, in azimuth."""
    elevation_rad: float
    """Elevation of the peak."""
    elevation_width_rad: float


def _make_panel_lobe(peak_db: float, *angles_deg: float) -> _PanelLobe:
    return _PanelLobe(float(from_decibels(peak_db)), *(math.radians(angle) for angle in angles_deg))


# 3GPP TR 38.901 V19, table 7.9.2.1-4: the passenger car of TR 37.885, 5.0 x 2.0 x 1.6 m.
_FRONT = _make_panel_lobe(15.52, 40.54, 90 - 71.75, 29.13)
_SIDE = _make_panel_lobe(20.75, 26.90, 90 - 79.70, 44.42)
_REAR = _make_panel_lobe(14.56, 36.32, 90 - 79.65, 36.73)
_ISOTROPIC_LOBE = _PanelLobe(0.0, math.inf, 0.0, math.inf)
_BACKGROUND_M2 = float(from_decibels(7.07))  # G_max - sigma_max, the same for all sides
_TABLE_LENGTH_M, _TABLE_WIDTH_M, _TABLE_HEIGHT_M = 5.0, 2.0, 1.6

# Shares of the table's value between its lobes. There, three corners and the parts of one side add
# up to 0.75 of it (-1.2 dB); where a lobe has fallen to as much, to 1.75 (+2.4 dB).
_CORNER_SHARE, _WHEEL_SHARE, _ARCH_SHARE = 0.15, 0.2, 0.1

_SPACING_M = 0.4  # of the points of a panel: a range bin or less
_RIM_POINTS = 8
_PANEL_LEVELS = (0.3, 0.6)  # of the height; the points of a panel alternate between them


class _PartGroup(NamedTuple):
    """Scatterers with equal properties, each (n, ...)."""

    position_m: np.ndarray
    """(n, 3); for a point of a rim, its hub."""
    rcs_m2: np.ndarray
    facing_rad: np.ndarray
    """Azimuth of the normal."""
    visible_rad: np.ndarray
    """Largest angle between the normal and the azimuth of the radar, both ways."""
    lobe: np.ndarray
    """(n, 3): width in azimuth, elevation of the peak, width in elevation."""


@frozen_dataclass
class Vehicle(AspectBody):
    r"""Box on wheels, on the ground; its origin is below the middle of the box.

    Rows of points on each side reflect in a lobe about the normal, like a gently curved panel;
    corners, wheel arches and wheels reflect equally in all directions from which they are visible.
    Sides facing away are hidden. Each point has its own aspect: the flash of a side moves along it
    as the radar passes. In total, with angles from the peak of the lobe of each panel over its
    width,

    .. math:: \sigma = \sum_i \sigma_i 10^{-1.2 \left((\Delta\varphi_i / \varphi_{3dB})^2 +
        (\Delta\theta_i / \theta_{3dB})^2\right)} + \sum_j \sigma_j

    Notes
    -----
    Panels, and the level between them, are those of a passenger car in the table below, within 2.5
    dB at
    all azimuths and up to 40 deg elevation, without any smoothing. Panels reflect in proportion to
    their areas, the other parts to the area of all sides: in the optical region, a body k times as
    large has k^2 times the cross section. No other data on vans and trucks are used. The flash of
    the
    roof, within 30 deg of the zenith, is neglected. Cross sections are means and do not depend on
    the
    wavelength; phases follow from the positions, so that the sum fluctuates with the aspect like
    that
    of a car.

    References
    ----------
    3GPP TR 38.901 V19 (2025), 7.9.2.1, eq. 7.9.2-2 and table 7.9.2.1-4 (up to 100 GHz).
    """

    length_m: float
    """Length along the heading."""
    width_m: float
    """Width across the heading."""
    height_m: float
    """Height of the roof above the ground."""
    wheel_radius_m: float
    """Radius of the tyres, whose points touch the ground."""
    speed_m_per_s: float
    """Rolling speed of the wheels, positive forwards; 0: they do not turn. The target's velocity
    moves the vehicle."""

    @property
    @abstractmethod
    def axle_fractions(self) -> tuple[float, ...]:
        """Return the positions of the axles: 0 at the tail, 1 at the nose."""

    def __post_init__(self) -> None:
        # Limits from a toy to a road train: other values indicate a wrong unit.
        check_positive_fields(self, "length_m", at_least=0.1, at_most=60.0)
        check_positive_fields(self, "width_m", "height_m", at_least=0.05, at_most=10.0)
        check_positive_fields(self, "wheel_radius_m")
        ends_m = np.array([0.0, *sorted(self.axle_fractions), 1.0]) * self.length_m
        gaps_m = np.diff(ends_m)
        largest_m = min(self.height_m / 2, gaps_m[0], gaps_m[-1], gaps_m[1:-1].min() / 2)
        name = type(self).__name__
        if self.wheel_radius_m > largest_m:
            raise InvalidSetting(
                f"{name}.wheel_radius_m",
                value=f"{self.wheel_radius_m:.4g} m",
                expected=f"at most {largest_m:.4g} m, for wheels to fit beside each other under a"
                f" {name.lower()} of {self.length_m:.4g} m by {self.height_m:.4g} m",
                fix="give the radius, not the diameter, or enlarge the vehicle",
            )
        where = f"{name}.speed_m_per_s"
        object.__setattr__(self, "speed_m_per_s", check_number(where, self.speed_m_per_s))
        check_speed_limit(where, 2 * abs(self.speed_m_per_s), context=" at the top of the wheels")

    @property
    def is_rigid(self) -> bool:
        return self.speed_m_per_s == 0

    @property
    def blocking_box_m(self) -> np.ndarray:
        x, y = self.length_m / 2, self.width_m / 2
        return np.array([[-x, -y, -np.inf], [x, y, self.height_m]])

    @property
    def side_reflectivity(self) -> None:
        return None

    @property
    def ground_clearance_m(self) -> float:
        """Return half the radius of the wheels: 16 cm of a car, 25 cm of a truck."""
        return self.wheel_radius_m / 2

    def n_scatterers(self) -> int:
        return len(self._all_scatterers.rcs_m2)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        offsets_m = np.repeat(self._all_scatterers.position_m[None], len(times_s), axis=0)
        turned_rad = (
            self._rim_angles_rad + times_s[:, None] * self.speed_m_per_s / self.wheel_radius_m
        )
        rims_m = offsets_m[:, -len(self._rim_angles_rad) :]
        rims_m[..., 0] += self.wheel_radius_m * np.sin(turned_rad)
        rims_m[..., 2] += self.wheel_radius_m * np.cos(turned_rad)
        return offsets_m

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        parts = self._all_scatterers
        x, y, z = np.moveaxis(radar_m[:, None] - parts.position_m, -1, 0)
        off_rad = np.arctan2(y, x) - parts.facing_rad
        off_rad = np.abs((off_rad + np.pi) % (2 * np.pi) - np.pi)
        width_rad, peak_rad, height_rad = parts.lobe.T
        elevation_ratio = (np.arctan2(z, np.hypot(x, y)) - peak_rad) / height_rad
        lobe = 10 ** (-1.2 * ((off_rad / width_rad) ** 2 + elevation_ratio**2))
        return np.where(off_rad < parts.visible_rad, parts.rcs_m2 * lobe, 0.0)

    @cached_property
    def _all_scatterers(self) -> _PartGroup:
        sizes = ((item.name, getattr(self, item.name)) for item in fields(self))
        return _scatterers_of_vehicle(
            type(self), tuple(size for size in sizes if size[0] != "speed_m_per_s")
        )

    def _make_all_scatterers(self) -> _PartGroup:
        kinds = [
            *self._make_scatterers_of_panels(),
            self._make_corner_scatterers(),
            self._make_wheel_arch_scatterers(),
            self._make_rim_scatterers(),
        ]
        return _PartGroup(*(np.concatenate(arrays) for arrays in zip(*kinds, strict=True)))

    @cached_property
    def _rim_angles_rad(self) -> np.ndarray:
        """Return the angles of the points of all rims at time zero, from the top forwards."""
        wheels = np.arange(2 * len(self.axle_fractions))[:, None]
        # Each wheel has another angle.
        turns = np.arange(_RIM_POINTS) + wheels / len(wheels)
        return (turns * (2 * np.pi / _RIM_POINTS)).ravel()

    def _make_scatterers_of_panels(self) -> list[_PartGroup]:
        length_m, width_m = self.length_m, self.width_m
        height_scale = self.height_m / _TABLE_HEIGHT_M
        side_scale, end_scale = (
            height_scale * length_m / _TABLE_LENGTH_M,
            height_scale * width_m / _TABLE_WIDTH_M,
        )
        sides = [
            (0.0, _FRONT, end_scale, length_m, width_m),
            (np.pi / 2, _SIDE, side_scale, width_m, length_m),
            (np.pi, _REAR, end_scale, length_m, width_m),
            (-np.pi / 2, _SIDE, side_scale, width_m, length_m),
        ]
        return [self._make_scatterers_of_panel(*side) for side in sides]

    def _make_scatterers_of_panel(
        self,
        facing_rad: float,
        lobe: _PanelLobe,
        scale: float,
        panel_distance_m: float,
        panel_width_m: float,
    ) -> _PartGroup:
        """Return points in a row, at half of `panel_distance_m` from the origin."""
        n = max(2, round(panel_width_m / _SPACING_M))
        along_m = (np.arange(n) + 0.5) / n * panel_width_m - panel_width_m / 2
        c, s = math.cos(facing_rad), math.sin(facing_rad)
        at_m = np.stack(
            [
                c * panel_distance_m / 2 - s * along_m,
                s * panel_distance_m / 2 + c * along_m,
                np.resize(_PANEL_LEVELS, n) * self.height_m,
            ],
            axis=-1,
        )
        return _scatterers_of_equal_rcs(at_m, scale * lobe.peak_m2, facing_rad, np.pi / 2, lobe)

    def _make_corner_scatterers(self) -> _PartGroup:
        x, y = np.array([1, 1, -1, -1]), np.array([1, -1, 1, -1])
        facing_rad = np.repeat(np.arctan2(y, x), len(_PANEL_LEVELS))
        at_m = np.stack(
            [
                np.repeat(x * self.length_m / 2, len(_PANEL_LEVELS)),
                np.repeat(y * self.width_m / 2, len(_PANEL_LEVELS)),
                np.tile(_PANEL_LEVELS, 4) * self.height_m,
            ],
            axis=-1,
        )
        # Visible from both adjacent sides.
        return _scatterers_of_equal_rcs(
            at_m,
            4 * _CORNER_SHARE * self._background_rcs_m2,
            facing_rad,
            3 * np.pi / 4,
            _ISOTROPIC_LOBE,
        )

    def _make_wheel_arch_scatterers(self) -> _PartGroup:
        """Return the edges before and behind each wheel."""
        hubs_m, facing_rad = self._hub_positions_and_side_azimuths(2)
        edges = np.array([1, 0, 0.5]) * self.wheel_radius_m
        signs = np.resize([[1, 1, 1], [-1, 1, 1]], hubs_m.shape)
        return _scatterers_of_equal_rcs(
            hubs_m + signs * edges,
            2 * _ARCH_SHARE * self._background_rcs_m2,
            facing_rad,
            np.pi / 2,
            _ISOTROPIC_LOBE,
        )

    def _make_rim_scatterers(self) -> _PartGroup:
        hubs_m, facing_rad = self._hub_positions_and_side_azimuths(_RIM_POINTS)
        return _scatterers_of_equal_rcs(
            hubs_m,
            2 * _WHEEL_SHARE * self._background_rcs_m2,
            facing_rad,
            np.pi / 2,
            _ISOTROPIC_LOBE,
        )

    def _hub_positions_and_side_azimuths(self, n_repeats: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the hubs of all wheels, repeated, (n, 3), and their side azimuths, (n,)."""
        x_m = (np.array(self.axle_fractions) - 0.5) * self.length_m
        sides = np.array([1.0, -1.0])
        x_m, sides = np.tile(x_m, 2), np.repeat(sides, len(x_m))
        hubs_m = np.stack(
            [x_m, sides * 0.45 * self.width_m, np.full(len(x_m), self.wheel_radius_m)], axis=-1
        )
        return np.repeat(hubs_m, n_repeats, axis=0), np.repeat(sides * np.pi / 2, n_repeats)

    @property
    def _background_rcs_m2(self) -> float:
        """Return the table's value between its lobes, scaled to the size of the vehicle."""
        around_m2 = (self.length_m + self.width_m) * self.height_m
        table_m2 = (_TABLE_LENGTH_M + _TABLE_WIDTH_M) * _TABLE_HEIGHT_M
        return _BACKGROUND_M2 * around_m2 / table_m2


# In traffic each frame has bodies of the same sizes at other speeds: 0.4 ms for each vehicle.
@lru_cache(maxsize=256)
def _scatterers_of_vehicle(kind: type[Vehicle], sizes: tuple[tuple[str, float], ...]) -> _PartGroup:
    """Return the scatterers of a vehicle at rest."""
    return kind(**dict(sizes), speed_m_per_s=0.0)._make_all_scatterers()


@frozen_dataclass
class Car(Vehicle):
    """Passenger car of some 80 scatterers: panels, corners, wheel arches, turning wheels.

    Its default size is that of the car of the table (3GPP TR 38.901); the origin is on the ground,
    below the centre. See `Vehicle` for the model.
    """

    length_m: float = 5.0
    width_m: float = 2.0
    height_m: float = 1.6
    wheel_radius_m: float = 0.32
    speed_m_per_s: float = 0.0

    @property
    def axle_fractions(self) -> tuple[float, ...]:
        return (0.23, 0.81)


@frozen_dataclass
class Van(Vehicle):
    """Delivery van of some 90 scatterers, with a car's cross section in proportion to areas.

    The origin is on the ground, below the centre. See `Vehicle` for the model.
    """

    length_m: float = 5.9
    width_m: float = 2.0
    height_m: float = 2.6
    wheel_radius_m: float = 0.34
    speed_m_per_s: float = 0.0

    @property
    def axle_fractions(self) -> tuple[float, ...]:
        return (0.21, 0.83)


@frozen_dataclass
class Truck(Vehicle):
    """Tractor with semitrailer: a box of some 200 scatterers on five axles.

    Its cross section is a car's in proportion to areas; its size is the limit of the European Union
    (directive 96/53/EC). The origin is on the ground, below the centre; it does not articulate. See
    `Vehicle` for the model.
    """

    length_m: float = 16.5
    width_m: float = 2.55
    height_m: float = 4.0
    wheel_radius_m: float = 0.52
    speed_m_per_s: float = 0.0

    @property
    def axle_fractions(self) -> tuple[float, ...]:
        return (0.15, 0.23, 0.31, 0.685, 0.915)


def _scatterers_of_equal_rcs(
    at_m: np.ndarray,
    total_rcs_m2: float,
    facing_rad: float | np.ndarray,
    visible_rad: float,
    lobe: _PanelLobe,
) -> _PartGroup:
    """Return parts that share a cross section evenly."""
    n = len(at_m)
    return _PartGroup(
        at_m,
        np.full(n, total_rcs_m2 / n),
        np.broadcast_to(facing_rad, n),
        np.full(n, visible_rad),
        np.tile(lobe[1:], (n, 1)),
    )
