"""Mutual coupling: antennas hear, and send, what belongs to their neighbours."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import Vector, listed, number
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

Matrix = tuple[tuple[tuple[float, float], ...], ...]


@value
class Coupling(Propagation):
    r"""A matrix for the receivers and one for the transmitters: steering vectors a become C a.

    Given whole, or by a level and a phase between nearest neighbours, from which it falls with
    the distance d as a wave in free space does,

    .. math:: C_{ij} = \sqrt{l} \, \frac{d_0}{d_{ij}} \,
        e^{i (\varphi + 2 \pi (d_{ij} - d_0) / \lambda)}, \quad C_{ii} = 1,

    d_0 the smallest distance of the array. Phases are of the dechirped samples: a longer way
    turns them forward. Receivers are mixed with what was added before this in the list, leakage
    included; the echoes of later ones are not. Coupled transmitters all send in each chirp:
    echoes take as many times longer to sum.

    References
    ----------
    B. Friedlander, A. J. Weiss, Direction finding in the presence of mutual coupling, IEEE
    Trans. Antennas Propag. 39, 1991.
    """

    rx_level: float | None = None
    """Power of a neighbour's signal in a receiver over its own, a ratio below 1 (dB in files);
    none: receivers are not coupled, or by `rx_matrix`."""
    rx_phase_rad: float = 0.0
    """Of the neighbour's signal."""
    rx_matrix: Matrix | None = None
    """(n_rx, n_rx), rows of [real, imaginary], instead of a level."""
    tx_level: float | None = None
    """As `rx_level`, of transmitters."""
    tx_phase_rad: float = 0.0
    """Of the neighbour's signal."""
    tx_matrix: Matrix | None = None
    """(n_tx, n_tx), rows of [real, imaginary], instead of a level."""

    def __post_init__(self) -> None:
        for which in ("rx", "tx"):
            self._check(which)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where a matrix has not the size of the array, or antennas are at one place."""
        self._coupled("rx", radar.array.rx_m, radar)
        self._coupled("tx", radar.array.tx_m, radar)

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """The same parts, sent by all transmitters that are coupled to the one meant."""
        matrix = self._coupled("tx", radar.array.tx_m, radar)
        if matrix is None:
            return list(parts)
        return [
            part._replace(sent=part.sent._replace(weights=part.sent.weights @ matrix))
            for part in parts
        ]

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Mix the receivers."""
        matrix = self._coupled("rx", radar.array.rx_m, radar)
        if matrix is None:
            return
        matrix = matrix.astype(samples.dtype)
        for of_chirp in samples:  # no second copy of all
            of_chirp[:] = matrix @ of_chirp

    def _coupled(
        self, which: str, antennas_m: tuple[Vector, ...], radar: Radar
    ) -> np.ndarray | None:
        """Matrix of the receivers or transmitters, (n, n) complex, or none."""
        n = len(antennas_m)
        given: Matrix | None = getattr(self, f"{which}_matrix")
        if given is not None:
            parts = np.array(given)
            if len(given) != n:
                raise InvalidSetting(
                    f"{which}_matrix",
                    got=f"{len(given)} x {len(given)}",
                    need=f"{n} x {n}: radar.array.{which} has {n} antennas",
                    fix="Give a row for each antenna.",
                )
            return np.asarray(parts[..., 0] + 1j * parts[..., 1])
        level: float | None = getattr(self, f"{which}_level")
        if level is None or n == 1:
            return None
        at_m = np.array(antennas_m)
        apart_m = np.linalg.norm(at_m[:, None] - at_m, axis=-1)
        np.fill_diagonal(apart_m, np.inf)
        nearest_m = apart_m.min()
        if nearest_m < 1e-6:
            raise InvalidSetting(
                f"{which}_level",
                got=f"given, and two antennas of radar.array.{which} are at one place",
                need="given for antennas that are apart",
                fix=f"Give {which}_matrix, or move an antenna.",
            )
        np.fill_diagonal(apart_m, nearest_m)
        turns = (apart_m - nearest_m) * radar.frame.chirp.mid_window_frequency_hz / SPEED_OF_LIGHT
        phases_rad = getattr(self, f"{which}_phase_rad") + 2 * np.pi * turns
        matrix = np.sqrt(level) * nearest_m / apart_m * np.exp(1j * phases_rad)
        np.fill_diagonal(matrix, 1.0)
        return np.asarray(matrix)

    def _check(self, which: str) -> None:
        level, matrix = getattr(self, f"{which}_level"), getattr(self, f"{which}_matrix")
        if level is not None:
            number(f"Coupling.{which}_level", level, above=0.0, at_most=1.0)
        number(
            f"Coupling.{which}_phase_rad",
            getattr(self, f"{which}_phase_rad"),
            at_least=-2 * np.pi,
            at_most=2 * np.pi,
        )
        if matrix is None:
            return
        if level is not None:
            raise InvalidSetting(
                f"Coupling.{which}_matrix",
                got=f"given beside {which}_level",
                need="the only one of the two",
                fix="Take one of them out.",
            )
        object.__setattr__(self, f"{which}_matrix", _square(f"Coupling.{which}_matrix", matrix))


def _square(where: str, given: object) -> Matrix:
    rows = [listed(row) or () for row in listed(given) or ()]
    pairs = [[listed(pair) or () for pair in row] for row in rows]
    if not rows or any(len(row) != len(rows) for row in rows):
        raise InvalidSetting(
            where,
            got=f"rows of {', '.join(str(len(row)) for row in rows) or 'nothing'}",
            need="a square matrix",
            fix="Give as many entries in each row as there are rows.",
        )
    if any(len(pair) != 2 for row in pairs for pair in row):
        raise InvalidSetting(
            where,
            got="with an entry that is not a pair",
            need="of entries [real, imaginary]",
            fix="Write [1, 0] on the diagonal.",
        )
    return tuple(
        tuple(
            (
                number(where, real, at_least=-1e3, at_most=1e3),
                number(where, imaginary, at_least=-1e3, at_most=1e3),
            )
            for real, imaginary in row
        )
        for row in pairs
    )
