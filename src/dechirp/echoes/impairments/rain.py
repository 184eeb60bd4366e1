"""Rain weakens echoes; what its drops send back is `rain_backscatter`."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.echoes.weakened import must_be_within, weakened
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.theory.attenuation import MOST_RAIN_M_PER_S, rain_db_per_km


@value
class Rain(Propagation):
    """Attenuation by rain, a power law of its rate (ITU-R P.838-3).

    11 dB/km at 77 GHz in 25 mm/h: 4.6 dB for an echo from 200 m. It weakens what stands before
    it in the list of impairments.
    """

    rate_m_per_s: float
    """Rain rate, as 25 mm/h; up to 200 mm/h."""
    tilt_rad: float = 0.0
    """Of the polarisation from horizontal: 90 deg vertical, 45 deg slanted or circular."""

    def __post_init__(self) -> None:
        check_rate("Rain.rate_m_per_s", self.rate_m_per_s)
        number("Rain.tilt_rad", self.tilt_rad, at_least=-np.pi, at_most=np.pi)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a radar below 1 GHz or above 1 THz."""
        must_be_within("rain", radar, 1e9, 1e12)

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
            parts, rain_db_per_km(frequency_hz, self.rate_m_per_s, tilt_rad=self.tilt_rad)
        )


def check_rate(where: str, rate_m_per_s: float) -> None:
    """Raise `InvalidSetting`, about the setting `where`, unless from 0 to 200 mm/h."""
    rate = number(where, rate_m_per_s)
    if not 0 <= rate <= MOST_RAIN_M_PER_S:
        raise InvalidSetting(
            where,
            got=f"{rate * 3.6e6:.4g} mm/h",
            need="a rain rate from 0 to 200 mm/h",
            fix="Check the unit: 25 mm/h is heavy rain, 100 mm/h a cloudburst.",
        )
