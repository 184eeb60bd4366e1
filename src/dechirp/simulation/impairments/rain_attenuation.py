"""Attenuation of echoes by rain; `rain_backscatter` adds the echoes of the drops."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.path_attenuation import attenuate_two_way, check_radar_frequency
from dechirp.theory.attenuation import MAX_RAIN_RATE_M_PER_S, rain_db_per_km


@frozen_dataclass
class RainAttenuation(Propagation):
    """Attenuation by rain, a power law of the rain rate (ITU-R P.838-3).

    It is 11 dB/km at 77 GHz in 25 mm/h, 4.6 dB for an echo from 200 m, and applies to echoes of
    impairments earlier in the list.
    """

    rate_m_per_s: float
    """Rain rate, for example 25 mm/h; up to 200 mm/h."""
    tilt_rad: float = 0.0
    """Tilt of the polarisation from horizontal: 90 deg vertical, 45 deg slanted or circular."""

    def __post_init__(self) -> None:
        check_rain_rate("RainAttenuation.rate_m_per_s", self.rate_m_per_s)
        check_number("RainAttenuation.tilt_rad", self.tilt_rad, at_least=-np.pi, at_most=np.pi)

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
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        return attenuate_two_way(
            groups, rain_db_per_km(frequency_hz, self.rate_m_per_s, tilt_rad=self.tilt_rad)
        )


def check_rain_rate(setting: str, rate_m_per_s: float) -> None:
    """Raise `InvalidSetting` for `setting` unless the rate is from 0 to 200 mm/h."""
    rate = check_number(setting, rate_m_per_s)
    if not 0 <= rate <= MAX_RAIN_RATE_M_PER_S:
        raise InvalidSetting(
            setting,
            value=f"{rate * 3.6e6:.4g} mm/h",
            expected="a rain rate from 0 to 200 mm/h",
            fix="check the unit: 25 mm/h is heavy rain, 100 mm/h a cloudburst",
        )
