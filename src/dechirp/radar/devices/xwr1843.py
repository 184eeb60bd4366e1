"""Texas Instruments xWR1843, on its BOOST board."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import DESIGN_77_HZ, FIRST_GENERATION_77, grid_positions_m


@frozen_dataclass
class Xwr1843(Device):
    """xWR1843BOOST: 76 to 81 GHz, 3 transmitters, 4 receivers.

    Antennas (board guide; the angle estimation of the SDK uses the same): receivers half a
    wavelength apart, TX1 and TX3 two wavelengths apart, TX2 between them, raised by half a
    wavelength. Beat frequencies to 10 MHz: data sheet. Memory of 1 MB:
    `mmwave_sdk_xwr18xx.mak`. Chirps of each transmitter in a multiple of 4: the Doppler
    transform in hardware takes any number (`dopplerproccommon.h` of SDK 3.5), but the demo of
    SDK 3.3 stopped with 33 where 32 worked (TI forum, thread 963670), and what makes it stop
    is not confirmed. Transforms of 1024 points: `hwa.c`.
    """

    name = "xWR1843BOOST"
    tx_m = grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=DESIGN_77_HZ)
    rx_m = grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=10e6,
        cube_bytes=1024 * 1024,
        max_fft_points=1024,
        chirp_count_rule="multiple of 4",
    )
