"""Echoes weakened by what fills the air, over both of their ways."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.echoes.parts import Part
from dechirp.radar.radar import Radar


def weakened(parts: Sequence[Part], loss_db_per_km: float) -> list[Part]:
    """Parts with the loss over the ways there and back, where scatterers are at mid-run.

    From the middle of the transmitters and to that of the receivers that each part is sent and
    received by: antennas 10 cm apart differ by 0.01 dB even in the oxygen line at 60 GHz.
    """
    return [_weakened(part, loss_db_per_km) for part in parts]


def must_be_within(kind: str, radar: Radar, least_hz: float, most_hz: float) -> None:
    """Raise `InvalidSetting` for a radar outside the frequencies for which a formula holds."""
    frequency_hz = radar.frame.chirp.mid_window_frequency_hz
    if not least_hz <= frequency_hz <= most_hz:
        raise InvalidSetting(
            "kind",
            got=f"{kind}, for a radar at {frequency_hz / 1e9:.4g} GHz",
            need=f"for one from {least_hz / 1e9:g} GHz to {most_hz / 1e9:g} GHz",
            fix="Leave it out: its formula does not hold there.",
        )


def _weakened(part: Part, loss_db_per_km: float) -> Part:
    at_m = part.scatterers.path_m[0]
    ways_m = sum(
        np.linalg.norm(at_m - antennas_m.mean(axis=0), axis=-1)
        for antennas_m in (part.sent.tx_m, part.sent.rx_m)
    )
    factors = np.sqrt(from_decibels(-loss_db_per_km * ways_m / 1000))
    return part.weaker(factors)
