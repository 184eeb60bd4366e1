"""Texas Instruments xWR1642, on its BOOST board."""

from dataclasses import replace

from dechirp.core.values import value
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import DESIGN_77_HZ, FIRST_77, positions


@value
class Xwr1642(Device):
    """xWR1642BOOST: 76 to 81 GHz, 2 transmitters, 4 receivers.

    Antennas (board guide): receivers half a wavelength apart, transmitters two wavelengths
    apart. Beat frequencies to 5 MHz: data sheet. Memory of 768 kB: `mmwave_sdk_xwr16xx.mak`.
    Chirps of each transmitter in a multiple of 4, and a Doppler transform of at least 16:
    `dopplerprocdsp.c` of SDK 3.5. The demos of SDK 1 and 2 need a power of two, 16 or more.
    """

    name = "xWR1642BOOST"
    tx_m = positions((0, 4), (0, 0), design_hz=DESIGN_77_HZ)
    rx_m = positions((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lanes = 2
    limits = replace(
        FIRST_77,
        max_beat_frequency_hz=5e6,
        cube_bytes=768 * 1024,
        min_chirps=12,
        chirps="multiple of 4",
    )
