"""Attenuation of echoes by fog."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.path_attenuation import attenuate_two_way, check_radar_frequency
from dechirp.theory.attenuation import fog_db_per_km


@frozen_dataclass
class FogAttenuation(Propagation):
    """Attenuation by fog droplets that are far smaller than the wavelength (ITU-R P.840-8).

    It is 1.6 dB/km at 77 GHz and 10 degrees in dense fog, and applies to echoes of impairments
    earlier in the list.
    """

    water_kg_per_m3: float
    """Liquid water content of the air, up to 10 g/m^3: 0.05 g/m^3 at a visibility of 300 m, 0.5
    g/m^3 at 50 m."""
    temperature_k: float = 283.15
    """Temperature of the droplets, in kelvin; below 273 K they are supercooled."""

    def __post_init__(self) -> None:
        check_number(
            "FogAttenuation.water_kg_per_m3", self.water_kg_per_m3, at_least=0, at_most=1e-2
        )
        check_number("FogAttenuation.temperature_k", self.temperature_k, at_least=243, at_most=323)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar below 1 GHz or above 200 GHz."""
        check_radar_frequency(self.kind(), radar, 1e9, 200e9)

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        return attenuate_two_way(
            groups,
            fog_db_per_km(frequency_hz, self.water_kg_per_m3, temperature_k=self.temperature_k),
        )
