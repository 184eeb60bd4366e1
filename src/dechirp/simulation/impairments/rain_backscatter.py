"""Volume clutter: echoes of rain in the common beam of the antennas."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import Vector, check_integer_fields, check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import unit_echo_amplitude
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.scene.speed_limit import check_and_convert_velocity_field
from dechirp.simulation.echo_groups import (
    EchoGroup,
    SampleWindow,
    echo_groups_of_equal_ramps,
    tx_and_rx_amplitude_gains,
)
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.rain_attenuation import check_rain_rate
from dechirp.simulation.kernels.base import Scatterers
from dechirp.simulation.path_attenuation import check_radar_frequency
from dechirp.theory.rain_backscatter import (
    DIAMETERS_M,
    drop_fall_speed_m_per_s,
    rain_reflectivity_per_m,
    rain_reflectivity_per_m4,
)

# Grid of directions over azimuth and the sine of elevation: cells of a degree over the whole
# sphere.
_N_CELLS = (360, 180)


@frozen_dataclass
class RainBackscatter(Propagation):
    r"""Volume clutter of raindrops: speckle that falls and drifts, decreasing as 1 / range^2.

    .. math:: P(r)\, dr = \frac{P_t \lambda^2 \eta}{(4\pi)^3 L r^2}
              \int G_t G_r \, d\Omega \; dr

    is the radar equation for a volume; eta sums Mie's cross sections over the drop-size
    distribution of
    Marshall and Palmer. Scatterers, one in each step of range, each represent many drops. They are
    drawn anew in each frame, in directions of both beams and with exponential powers, so that the
    mean
    power at each range is exact. Each moves with the wind and falls at the speed of drops that
    contribute much to the reflectivity.

    An antenna without a pattern covers 4 pi / G sr about boresight, the solid angle of its gain: up
    to
    180 deg / sqrt(G) to each side, and 1 / sqrt(G) in the sine of elevation. Drops are round: no
    depolarisation. `rain-attenuation` later in the list attenuates its echoes too.
    """

    rate_m_per_s: float
    """Rain rate, for example 25 mm/h; up to 200 mm/h."""
    wind_m_per_s: Vector = (0.0, 0.0, 0.0)
    """Wind velocity in the coordinates of the scene."""
    temperature_k: float = 283.15
    """Temperature of the drops, in kelvin."""
    n_scatterers: int = 2000
    """Number of scatterers in a frame; a few in each range bin approximate many drops."""
    min_range_m: float = 1.0
    """Least range; nearer drops are omitted."""
    max_range_m: float | None = None
    """Largest range; none: the unambiguous range of the samples."""

    def __post_init__(self) -> None:
        check_rain_rate("RainBackscatter.rate_m_per_s", self.rate_m_per_s)
        check_and_convert_velocity_field(self, "wind_m_per_s")
        check_number("RainBackscatter.temperature_k", self.temperature_k, at_least=243, at_most=323)
        check_integer_fields(self, "n_scatterers", at_most=10_000_000)
        check_positive_fields(self, "min_range_m", at_most=1e6)
        if self.max_range_m is not None:
            check_positive_fields(self, "max_range_m", at_most=1e6)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if no rain is in view, or if the radar is below 1 GHz or above 1 THz."""
        check_radar_frequency(self.kind(), radar, 1e9, 1e12)
        if not self._configured_or_unambiguous_range_m(radar) > self.min_range_m:
            raise InvalidSetting(
                "max_range",
                value=f"{self._configured_or_unambiguous_range_m(radar):g} m",
                expected=f"beyond min_range, {self.min_range_m:g} m",
                fix="move one of them",
            )
        _find_common_beam(radar.require_hardware())

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Append the drops of this frame."""
        if self.rate_m_per_s == 0:
            return list(groups)
        frame = radar.frame
        scatterers = self._draw_rain_scatterers(
            window.frame_start_s + frame.mid_frame_s, scene, radar, rng
        )
        all_chirps = slice(0, frame.n_chirps_total)
        return [
            *groups,
            *echo_groups_of_equal_ramps(all_chirps, scatterers, frame.mid_frame_s, radar),
        ]

    def _draw_rain_scatterers(
        self, mid_s: float, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> Scatterers:
        n, frequency_hz = self.n_scatterers, radar.frame.chirp.mid_window_frequency_hz
        step_m = (self._configured_or_unambiguous_range_m(radar) - self.min_range_m) / n
        range_m = self.min_range_m + step_m * (np.arange(n) + rng.random(n))
        directions, per_sr = _find_common_beam(
            radar.require_hardware()
        ).draw_directions_and_densities(n, rng)
        position_m = range_m[:, None] * directions
        eta = rain_reflectivity_per_m(
            frequency_hz, self.rate_m_per_s, temperature_k=self.temperature_k
        )
        rcs_m2 = eta * range_m**2 * step_m / per_sr * rng.exponential(size=n)
        velocity = np.array(self.wind_m_per_s) - self._draw_fall_velocities(frequency_hz, rng)
        return Scatterers(
            _path_polynomials_in_radar_axes_m(position_m, velocity, scene.ego, mid_s),
            unit_echo_amplitude(radar) * np.sqrt(rcs_m2),
            *tx_and_rx_amplitude_gains(position_m, radar),
        )

    def _draw_fall_velocities(self, frequency_hz: float, rng: np.random.Generator) -> np.ndarray:
        """Draw the downward velocity of each scatterer, (n, 3), weighted by reflectivity."""
        shares = np.cumsum(
            rain_reflectivity_per_m4(
                frequency_hz, self.rate_m_per_s, temperature_k=self.temperature_k
            )
        )
        grid_positions = np.searchsorted(shares, shares[-1] * rng.random(self.n_scatterers))
        return drop_fall_speed_m_per_s(DIAMETERS_M)[grid_positions, None] * np.array(
            [0.0, 0.0, 1.0]
        )

    def _configured_or_unambiguous_range_m(self, radar: Radar) -> float:
        return radar.frame.chirp.max_range_m if self.max_range_m is None else self.max_range_m


class _CommonBeam(NamedTuple):
    """Directions of both beams, as cells over azimuth and the sine of elevation."""

    half_azimuth_rad: float
    """Half of the width of all cells together."""
    max_sine_elevation: float
    """Half of their height, the largest sine of elevation."""
    cumulative_shares: np.ndarray
    """(n_cells,): cumulative share of the product of both gains; 1 at the end."""

    def draw_directions_and_densities(
        self, n: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw unit vectors, (n, 3), and return their density as well, per sr."""
        cells = np.searchsorted(self.cumulative_shares, rng.random(n), side="right")
        grid_positions = np.stack(np.unravel_index(cells, _N_CELLS)) + rng.random((2, n))
        azimuth_rad = self.half_azimuth_rad * (2 * grid_positions[0] / _N_CELLS[0] - 1)
        rise = self.max_sine_elevation * (2 * grid_positions[1] / _N_CELLS[1] - 1)
        level = np.sqrt(1 - rise**2)
        directions = np.stack(
            [level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), rise], axis=-1
        )
        # Equal areas in azimuth and sine of elevation are equal solid angles.
        cell_sr = 4 * self.half_azimuth_rad * self.max_sine_elevation / self.cumulative_shares.size
        return directions, np.diff(self.cumulative_shares, prepend=0.0)[cells] / cell_sr


@lru_cache
def _find_common_beam(hardware: Hardware) -> _CommonBeam:
    """Return the cells that both antennas cover, weighted by the product of their gains."""
    azimuth_rad, rise = math.pi, 1.0
    if hardware.tx_pattern is None or hardware.rx_pattern is None:
        width = min(1.0, 1 / math.sqrt(float(hardware.antenna_gain or 1.0)))
        azimuth_rad, rise = math.pi * width, width
    middles = [(2 * np.arange(n) + 1) / n - 1 for n in _N_CELLS]
    azimuths_rad = azimuth_rad * middles[0][:, None]
    elevations_rad = np.arcsin(rise * middles[1])
    gain_products = hardware.tx_gain(azimuths_rad, elevations_rad)
    gain_products = gain_products * hardware.rx_gain(azimuths_rad, elevations_rad)
    shares = np.cumsum(gain_products.ravel())
    if not (np.isfinite(shares[-1]) and shares[-1] > 0):
        raise InvalidSetting(
            "kind",
            value="rain-backscatter, with antennas whose beams do not overlap",
            expected="transmit and receive patterns with gain towards the same directions",
            fix="turn the beams towards each other, or remove the impairment",
        )
    return _CommonBeam(azimuth_rad, rise, shares / shares[-1])


def _path_polynomials_in_radar_axes_m(
    position_m: np.ndarray, velocity_m_per_s: np.ndarray, ego: Ego, mid_s: float
) -> np.ndarray:
    """Return polynomial paths in the coordinates of the moving radar, (2 or 3, n, 3).

    They are exact unless the radar turns. Then they are of second order in time, since a linear
    path
    would recede tangentially.
    """
    time_s = np.array([mid_s])
    axes = ego.axes(time_s)[0]
    ego_velocity = ego.velocities_m_per_s(time_s)[0]
    scene_offsets_m, relative_velocity = position_m @ axes.T, velocity_m_per_s - ego_velocity
    if not ego.is_turning:
        return np.stack([position_m, relative_velocity @ axes])
    turn_rates = np.array([0.0, 0.0, ego.turn_rate_rad_per_s])
    tangential = np.cross(turn_rates, scene_offsets_m)
    acceleration = (
        np.cross(turn_rates, tangential)
        - 2 * np.cross(turn_rates, relative_velocity)
        - np.cross(turn_rates, ego_velocity)
    )
    return np.stack([position_m, (relative_velocity - tangential) @ axes, acceleration @ axes / 2])
