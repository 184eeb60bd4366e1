"""The array as directions see it: positions in wavelengths, a grid of directions over it."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import next_fast_len

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.turns import phasors
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.process.angle.lattice import Places, places
from dechirp.radar.radar import Radar
from dechirp.theory import direction_bounds

# Grid steps in a beam, 1 / length in sines. Eight: between two sources a beamwidth apart
# there are seven directions, and no lobe of a plain spectrum is met more than 0.06 dB below its
# top. On two axes four, 0.5 dB at worst, since their numbers multiply.
_STEPS = {1: 8, 2: 4}
# Arrays shorter than this get the grid of one so long: 64 steps from side to side.
_LEAST_LENGTH = 4.0
# Numbers in the steering vectors of a grid: 512 MiB.
_MOST_NUMBERS = 2**26
# Lengths across the line of sight, in wavelengths, from which an array tells a direction. On
# the second axis: a quarter of a turn from side to side of +-30 degrees.
_TELLS, _TELLS_BOTH = 0.01, 0.25
# Directions to the sides themselves have no slope to climb along: 0.08 degrees short of them.
_MOST_SINE = 1 - 1e-6


@value
class FieldOfView:
    """Directions that are searched: so far to each side of boresight."""

    azimuth_rad: float = np.pi / 2
    # 30 deg to the nearest float: pi / 6 is rounded down, and no number of degrees.
    elevation_rad: float = 0.5235987755982989

    def __post_init__(self) -> None:
        # Angles that came through degrees may lie a rounding error beyond.
        positive(self, "azimuth_rad", "elevation_rad", at_most=np.pi / 2 + 1e-9)

    @property
    def sines(self) -> tuple[float, float]:
        """Largest sines of azimuth and of elevation."""
        return (
            min(float(np.sin(self.azimuth_rad)), _MOST_SINE),
            min(float(np.sin(self.elevation_rad)), _MOST_SINE),
        )


_AHEAD = FieldOfView()


class Grid(NamedTuple):
    """Directions over a field of view, elevation by azimuth, finer than the beam."""

    azimuth_rad: np.ndarray
    """(n_azimuths,), ascending; even steps of its sine, boresight among them."""
    elevation_rad: np.ndarray
    """(n_elevations,), the same; (0,) alone where the array tells no elevation."""
    steering: np.ndarray
    """(n_elevations x n_azimuths, n_elements) complex64, azimuth running fastest."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of elevations and azimuths."""
        return len(self.elevation_rad), len(self.azimuth_rad)


@dataclass(frozen=True, eq=False)
class Aperture:
    """Virtual elements at one wavelength, and the directions that are searched with them.

    Raises `InvalidSetting` unless there are elements at two places across the line of sight:
    geometry that is not known, or one element, has no directions.
    """

    positions: np.ndarray
    """(n_elements, 3), in wavelengths at mid-window."""
    field_of_view: FieldOfView = _AHEAD

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=float)
        if positions.ndim != 2 or positions.shape[1] != 3 or not np.isfinite(positions).all():
            raise InvalidSetting(
                "Aperture.positions",
                got=f"an array {positions.shape}",
                need="a row of three finite numbers for each element",
                fix="Give x, y and z in wavelengths.",
            )
        positions.flags.writeable = False
        object.__setattr__(self, "positions", positions)
        if self._lengths[0] < _TELLS:
            raise InvalidSetting(
                "Radar.array",
                got=f"{len(positions)} virtual element{'s' * (len(positions) > 1)} within"
                f" {self._lengths[0]:.2g} wavelengths across the line of sight",
                need="elements at two places or more, along y or z: they tell directions",
                fix="Give where the antennas are in array.tx and array.rx, or set angle to null.",
            )

    @property
    def n_elements(self) -> int:
        """Virtual elements, those at one place included."""
        return len(self.positions)

    @cached_property
    def _lengths(self) -> tuple[float, float]:
        """Lengths along and across the longest direction in the y-z plane."""
        across = self.positions[:, 1:] - self.positions[:, 1:].mean(axis=0)
        axes = np.linalg.svd(across, full_matrices=True)[2]
        extent = np.ptp(across @ axes.T, axis=0)
        return float(extent[0]), float(extent[1])

    @cached_property
    def tells(self) -> tuple[bool, bool]:
        """Whether the array tells azimuth, and elevation.

        Elements on a line tell one angle: the elevation, at azimuth 0, where the line is
        steeper than 45 degrees, and else the azimuth, at elevation 0. So what a tilted line
        says of a target that is high and to the side is the angle, on one of these two arcs,
        of the cone on which the target lies.
        """
        if self._lengths[1] >= _TELLS_BOTH:
            return True, True
        _, wide, high = np.ptp(self.positions, axis=0)
        return bool(wide >= high), bool(wide < high)

    @cached_property
    def places(self) -> Places | None:
        """The even grid on which the elements lie, or None."""
        return places(self.positions)

    @cached_property
    def steps(self) -> tuple[float, float]:
        """Steps of the grid in the sines of azimuth and elevation; 0 where it tells none.

        Where the elements lie on an even grid they are bins of a transform over it.
        """
        per_beam = _STEPS[sum(self.tells)]
        lengths = np.maximum(np.ptp(self.positions, axis=0)[1:], _LEAST_LENGTH)
        apart = self.places.step if self.places else (1.0, 1.0)
        azimuth, elevation = (
            1 / (d * next_fast_len(int(np.ceil(per_beam * length / d)))) if told else 0.0
            for told, length, d in zip(self.tells, lengths, apart, strict=True)
        )
        return azimuth, elevation

    @cached_property
    def grid(self) -> Grid:
        """Directions that a spectrum is taken over, eight to a beam; four on each of two axes.

        Raises `InvalidSetting` where its steering vectors would take more than 512 MiB.
        """
        azimuth, elevation = (
            np.arcsin(_even(step, most))
            for step, most in zip(self.steps, self.field_of_view.sines, strict=True)
        )
        n_numbers = len(azimuth) * len(elevation) * self.n_elements
        if n_numbers > _MOST_NUMBERS:
            raise InvalidSetting(
                "Chain.field_of_view",
                got=f"{len(azimuth)} azimuths x {len(elevation)} elevations at"
                f" {self.n_elements} elements",
                need=f"at most {_MOST_NUMBERS:.3g} numbers, 512 MiB",
                fix="Narrow the azimuths or elevations that are searched.",
            )
        steering = self.steering(azimuth, elevation[:, None]).reshape(-1, self.n_elements)
        return Grid(azimuth, elevation, steering.astype(np.complex64))

    def steering(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
        r"""Response of the elements to far sources, (..., n_elements) complex128.

        .. math:: a_i = \exp(-2\pi\mathrm{i}\, \mathbf{u} \cdot \mathbf{p}_i), \quad
            \mathbf{u} = (\cos\theta\cos\phi, \cos\theta\sin\phi, \sin\theta)

        with p in wavelengths, phi the azimuth and theta the elevation. The beat signal is
        Tx x conj(Rx), so its phase falls where the way is shorter: minus.
        """
        towards = direction_bounds.towards(azimuth_rad, elevation_rad)
        return phasors(-(towards @ self.positions.T))

    def derivatives(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
        """Derivatives of `steering` by the angles that the array tells, (..., n_told, n_elements).

        Each per rad; azimuth before elevation.
        """
        slopes = direction_bounds.slopes(azimuth_rad, elevation_rad)[..., list(self.tells), :]
        steering = self.steering(azimuth_rad, elevation_rad)
        return np.asarray(-2j * np.pi * (slopes @ self.positions.T) * steering[..., None, :])


def aperture(radar: Radar, field_of_view: FieldOfView = _AHEAD) -> Aperture:
    """The virtual array of a radar, with the positions of its calibration where it has any.

    Raises
    ------
    InvalidSetting
        About `Radar.array`, where the elements do not lie at two places across the line of
        sight.
    """
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    positions = np.asarray(radar.elements_m / wavelength_m, dtype=float)
    return _kept(positions.tobytes(), field_of_view)


@lru_cache(maxsize=8)
def _kept(positions: bytes, field_of_view: FieldOfView) -> Aperture:
    return Aperture(np.frombuffer(positions).reshape(-1, 3), field_of_view)


def _even(step: float, most: float) -> np.ndarray:
    """Whole multiples of a step, from -most to most; 0 alone for a step of 0."""
    if step == 0:
        return np.zeros(1)
    n = int(most / step + 1e-9)
    return step * np.arange(-n, n + 1)
