"""Virtual array in wavelengths, its steering vectors, and a grid of directions."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.phasors import phasors
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.element_grid import ElementGrid, find_element_grid
from dechirp.radar.radar import Radar
from dechirp.theory import direction_bounds

# Grid steps in a beam, 1 / length in sines. Eight: seven directions between two sources a beamwidth
# apart, and a grid loss of at most 0.06 dB at the top of a lobe. Four on each of two axes, 0.5 dB
# at worst, since their numbers multiply.
_STEPS_PER_BEAM = {1: 8, 2: 4}
# Shorter arrays get the grid of an array of this length: 64 steps from side to side.
_MIN_GRID_EXTENT = 4.0
# Values of the steering vectors of a grid: 512 MiB.
_MAX_STEERING_VALUES = 2**26
# Smallest extents across the line of sight, in wavelengths, that resolve a direction. The second
# axis needs a phase change of a quarter of a cycle over +-30 degrees.
MIN_EXTENT, _MIN_SECOND_EXTENT = 0.01, 0.25
# At +-90 degrees the spectrum has zero slope: the limit is 0.08 degrees short of it.
_MAX_SINE = 1 - 1e-6


@frozen_dataclass
class FieldOfView:
    """Directions that are searched, as limits to each side of boresight."""

    azimuth_rad: float = np.pi / 2
    # 30 deg to the nearest float: pi / 6 is rounded down, and no number of degrees.
    elevation_rad: float = 0.5235987755982989

    def __post_init__(self) -> None:
        # Angles converted from degrees may exceed the limit by a rounding error.
        check_positive_fields(self, "azimuth_rad", "elevation_rad", at_most=np.pi / 2 + 1e-9)

    @property
    def max_angle_sines(self) -> tuple[float, float]:
        """Largest sines of azimuth and of elevation."""
        return (
            min(float(np.sin(self.azimuth_rad)), _MAX_SINE),
            min(float(np.sin(self.elevation_rad)), _MAX_SINE),
        )


_DEFAULT_FIELD_OF_VIEW = FieldOfView()


class DirectionGrid(NamedTuple):
    """Directions over a field of view, elevation by azimuth, finer than the beam."""

    azimuth_rad: np.ndarray
    """Azimuths (n_azimuths,), ascending in even steps of the sine, boresight included."""
    elevation_rad: np.ndarray
    """Elevations (n_elevations,), likewise; (0,) where the array resolves no elevation."""
    steering: np.ndarray
    """Steering vectors (n_elevations x n_azimuths, n_elements) complex64, azimuth fastest."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of elevations and azimuths."""
        return len(self.elevation_rad), len(self.azimuth_rad)


@dataclass(frozen=True, eq=False)
class Aperture:
    """Virtual elements at one wavelength, and the field of view to search.

    Raises `InvalidSetting` unless there are elements at two positions across the line of sight:
    an unknown geometry, or a single element, has no directions.
    """

    positions: np.ndarray
    """Element positions (n_elements, 3), in wavelengths at mid-window."""
    field_of_view: FieldOfView = _DEFAULT_FIELD_OF_VIEW
    n_transmitters: int = 1
    """Number of transmitters whose elements the array consists of, receivers fastest; 1 if all
    elements have the same transmitter."""

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=float)
        if positions.ndim != 2 or positions.shape[1] != 3 or not np.isfinite(positions).all():
            raise InvalidSetting(
                "Aperture.positions",
                value=f"an array {positions.shape}",
                expected="a row of three finite numbers for each element",
                fix="give x, y and z in wavelengths",
            )
        if self.n_transmitters < 1 or len(positions) % self.n_transmitters:
            raise InvalidSetting(
                "Aperture.n_transmitters",
                value=self.n_transmitters,
                expected=f"a divisor of {len(positions)}, the number of elements",
                fix="give the number of transmitters, or leave it out",
            )
        positions.flags.writeable = False
        object.__setattr__(self, "positions", positions)
        if self._longest_and_perpendicular_extents[0] < MIN_EXTENT:
            raise InvalidSetting(
                "Radar.array",
                value=f"{len(positions)} virtual element{'s' * (len(positions) > 1)} within"
                f" {self._longest_and_perpendicular_extents[0]:.2g} wavelengths across the line of"
                " sight",
                expected="elements at two or more positions along y or z, which determine"
                " directions",
                fix="give the antenna positions in array.tx and array.rx, or set angle to null",
            )

    @property
    def n_elements(self) -> int:
        """Number of virtual elements, coincident ones included."""
        return len(self.positions)

    @cached_property
    def _longest_and_perpendicular_extents(self) -> tuple[float, float]:
        """Extents along and across the longest direction in the y-z plane."""
        across = self.positions[:, 1:] - self.positions[:, 1:].mean(axis=0)
        axes = np.linalg.svd(across, full_matrices=True)[2]
        extent = np.ptp(across @ axes.T, axis=0)
        return float(extent[0]), float(extent[1])

    @cached_property
    def resolves_azimuth_and_elevation(self) -> tuple[bool, bool]:
        """Pair of flags: True if the array resolves azimuth, and elevation.

        Elements on a line resolve one angle: the elevation, at azimuth 0, where the line is
        steeper than 45 degrees, and else the azimuth, at elevation 0. A tilted line therefore
        maps a target that is high and to the side to the angle, on one of these two arcs, of the
        cone on which the target lies.
        """
        if self._longest_and_perpendicular_extents[1] >= _MIN_SECOND_EXTENT:
            return True, True
        _, width, height = np.ptp(self.positions, axis=0)
        return bool(width >= height), bool(width < height)

    @cached_property
    def antenna_indicators(self) -> np.ndarray:
        """Return 1 for each transmitter and receiver of an element, (n_elements, n_tx + n_rx).

        Receivers alone where the elements share a transmitter, whose phase is common to all.
        """
        n_rx = self.n_elements // self.n_transmitters
        receivers = np.tile(np.eye(n_rx), (self.n_transmitters, 1))
        if self.n_transmitters == 1:
            return receivers
        return np.hstack([np.repeat(np.eye(self.n_transmitters), n_rx, axis=0), receivers])

    @cached_property
    def element_grid(self) -> ElementGrid | None:
        """Even grid on which the elements lie, or None."""
        return find_element_grid(self.positions)

    @cached_property
    def direction_grid_sine_steps(self) -> tuple[float, float]:
        """Steps of the grid in the sines of azimuth and elevation; 0 for an unresolved angle.

        Where the elements lie on an even grid, the steps are bins of a transform over it.
        """
        per_beam = _STEPS_PER_BEAM[sum(self.resolves_azimuth_and_elevation)]
        lengths = np.maximum(np.ptp(self.positions, axis=0)[1:], _MIN_GRID_EXTENT)
        spacings = self.element_grid.spacing if self.element_grid else (1.0, 1.0)
        azimuth, elevation = (
            1 / (spacing * scipy.fft.next_fast_len(int(np.ceil(per_beam * length / spacing))))
            if is_resolved
            else 0.0
            for is_resolved, length, spacing in zip(
                self.resolves_azimuth_and_elevation, lengths, spacings, strict=True
            )
        )
        return azimuth, elevation

    @cached_property
    def direction_grid(self) -> DirectionGrid:
        """Directions at which a spectrum is computed, eight to a beam; four on each of two axes.

        Raises `InvalidSetting` where its steering vectors would take more than 512 MiB.
        """
        azimuth, elevation = (
            np.arcsin(_symmetric_multiples(step, max_sine))
            for step, max_sine in zip(
                self.direction_grid_sine_steps, self.field_of_view.max_angle_sines, strict=True
            )
        )
        n_numbers = len(azimuth) * len(elevation) * self.n_elements
        if n_numbers > _MAX_STEERING_VALUES:
            raise InvalidSetting(
                "Chain.field_of_view",
                value=f"{len(azimuth)} azimuths x {len(elevation)} elevations at"
                f" {self.n_elements} elements",
                expected=f"at most {_MAX_STEERING_VALUES:.3g} numbers, 512 MiB",
                fix="narrow the field of view",
            )
        steering = self.steering_vectors(azimuth, elevation[:, None]).reshape(-1, self.n_elements)
        return DirectionGrid(azimuth, elevation, steering.astype(np.complex64))

    def steering_vectors(
        self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0
    ) -> np.ndarray:
        r"""Return the response of the elements to far sources, (..., n_elements) complex128.

        .. math:: a_i = \exp(-2\pi\mathrm{i}\, \mathbf{u} \cdot \mathbf{p}_i), \quad
            \mathbf{u} = (\cos\theta\cos\phi, \cos\theta\sin\phi, \sin\theta)

        with p in wavelengths, phi the azimuth and theta the elevation. The beat signal is
        Tx x conj(Rx), whose phase decreases with a shorter path, hence the minus.
        """
        unit_vectors = direction_bounds.unit_vectors(azimuth_rad, elevation_rad)
        return phasors(-(unit_vectors @ self.positions.T))

    def steering_derivatives(
        self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0
    ) -> np.ndarray:
        """Return steering vector derivatives by the resolved angles, (..., n_angles, n_elements).

        Each per rad; azimuth before elevation.
        """
        slopes = direction_bounds.unit_vector_derivatives(azimuth_rad, elevation_rad)[
            ..., list(self.resolves_azimuth_and_elevation), :
        ]
        steering = self.steering_vectors(azimuth_rad, elevation_rad)
        return np.asarray(-2j * np.pi * (slopes @ self.positions.T) * steering[..., None, :])


def radar_aperture(radar: Radar, field_of_view: FieldOfView = _DEFAULT_FIELD_OF_VIEW) -> Aperture:
    """Return the aperture of a radar, with the calibrated positions if there are any.

    Raises
    ------
    InvalidSetting
        About `Radar.array`, if the elements do not lie at two positions across the line of sight.
    """
    wavelength_m = SPEED_OF_LIGHT / radar.frame.chirp.mean_sampled_frequency_hz
    positions = np.asarray(radar.element_positions_m / wavelength_m, dtype=float)
    n_transmitters = 1 if radar.frame.multiplexing is None else len(radar.array.tx_m)
    return _aperture_from_position_bytes(positions.tobytes(), field_of_view, n_transmitters)


@lru_cache(maxsize=8)
def _aperture_from_position_bytes(
    positions: bytes, field_of_view: FieldOfView, n_transmitters: int
) -> Aperture:
    return Aperture(np.frombuffer(positions).reshape(-1, 3), field_of_view, n_transmitters)


def _symmetric_multiples(step: float, limit: float) -> np.ndarray:
    """Return multiples of a step from -limit to limit; 0 alone for a step of 0."""
    if step == 0:
        return np.zeros(1)
    n = int(limit / step + 1e-9)
    return step * np.arange(-n, n + 1)
