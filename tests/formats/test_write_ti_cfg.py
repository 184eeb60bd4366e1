"""Writer of `.cfg` files of TI's demo: round trips, commands of each chip and SDK, limits."""

import math
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.read import read_settings
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg

KINDS = ["xwr1443", "xwr1642", "xwr1843", "xwr6843"]
STARTS_HZ = dict.fromkeys(KINDS, 77.1e9) | {"xwr6843": 60.3e9}


def make_radar(
    kind, *, order=(0, 1), tx_mask=0b11, rx_mask=0b1111, n_chirps=32, **changes
) -> Radar:
    """Make a radar that all devices support."""
    numbers = {
        "start_frequency_hz": STARTS_HZ[kind],
        "slope_hz_per_s": 29.3e12,
        "adc_start_s": 6e-6,
        "ramp_duration_s": 60e-6,
        "sample_rate_hz": 5e6,
        "n_samples": 256,
        "sampling": "complex",
    }
    chirp = Chirp(**(numbers | changes))
    frame = Frame(
        chirp=chirp,
        n_chirps=n_chirps,
        interval_s=chirp.ramp_duration_s + 20e-6,
        period_s=50e-3,
        multiplexing=Tdm(order=order) if len(order) > 1 else None,
    )
    return Radar(frame=frame, array=device(kind).select_antennas(tx_mask, rx_mask))


def parse_numbers(text, command):
    (line,) = [line for line in text.splitlines() if line.startswith(f"{command} ")]
    return [float(word) for word in line.split()[1:]]


@pytest.fixture(scope="module")
def reread_text(tmp_path_factory):
    """Return a function that writes a text and reads its settings."""
    folder = tmp_path_factory.mktemp("written")

    def read_text(text):
        (folder / "radar.cfg").write_text(text)
        return read_settings(folder / "radar.cfg")

    return read_text


BPM_MULTIPLEXING = Bpm(order=(0, 1))
SDKS = [(kind, 3) for kind in KINDS] + [("xwr1443", 1), ("xwr1443", 2), ("xwr1642", 2)]


@pytest.mark.parametrize(("kind", "sdk"), SDKS)
def test_round_trip_of_decimal_values_is_exact(reread_text, kind, sdk):
    radar = make_radar(kind)

    settings = reread_text(format_ti_cfg(radar, device=kind, n_frames=7, sdk=sdk))

    assert settings.radar == radar
    assert (settings.n_frames, settings.device) == (7, kind)
    assert settings.is_interleaved == (kind == "xwr1443")
    assert settings.findings == ()


@pytest.mark.parametrize(
    ("order", "tx_mask", "rx_mask"),
    [((0,), 0b100, 0b1111), ((0, 1), 0b101, 0b0110), ((2, 0, 1), 0b111, 0b1000)],
)
def test_cfg_masks_match_array(reread_text, order, tx_mask, rx_mask):
    radar = make_radar("xwr1843", order=order, tx_mask=tx_mask, rx_mask=rx_mask)

    text = format_ti_cfg(radar, device="AWR1843")

    assert parse_numbers(text, "channelCfg") == [rx_mask, tx_mask, 0]
    assert reread_text(text).radar == radar


def test_shifted_array_gives_equal_cfg(reread_text):
    radar = make_radar("xwr1843", tx_mask=0b101)
    shifted_rx_m = tuple((x + 0.1, y - 0.2, z + 1.0) for x, y, z in radar.array.rx_m)
    shifted_radar = replace(radar, array=replace(radar.array, rx_m=shifted_rx_m))

    assert format_ti_cfg(shifted_radar, device="xwr1843") == format_ti_cfg(radar, device="xwr1843")


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_round_trip_error_is_within_one_chip_step(reread_text, data, kind):
    limits = device(kind).limits

    def draw_float(low, high):
        return data.draw(st.floats(low, high))

    radar = make_radar(
        kind,
        start_frequency_hz=STARTS_HZ[kind] + draw_float(0, 0.5e9),
        slope_hz_per_s=draw_float(5e12, 40e12),
        adc_start_s=draw_float(3e-6, 8e-6),
        ramp_duration_s=draw_float(62e-6, 70e-6),
        sample_rate_hz=draw_float(4.8e6, 5.5e6),
    )
    frame = replace(
        radar.frame,
        interval_s=radar.frame.interval_s + draw_float(0, 1e-4),
        period_s=draw_float(20e-3, 200e-3),
    )
    radar = replace(radar, frame=frame)
    assume(not device(kind).find_broken_rules(radar))

    read_radar = reread_text(format_ti_cfg(radar, device=kind)).radar
    reread_radar = reread_text(format_ti_cfg(read_radar, device=kind)).radar

    chirp, read_chirp = radar.frame.chirp, read_radar.frame.chirp
    for value, expected, step in [
        (read_chirp.start_frequency_hz, chirp.start_frequency_hz, limits.frequency_step_hz),
        (read_chirp.slope_hz_per_s, chirp.slope_hz_per_s, limits.slope_step_hz_per_s),
        (read_chirp.adc_start_s, chirp.adc_start_s, limits.time_step_s),
        (read_chirp.ramp_duration_s, chirp.ramp_duration_s, limits.time_step_s),
        (read_chirp.sample_rate_hz, chirp.sample_rate_hz, limits.sample_rate_step_hz),
        (read_radar.frame.interval_s, radar.frame.interval_s, limits.time_step_s),
        (read_radar.frame.period_s, radar.frame.period_s, limits.period_step_s),
    ]:
        assert abs(value - expected) <= step * (1 + 1e-6)
    assert (read_chirp.n_samples, read_radar.frame.n_chirps) == (
        chirp.n_samples,
        radar.frame.n_chirps,
    )
    assert read_radar.array == radar.array
    assert reread_radar == read_radar


@given(start=st.integers(1437252998, 1455893897), slope=st.integers(100, 1200))
def test_multiples_of_chip_step_are_written_exactly(start, slope):
    # 77.1 to 78.1 GHz in steps of 53.644 Hz. The demo truncates numbers to whole steps, so a
    # number that is slightly too small would end one step below.
    limits = device("xwr1642").limits
    radar = make_radar(
        "xwr1642",
        start_frequency_hz=start * limits.frequency_step_hz,
        slope_hz_per_s=slope * limits.slope_step_hz_per_s,
        ramp_duration_s=57.4e-6,
    )
    assume(not device("xwr1642").find_broken_rules(radar))

    numbers = parse_numbers(format_ti_cfg(radar, device="xwr1642"), "profileCfg")

    assert math.floor(numbers[1] * 2**26 / 3.6) == start
    assert math.floor(numbers[7] * 2**26 / (3.6e3 * 900)) == slope


def test_sdk_3_cfg_has_all_visualizer_commands():
    text = format_ti_cfg(make_radar("xwr1843"), device="xwr1843")

    commands = [line.split()[0] for line in text.splitlines() if not line.startswith("%")]
    expected = """
        sensorStop flushCfg dfeDataOutputMode channelCfg adcCfg adcbufCfg profileCfg chirpCfg
        frameCfg lowPower guiMonitor cfarCfg multiObjBeamForming clutterRemoval calibDcRangeSig
        extendedMaxVelocity lvdsStreamCfg compRangeBiasAndRxChanPhase CQRxSatMonitor
        measureRangeBiasAndRxChanPhase CQSigImgMonitor analogMonitor aoaFovCfg cfarFovCfg
        calibData sensorStart"""
    assert set(expected.split()) == set(commands)
    assert commands[-1] == "sensorStart"
    assert len(parse_numbers(text, "compRangeBiasAndRxChanPhase")) == 1 + 2 * 12  # 3 tx, 4 rx


def test_dsp_demos_have_bpm_command_disabled():
    # mss_main.c of xwr16xx and xwr68xx requires bpmCfg; xwr18xx does not have this command.
    has_bpm_command = {
        kind: "bpmCfg -1 0 0 1" in format_ti_cfg(make_radar(kind), device=kind) for kind in KINDS
    }

    assert has_bpm_command == {"xwr1443": False, "xwr1642": True, "xwr1843": False, "xwr6843": True}


@pytest.mark.parametrize(
    ("kind", "sdk", "layout", "low_power"),
    [
        ("xwr1443", 2, [0, 1, 0, 1], 0),
        ("xwr1642", 2, [-1, 0, 0, 1, 1], 1),
        ("xwr1642", 3, [-1, 0, 1, 1, 1], 1),
        ("xwr1843", 3, [-1, 0, 1, 1, 1], 0),
        ("xwr6843", 3, [-1, 0, 1, 1, 1], 0),
    ],
)
def test_sample_layout_matches_demo(kind, sdk, layout, low_power):
    # Layouts of the visualizer: I first only in the first demos with DSP.
    text = format_ti_cfg(make_radar(kind), device=kind, sdk=sdk)

    assert parse_numbers(text, "adcbufCfg") == layout
    assert parse_numbers(text, "lowPower") == [0, low_power]


@pytest.mark.parametrize(("kind", "last_bin"), [("xwr1443", 229), ("xwr1642", 255)])
def test_peak_grouping_covers_fft_bins(kind, last_bin):
    # 240 samples give 256 bins; all files for 14xx chips contain 229.
    text = format_ti_cfg(make_radar(kind, n_samples=240), device=kind, sdk=2)

    assert parse_numbers(text, "peakGrouping")[-1] == last_bin


@pytest.mark.parametrize(("n_samples", "rate_hz"), [(256, 5.209e6), (272, 2.559e6), (64, 12.5e6)])
def test_monitor_slices_fit_in_chirp(n_samples, rate_hz):
    radar = make_radar(
        "xwr1843",
        n_samples=n_samples,
        sample_rate_hz=rate_hz,
        ramp_duration_s=7e-6 + n_samples / rate_hz,
        slope_hz_per_s=8e12,
    )

    text = format_ti_cfg(radar, device="xwr1843")

    _, _, ticks, n_long, _ = parse_numbers(text, "CQRxSatMonitor")
    _, n_even, samples = parse_numbers(text, "CQSigImgMonitor")
    assert (n_long + 1) / 2 * ticks * 0.16e-6 <= n_samples / rate_hz
    assert (n_even + 1) / 2 * samples <= n_samples
    assert n_long <= 127
    assert n_even <= 127


def test_error_lists_every_broken_device_rule():
    radar = make_radar("xwr1443", slope_hz_per_s=110e12, n_chirps=33, ramp_duration_s=58e-6)

    with pytest.raises(DechirpError) as error:
        format_ti_cfg(radar, device="xwr1443")

    settings = {mistake.setting for mistake in error.value.mistakes}
    assert {"radar.frame.chirp.slope", "radar.frame.n_chirps"} <= settings


@pytest.mark.parametrize(
    ("radar", "device_name", "setting"),
    [
        (replace(make_radar("xwr1843"), array=Array(tx_m=[(0, 0, 0), (0, 1, 0)])),
         "xwr1843", "tx_m"),
        (replace(make_radar("xwr1443"), frame=replace(make_radar("xwr1443").frame, period_s=None)),
         "xwr1443", "period_s"),
        (make_radar("xwr1843", sampling="real"), "xwr1843", "sampling"),
        (replace(make_radar("xwr1642"),
                 frame=replace(make_radar("xwr1642").frame, multiplexing=BPM_MULTIPLEXING)),
         "xwr1642", "multiplexing"),
        (make_radar("xwr1843"), "xwr2944", "device"),
        (make_radar("xwr1843"), "bgt60tr13c", "device"),
        (make_radar("xwr1843"), "no such chip", "device"),
    ],
)  # fmt: skip
def test_rejects_radar_that_demo_does_not_support(radar, device_name, setting):
    with pytest.raises(InvalidSetting) as error:
        format_ti_cfg(radar, device=device_name)

    assert error.value.mistakes[0].setting.endswith(setting)


def test_rejects_reordered_receivers():
    radar = make_radar("xwr1843")
    reversed_radar = replace(radar, array=replace(radar.array, rx_m=radar.array.rx_m[::-1]))

    with pytest.raises(InvalidSetting, match="receivers 4, 3, 2, 1"):
        format_ti_cfg(reversed_radar, device="xwr1843")


def test_rejects_sdk_without_demo_for_chip():
    with pytest.raises(InvalidSetting, match="sdk: 2; expected 3"):
        format_ti_cfg(make_radar("xwr6843"), device="xwr6843", sdk=2)
    with pytest.raises(InvalidSetting, match="n_frames"):
        format_ti_cfg(make_radar("xwr6843"), device="xwr6843", n_frames=-1)
