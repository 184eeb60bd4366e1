"""Two-way path attenuation of echoes."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.radar.radar import Radar
from dechirp.simulation.echo_groups import EchoGroup


def attenuate_two_way(groups: Sequence[EchoGroup], loss_db_per_km: float) -> list[EchoGroup]:
    """Attenuate groups by the loss over both paths, with scatterers at their mid-run positions.

    Distances are from the centre of the transmitters and to that of the receivers of each group:
    antennas 10 cm apart differ by 0.01 dB even in the oxygen line at 60 GHz.
    """
    return [_attenuate_group(group, loss_db_per_km) for group in groups]


def check_radar_frequency(impairment_kind: str, radar: Radar, min_hz: float, max_hz: float) -> None:
    """Raise `InvalidSetting` for a radar outside the frequencies for which a formula holds."""
    frequency_hz = radar.frame.chirp.mid_window_frequency_hz
    if not min_hz <= frequency_hz <= max_hz:
        raise InvalidSetting(
            "kind",
            value=f"{impairment_kind}, with a radar at {frequency_hz / 1e9:.4g} GHz",
            expected=f"for one from {min_hz / 1e9:g} GHz to {max_hz / 1e9:g} GHz",
            fix="remove the impairment: its formula does not hold at that frequency",
        )


def _attenuate_group(group: EchoGroup, loss_db_per_km: float) -> EchoGroup:
    positions_m = group.scatterers.path_m[0]
    path_lengths_m = sum(
        np.linalg.norm(positions_m - antennas_m.mean(axis=0), axis=-1)
        for antennas_m in (group.transmission.tx_m, group.transmission.rx_m)
    )
    factors = np.sqrt(from_decibels(-loss_db_per_km * path_lengths_m / 1000))
    return group.scale_amplitudes(factors)
