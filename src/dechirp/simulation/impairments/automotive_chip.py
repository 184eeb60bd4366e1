"""Preset of a typical 77 GHz CMOS radar chip, from data sheets."""

import warnings

import numpy as np

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import from_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.base import Impairment, Preset
from dechirp.simulation.impairments.channel_mismatch import ChannelMismatch
from dechirp.simulation.impairments.compression import Compression
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.iq_imbalance import IqImbalance
from dechirp.simulation.impairments.leakage import Leakage
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.phase_noise import PhaseNoise
from dechirp.simulation.impairments.quantisation import Quantisation


@frozen_dataclass
class AutomotiveChip(Preset):
    """Oscillator, leakage and receiver of a chip like those of Texas Instruments.

    phase-noise: -95 dBc/Hz at 1 MHz (SWRS330: -96 below 77 GHz, -95 to 81 GHz), 20 dB per decade
    like
    a free oscillator (Leeson 1966), flat within 400 kHz of the carrier, as a loop of that bandwidth
    would hold it: an assumption.
    leakage: 30 dB of isolation, a round number between antennas of one board: an assumption.
    thermal-noise: from the radar's noise factor (SWRS330: 12 dB; AWR1243: 14 to 15 dB).
    compression: -7 dBm at 1 dB (SWRS330: measured far below the corner of the high-pass, so of
    amplifier and mixer; AWR1243: -8 dBm).
    iq-imbalance: 0.45 dB and 2 deg, an image 30 dB down, with complex sampling (TI forum,
    thread 654592: data sheet of the AWR1243, 1 dB and 2 deg at most).
    if-filter: high-pass of second order, 6 dB down at 350 kHz (SWRS330: 300, 350, 700 or
    1400 kHz), which is 3 dB down at 460 kHz. No low-pass: that of the chip is within 0.5 dB in the
    band, and its 60 dB of alias rejection act before sampling.
    channel-mismatch: 0.25 dB and 1.5 deg (SWRS330: +-0.5 dB and +-3 deg over temperature, taken as
    two standard deviations).
    quantisation: 16 bits (SWRS330), full scale -20 dBm, as with 30 dB of gain before a 10 dBm
    ADC: an assumption; above -20 dBm receivers of the IWR1443 compress in the band (TI forum,
    thread 702363).

    References
    ----------
    Texas Instruments, SWRS330, RF specification; SWRS188D, AWR1243.
    D. B. Leeson, A simple model of feedback oscillator noise spectrum, Proc. IEEE, 1966.
    """

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn about a radar of another band."""
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        if not 76e9 <= frequency_hz <= 81e9:
            finding = Finding(
                level="warning",
                setting=f"impairments.{self.kind()}",
                value=f"a radar at {frequency_hz / 1e9:.4g} GHz",
                expected="a radar from 76 GHz to 81 GHz, the band of the data sheets",
                fix="list impairments of your own chip instead",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=3)

    def impairments(self, radar: Radar) -> tuple[Impairment, ...]:
        """Return the impairments in signal order, without I/Q imbalance for real samples."""
        image = IqImbalance(gain=_decibels_to_ratio(0.45), phase_rad=float(np.radians(2.0)))
        return (
            PhaseNoise(
                offset_hz=(400e3, 1e6, 10e6, 100e6),
                level_per_hz=(
                    _decibels_to_ratio(-87.04),
                    _decibels_to_ratio(-95.0),
                    _decibels_to_ratio(-115.0),
                    _decibels_to_ratio(-135.0),
                ),
            ),
            Leakage(isolation=_decibels_to_ratio(30.0)),
            ThermalNoise(),
            Compression(p1db_w=_decibels_to_ratio(-7.0 - 30.0)),
            *((image,) if radar.frame.chirp.sampling == "complex" else ()),
            IfFilter(high_pass_hz=460e3, high_pass_order=2),
            ChannelMismatch(
                gain_std=_decibels_to_ratio(0.25), phase_std_rad=float(np.radians(1.5))
            ),
            Quantisation(bits=16, full_scale_w=_decibels_to_ratio(-20.0 - 30.0)),
        )


def _decibels_to_ratio(level_db: float) -> float:
    return float(from_decibels(level_db))
