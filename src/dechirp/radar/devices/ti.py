"""Shared limits and antenna layout of the Texas Instruments devices.

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


def grid_positions_m(
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
