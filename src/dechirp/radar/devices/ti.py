"""Texas Instruments devices on their evaluation boards.

Ranges and steps: `rl_sensor.h` of mmWave SDK 1.2 and 3.5 (profile and frame configuration).
Shortest idle times: TI's table for more than 5 MS/s, 2, 3.5, 5 and 7 us for ramps of less than 1,
2, 3 and of more than 3 GHz, as users quote it; demo profiles keep to it (7 us for 4 GHz on the
6843). Settling of the ramp before the first sample: 1 us, or 2.5 us above 50 MHz/us (answer of TI
in its forum, thread 1342307). ADC buffer: 32 kB, and 16 on the xWR1443, by the text of
`rl_sensor.h` of SDK 3.5 and by the demo (the table under that text has the numbers of 16 kB, as
the header of SDK 1 gave every chip).
"""

from dataclasses import replace

from dechirp.core.checks import Vector
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.limits import DeviceLimits

# The synthesiser counts 2^26 steps of 3.6 GHz in 77 GHz chips, 2.7 GHz in 60 GHz ones, and
# its slope in steps of that every 1/900 us.
FREQUENCY_STEP_77_HZ = 3.6e9 / 2**26  # 53.644 Hz
FREQUENCY_STEP_60_HZ = 2.7e9 / 2**26  # 40.233 Hz
SLOPE_STEP_77_HZ_PER_S = FREQUENCY_STEP_77_HZ * 900e6  # 48.279 kHz/us
SLOPE_STEP_60_HZ_PER_S = FREQUENCY_STEP_60_HZ * 900e6  # 36.210 kHz/us

COMMON_LIMITS = DeviceLimits(
    bands_hz=(),
    min_sample_rate_hz=2e6,
    max_chirps=255,
    min_idle_s=((0.0, 2e-6), (1e9, 3.5e-6), (2e9, 5e-6), (3e9, 7e-6)),
    max_idle_s=524_287 * 10e-9,
    min_adc_start_s=((0.0, 1e-6), (50e12, 2.5e-6)),
    max_adc_start_s=4095 * 10e-9,
    max_ramp_duration_s=500_000 * 10e-9,
    time_step_s=10e-9,
    period_step_s=5e-9,
    sample_rate_step_hz=1e3,
)
"""Limits of all chips; bands and rates differ."""

FIRST_GENERATION_77 = replace(
    COMMON_LIMITS,
    # Two oscillators: a ramp must stay within one of them.
    bands_hz=((76e9, 78e9), (77e9, 81e9)),
    max_slope_hz_per_s=2072 * SLOPE_STEP_77_HZ_PER_S,
    max_complex_rate_hz=18.75e6,
    max_real_rate_hz=37.5e6,
    adc_buffer_bytes=32 * 1024,
    min_gap_s=300e-6,
    max_period_s=1.342,
    frequency_step_hz=FREQUENCY_STEP_77_HZ,
    slope_step_hz_per_s=SLOPE_STEP_77_HZ_PER_S,
)
"""Limits of the chips xWR12 to xWR18."""

DESIGN_77_HZ = 78.5e9
"""Frequency at which the spacing of the 77 GHz boards, 1.91 mm, is half a wavelength.

Not stated in their guides. The board file of the AWR2944EVM has 0.49 wavelengths of 77 GHz,
and reflectors at known angles in front of an xWR1443 agree within 1.1 degrees up to 50.
"""


def half_wavelength_grid_positions_m(
    columns: tuple[float, ...], rows: tuple[float, ...], *, design_hz: float
) -> tuple[Vector, ...]:
    """Return positions in metres of antennas given in half wavelengths, (n, 3).

    Columns count as TI numbers them, so that TX1 RX1..4, TX3 RX1..4 ascend; rows count up. Seen
    from the radar, looking forward, columns run to the right, towards -y.

    The echo from +y is nearer to an element at larger y by y sin(azimuth), so it arrives earlier,
    and the beat Tx x conj(Rx), whose phase is 2 pi f times the delay, has the smaller phase
    there: 2 pi / lambda (2 r - y sin(azimuth)), y that of the virtual element. Along columns that
    run towards -y it rises for positive azimuths, so positive azimuth is positive spatial
    frequency, as in recordings of reflectors at known angles. Which side those recordings call
    positive is not confirmed.
    """
    half_wavelength_m = SPEED_OF_LIGHT / (2 * design_hz)
    return tuple(
        (0.0, 0.0 - column * half_wavelength_m, row * half_wavelength_m)
        for column, row in zip(columns, rows, strict=True)
    )


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

    name: str = "xWR1443BOOST"
    """Board in messages: AWR1243BOOST for a chip of that name."""
    tx_m = half_wavelength_grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=DESIGN_77_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 4
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=15e6,
        adc_buffer_bytes=16 * 1024,
        cube_bytes=384 * 1024,
        max_fft_points=1024,
        chirp_count_rule="power of two",
    )


@frozen_dataclass
class Xwr1642(Device):
    """xWR1642BOOST: 76 to 81 GHz, 2 transmitters, 4 receivers.

    Antennas (board guide): receivers half a wavelength apart, transmitters two wavelengths
    apart. Beat frequencies to 5 MHz: data sheet. Memory of 768 kB: `mmwave_sdk_xwr16xx.mak`.
    Chirps of each transmitter in a multiple of 4, and a Doppler transform of at least 16:
    `dopplerprocdsp.c` of SDK 3.5. The demos of SDK 1 and 2 need a power of two, 16 or more.
    """

    name = "xWR1642BOOST"
    tx_m = half_wavelength_grid_positions_m((0, 4), (0, 0), design_hz=DESIGN_77_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=5e6,
        cube_bytes=768 * 1024,
        min_chirps=12,
        chirp_count_rule="multiple of 4",
    )


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
    tx_m = half_wavelength_grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=DESIGN_77_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = replace(
        FIRST_GENERATION_77,
        max_beat_frequency_hz=10e6,
        cube_bytes=1024 * 1024,
        max_fft_points=1024,
        chirp_count_rule="multiple of 4",
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
    tx_m = half_wavelength_grid_positions_m((0, 2, 4, 8), (0, 1.6, 0, 0), design_hz=DESIGN_77_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
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


# A sister board, the IWR6843LEVM, states 62 GHz; for the ISK it is not confirmed.
_BOARD_60_HZ = 62e9


@frozen_dataclass
class Xwr6843(Device):
    """IWR6843ISK: 57 to 64 GHz, 3 transmitters, 4 receivers.

    Antennas (`antGeometry0` and `antGeometry1` of TI's settings for the board): receivers
    half a wavelength apart, TX1 and TX3 two wavelengths apart, TX2 between them, raised by
    half a wavelength. Bands, slopes of 250 MHz/us and
    rates: `rl_sensor.h` of SDK 3.5; steps of frequency and slope count in twos. Beat
    frequencies to 10 MHz: data sheet. Memory of 768 kB: `mmwave_sdk_xwr68xx.mak`. Chirps of
    each transmitter in a multiple of 4, and a Doppler transform of at least 16:
    `dopplerprocdsp.c`, which its demo runs. Transforms of 1024 points: `hwa.c`.
    """

    name = "xWR6843ISK"
    tx_m = half_wavelength_grid_positions_m((0, 2, 4), (0, 1, 0), design_hz=_BOARD_60_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 1, 2, 3), (0, 0, 0, 0), design_hz=_BOARD_60_HZ)
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


# `gAntennaSpacing` of TI's object detection for the two boards: 2.5 and 2.426 mm.
_AOP_HZ = SPEED_OF_LIGHT / 2 / 2.5e-3
_ODS_HZ = SPEED_OF_LIGHT / 2 / 2.426e-3


@frozen_dataclass
class Xwr6843aop(Device):
    """IWR6843AOPEVM and AWR6843AOPEVM: the chip of the IWR6843ISK, with antennas in the package.

    Antennas (`antenna_geometry.c` of TI's object detection; `antGeometry0` and `antGeometry1` of
    TI's settings agree): receivers in a square of half a wavelength, RX4 above RX3 and RX2
    above RX1, which lie right of them; TX1 and TX3 one wavelength below each other, TX2 right
    of TX3 by one wavelength. The feeds of RX2 and RX4 come from the other side, so their
    samples are inverted (`antPhaseRot`, and `compRangeBiasAndRxChanPhase` of TI's
    visualizer). Limits as for the IWR6843ISK.
    """

    name = "xWR6843AOP"
    tx_m = half_wavelength_grid_positions_m((0, 2, 0), (0, -2, -2), design_hz=_AOP_HZ)
    rx_m = half_wavelength_grid_positions_m((1, 1, 0, 0), (-1, 0, -1, 0), design_hz=_AOP_HZ)
    rx_signs = (1, -1, 1, -1)
    lvds_lanes = 2
    limits = Xwr6843.limits


@frozen_dataclass
class Xwr6843ods(Device):
    """IWR6843ISK-ODS: the chip of the IWR6843ISK, with antennas for wide elevations.

    Antennas (sources of the AOP board): receivers in a square of half a wavelength, in the
    order left above, left below, right below, right above; TX2 right of TX1 and TX3 below TX2
    by one wavelength. Samples of RX2 and RX3 are inverted. Limits as for the IWR6843ISK.
    """

    name = "xWR6843ISK-ODS"
    tx_m = half_wavelength_grid_positions_m((0, 2, 2), (0, 0, -2), design_hz=_ODS_HZ)
    rx_m = half_wavelength_grid_positions_m((0, 0, 1, 1), (0, -1, -1, 0), design_hz=_ODS_HZ)
    rx_signs = (1, -1, -1, 1)
    lvds_lanes = 2
    limits = Xwr6843.limits


@frozen_dataclass
class Xwr1843aop(Device):
    """AWR1843AOPEVM: the chip of the xWR1843BOOST, with antennas in the package.

    Antennas (`antenna_geometry.c` of TI's object detection): receivers half a wavelength apart,
    RX4 on the left; transmitters below each other, half a wavelength apart. TI's visualizer
    corrects no sign. The frequency of the half wavelength is not confirmed. Limits as for the
    xWR1843BOOST.
    """

    name = "AWR1843AOP"
    tx_m = half_wavelength_grid_positions_m((0, 0, 0), (0, -1, -2), design_hz=DESIGN_77_HZ)
    rx_m = half_wavelength_grid_positions_m((3, 2, 1, 0), (0, 0, 0, 0), design_hz=DESIGN_77_HZ)
    lvds_lanes = 2
    limits = Xwr1843.limits


_CASCADE_HZ = 76.8e9
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
    tx_m = half_wavelength_grid_positions_m(_TX_COLUMNS, _TX_ROWS, design_hz=_CASCADE_HZ)
    rx_m = half_wavelength_grid_positions_m(_RX_COLUMNS, (0,) * 16, design_hz=_CASCADE_HZ)
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


@frozen_dataclass
class Xwr2243(Device):
    """AWR2243BOOST: 76 to 81 GHz, 3 transmitters, 4 receivers.

    Antennas of the AWR1243BOOST (both boards have one user guide). Limits as for the chips of
    the cascade; samples over LVDS on four lanes, as from the AWR1243, and no demo on the chip.
    """

    name = "AWR2243BOOST"
    tx_m = Xwr1443.tx_m
    rx_m = Xwr1443.rx_m
    lvds_lanes = 4
    limits = replace(Cascade.limits, adc_buffer_bytes=16 * 1024)
