"""Texas Instruments xWR1443 and AWR1243, on their BOOST boards."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import DESIGN_77_HZ, FIRST_GENERATION_77, grid_positions_m


@frozen_dataclass
class Xwr1443(Device):
    """xWR1443BOOST and AWR1243BOOST: 76 to 81 GHz, 3 transmitters, 4 receivers.

    Antennas (board guide; the angle estimation of the SDK uses the same): receivers half a
    wavelength apart, TX1 and TX3 two wavelengths apart, TX2 between them, raised by half a
    wavelength. Beat frequencies to 15 MHz: data sheet of the AWR1243; the AWR1443 is
    sold for less, which is not confirmed. Memory of 384 kB: `mmwave_sdk_xwr14xx.mak`.
    Chirps of each transmitter in a power of two: user guide of SDK 1.2, `frameCfg`; later
    SDKs have no demo for it. Transforms of 1024 points: `hwa.c`.
    """

    name = "xWR1443BOOST"
    tx_m = grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=DESIGN_77_HZ)
    rx_m = grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 4
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=15e6,
        adc_buffer_bytes=16 * 1024,
        cube_bytes=384 * 1024,
        max_fft_points=1024,
        chirp_count_rule="power of two",
    )
