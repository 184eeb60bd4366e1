"""Texas Instruments xWR1642, on its BOOST board."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import DESIGN_77_HZ, FIRST_GENERATION_77, grid_positions_m


@frozen_dataclass
class Xwr1642(Device):
    """xWR1642BOOST: 76 to 81 GHz, 2 transmitters, 4 receivers.

    Antennas (board guide): receivers half a wavelength apart, transmitters two wavelengths
    apart. Beat frequencies to 5 MHz: data sheet. Memory of 768 kB: `mmwave_sdk_xwr16xx.mak`.
    Chirps of each transmitter in a multiple of 4, and a Doppler transform of at least 16:
    `dopplerprocdsp.c` of SDK 3.5. The demos of SDK 1 and 2 need a power of two, 16 or more.
    """

    name = "xWR1642BOOST"
    tx_m = grid_positions_m((0, 4), (0, 0), design_hz=DESIGN_77_HZ)
    rx_m = grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=5e6,
        cube_bytes=768 * 1024,
        min_chirps=12,
        chirp_count_rule="multiple of 4",
    )
