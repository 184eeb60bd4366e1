"""Mutual coupling between neighbouring antennas."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import Vector, as_tuple_or_none, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation

Matrix = tuple[tuple[tuple[float, float], ...], ...]


@frozen_dataclass
class MutualCoupling(Propagation):
    r"""Coupling matrices of receivers and transmitters: a steering vector a becomes C a.

    Given as a matrix, or by level and phase between nearest neighbours, from which it decreases
    with
    the distance d like a wave in free space,

    .. math:: C_{ij} = \sqrt{l} \, \frac{d_0}{d_{ij}} \,
        e^{i (\varphi + 2 \pi (d_{ij} - d_0) / \lambda)}, \quad C_{ii} = 1,

    with d_0 the smallest distance of the array. Phases are those of the dechirped samples: a longer
    path advances them. The receiver matrix applies to signals of impairments earlier in the list,
    leakage included, not to later ones. Coupled transmitters all send in each chirp, which
    multiplies
    the time of summation by their number.

    References
    ----------
    B. Friedlander, A. J. Weiss, Direction finding in the presence of mutual coupling, IEEE
    Trans. Antennas Propag. 39, 1991.
    """

    rx_level: float | None = None
    """Power of a neighbour's signal in a receiver over its own, a ratio below 1 (dB in files);
    none: no coupling of receivers, or by `rx_matrix`."""
    rx_phase_rad: float = 0.0
    """Phase of the neighbour's signal."""
    rx_matrix: Matrix | None = None
    """(n_rx, n_rx), rows of [real, imaginary], in place of a level."""
    tx_level: float | None = None
    """Power of a neighbour's signal in a transmitter, like `rx_level`."""
    tx_phase_rad: float = 0.0
    """Phase of the neighbour's signal."""
    tx_matrix: Matrix | None = None
    """(n_tx, n_tx), rows of [real, imaginary], in place of a level."""

    def __post_init__(self) -> None:
        for side in ("rx", "tx"):
            self._check_level_phase_and_matrix(side)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if a matrix does not fit the array, or antennas coincide."""
        self._coupling_matrix("rx", radar.array.rx_m, radar)
        self._coupling_matrix("tx", radar.array.tx_m, radar)

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Add the coupled transmitters to the weights of each transmission."""
        matrix = self._coupling_matrix("tx", radar.array.tx_m, radar)
        if matrix is None:
            return list(groups)
        return [
            group._replace(
                transmission=group.transmission._replace(
                    weights=group.transmission.weights @ matrix
                )
            )
            for group in groups
        ]

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Mix the signals of the receivers."""
        matrix = self._coupling_matrix("rx", radar.array.rx_m, radar)
        if matrix is None:
            return
        matrix = matrix.astype(samples.dtype)
        for chirp_samples in samples:  # without a second copy of all samples
            chirp_samples[:] = matrix @ chirp_samples

    def _coupling_matrix(
        self, side: str, antennas_m: tuple[Vector, ...], radar: Radar
    ) -> np.ndarray | None:
        """Return the matrix of the receivers or transmitters, (n, n) complex, or None."""
        n = len(antennas_m)
        listed: Matrix | None = getattr(self, f"{side}_matrix")
        if listed is not None:
            groups = np.array(listed)
            if len(listed) != n:
                raise InvalidSetting(
                    f"{side}_matrix",
                    value=f"{len(listed)} x {len(listed)}",
                    expected=f"{n} x {n}: radar.array.{side} has {n} antennas",
                    fix="give a row for each antenna",
                )
            return np.asarray(groups[..., 0] + 1j * groups[..., 1])
        level: float | None = getattr(self, f"{side}_level")
        if level is None or n == 1:
            return None
        positions_m = np.array(antennas_m)
        distances_m = np.linalg.norm(positions_m[:, None] - positions_m, axis=-1)
        np.fill_diagonal(distances_m, np.inf)
        nearest_m = distances_m.min()
        if nearest_m < 1e-6:
            raise InvalidSetting(
                f"{side}_level",
                value=f"a level, with coincident antennas in radar.array.{side}",
                expected="antennas at different positions",
                fix=f"give {side}_matrix, or move an antenna",
            )
        np.fill_diagonal(distances_m, nearest_m)
        extra_cycles = (
            (distances_m - nearest_m) * radar.frame.chirp.mid_window_frequency_hz / SPEED_OF_LIGHT
        )
        phases_rad = getattr(self, f"{side}_phase_rad") + 2 * np.pi * extra_cycles
        matrix = np.sqrt(level) * nearest_m / distances_m * np.exp(1j * phases_rad)
        np.fill_diagonal(matrix, 1.0)
        return np.asarray(matrix)

    def _check_level_phase_and_matrix(self, side: str) -> None:
        level, matrix = getattr(self, f"{side}_level"), getattr(self, f"{side}_matrix")
        if level is not None:
            check_number(f"MutualCoupling.{side}_level", level, above=0.0, at_most=1.0)
        check_number(
            f"MutualCoupling.{side}_phase_rad",
            getattr(self, f"{side}_phase_rad"),
            at_least=-2 * np.pi,
            at_most=2 * np.pi,
        )
        if matrix is None:
            return
        if level is not None:
            raise InvalidSetting(
                f"MutualCoupling.{side}_matrix",
                value=f"a matrix in addition to {side}_level",
                expected="only one of the two",
                fix="remove one of them",
            )
        object.__setattr__(
            self,
            f"{side}_matrix",
            _check_square_complex_matrix(f"MutualCoupling.{side}_matrix", matrix),
        )


def _check_square_complex_matrix(setting: str, matrix: object) -> Matrix:
    rows = [as_tuple_or_none(row) or () for row in as_tuple_or_none(matrix) or ()]
    pairs = [[as_tuple_or_none(pair) or () for pair in row] for row in rows]
    if not rows or any(len(row) != len(rows) for row in rows):
        raise InvalidSetting(
            setting,
            value=f"rows of {', '.join(str(len(row)) for row in rows) or 'nothing'}",
            expected="a square matrix",
            fix="give as many entries in each row as there are rows",
        )
    if any(len(pair) != 2 for row in pairs for pair in row):
        raise InvalidSetting(
            setting,
            value="a matrix with an entry that is not a pair",
            expected="entries [real, imaginary]",
            fix="write [1, 0] on the diagonal",
        )
    return tuple(
        tuple(
            (
                check_number(setting, real, at_least=-1e3, at_most=1e3),
                check_number(setting, imaginary, at_least=-1e3, at_most=1e3),
            )
            for real, imaginary in row
        )
        for row in pairs
    )
