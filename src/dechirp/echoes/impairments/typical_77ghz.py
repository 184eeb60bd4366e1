"""A 77 GHz radar chip in CMOS, as its data sheets have it."""

import warnings

import numpy as np

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import from_decibels
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Impairment, Preset
from dechirp.echoes.impairments.compression import Compression
from dechirp.echoes.impairments.if_filter import IfFilter
from dechirp.echoes.impairments.iq_imbalance import IqImbalance
from dechirp.echoes.impairments.leakage import Leakage
from dechirp.echoes.impairments.mismatch import Mismatch
from dechirp.echoes.impairments.phase_noise import PhaseNoise
from dechirp.echoes.impairments.quantisation import Quantisation
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class Typical77Ghz(Preset):
    """Oscillator, leakage and receiver of a chip like those of Texas Instruments.

    phase-noise: -95 dBc/Hz at 1 MHz (SWRS330: -96 below 77 GHz, -95 to 81 GHz), 20 dB a decade
    as of a free oscillator (Leeson 1966), flat within 400 kHz of the carrier, where a loop of that
    bandwidth would hold it: an assumption.
    leakage: 30 dB of isolation, a round number between antennas of one board: an assumption.
    thermal-noise: of the radar's noise factor (SWRS330: 12 dB; AWR1243: 14 to 15 dB).
    compression: -7 dBm at 1 dB (SWRS330: measured far below the corner of the high-pass, that is
    of amplifier and mixer; AWR1243: -8 dBm).
    iq-imbalance: 0.45 dB and 2 deg, an image 30 dB down, where sampling is complex (TI forum,
    thread 654592: data sheet of the AWR1243, 1 dB and 2 deg at most).
    if-filter: high-pass of second order, 6 dB down at 350 kHz (SWRS330: 300, 350, 700 or
    1400 kHz), which is 3 dB down at 460 kHz. No low-pass: that of the chip is within 0.5 dB in the
    band, and the 60 dB by which it cuts what would alias come too late for samples.
    mismatch: 0.25 dB and 1.5 deg (SWRS330: +-0.5 dB and +-3 deg over temperature, taken as two
    standard deviations).
    quantisation: 16 bits (SWRS330), full scale -20 dBm, as with 30 dB of gain before a converter
    of 10 dBm: an assumption, above -20 dBm receivers of the IWR1443 compress in the band (TI
    forum, thread 702363).

    References
    ----------
    Texas Instruments, SWRS330, RF specification; SWRS188D, AWR1243.
    D. B. Leeson, A simple model of feedback oscillator noise spectrum, Proc. IEEE, 1966.
    """

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn of a radar of another band."""
        frequency_hz = radar.frame.chirp.mid_window_frequency_hz
        if not 76e9 <= frequency_hz <= 81e9:
            finding = Finding(
                level="warning",
                setting=f"impairments.{self.kind()}",
                got=f"a radar at {frequency_hz / 1e9:.4g} GHz",
                need="one from 76 GHz to 81 GHz, of which its data sheets tell",
                fix="List impairments of your own chip instead.",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=3)

    def impairments(self, radar: Radar) -> tuple[Impairment, ...]:
        """In the order of the signal; real samples are of one mixer, which has no image."""
        image = IqImbalance(gain=_ratio(0.45), phase_rad=float(np.radians(2.0)))
        return (
            PhaseNoise(
                offset_hz=(400e3, 1e6, 10e6, 100e6),
                level_per_hz=(_ratio(-87.04), _ratio(-95.0), _ratio(-115.0), _ratio(-135.0)),
            ),
            Leakage(isolation=_ratio(30.0)),
            ThermalNoise(),
            Compression(p1db_w=_ratio(-7.0 - 30.0)),
            *((image,) if radar.frame.chirp.sampling == "complex" else ()),
            IfFilter(high_pass_hz=460e3, high_pass_order=2),
            Mismatch(gain_std=_ratio(0.25), phase_std_rad=float(np.radians(1.5))),
            Quantisation(bits=16, full_scale_w=_ratio(-20.0 - 30.0)),
        )


def _ratio(level_db: float) -> float:
    return float(from_decibels(level_db))
