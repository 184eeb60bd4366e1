"""Clear air: oxygen and water vapour weaken echoes."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import number
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.echoes.weakened import must_be_within, weakened
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.theory.attenuation import gas_db_per_km


@value
class Gas(Propagation):
    """Attenuation by the gases of the air, line by line (ITU-R P.676-12).

    0.35 dB/km at 77 GHz in standard air, 15 dB/km at 60 GHz. It weakens what stands before it
    in the list of impairments.
    """

    pressure_pa: float = 101_325.0
    """Of the dry air; 101325 Pa at sea level."""
    temperature_k: float = 288.15
    """Of the air, in kelvin."""
    vapour_kg_per_m3: float = 7.5e-3
    """Density of the water vapour."""

    def __post_init__(self) -> None:
        number("Gas.pressure_pa", self.pressure_pa, above=0, at_most=110e3)
        number("Gas.temperature_k", self.temperature_k, at_least=200, at_most=330)
        number("Gas.vapour_kg_per_m3", self.vapour_kg_per_m3, at_least=0, at_most=0.1)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar below 1 GHz or above 1 THz."""
        must_be_within("gas", radar, 1e9, 1e12)

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """Weaker by the loss over both ways."""
        loss = gas_db_per_km(
            radar.frame.chirp.mid_window_frequency_hz,
            pressure_pa=self.pressure_pa,
            temperature_k=self.temperature_k,
            vapour_kg_per_m3=self.vapour_kg_per_m3,
        )
        return weakened(parts, loss)
