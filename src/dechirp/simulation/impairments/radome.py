"""Loss of the radome, dry or wet."""

import math

import numpy as np

from dechirp.core.checks import check_number, check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.path_attenuation import check_radar_frequency
from dechirp.theory.water_permittivity import water_film_loss


@frozen_dataclass
class Radome(Propagation):
    r"""Loss of echoes on the outbound and inbound path, and of interference on the inbound path.

    .. math:: P = \frac{P_0}{L_{film}^2 L} \text{ (echoes)}, \quad
              \frac{P_0}{L_{film} \sqrt{L}} \text{ (interference)}

    with the one-way loss of the film from `theory.water_permittivity.film_loss`: 10 dB for 0.2 mm
    at
    77 GHz and 10 degrees. Echoes suffer both losses at any position in the list of impairments,
    including those of walls, ground and rain. Signals without scatterers suffer the inbound loss if
    they are listed before it: put leakage inside the radome after it.
    """

    film_m: float = 0.0
    """Thickness of the water film; 0: dry. Rain leaves 0.1 mm to 0.5 mm."""
    temperature_k: float = 283.15
    """Temperature of the water, in kelvin."""
    loss: float = 1.0
    """Two-way loss of the dry radome, a ratio of at least 1."""

    def __post_init__(self) -> None:
        check_number("Radome.film_m", self.film_m, at_least=0, at_most=0.01)
        check_number("Radome.temperature_k", self.temperature_k, at_least=243, at_most=323)
        check_positive_fields(self, "loss", at_least=1.0, at_most=1e12)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar above 1 THz."""
        check_radar_frequency(self.kind(), radar, 0.0, 1e12)

    def outbound_amplitude_gain(self, radar: Radar) -> float:
        return self._one_way_amplitude_gain(radar)

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Attenuate the signals of earlier impairments by the inbound loss."""
        samples *= self._one_way_amplitude_gain(radar)

    def _one_way_amplitude_gain(self, radar: Radar) -> float:
        """Return the amplitude gain of one path."""
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        film = water_film_loss(frequency_hz, self.film_m, self.temperature_k)
        return 1 / math.sqrt(film * math.sqrt(self.loss))
