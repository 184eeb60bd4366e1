"""Texas Instruments AWR2944, on its evaluation board."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import (
    COMMON_LIMITS,
    DESIGN_77_HZ,
    FREQUENCY_STEP_77_HZ,
    SLOPE_STEP_77_HZ_PER_S,
    grid_positions_m,
)


@frozen_dataclass
class Xwr2944(Device):
    """AWR2944EVM: 76 to 81 GHz, 4 transmitters, 4 receivers, real samples only.

    Antennas (`antGeometryCfg` of TI's settings for the board): receivers half a wavelength
    apart, TX1, TX3 and TX4 two wavelengths apart, TX2 between TX1 and TX3 and 0.8
    wavelengths off their row. That it is above the row is not confirmed. Beat frequencies
    to 15 MHz: data sheet. Rates to 37.5 MS/s, and two lanes: users' capture programs.
    Memory of 2.5 MB for plain samples: TIDUF01; the demo can compress them. Shortest idle
    time of 2.5 us: TI forum, thread 1342307.

    Not confirmed, and not checked: largest slope, buffer of the converter, numbers of chirps
    of its demo, gap between frames.
    """

    name = "AWR2944EVM"
    tx_m = grid_positions_m((0, 2, 4, 8), (0, 1.6, 0, 0), design_hz=DESIGN_77_HZ)
    rx_m = grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = replace(
        COMMON_LIMITS,
        bands_hz=((76e9, 81e9),),
        max_real_rate_hz=37.5e6,
        max_beat_frequency_hz=15e6,
        cube_bytes=2560 * 1024,
        min_idle_s=((0.0, 2.5e-6),),
        frequency_step_hz=FREQUENCY_STEP_77_HZ,
        slope_step_hz_per_s=SLOPE_STEP_77_HZ_PER_S,
    )
