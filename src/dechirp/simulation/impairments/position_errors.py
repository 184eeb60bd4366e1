"""Errors of the antenna positions, unknown to the processing."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import (
    Vector,
    check_and_convert_vectors_field,
    check_integer_fields,
    check_number,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.mirror_images import infer_mirrors_from_image, up_vector_in_radar_axes


@frozen_dataclass
class PositionErrors(Propagation):
    """Displaced antennas, while the processing assumes the nominal positions of the radar.

    An error e changes the phase of an antenna by 2 pi u e / lambda towards the direction u: 0.1 mm
    across the beam are 4.6 degrees at 77 GHz and 30 degrees off boresight. Errors are the same in
    all
    frames. Images of antennas, in walls and in the road, are displaced as mirrored, whether this is
    listed before or after them. Patterns, leakage and the bumper use the nominal positions.
    """

    std_m: float = 0.0
    """Standard deviation of normal errors along each axis, independent for every antenna."""
    seed: int = 0
    """Seed of the normal errors: the same number, the same hardware."""
    tx_m: tuple[Vector, ...] | None = None
    """Errors of the transmitters, (n_tx, 3), added to the normal ones."""
    rx_m: tuple[Vector, ...] | None = None
    """Errors of the receivers, (n_rx, 3), added to the normal ones."""

    def __post_init__(self) -> None:
        # Far above tolerances of a board; a larger value indicates a wrong unit.
        check_number("PositionErrors.std_m", self.std_m, at_least=0.0, at_most=0.01)
        check_integer_fields(self, "seed", at_least=0, at_most=2**63 - 1)
        for name in ("tx_m", "rx_m"):
            if getattr(self, name) is not None:
                check_and_convert_vectors_field(self, name, max_magnitude=0.04)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless there is one error for each antenna."""
        for name, kind in (("tx", "transmitters"), ("rx", "receivers")):
            given_m = getattr(self, f"{name}_m")
            n_antennas = len(getattr(radar.array, f"{name}_m"))
            if given_m is not None and len(given_m) != n_antennas:
                raise InvalidSetting(
                    name,
                    value=f"{len(given_m)} errors for {n_antennas} {kind}",
                    expected=f"one (x, y, z) for each of radar.array.{name}",
                    fix="give zeros for antennas without an error",
                )

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Move the antennas of each transmission."""
        upwards = up_vector_in_radar_axes(scene)
        tx_m, rx_m = self.errors_m(radar)
        return [
            group._replace(
                transmission=group.transmission._replace(
                    tx_m=_displace_antennas(
                        group.transmission.tx_m, np.array(radar.array.tx_m), tx_m, upwards
                    ),
                    rx_m=_displace_antennas(
                        group.transmission.rx_m, np.array(radar.array.rx_m), rx_m, upwards
                    ),
                )
            )
            for group in groups
        ]

    def errors_m(self, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of the transmitters, (n_tx, 3), and of the receivers, (n_rx, 3)."""
        rng = np.random.default_rng(self.seed)
        tx_m, rx_m = (
            self.std_m * rng.standard_normal((len(nominal_m), 3))
            for nominal_m in (radar.array.tx_m, radar.array.rx_m)
        )
        if self.tx_m is not None:
            tx_m += np.array(self.tx_m)
        if self.rx_m is not None:
            rx_m += np.array(self.rx_m)
        return tx_m, rx_m


def _displace_antennas(
    current_m: np.ndarray, nominal_m: np.ndarray, errors_m: np.ndarray, upwards_vector: np.ndarray
) -> np.ndarray:
    """Add errors to antennas or to their images, mirrored for images."""
    for mirror in infer_mirrors_from_image(nominal_m[0], current_m[0], upwards_vector):
        errors_m = errors_m - 2 * (errors_m @ mirror.normal)[:, None] * mirror.normal
    return current_m + errors_m
