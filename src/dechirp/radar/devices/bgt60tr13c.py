"""Infineon BGT60TR13C: antennas in the package."""

from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.limits import DeviceLimits


@frozen_dataclass
class Bgt60tr13c(Device):
    """BGT60TR13C: 58 to 63.5 GHz, 1 transmitter, 3 receivers, real samples of 12 bits.

    All numbers: data sheet 2.4.9. Ramps of up to 400 MHz/us, 4 MS/s at most and 80 MHz over a
    whole number from 20 to 1023, a buffer of 8192 words of two samples.

    Antennas: receivers 2.5 mm apart in an L whose corner is RX3, with RX1 beside it and RX2
    above or below (from programs that estimate angles with it). On which side they lie, and
    where the transmitter is, is not confirmed; it is put at the corner, which shifts all
    phases alike.
    """

    name = "BGT60TR13C"
    tx_m = ((0.0, 0.0, 0.0),)
    rx_m = ((0.0, 2.5e-3, 0.0), (0.0, 0.0, 2.5e-3), (0.0, 0.0, 0.0))
    limits = DeviceLimits(
        bands_hz=((58e9, 63.5e9),),
        max_slope_hz_per_s=400e12,
        max_real_rate_hz=4e6,
        min_sample_rate_hz=80e6 / 1023,
        sample_clock_hz=80e6,
        adc_buffer_bytes=8192 * 3,
        real_sample_bytes=1.5,
    )
