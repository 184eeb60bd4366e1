"""Reflection of the transmitted wave by a bumper or radome in front of the antennas."""

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import unit_echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow, tx_and_rx_amplitude_gains
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.leakage import add_constant_path_signals


@frozen_dataclass
class Bumper(Propagation):
    r"""Echo of each antenna pair off a flat plate across the x axis of the radar.

    Friis' equation over the whole path r, with the gains towards the images:

    .. math:: P_r = \rho\, P_t G_t G_r \left(\frac{\lambda}{4 \pi r}\right)^2 / L

    It has the same strength in all chirps, and its phase is reversed. An absorbing bumper
    attenuates
    echoes as well: include that in the loss of the hardware.

    References
    ----------
    A. Melzer, A. Onic, F. Starzer, M. Huemer, Short-range leakage cancelation in FMCW radar
    transceivers using an artificial on-chip target, IEEE J. Sel. Topics Signal Process. 9, 2015.
    """

    distance_m: float
    """Distance from the origin of the radar's coordinates, along the x axis."""
    reflectivity: float
    """Fraction of the power that is reflected, at most 1 (0 dB)."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "distance_m", at_most=1e3)
        check_positive_fields(self, "reflectivity", at_most=1.0)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless the bumper is in front of all antennas."""
        farthest_m = max(x for x, _, _ in radar.array.tx_m + radar.array.rx_m)
        if self.distance_m < farthest_m + 1e-3:
            raise InvalidSetting(
                "distance",
                value=f"{self.distance_m:.6g} m, with an antenna at x = {farthest_m:.6g} m",
                expected="at least 1 mm in front of all antennas",
                fix="move the bumper forward",
            )

    def added_delay_bounds_s(self, radar: Radar) -> tuple[float, float]:
        lengths_m = self._path_lengths_m(radar)
        return lengths_m.min() / SPEED_OF_LIGHT, lengths_m.max() / SPEED_OF_LIGHT

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        tx_m, rx_m = np.array(radar.array.tx_m), np.array(radar.array.rx_m)
        tx_images_m, rx_images_m = self._image_positions_m(tx_m), self._image_positions_m(rx_m)
        lengths_m = self._path_lengths_m(radar)
        gain_products = (
            tx_and_rx_amplitude_gains(rx_images_m, radar)[0]
            * tx_and_rx_amplitude_gains(tx_images_m, radar)[1].T
        )
        # Amplitude of an echo without one path and the spreading area: sqrt(P_t / L) lambda / 4 pi.
        one_way_amplitude = unit_echo_amplitude(radar) * np.sqrt(4 * np.pi)
        amplitudes = -np.sqrt(self.reflectivity) * one_way_amplitude * gain_products / lengths_m
        add_constant_path_signals(samples, window, radar, amplitudes, lengths_m)

    def _path_lengths_m(self, radar: Radar) -> np.ndarray:
        """Return the path lengths of all antenna pairs, (n_tx, n_rx)."""
        tx_images_m = self._image_positions_m(np.array(radar.array.tx_m))
        return np.asarray(np.linalg.norm(tx_images_m[:, None] - radar.array.rx_m, axis=-1))

    def _image_positions_m(self, antennas_m: np.ndarray) -> np.ndarray:
        return np.array([2 * self.distance_m, 0, 0]) + antennas_m * (-1, 1, 1)
