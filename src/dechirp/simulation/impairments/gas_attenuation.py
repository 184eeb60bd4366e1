"""Attenuation of echoes by oxygen and water vapour in clear air."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.path_attenuation import attenuate_two_way, check_radar_frequency
from dechirp.theory.attenuation import gas_db_per_km


@frozen_dataclass
class GasAttenuation(Propagation):
    """Attenuation by atmospheric gases, line by line (ITU-R P.676-12).

    It is 0.35 dB/km at 77 GHz in standard air and 15 dB/km at 60 GHz, and applies to echoes of
    impairments earlier in the list.
    """

    pressure_pa: float = 101_325.0
    """Pressure of the dry air; 101325 Pa at sea level."""
    temperature_k: float = 288.15
    """Temperature of the air, in kelvin."""
    vapour_kg_per_m3: float = 7.5e-3
    """Density of the water vapour."""

    def __post_init__(self) -> None:
        check_number("GasAttenuation.pressure_pa", self.pressure_pa, above=0, at_most=110e3)
        check_number("GasAttenuation.temperature_k", self.temperature_k, at_least=200, at_most=330)
        check_number(
            "GasAttenuation.vapour_kg_per_m3", self.vapour_kg_per_m3, at_least=0, at_most=0.1
        )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar below 1 GHz or above 1 THz."""
        check_radar_frequency(self.kind(), radar, 1e9, 1e12)

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        loss = gas_db_per_km(
            radar.frame.chirp.mid_window_frequency_hz,
            pressure_pa=self.pressure_pa,
            temperature_k=self.temperature_k,
            vapour_kg_per_m3=self.vapour_kg_per_m3,
        )
        return attenuate_two_way(groups, loss)
