"""Device library: antenna positions of boards, aliases and rules of chips."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar


def column_positions(array: Array, design_hz: float) -> np.ndarray:
    """Return the sum of transmitter and receiver columns in half wavelengths, (tx, rx)."""
    half_m = SPEED_OF_LIGHT / (2 * design_hz)
    tx, rx = np.array(array.tx_m), np.array(array.rx_m)
    return -(tx[:, None, 1] + rx[None, :, 1]) / half_m


def row_positions(array: Array, design_hz: float) -> np.ndarray:
    half_m = SPEED_OF_LIGHT / (2 * design_hz)
    return np.array(array.tx_m)[:, 2] / half_m


@pytest.mark.parametrize(
    ("name", "tx_mask", "design_hz"),
    [
        ("xwr1443", 0b101, 78.5e9),
        ("xwr1642", 0b11, 78.5e9),
        ("xwr1843", 0b101, 78.5e9),
        ("xwr6843", 0b101, 62e9),
        ("xwr2944", 0b101, 78.5e9),
    ],
)
def test_two_azimuth_transmitters_yield_uniform_line_of_eight(name, tx_mask, design_hz):
    line = column_positions(device(name).select_antennas(tx_mask, 0b1111), design_hz)
    assert line.ravel() == pytest.approx(np.arange(8))


def test_three_transmitters_of_2944_yield_uniform_line_of_twelve():
    line = column_positions(device("xwr2944").select_antennas(0b1101, 0b1111), 78.5e9)
    assert line.ravel() == pytest.approx(np.arange(12))


@pytest.mark.parametrize(
    ("name", "design_hz"), [("xwr1443", 78.5e9), ("xwr1843", 78.5e9), ("xwr6843", 62e9)]
)
def test_second_transmitter_is_centred_half_a_wavelength_above_others(name, design_hz):
    board = device(name).select_antennas(0b111, 0b1111)
    assert column_positions(board, design_hz)[:, 0] == pytest.approx([0, 2, 4])
    assert row_positions(board, design_hz) == pytest.approx([0, 1, 0])


# `antGeometry0`, `antGeometry1` and `antPhaseRot` of TI's settings for people tracking: columns
# to the left, rows up and signs of TX1 RX1..4, TX2 RX1..4, TX3 RX1..4.
@pytest.mark.parametrize(
    ("name", "spacing_m", "left", "up", "signs"),
    [
        (
            "xwr6843aop",
            2.5e-3,
            "-1 -1 0 0 -3 -3 -2 -2 -1 -1 0 0",
            "-1 0 -1 0 -3 -2 -3 -2 -3 -2 -3 -2",
            "1 -1 1 -1 1 -1 1 -1 1 -1 1 -1",
        ),
        (
            "xwr6843ods",
            2.426e-3,
            "0 0 -1 -1 -2 -2 -3 -3 -2 -2 -3 -3",
            "0 -1 -1 0 0 -1 -1 0 -2 -3 -3 -2",
            "1 -1 -1 1 1 -1 -1 1 1 -1 -1 1",
        ),
        (
            "xwr6843",
            SPEED_OF_LIGHT / 2 / 62e9,
            "0 -1 -2 -3 -2 -3 -4 -5 -4 -5 -6 -7",
            "-1 -1 -1 -1 0 0 0 0 -1 -1 -1 -1",
            "1 1 1 1 1 1 1 1 1 1 1 1",
        ),
    ],
)
def test_virtual_array_equals_geometry_commands(name, spacing_m, left, up, signs):
    board = device(name)
    positions = board.select_antennas(0b111, 0b1111).virtual_positions_m / spacing_m
    left, up, signs = (np.array(text.split(), float) for text in (left, up, signs))

    assert np.ptp(positions[:, 1] - left) == pytest.approx(0, abs=1e-9)
    assert np.ptp(positions[:, 2] - up) == pytest.approx(0, abs=1e-9)
    calibration = board.sign_calibration(0b111, 0b1111)
    factors = np.ones(12) if calibration is None else calibration.element_corrections()
    assert np.array_equal(factors, signs)


def test_1843aop_has_four_columns_and_three_rows():
    board = device("AWR1843AOP").select_antennas(0b111, 0b1111)

    assert column_positions(board, 78.5e9) == pytest.approx(np.tile([3, 2, 1, 0], (3, 1)))
    assert row_positions(board, 78.5e9) == pytest.approx([0, -1, -2])


def test_2243_has_antennas_of_1243():
    assert device("AWR2243").select_antennas(7, 15) == device("AWR1243").select_antennas(7, 15)


def test_sign_calibration_has_selected_receivers():
    board = device("xwr6843aop")

    assert board.sign_calibration(0b101, 0b0110).element_corrections().real.tolist() == [
        -1, 1, -1, 1,
    ]  # fmt: skip
    assert board.sign_calibration(0b1, 0b0101) is None


def test_cascade_has_86_azimuth_positions_and_seven_elevation_spacings():
    # Design guide JAJU737A: 86 azimuth positions of 9 transmitters, elevation like 7 antennas.
    board = device("cascade").select_antennas(0xFFF, 0xFFFF)
    azimuth_columns, elevation_rows = column_positions(board, 76.8e9), row_positions(board, 76.8e9)
    is_level = np.isclose(elevation_rows, 0)
    assert is_level.sum() == 9
    positions = np.unique(azimuth_columns[is_level].round(6))
    assert positions == pytest.approx(np.arange(86))
    # The four rows yield every spacing from 0 to 6 half wavelengths.
    spacings = np.unique(abs(elevation_rows[:, None] - elevation_rows[None, :]).round(6))
    assert spacings == pytest.approx(np.arange(7))


def test_bgt60_receivers_form_l_shape_of_half_wavelengths():
    rx_m = np.array(device("bgt60tr13c").rx_m)
    horizontal_m, vertical_m = rx_m[0] - rx_m[2], rx_m[1] - rx_m[2]
    assert np.linalg.norm(horizontal_m) == np.linalg.norm(vertical_m) == 2.5e-3
    assert horizontal_m @ vertical_m == 0
    # 2.5 mm is half a wavelength of 60 GHz, within 0.1 %.
    assert pytest.approx(2.5e-3, rel=1e-3) == SPEED_OF_LIGHT / 60e9 / 2


def test_positive_azimuth_yields_positive_spatial_frequency():
    board = device("xwr1443").select_antennas(0b101, 0b1111)
    azimuth_rad, wavelength_m = np.radians(30), SPEED_OF_LIGHT / 78.5e9
    target_m = 1e4 * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
    tx_m, rx_m = np.array(board.tx_m), np.array(board.rx_m)
    path_m = (
        np.linalg.norm(target_m - tx_m, axis=1)[:, None]
        + np.linalg.norm(target_m - rx_m, axis=1)[None, :]
    ).ravel()
    # Tx x conj(Rx): the phase of the beat grows with the delay.
    channels = np.exp(2j * np.pi * path_m / wavelength_m)
    peak = np.argmax(abs(np.fft.fft(channels, 1024)))
    # sin(30 deg) / 2 of a cycle from channel to channel.
    assert np.fft.fftfreq(1024)[peak] == pytest.approx(0.25, abs=1 / 1024)


def test_antenna_masks_select_antennas_in_order():
    board = device("xwr1843")
    selection = board.select_antennas(0b110, 0b1001)
    assert selection.tx_m == board.tx_m[1:]
    assert selection.rx_m == (board.rx_m[0], board.rx_m[3])


@pytest.mark.parametrize(("tx_mask", "rx_mask"), [(0, 15), (1, 0), (8, 1), (1, 16), (-1, 1)])
def test_rejects_empty_and_out_of_range_masks(tx_mask, rx_mask):
    with pytest.raises(InvalidSetting, match="mask"):
        device("xwr1843").select_antennas(tx_mask, rx_mask)


@pytest.mark.parametrize(
    ("alias", "kind"),
    [
        ("AWR1843", "xwr1843"),
        ("IWR1843", "xwr1843"),
        ("xWR18xx", "xwr1843"),
        ("xwr1843boost", "xwr1843"),
        ("AR1642", "xwr1642"),
        ("xwr16xx", "xwr1642"),
        ("xWR14xx", "xwr1443"),
        ("AR1243", "xwr1443"),
        ("AWR1243", "xwr1443"),
        ("xwr1243", "xwr1443"),
        ("xwr68xx", "xwr6843"),
        ("IWR6843ISK", "xwr6843"),
        ("IWR6443", "xwr6843"),
        ("IWR6843AOP", "xwr6843aop"),
        ("IWR6843AOPEVM-G", "xwr6843aop"),
        ("xWR68xx_AOP", "xwr6843aop"),
        ("IWR6843ISK-ODS", "xwr6843ods"),
        ("IWR6843ODS", "xwr6843ods"),
        ("AWR1843AOPEVM", "xwr1843aop"),
        ("xWR18xx_AOP", "xwr1843aop"),
        ("AWR2243BOOST", "xwr2243"),
        ("xWR22xx", "xwr2243"),
        ("xwr294x", "xwr2944"),
        ("AWR2944", "xwr2944"),
        ("MMWCAS-RF-EVM", "cascade"),
        ("Cascade", "cascade"),
        ("BGT60TR13C", "bgt60tr13c"),
    ],
)
def test_finds_device_by_any_alias(alias, kind):
    assert type(device(alias)) is Device.members()[kind]


# Boards that do not exist, and another chip.
@pytest.mark.parametrize("name", ["AWR1642AOP", "IWR1843ODS", "AWR2944AOP", "xWRL6432", "", "x"])
def test_rejects_unknown_device_and_lists_known_ones(name):
    with pytest.raises(InvalidSetting, match=r"one of bgt60tr13c, cascade, xwr1443"):
        device(name)


def make_radar(name: str, *, tx: int = 1, rx: int = 0b1111, **settings) -> Radar:
    """Return a radar with selected antennas of a device; keywords change its chirp and frame."""
    array = device(name).select_antennas(tx, rx)
    order = tuple(range(len(array.tx_m)))
    chirp = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 70e12,
        "adc_start_s": 7e-6,
        "ramp_duration_s": 57.14e-6,
        "sample_rate_hz": 5.209e6,
        "n_samples": 256,
        "sampling": "complex",
    }
    frame = {"n_chirps": 16, "interval_s": 486.14e-6, "period_s": 0.1}
    for key, number in settings.items():
        (chirp if key in chirp else frame)[key] = number
    return Radar(
        frame=Frame(
            chirp=Chirp(**chirp),
            multiplexing=Tdm(order=order) if len(order) > 1 else None,
            **frame,
        ),
        array=array,
    )


SIXTY_GHZ_SETTINGS = {
    "start_frequency_hz": 60e9,
    "slope_hz_per_s": 166e12,
    "adc_start_s": 3e-6,
    "ramp_duration_s": 24e-6,
    "sample_rate_hz": 12.5e6,
    "interval_s": 31e-6,
    "n_chirps": 32,
}
# The waveform of a demonstration kit: 5.5 GHz in 64 samples at 2 MS/s.
BGT60_SETTINGS = {
    "start_frequency_hz": 58e9,
    "slope_hz_per_s": 5.5e9 / 32e-6,
    "adc_start_s": 0.0,
    "ramp_duration_s": 32e-6,
    "sample_rate_hz": 2e6,
    "n_samples": 64,
    "sampling": "real",
    "n_chirps": 64,
    "interval_s": 591e-6,
    "period_s": 77e-3,
}
CASCADE_SETTINGS = {
    "slope_hz_per_s": 79e12,
    "adc_start_s": 6e-6,
    "ramp_duration_s": 40e-6,
    "sample_rate_hz": 8e6,
    "interval_s": 50e-6,
    "n_chirps": 64,
}
# Typical applications of each device.
TYPICAL_RADARS = {
    "xwr1443": make_radar(
        "xwr1443", tx=0b101, n_samples=240, sample_rate_hz=4.884e6, ramp_duration_s=57.13e-6
    ),
    "xwr1642": make_radar("xwr1642", tx=0b11, n_samples=240),
    "xwr1843": make_radar("xwr1843", tx=0b101),
    "xwr1843aop": make_radar("xwr1843aop", tx=0b111),
    "xwr2243": make_radar(
        "xwr2243", tx=0b101, slope_hz_per_s=250e12, ramp_duration_s=15e-6, n_samples=32
    ),
    "xwr6843aop": make_radar("xwr6843aop", tx=0b111, **SIXTY_GHZ_SETTINGS),
    "xwr6843ods": make_radar("xwr6843ods", tx=0b111, **SIXTY_GHZ_SETTINGS),
    "xwr6843": make_radar("xwr6843", tx=0b111, **SIXTY_GHZ_SETTINGS),
    "xwr2944": make_radar("xwr2944", tx=0b1111, sampling="real", sample_rate_hz=10e6),
    "cascade": make_radar("cascade", tx=0xFFF, rx=0xFFFF, **CASCADE_SETTINGS),
    "bgt60tr13c": make_radar("bgt60tr13c", rx=0b111, **BGT60_SETTINGS),
}


@pytest.mark.parametrize("name", Device.members())
def test_typical_radar_breaks_no_rule(name):
    assert device(name).find_broken_rules(TYPICAL_RADARS[name]) == ()


def check_error_settings(findings) -> list[str]:
    assert all(finding.level == "error" for finding in findings)
    return [finding.setting.removeprefix("radar.") for finding in findings]


START, SLOPE, RATE = "frame.chirp.start_frequency", "frame.chirp.slope", "frame.chirp.sample_rate"
SAMPLES, ADC, RAMP = "frame.chirp.n_samples", "frame.chirp.adc_start", "frame.chirp.ramp_duration"
SAMPLING, INTERVAL, PERIOD = "frame.chirp.sampling", "frame.interval", "frame.period"
CHIRPS = "frame.n_chirps"

# Long chirps: 2048 samples take 393 us.
LONG_CHIRP_SETTINGS = {
    "slope_hz_per_s": 5e12,
    "ramp_duration_s": 420e-6,
    "interval_s": 430e-6,
    "n_chirps": 12,
}

# Each radar breaks one rule only.
SINGLE_VIOLATIONS = [
    ("xwr1843", {"start_frequency_hz": 75.9e9}, START, "oscillator"),
    # 77.5 to 81.5 GHz.
    ("xwr1843", {"start_frequency_hz": 77.5e9}, START, "oscillator"),
    # 76.9 to 78.1 GHz is within 76 to 81 GHz, but not within one oscillator.
    ("xwr1843", {"start_frequency_hz": 76.9e9, "slope_hz_per_s": 21e12}, START, "oscillator"),
    (
        "xwr1843",
        {"slope_hz_per_s": 101e12, "n_samples": 128, "ramp_duration_s": 32e-6},
        SLOPE,
        "steeper",
    ),
    (
        "xwr6843",
        {
            **SIXTY_GHZ_SETTINGS,
            "slope_hz_per_s": 251e12,
            "n_samples": 128,
            "ramp_duration_s": 15e-6,
        },
        SLOPE,
        "steeper",
    ),
    ("xwr2944", {}, SAMPLING, "no other samples"),
    ("bgt60tr13c", {**BGT60_SETTINGS, "sampling": "complex"}, SAMPLING, "no other samples"),
    (
        "xwr1843",
        {"sample_rate_hz": 1.9e6, "n_samples": 64},
        RATE,
        "what the converter",
    ),
    ("bgt60tr13c", {**BGT60_SETTINGS, "sample_rate_hz": 3e6}, RATE, "divides its clock"),
    # The converter of an xWR1642 reaches 18.75 MS/s, its filter ends at 5 MHz.
    ("xwr1642", {"sample_rate_hz": 6.3e6}, RATE, "filter"),
    ("xwr1843", {"sample_rate_hz": 12.6e6}, RATE, "filter"),
    (
        "bgt60tr13c",
        {**BGT60_SETTINGS, "n_samples": 5462, "ramp_duration_s": 2.8e-3, "interval_s": 3e-3}
        | {"slope_hz_per_s": 1e12, "period_s": 1.0},
        SAMPLES,
        "buffer",
    ),
    # 2048 complex samples of four receivers fill 32 kB, but exceed every transform of the demo.
    ("xwr1843", {**LONG_CHIRP_SETTINGS, "n_samples": 2048}, SAMPLES, "transforms a chirp"),
    (
        "xwr6843",
        {**LONG_CHIRP_SETTINGS, "start_frequency_hz": 60.3e9, "n_samples": 1025},
        SAMPLES,
        "transforms a chirp",
    ),
    ("xwr1843", {"adc_start_s": 2.4e-6}, ADC, "straight"),
    ("xwr1843", {"adc_start_s": 0.9e-6, "slope_hz_per_s": 50e12}, ADC, "straight"),
    (
        "xwr1843",
        {"adc_start_s": 41e-6, "slope_hz_per_s": 30e12, "ramp_duration_s": 95e-6},
        ADC,
        "counts no further",
    ),
    # The last sample begins at 55.954 us and ends at 56.146 us.
    ("xwr1843", {"ramp_duration_s": 56.1e-6}, RAMP, "last sample"),
    (
        "xwr1843",
        {"slope_hz_per_s": 0.1e12, "ramp_duration_s": 5.1e-3, "interval_s": 5.2e-3}
        | {"period_s": 1.0},
        RAMP,
        "counts no further",
    ),
    # The return from 4.0 GHz takes 7 us.
    ("xwr1843", {"interval_s": 64.1e-6}, INTERVAL, "settle"),
    # The return from 0.57 GHz takes 2 us.
    ("xwr1843", {"interval_s": 59e-6, "slope_hz_per_s": 10e12}, INTERVAL, "settle"),
    ("xwr1843", {"interval_s": 5.4e-3, "period_s": 1.0}, INTERVAL, "counts no further"),
    ("xwr1843", {"n_chirps": 256, "n_samples": 128, "period_s": 0.2}, CHIRPS, "no more often"),
    # 33 chirps of three transmitters stopped a demo that runs with 32.
    ("xwr1843", {"n_chirps": 33}, CHIRPS, "Doppler transform"),
    ("xwr1642", {"n_chirps": 18}, CHIRPS, "Doppler transform"),
    ("xwr1642", {"n_chirps": 8}, CHIRPS, "at least 12"),
    ("xwr1443", {"n_chirps": 24}, CHIRPS, "power of two"),
    # 1024 samples and 64 chirps of four channels take 1 MB without the map.
    (
        "xwr1843",
        {"n_samples": 1000, "n_chirps": 64, "sample_rate_hz": 10e6, "slope_hz_per_s": 30e12}
        | {"ramp_duration_s": 110e-6},
        CHIRPS,
        "keeps the range spectra",
    ),
    ("xwr1843", {"period_s": 16 * 486.14e-6 + 299e-6}, PERIOD, "calibrates"),
    ("xwr1843", {"period_s": None}, PERIOD, "calibrates"),
    ("xwr1843", {"period_s": 1.4}, PERIOD, "counts no further"),
]


@pytest.mark.parametrize(
    ("name", "settings", "setting", "reason"),
    SINGLE_VIOLATIONS,
    ids=[f"{name} {setting} {reason}" for name, _, setting, reason in SINGLE_VIOLATIONS],
)
def test_single_violation_is_reported_with_setting_and_reason(name, settings, setting, reason):
    rx = 0b111 if name == "bgt60tr13c" else 0b1111
    findings = device(name).find_broken_rules(make_radar(name, rx=rx, **settings))
    assert check_error_settings(findings) == [setting]
    assert reason in findings[0].expected
    assert device(name).name in findings[0].expected


@pytest.mark.parametrize(
    ("name", "max_samples"), [("xwr1443", 1024), ("xwr1642", 2048), ("xwr6843", 2048)]
)
def test_chirp_is_limited_by_sample_buffer(name, max_samples):
    # Each sample takes 4 bytes of four receivers: 16 kB store 1024 samples, and later chips store
    # twice that.
    start = {"start_frequency_hz": 60.3e9 if name == "xwr6843" else 77e9}
    full_buffer_radar, overflowing_radar = (
        make_radar(name, rx=0b1111, **LONG_CHIRP_SETTINGS | start, n_samples=n)
        for n in (max_samples, max_samples + 1)
    )

    assert device(name).find_broken_rules(full_buffer_radar, demo=False) == ()
    (finding,) = device(name).find_broken_rules(overflowing_radar, demo=False)
    assert f"at most {16 * max_samples} bytes, {max_samples} samples" in finding.expected


@pytest.mark.parametrize(("side", "number"), [("tx", 4), ("rx", 5)])
def test_reports_antennas_missing_from_board(side, number):
    radar = TYPICAL_RADARS["xwr1843"]
    positions_m = tuple((0.0, 2e-3 * n, 0.0) for n in range(number))
    array = replace(radar.array, **{f"{side}_m": positions_m})
    frame = replace(radar.frame, multiplexing=Tdm(order=tuple(range(len(array.tx_m)))))
    findings = device("xwr1843").find_broken_rules(Radar(frame=frame, array=array))
    assert check_error_settings(findings) == [f"array.{side}"]


def test_excessive_sample_rate_breaks_converter_and_filter_rules():
    # Neither the converter nor the filter of an xWR1443 supports 20 MS/s.
    radar = make_radar("xwr1443", sample_rate_hz=20e6)
    assert check_error_settings(device("xwr1443").find_broken_rules(radar)) == [RATE, RATE]


def test_reports_every_broken_rule():
    radar = make_radar("xwr1843", start_frequency_hz=60e9, n_chirps=33, interval_s=58e-6)
    assert check_error_settings(device("xwr1843").find_broken_rules(radar)) == [
        START,
        INTERVAL,
        CHIRPS,
    ]


def test_demo_rules_do_not_apply_to_raw_capture():
    radar = make_radar(
        "xwr1843", tx=0b111, n_chirps=255, n_samples=512, sample_rate_hz=11e6, period_s=0.5
    )
    assert check_error_settings(device("xwr1843").find_broken_rules(radar)) == [CHIRPS, CHIRPS]
    assert device("xwr1843").find_broken_rules(radar, demo=False) == ()


def test_frame_memory_rounds_samples_up_to_power_of_two():
    # 349 samples are padded to 512; 32 chirps of 12 channels take 786432 bytes, and a map 32768.
    radar = make_radar("xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=32)
    assert device("xwr1843").find_broken_rules(radar) == ()
    # 40 chirps take 983040 bytes, and a map 65536: exactly one megabyte.
    full_memory_radar = make_radar(
        "xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=40
    )
    assert device("xwr1843").find_broken_rules(full_memory_radar) == ()
    overflowing_radar = make_radar(
        "xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=44
    )
    (finding,) = device("xwr1843").find_broken_rules(overflowing_radar)
    assert "1120 kB" in finding.value
    assert "1024 kB" in finding.expected


def test_real_samples_take_half_the_memory_of_complex_samples():
    # Half of 1024 bins, 128 chirps, 16 channels and 4 bytes: 4 MB; complex samples take 8 MB.
    radar = make_radar(
        "xwr2944",
        tx=0b1111,
        sampling="real",
        sample_rate_hz=25e6,
        n_samples=1024,
        n_chirps=128,
        period_s=0.5,
    )
    (finding,) = device("xwr2944").find_broken_rules(radar)
    assert f"{(4 * 2**20 + 512 * 128 * 2) / 1024:.5g} kB" in finding.value


def test_allows_ramp_in_either_half_of_60_ghz_band():
    for start_hz in (57e9, 60e9):
        settings = {**SIXTY_GHZ_SETTINGS, "start_frequency_hz": start_hz, "slope_hz_per_s": 150e12}
        assert device("xwr6843").find_broken_rules(make_radar("xwr6843", **settings)) == ()


def test_reference_waveform_exceeds_limits_of_xwr1843():
    # The reference has 300 MS/s, samples from the ramp start, no pause, no gap between frames, and
    # 4096 x 128 points; its band, its slope of 20 MHz/us and its one receiver are possible.
    findings = device("xwr1843").find_broken_rules(dc.reference().radar)
    assert check_error_settings(findings) == [RATE, RATE, ADC, INTERVAL, PERIOD, SAMPLES, CHIRPS]


def test_synthesiser_steps_match_data_sheets():
    limits = device("xwr1843").limits
    assert limits.frequency_step_hz == pytest.approx(53.644, abs=5e-4)
    assert limits.slope_step_hz_per_s == pytest.approx(48.279e9, abs=1e6)
    # 60 GHz chips use steps of two.
    sixty_ghz_limits = device("xwr6843").limits
    assert sixty_ghz_limits.slope_step_hz_per_s == pytest.approx(2 * 36.21e9, abs=2e6)
    assert sixty_ghz_limits.max_slope_hz_per_s == pytest.approx(250e12, rel=1e-3)


LVDS_LANES = {"xwr1443": 4, "xwr1642": 2, "xwr1843": 2, "xwr6843": 2, "xwr2944": 2, "xwr2243": 4}
LVDS_LANES |= {"xwr1843aop": 2, "xwr6843aop": 2, "xwr6843ods": 2}


@pytest.mark.parametrize("name", Device.members())
def test_number_of_lvds_lanes_matches_data_sheets(name):
    assert device(name).lvds_lanes == LVDS_LANES.get(name)


@pytest.mark.parametrize(
    ("alias", "name"),
    [("xwr1243", "AWR1243BOOST"), ("AR12xx", "AWR1243BOOST"), ("AWR1443", "xWR1443BOOST")],
)
def test_board_has_the_name_of_the_chip_of_the_user(alias, name):
    board = device(alias)
    assert board.name == name
    (rule, *_) = board.find_broken_rules(make_radar("xwr1443", tx=0b111, start_frequency_hz=60e9))
    assert name in f"{rule.value} {rule.expected}"
