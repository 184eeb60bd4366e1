"""Texas Instruments MMWCAS-RF-EVM: four AWR2243 that share an oscillator."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import (
    COMMON_LIMITS,
    FREQUENCY_STEP_77_HZ,
    SLOPE_STEP_77_HZ_PER_S,
    grid_positions_m,
)

_DESIGN_HZ = 76.8e9
_TX_COLUMNS = (11, 10, 9, 32, 28, 24, 20, 16, 12, 8, 4, 0)
_TX_ROWS = (6, 4, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0)
_RX_COLUMNS = (*range(11, 15), *range(50, 54), *range(46, 50), *range(4))


@frozen_dataclass
class Cascade(Device):
    """MMWCAS-RF-EVM: 76 to 81 GHz, 12 transmitters, 16 receivers.

    Antennas: the tables of TI's processing example, in half wavelengths of 76.8 GHz, chip
    after chip from 1 to 4; its directions left and up are not confirmed. Beat
    frequencies to 20 MHz: data sheet of the AWR2243. Rates to 45 MS/s real: SWRA553; half
    of that complex, as on the other chips. Slopes of 266 MHz/us, ranges and the buffer:
    the interface document of the AWR2243, as users quote it. Samples leave over CSI-2 and
    are not processed on the chips. The gap between frames is not confirmed.
    """

    name = "MMWCAS-RF-EVM"
    tx_m = grid_positions_m(_TX_COLUMNS, _TX_ROWS, design_hz=_DESIGN_HZ)
    rx_m = grid_positions_m(_RX_COLUMNS, (0,) * 16, design_hz=_DESIGN_HZ)
    limits = replace(
        COMMON_LIMITS,
        bands_hz=((76e9, 78e9), (77e9, 81e9)),
        max_slope_hz_per_s=5510 * SLOPE_STEP_77_HZ_PER_S,
        max_complex_rate_hz=22.5e6,
        max_real_rate_hz=45e6,
        max_beat_frequency_hz=20e6,
        # Each of the four chips has its own, for its four receivers.
        adc_buffer_bytes=4 * 16 * 1024,
        frequency_step_hz=FREQUENCY_STEP_77_HZ,
        slope_step_hz_per_s=SLOPE_STEP_77_HZ_PER_S,
    )
