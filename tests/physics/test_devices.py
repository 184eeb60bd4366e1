"""What known chips allow, and where the antennas of their boards are."""

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


def columns(array: Array, design_hz: float) -> np.ndarray:
    """Sum of the columns of each transmitter and receiver, in half wavelengths, (tx, rx)."""
    half_m = SPEED_OF_LIGHT / (2 * design_hz)
    tx, rx = np.array(array.tx_m), np.array(array.rx_m)
    return -(tx[:, None, 1] + rx[None, :, 1]) / half_m


def rows(array: Array, design_hz: float) -> np.ndarray:
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
def test_two_azimuth_transmitters_make_a_uniform_line_of_eight(name, tx_mask, design_hz):
    line = columns(device(name).select_antennas(tx_mask, 0b1111), design_hz)
    assert line.ravel() == pytest.approx(np.arange(8))


def test_the_first_and_the_last_azimuth_transmitters_of_the_2944_make_a_line_of_twelve():
    line = columns(device("xwr2944").select_antennas(0b1101, 0b1111), 78.5e9)
    assert line.ravel() == pytest.approx(np.arange(12))


@pytest.mark.parametrize(
    ("name", "design_hz"), [("xwr1443", 78.5e9), ("xwr1843", 78.5e9), ("xwr6843", 62e9)]
)
def test_the_second_transmitter_is_between_the_others_and_half_a_wavelength_above(name, design_hz):
    board = device(name).select_antennas(0b111, 0b1111)
    assert columns(board, design_hz)[:, 0] == pytest.approx([0, 2, 4])
    assert rows(board, design_hz) == pytest.approx([0, 1, 0])


def test_the_cascade_has_86_places_in_azimuth_and_seven_rows_in_elevation():
    # Design guide JAJU737A: 86 azimuth positions of 9 transmitters, elevation like 7 antennas.
    board = device("cascade").select_antennas(0xFFF, 0xFFFF)
    along, up = columns(board, 76.8e9), rows(board, 76.8e9)
    level = np.isclose(up, 0)
    assert level.sum() == 9
    places = np.unique(along[level].round(6))
    assert places == pytest.approx(np.arange(86))
    # The four rows make every spacing from 0 to 6 half wavelengths.
    spacings = np.unique(abs(up[:, None] - up[None, :]).round(6))
    assert spacings == pytest.approx(np.arange(7))


def test_the_receivers_of_the_bgt60_are_an_l_of_half_wavelengths():
    rx_m = np.array(device("bgt60tr13c").rx_m)
    beside, above = rx_m[0] - rx_m[2], rx_m[1] - rx_m[2]
    assert np.linalg.norm(beside) == np.linalg.norm(above) == 2.5e-3
    assert beside @ above == 0
    # 2.5 mm is half a wavelength of 60 GHz, within 0.1 %.
    assert pytest.approx(2.5e-3, rel=1e-3) == SPEED_OF_LIGHT / 60e9 / 2


def test_positive_azimuth_is_positive_spatial_frequency_over_the_channels():
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


def test_a_part_keeps_the_antennas_of_the_masks_in_their_order():
    board = device("xwr1843")
    part = board.select_antennas(0b110, 0b1001)
    assert part.tx_m == board.tx_m[1:]
    assert part.rx_m == (board.rx_m[0], board.rx_m[3])


@pytest.mark.parametrize(("tx_mask", "rx_mask"), [(0, 15), (1, 0), (8, 1), (1, 16), (-1, 1)])
def test_masks_of_no_antenna_or_of_one_that_is_not_there_are_refused(tx_mask, rx_mask):
    with pytest.raises(InvalidSetting, match="mask"):
        device("xwr1843").select_antennas(tx_mask, rx_mask)


@pytest.mark.parametrize(
    ("spelled", "kind"),
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
        ("xwr68xx", "xwr6843"),
        ("IWR6843ISK", "xwr6843"),
        ("xwr294x", "xwr2944"),
        ("AWR2944", "xwr2944"),
        ("MMWCAS-RF-EVM", "cascade"),
        ("Cascade", "cascade"),
        ("BGT60TR13C", "bgt60tr13c"),
    ],
)
def test_a_device_is_found_however_it_is_spelled(spelled, kind):
    assert type(device(spelled)) is Device.members()[kind]


# Of these, the first three have the chip but other antennas, the fourth is another chip.
@pytest.mark.parametrize("name", ["IWR6843AOP", "xwr68xx_AOP", "IWR6843ODS", "xWRL6432", "", "x"])
def test_a_device_that_is_not_known_is_refused_with_those_that_are(name):
    with pytest.raises(InvalidSetting, match=r"one of bgt60tr13c, cascade, xwr1443"):
        device(name)


def radar_on(name: str, *, tx: int = 1, rx: int = 0b1111, **settings) -> Radar:
    """A radar of some of the antennas of a device; keywords change its chirp and frame."""
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


SIXTY = {
    "start_frequency_hz": 60e9,
    "slope_hz_per_s": 166e12,
    "adc_start_s": 3e-6,
    "ramp_duration_s": 24e-6,
    "sample_rate_hz": 12.5e6,
    "interval_s": 31e-6,
    "n_chirps": 32,
}
# 5.5 GHz in 64 samples at 2 MS/s, as a demonstration kit sends it.
BGT60 = {
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
CASCADE = {
    "slope_hz_per_s": 79e12,
    "adc_start_s": 6e-6,
    "ramp_duration_s": 40e-6,
    "sample_rate_hz": 8e6,
    "interval_s": 50e-6,
    "n_chirps": 64,
}
# What each is used for in practice.
TYPICAL = {
    "xwr1443": radar_on(
        "xwr1443", tx=0b101, n_samples=240, sample_rate_hz=4.884e6, ramp_duration_s=57.13e-6
    ),
    "xwr1642": radar_on("xwr1642", tx=0b11, n_samples=240),
    "xwr1843": radar_on("xwr1843", tx=0b101),
    "xwr6843": radar_on("xwr6843", tx=0b111, **SIXTY),
    "xwr2944": radar_on("xwr2944", tx=0b1111, sampling="real", sample_rate_hz=10e6),
    "cascade": radar_on("cascade", tx=0xFFF, rx=0xFFFF, **CASCADE),
    "bgt60tr13c": radar_on("bgt60tr13c", rx=0b111, **BGT60),
}


@pytest.mark.parametrize("name", Device.members())
def test_a_typical_radar_breaks_no_rule(name):
    assert device(name).find_broken_rules(TYPICAL[name]) == ()


def settings_of(findings) -> list[str]:
    assert all(finding.level == "error" for finding in findings)
    return [finding.setting.removeprefix("radar.") for finding in findings]


START, SLOPE, RATE = "frame.chirp.start_frequency", "frame.chirp.slope", "frame.chirp.sample_rate"
SAMPLES, ADC, RAMP = "frame.chirp.n_samples", "frame.chirp.adc_start", "frame.chirp.ramp_duration"
SAMPLING, INTERVAL, PERIOD = "frame.chirp.sampling", "frame.interval", "frame.period"
CHIRPS = "frame.n_chirps"

# Room for many samples: 2048 take 393 us.
LONG = {"slope_hz_per_s": 5e12, "ramp_duration_s": 420e-6, "interval_s": 430e-6, "n_chirps": 12}

# Each breaks one rule and keeps all others.
ONE_BROKEN = [
    ("xwr1843", {"start_frequency_hz": 75.9e9}, START, "oscillator"),
    # 77.5 to 81.5 GHz.
    ("xwr1843", {"start_frequency_hz": 77.5e9}, START, "oscillator"),
    # 76.9 to 78.1 GHz is within 76 to 81 GHz, but within neither oscillator.
    ("xwr1843", {"start_frequency_hz": 76.9e9, "slope_hz_per_s": 21e12}, START, "oscillator"),
    (
        "xwr1843",
        {"slope_hz_per_s": 101e12, "n_samples": 128, "ramp_duration_s": 32e-6},
        SLOPE,
        "steeper",
    ),
    (
        "xwr6843",
        {**SIXTY, "slope_hz_per_s": 251e12, "n_samples": 128, "ramp_duration_s": 15e-6},
        SLOPE,
        "steeper",
    ),
    ("xwr2944", {}, SAMPLING, "no other samples"),
    ("bgt60tr13c", {**BGT60, "sampling": "complex"}, SAMPLING, "no other samples"),
    (
        "xwr1843",
        {"sample_rate_hz": 1.9e6, "n_samples": 64},
        RATE,
        "what the converter",
    ),
    ("bgt60tr13c", {**BGT60, "sample_rate_hz": 3e6}, RATE, "divides its clock"),
    # The converter of an xWR1642 does 18.75 MS/s, its filter ends at 5 MHz.
    ("xwr1642", {"sample_rate_hz": 6.3e6}, RATE, "filter"),
    ("xwr1843", {"sample_rate_hz": 12.6e6}, RATE, "filter"),
    (
        "bgt60tr13c",
        {**BGT60, "n_samples": 5462, "ramp_duration_s": 2.8e-3, "interval_s": 3e-3}
        | {"slope_hz_per_s": 1e12, "period_s": 1.0},
        SAMPLES,
        "buffer",
    ),
    # 2048 complex samples of four receivers fill 32 kB, but no transform of the demo.
    ("xwr1843", {**LONG, "n_samples": 2048}, SAMPLES, "transforms a chirp"),
    (
        "xwr6843",
        {**LONG, "start_frequency_hz": 60.3e9, "n_samples": 1025},
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
    # 4.0 GHz takes 7 us to return from.
    ("xwr1843", {"interval_s": 64.1e-6}, INTERVAL, "settle"),
    # 0.57 GHz takes 2 us.
    ("xwr1843", {"interval_s": 59e-6, "slope_hz_per_s": 10e12}, INTERVAL, "settle"),
    ("xwr1843", {"interval_s": 5.4e-3, "period_s": 1.0}, INTERVAL, "counts no further"),
    ("xwr1843", {"n_chirps": 256, "n_samples": 128, "period_s": 0.2}, CHIRPS, "no more often"),
    # 33 of three transmitters stopped a demo for which 32 worked.
    ("xwr1843", {"n_chirps": 33}, CHIRPS, "Doppler transform"),
    ("xwr1642", {"n_chirps": 18}, CHIRPS, "Doppler transform"),
    ("xwr1642", {"n_chirps": 8}, CHIRPS, "at least 12"),
    ("xwr1443", {"n_chirps": 24}, CHIRPS, "power of two"),
    # 1024 samples, 64 chirps of four channels: 1 MB without the map.
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
    ONE_BROKEN,
    ids=[f"{name} {setting} {reason}" for name, _, setting, reason in ONE_BROKEN],
)
def test_a_radar_that_breaks_one_rule_is_told_that_rule_and_why(name, settings, setting, reason):
    rx = 0b111 if name == "bgt60tr13c" else 0b1111
    found = device(name).find_broken_rules(radar_on(name, rx=rx, **settings))
    assert settings_of(found) == [setting]
    assert reason in found[0].expected
    assert device(name).name in found[0].expected


@pytest.mark.parametrize(
    ("name", "most"), [("xwr1443", 1024), ("xwr1642", 2048), ("xwr6843", 2048)]
)
def test_a_chirp_fits_into_the_buffer_of_its_chip(name, most):
    # 4 bytes of four receivers: 16 kB hold 1024 samples, and those of later chips twice that.
    start = {"start_frequency_hz": 60.3e9 if name == "xwr6843" else 77e9}
    full, too_long = (
        radar_on(name, rx=0b1111, **LONG | start, n_samples=n) for n in (most, most + 1)
    )

    assert device(name).find_broken_rules(full, demo=False) == ()
    (found,) = device(name).find_broken_rules(too_long, demo=False)
    assert f"at most {16 * most} bytes, {most} samples" in found.expected


@pytest.mark.parametrize(("side", "number"), [("tx", 4), ("rx", 5)])
def test_antennas_that_a_board_does_not_have_are_named(side, number):
    radar = TYPICAL["xwr1843"]
    spots = tuple((0.0, 2e-3 * n, 0.0) for n in range(number))
    array = replace(radar.array, **{f"{side}_m": spots})
    frame = replace(radar.frame, multiplexing=Tdm(order=tuple(range(len(array.tx_m)))))
    found = device("xwr1843").find_broken_rules(Radar(frame=frame, array=array))
    assert settings_of(found) == [f"array.{side}"]


def test_a_converter_that_is_too_slow_is_told_its_range_too():
    # At 20 MS/s neither the converter nor the filter of an xWR1443 follows.
    radar = radar_on("xwr1443", sample_rate_hz=20e6)
    assert settings_of(device("xwr1443").find_broken_rules(radar)) == [RATE, RATE]


def test_every_broken_rule_is_named_at_once():
    radar = radar_on("xwr1843", start_frequency_hz=60e9, n_chirps=33, interval_s=58e-6)
    assert settings_of(device("xwr1843").find_broken_rules(radar)) == [START, INTERVAL, CHIRPS]


def test_rules_of_the_demo_do_not_bind_a_capture_of_raw_samples():
    radar = radar_on(
        "xwr1843", tx=0b111, n_chirps=255, n_samples=512, sample_rate_hz=11e6, period_s=0.5
    )
    assert settings_of(device("xwr1843").find_broken_rules(radar)) == [CHIRPS, CHIRPS]
    assert device("xwr1843").find_broken_rules(radar, demo=False) == ()


def test_the_memory_of_a_frame_counts_samples_as_their_next_power_of_two():
    # 349 samples become 512; 32 chirps of 12 channels: 786432 bytes, and a map of 32768.
    radar = radar_on("xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=32)
    assert device("xwr1843").find_broken_rules(radar) == ()
    # 40 chirps: 983040 bytes, and a map of 65536: exactly the megabyte.
    full = radar_on("xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=40)
    assert device("xwr1843").find_broken_rules(full) == ()
    more = radar_on("xwr1843", tx=0b111, n_samples=349, sample_rate_hz=10e6, n_chirps=44)
    (found,) = device("xwr1843").find_broken_rules(more)
    assert "1120 kB" in found.value
    assert "1024 kB" in found.expected


def test_real_samples_take_half_the_memory_of_complex_ones():
    # Half of 1024 bins, 128 chirps, 16 channels, 4 bytes: 4 MB; complex ones would take 8.
    radar = radar_on(
        "xwr2944",
        tx=0b1111,
        sampling="real",
        sample_rate_hz=25e6,
        n_samples=1024,
        n_chirps=128,
        period_s=0.5,
    )
    (found,) = device("xwr2944").find_broken_rules(radar)
    assert f"{(4 * 2**20 + 512 * 128 * 2) / 1024:.5g} kB" in found.value


def test_a_ramp_in_either_half_of_the_60_gigahertz_band_is_allowed():
    for start_hz in (57e9, 60e9):
        lower = {**SIXTY, "start_frequency_hz": start_hz, "slope_hz_per_s": 150e12}
        assert device("xwr6843").find_broken_rules(radar_on("xwr6843", **lower)) == ()


def test_the_reference_waveform_is_beyond_the_chip_it_is_likened_to():
    # 300 MS/s, sampled from the start of ramps without a pause, in frames without a gap, of
    # 4096 x 128 points; its band, its slope of 20 MHz/us and its one receiver are possible.
    found = device("xwr1843").find_broken_rules(dc.reference().radar)
    assert settings_of(found) == [RATE, RATE, ADC, INTERVAL, PERIOD, SAMPLES, CHIRPS]


def test_settings_are_kept_in_the_steps_of_the_synthesiser():
    limits = device("xwr1843").limits
    assert limits.frequency_step_hz == pytest.approx(53.644, abs=5e-4)
    assert limits.slope_step_hz_per_s == pytest.approx(48.279e9, abs=1e6)
    # 60 GHz chips count in twos.
    sixty = device("xwr6843").limits
    assert sixty.slope_step_hz_per_s == pytest.approx(2 * 36.21e9, abs=2e6)
    assert sixty.max_slope_hz_per_s == pytest.approx(250e12, rel=1e-3)


LANES = {"xwr1443": 4, "xwr1642": 2, "xwr1843": 2, "xwr6843": 2, "xwr2944": 2}


@pytest.mark.parametrize("name", Device.members())
def test_raw_samples_leave_over_so_many_lanes(name):
    assert device(name).lvds_lanes == LANES.get(name)
