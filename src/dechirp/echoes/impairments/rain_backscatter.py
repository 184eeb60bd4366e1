"""Echoes of rain: clutter from the whole volume of air that the antennas see."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import Vector, count, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.impairments.rain import check_rate
from dechirp.echoes.kernels.base import Scatterers
from dechirp.echoes.parts import Part, Window, gains, run_parts
from dechirp.echoes.weakened import must_be_within
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.scene.slow import slow_vector
from dechirp.theory.rain_echo import (
    DIAMETERS_M,
    fall_speed_m_per_s,
    reflectivity_per_m,
    reflectivity_per_m4,
)

# Directions in which gains are looked at, over azimuth and the sine of elevation: of the whole
# sphere, cells of a degree.
_N_CELLS = (360, 180)


@value
class RainBackscatter(Propagation):
    r"""Many drops in the air: speckle, weaker with the square of range, that falls and drifts.

    .. math:: P(r)\, dr = \frac{P_t \lambda^2 \eta}{(4\pi)^3 L r^2}
              \int G_t G_r \, d\Omega \; dr

    the radar equation for a volume; eta sums Mie's cross sections over Marshall and Palmer's
    drops. Scatterers, one in each step of range, stand for many drops: drawn anew in each frame
    towards where both antennas look, with exponential powers, so that the mean power at each
    range is exact. Each moves as drops do that send back much: with the wind, and falling.

    An antenna without a pattern sees 4 pi / G sr about boresight, what its gain can fill: up to
    180 deg / sqrt(G) to each side, and 1 / sqrt(G) for the sine of elevation. Drops are round:
    no depolarisation. `rain` after it in the list of impairments weakens its echoes too.
    """

    rate_m_per_s: float
    """Rain rate, as 25 mm/h; up to 200 mm/h."""
    wind_m_per_s: Vector = (0.0, 0.0, 0.0)
    """In the coordinates of the scene."""
    temperature_k: float = 283.15
    """Of the drops, in kelvin."""
    n_scatterers: int = 2000
    """How many stand for all drops in a frame; a few in each range bin look like more."""
    min_range_m: float = 1.0
    """Nearer drops are left out."""
    max_range_m: float | None = None
    """Drops beyond are left out; none: beyond what the samples can tell from nearer ones."""

    def __post_init__(self) -> None:
        check_rate("RainBackscatter.rate_m_per_s", self.rate_m_per_s)
        slow_vector(self, "wind_m_per_s")
        number("RainBackscatter.temperature_k", self.temperature_k, at_least=243, at_most=323)
        count(self, "n_scatterers", at_most=10_000_000)
        positive(self, "min_range_m", at_most=1e6)
        if self.max_range_m is not None:
            positive(self, "max_range_m", at_most=1e6)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where no rain is in view, or where the radar is below 1 GHz or above 1 THz."""
        must_be_within("rain-backscatter", radar, 1e9, 1e12)
        if not self._max_range_m(radar) > self.min_range_m:
            raise InvalidSetting(
                "max_range",
                got=f"{self._max_range_m(radar):g} m",
                need=f"beyond min_range, {self.min_range_m:g} m",
                fix="Move one of them.",
            )
        _view(radar.known_hardware())

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """With the drops of this frame."""
        if self.rate_m_per_s == 0:
            return list(parts)
        frame = radar.frame
        scatterers = self._scatterers(window.start_s + frame.mid_frame_s, scene, radar, rng)
        every = slice(0, frame.n_sent)
        return [*parts, *run_parts(every, scatterers, frame.mid_frame_s, radar)]

    def _scatterers(
        self, mid_s: float, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> Scatterers:
        n, frequency_hz = self.n_scatterers, radar.frame.chirp.mid_window_frequency_hz
        step_m = (self._max_range_m(radar) - self.min_range_m) / n
        range_m = self.min_range_m + step_m * (np.arange(n) + rng.random(n))
        directions, per_sr = _view(radar.known_hardware()).drawn(n, rng)
        position_m = range_m[:, None] * directions
        eta = reflectivity_per_m(frequency_hz, self.rate_m_per_s, temperature_k=self.temperature_k)
        rcs_m2 = eta * range_m**2 * step_m / per_sr * rng.exponential(size=n)
        velocity = np.array(self.wind_m_per_s) - self._fall(frequency_hz, rng)
        return Scatterers(
            _terms_m(position_m, velocity, scene.ego, mid_s),
            echo_amplitude(radar) * np.sqrt(rcs_m2),
            *gains(position_m, radar),
        )

    def _fall(self, frequency_hz: float, rng: np.random.Generator) -> np.ndarray:
        """Downward velocity of each scatterer, (n, 3), of drops drawn by what they send back."""
        shares = np.cumsum(
            reflectivity_per_m4(frequency_hz, self.rate_m_per_s, temperature_k=self.temperature_k)
        )
        places = np.searchsorted(shares, shares[-1] * rng.random(self.n_scatterers))
        return fall_speed_m_per_s(DIAMETERS_M)[places, None] * np.array([0.0, 0.0, 1.0])

    def _max_range_m(self, radar: Radar) -> float:
        return radar.frame.chirp.max_range_m if self.max_range_m is None else self.max_range_m


class _View(NamedTuple):
    """Where both antennas look, in cells over azimuth and the sine of elevation."""

    azimuth_rad: float
    """Half of the width of all cells together."""
    rise: float
    """Half of their height: the largest sine of elevation."""
    shares: np.ndarray
    """(n_cells,): of each cell and those before it, of the product of both gains; 1 at last."""

    def drawn(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors, (n, 3), and how densely they are drawn there, per sr."""
        cells = np.searchsorted(self.shares, rng.random(n), side="right")
        places = np.stack(np.unravel_index(cells, _N_CELLS)) + rng.random((2, n))
        azimuth_rad = self.azimuth_rad * (2 * places[0] / _N_CELLS[0] - 1)
        rise = self.rise * (2 * places[1] / _N_CELLS[1] - 1)
        level = np.sqrt(1 - rise**2)
        directions = np.stack(
            [level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), rise], axis=-1
        )
        # In azimuth and sine of elevation, equal areas are equal solid angles.
        cell_sr = 4 * self.azimuth_rad * self.rise / self.shares.size
        return directions, np.diff(self.shares, prepend=0.0)[cells] / cell_sr


@lru_cache
def _view(hardware: Hardware) -> _View:
    """Cells that both antennas see, drawn as often as the product of their gains says."""
    azimuth_rad, rise = math.pi, 1.0
    if hardware.tx_pattern is None or hardware.rx_pattern is None:
        width = min(1.0, 1 / math.sqrt(float(hardware.antenna_gain or 1.0)))
        azimuth_rad, rise = math.pi * width, width
    middles = [(2 * np.arange(n) + 1) / n - 1 for n in _N_CELLS]
    azimuths_rad = azimuth_rad * middles[0][:, None]
    elevations_rad = np.arcsin(rise * middles[1])
    both = hardware.tx_gain(azimuths_rad, elevations_rad)
    both = both * hardware.rx_gain(azimuths_rad, elevations_rad)
    shares = np.cumsum(both.ravel())
    if not (np.isfinite(shares[-1]) and shares[-1] > 0):
        raise InvalidSetting(
            "kind",
            got="rain-backscatter, for antennas that see no direction together",
            need="for a transmit and a receive pattern with gain towards the same directions",
            fix="Turn the beams towards each other, or leave it out.",
        )
    return _View(azimuth_rad, rise, shares / shares[-1])


def _terms_m(
    position_m: np.ndarray, velocity_m_per_s: np.ndarray, ego: Ego, mid_s: float
) -> np.ndarray:
    """Path seen from a radar that moves and turns, (2 or 3, n, 3): exact unless it turns.

    Then to the second order in time, since a linear path would recede tangentially.
    """
    time_s = np.array([mid_s])
    axes = ego.axes(time_s)[0]
    own = ego.velocities_m_per_s(time_s)[0]
    towards_m, seen = position_m @ axes.T, velocity_m_per_s - own
    if not ego.is_turning:
        return np.stack([position_m, seen @ axes])
    turn = np.array([0.0, 0.0, ego.turn_rate_rad_per_s])
    across = np.cross(turn, towards_m)
    second = np.cross(turn, across) - 2 * np.cross(turn, seen) - np.cross(turn, own)
    return np.stack([position_m, (seen - across) @ axes, second @ axes / 2])
