"""Texas Instruments xWR6843, on its ISK board."""

from dataclasses import replace

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.ti import (
    COMMON_LIMITS,
    FREQUENCY_STEP_60_HZ,
    SLOPE_STEP_60_HZ_PER_S,
    grid_positions_m,
)

# A sister board, the IWR6843LEVM, states 62 GHz; for the ISK it is not confirmed.
_DESIGN_HZ = 62e9


@frozen_dataclass
class Xwr6843(Device):
    """IWR6843ISK: 57 to 64 GHz, 3 transmitters, 4 receivers.

    Antennas (`antGeometry0` and `antGeometry1` of TI's settings for the board): receivers
    half a wavelength apart, TX1 and TX3 two wavelengths apart, TX2 between them, raised by
    half a wavelength. ODS and AOP boards have others. Bands, slopes of 250 MHz/us and
    rates: `rl_sensor.h` of SDK 3.5; steps of frequency and slope count in twos. Beat
    frequencies to 10 MHz: data sheet. Memory of 768 kB: `mmwave_sdk_xwr68xx.mak`. Chirps of
    each transmitter in a multiple of 4, and a Doppler transform of at least 16:
    `dopplerprocdsp.c`, which its demo runs. Transforms of 1024 points: `hwa.c`.
    """

    name = "xWR6843ISK"
    tx_m = grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=_DESIGN_HZ)
    rx_m = grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=_DESIGN_HZ)
    lvds_lanes = 2
    limits = replace(
        COMMON_LIMITS,
        bands_hz=((57e9, 60.75e9), (60e9, 64e9)),
        max_slope_hz_per_s=6905 * SLOPE_STEP_60_HZ_PER_S,
        max_complex_rate_hz=12.5e6,
        max_real_rate_hz=25e6,
        max_beat_frequency_hz=10e6,
        adc_buffer_bytes=32 * 1024,
        cube_bytes=768 * 1024,
        max_fft_points=1024,
        min_chirps=12,
        chirp_count_rule="multiple of 4",
        min_gap_s=300e-6,
        max_period_s=1.342,
        frequency_step_hz=2 * FREQUENCY_STEP_60_HZ,
        slope_step_hz_per_s=2 * SLOPE_STEP_60_HZ_PER_S,
    )
