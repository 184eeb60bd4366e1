"""The radome, dry or under a film of water: a loss for all that passes it."""

import math

import numpy as np

from dechirp.core.checks import number, positive
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Window
from dechirp.echoes.weakened import must_be_within
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.theory.water import film_loss


@value
class Radome(Propagation):
    r"""Weakens echoes on the way out and in, and what others send on the way in.

    .. math:: P = \frac{P_0}{L_{film}^2 L} \text{ (echoes)}, \quad
              \frac{P_0}{L_{film} \sqrt{L}} \text{ (interference)}

    with the loss of the film one way by `theory.water.film_loss`: 10 dB for 0.2 mm at 77 GHz and
    10 degrees. Echoes lose both wherever it stands in the list of impairments, those of walls,
    ground and rain too. Of what comes without scatterers, what stands before it loses the way
    in: put leakage within the radar after it.
    """

    film_m: float = 0.0
    """Thickness of the water on it; 0: dry. Rain leaves 0.1 mm to 0.5 mm."""
    temperature_k: float = 283.15
    """Of the water, in kelvin."""
    loss: float = 1.0
    """Of the dry radome, on the way out and in together, a ratio of at least 1."""

    def __post_init__(self) -> None:
        number("Radome.film_m", self.film_m, at_least=0, at_most=0.01)
        number("Radome.temperature_k", self.temperature_k, at_least=243, at_most=323)
        positive(self, "loss", at_least=1.0, at_most=1e12)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar above 1 THz."""
        must_be_within("radome", radar, 0.0, 1e12)

    def way_out(self, radar: Radar) -> float:
        """As much as on the way in."""
        return self._amplitude_factor(radar)

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Weaken what has come so far by the way in."""
        samples *= self._amplitude_factor(radar)

    def _amplitude_factor(self, radar: Radar) -> float:
        """Of one way."""
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        film = film_loss(frequency_hz, self.film_m, self.temperature_k)
        return 1 / math.sqrt(film * math.sqrt(self.loss))
