"""Fog weakens echoes."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import number
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.echoes.weakened import must_be_within, weakened
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.theory.attenuation import fog_db_per_km


@value
class Fog(Propagation):
    """Attenuation by the droplets of fog, far smaller than the wave (ITU-R P.840-8).

    1.6 dB/km at 77 GHz and 10 degrees in dense fog. It weakens what stands before it in the
    list of impairments.
    """

    water_kg_per_m3: float
    """Liquid water in the air, up to 10 g/m^3: 0.05 g/m^3 where one sees 300 m, 0.5 g/m^3 where
    one sees 50 m."""
    temperature_k: float = 283.15
    """Of the droplets, in kelvin; below 273 K they are supercooled."""

    def __post_init__(self) -> None:
        number("Fog.water_kg_per_m3", self.water_kg_per_m3, at_least=0, at_most=1e-2)
        number("Fog.temperature_k", self.temperature_k, at_least=243, at_most=323)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar below 1 GHz or above 200 GHz."""
        must_be_within("fog", radar, 1e9, 200e9)

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """Weaker by the loss over both ways."""
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        return weakened(
            parts,
            fog_db_per_km(frequency_hz, self.water_kg_per_m3, temperature_k=self.temperature_k),
        )
