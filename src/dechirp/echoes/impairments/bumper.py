"""A bumper or radome in front of the antennas reflects what they send."""

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.impairments.leakage import add_pairs
from dechirp.echoes.parts import Window, gains
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class Bumper(Propagation):
    r"""An echo of each pair of antennas off a flat plate across the x axis of the radar.

    Friis' equation over the whole way r, with the gains towards the images:

    .. math:: P_r = \rho\, P_t G_t G_r \left(\frac{\lambda}{4 \pi r}\right)^2 / L

    Of the same strength in all chirps, with the phase turned by half a circle. A bumper that
    absorbs weakens echoes as well: the loss of the hardware.

    References
    ----------
    A. Melzer, A. Onic, F. Starzer, M. Huemer, Short-range leakage cancelation in FMCW radar
    transceivers using an artificial on-chip target, IEEE J. Sel. Topics Signal Process. 9, 2015.
    """

    distance_m: float
    """From the origin of the radar's coordinates, along the x axis."""
    reflectivity: float
    """Power that it reflects, a ratio of at most 1 (0 dB)."""

    def __post_init__(self) -> None:
        positive(self, "distance_m", at_most=1e3)
        positive(self, "reflectivity", at_most=1.0)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless it is in front of all antennas."""
        farthest_m = max(x for x, _, _ in radar.array.tx_m + radar.array.rx_m)
        if self.distance_m < farthest_m + 1e-3:
            raise InvalidSetting(
                "distance",
                got=f"{self.distance_m:.6g} m, with an antenna at x = {farthest_m:.6g} m",
                need="1 mm in front of all antennas, at least",
                fix="Move the bumper forward.",
            )

    def added_delays_s(self, radar: Radar) -> tuple[float, float]:
        """Those of all pairs."""
        lengths_m = self._lengths_m(radar)
        return lengths_m.min() / SPEED_OF_LIGHT, lengths_m.max() / SPEED_OF_LIGHT

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Add the tones of all pairs."""
        tx_m, rx_m = np.array(radar.array.tx_m), np.array(radar.array.rx_m)
        tx_images_m, rx_images_m = self._images_m(tx_m), self._images_m(rx_m)
        lengths_m = self._lengths_m(radar)
        both = gains(rx_images_m, radar)[0] * gains(tx_images_m, radar)[1].T
        # Of an echo, less one way over an area: sqrt(P_t / L) lambda / 4 pi.
        one_way = echo_amplitude(radar) * np.sqrt(4 * np.pi)
        amplitudes = -np.sqrt(self.reflectivity) * one_way * both / lengths_m
        add_pairs(samples, window, radar, amplitudes, lengths_m)

    def _lengths_m(self, radar: Radar) -> np.ndarray:
        """(n_tx, n_rx)."""
        tx_images_m = self._images_m(np.array(radar.array.tx_m))
        return np.asarray(np.linalg.norm(tx_images_m[:, None] - radar.array.rx_m, axis=-1))

    def _images_m(self, antennas_m: np.ndarray) -> np.ndarray:
        return np.array([2 * self.distance_m, 0, 0]) + antennas_m * (-1, 1, 1)
