"""Antennas that are not where the radar says."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import Vector, count, number, vectors
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.images import mirrors_between, up
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class PositionErrors(Propagation):
    """Echoes are those of antennas out of place, while processing believes the radar.

    An error e turns the phase of an antenna by 2 pi u e / lambda towards the direction u: 0.1 mm
    across the beam are 4.6 degrees at 77 GHz and 30 degrees aside. Errors are the same in all
    frames. Images of antennas, in walls and in the road, are out of place as mirrored, whether
    this is listed before or after them. Patterns, leakage and the bumper keep to the radar.
    """

    std_m: float = 0.0
    """Standard deviation of normal errors along each axis, of every antenna by itself."""
    seed: int = 0
    """Of the normal errors: the same number, the same hardware."""
    tx_m: tuple[Vector, ...] | None = None
    """Errors of the transmitters, (n_tx, 3), beside the normal ones."""
    rx_m: tuple[Vector, ...] | None = None
    """Errors of the receivers, (n_rx, 3), beside the normal ones."""

    def __post_init__(self) -> None:
        # Far beyond what is out of place on a board: outside, a unit is wrong.
        number("PositionErrors.std_m", self.std_m, at_least=0.0, at_most=0.01)
        count(self, "seed", at_least=0, at_most=2**63 - 1)
        for name in ("tx_m", "rx_m"):
            if getattr(self, name) is not None:
                vectors(self, name, at_most=0.04)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where there is not an error for each antenna."""
        for name, kind in (("tx", "transmitters"), ("rx", "receivers")):
            given_m = getattr(self, f"{name}_m")
            n_antennas = len(getattr(radar.array, f"{name}_m"))
            if given_m is not None and len(given_m) != n_antennas:
                raise InvalidSetting(
                    name,
                    got=f"{len(given_m)} errors for {n_antennas} {kind}",
                    need=f"one (x, y, z) for each of radar.array.{name}",
                    fix="Give zeros for those in their place.",
                )

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """The same parts, from and to where the antennas are."""
        upwards = up(scene)
        tx_m, rx_m = self.errors_m(radar)
        return [
            part._replace(
                sent=part.sent._replace(
                    tx_m=_moved(part.sent.tx_m, np.array(radar.array.tx_m), tx_m, upwards),
                    rx_m=_moved(part.sent.rx_m, np.array(radar.array.rx_m), rx_m, upwards),
                )
            )
            for part in parts
        ]

    def errors_m(self, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the transmitters, (n_tx, 3), and of the receivers, (n_rx, 3)."""
        rng = np.random.default_rng(self.seed)
        tx_m, rx_m = (
            self.std_m * rng.standard_normal((len(own_m), 3))
            for own_m in (radar.array.tx_m, radar.array.rx_m)
        )
        if self.tx_m is not None:
            tx_m += np.array(self.tx_m)
        if self.rx_m is not None:
            rx_m += np.array(self.rx_m)
        return tx_m, rx_m


def _moved(
    now_m: np.ndarray, own_m: np.ndarray, errors_m: np.ndarray, up: np.ndarray
) -> np.ndarray:
    """Antennas, or their images, with errors as these mirror them."""
    for mirror in mirrors_between(own_m[0], now_m[0], up):
        errors_m = errors_m - 2 * (errors_m @ mirror.normal)[:, None] * mirror.normal
    return now_m + errors_m
