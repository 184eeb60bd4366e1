"""A radar written as a `.cfg` of TI's demo, and read back, is the same radar."""

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


def radar(kind, *, order=(0, 1), tx_mask=0b11, rx_mask=0b1111, n_chirps=32, **changes) -> Radar:
    """Make a radar that every one of the devices can be."""
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


def numbers_of(text, command):
    (line,) = [line for line in text.splitlines() if line.startswith(f"{command} ")]
    return [float(word) for word in line.split()[1:]]


@pytest.fixture(scope="module")
def read_back(tmp_path_factory):
    """Write a text and read it."""
    folder = tmp_path_factory.mktemp("written")

    def read(text):
        (folder / "radar.cfg").write_text(text)
        return read_settings(folder / "radar.cfg")

    return read


SIGNS = Bpm(order=(0, 1))
SDKS = [(kind, 3) for kind in KINDS] + [("xwr1443", 1), ("xwr1443", 2), ("xwr1642", 2)]


@pytest.mark.parametrize(("kind", "sdk"), SDKS)
def test_a_radar_in_decimals_comes_back_as_it_was(read_back, kind, sdk):
    made = radar(kind)

    settings = read_back(format_ti_cfg(made, device=kind, n_frames=7, sdk=sdk))

    assert settings.radar == made
    assert (settings.n_frames, settings.device) == (7, kind)
    assert settings.is_interleaved == (kind == "xwr1443")
    assert settings.findings == ()


@pytest.mark.parametrize(
    ("order", "tx_mask", "rx_mask"),
    [((0,), 0b100, 0b1111), ((0, 1), 0b101, 0b0110), ((2, 0, 1), 0b111, 0b1000)],
)
def test_masks_are_those_of_the_antennas_in_the_array(read_back, order, tx_mask, rx_mask):
    made = radar("xwr1843", order=order, tx_mask=tx_mask, rx_mask=rx_mask)

    text = format_ti_cfg(made, device="AWR1843")

    assert numbers_of(text, "channelCfg") == [rx_mask, tx_mask, 0]
    assert read_back(text).radar == made


def test_an_array_elsewhere_is_that_of_the_device_if_its_shape_is(read_back):
    made = radar("xwr1843", tx_mask=0b101)
    moved = tuple((x + 0.1, y - 0.2, z + 1.0) for x, y, z in made.array.rx_m)
    elsewhere = replace(made, array=replace(made.array, rx_m=moved))

    assert format_ti_cfg(elsewhere, device="xwr1843") == format_ti_cfg(made, device="xwr1843")


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_every_value_comes_back_within_a_step_of_the_chip(read_back, data, kind):
    limits = device(kind).limits

    def between(low, high):
        return data.draw(st.floats(low, high))

    made = radar(
        kind,
        start_frequency_hz=STARTS_HZ[kind] + between(0, 0.5e9),
        slope_hz_per_s=between(5e12, 40e12),
        adc_start_s=between(3e-6, 8e-6),
        ramp_duration_s=between(62e-6, 70e-6),
        sample_rate_hz=between(4.8e6, 5.5e6),
    )
    frame = replace(
        made.frame,
        interval_s=made.frame.interval_s + between(0, 1e-4),
        period_s=between(20e-3, 200e-3),
    )
    made = replace(made, frame=frame)
    assume(not device(kind).find_broken_rules(made))

    back = read_back(format_ti_cfg(made, device=kind)).radar
    again = read_back(format_ti_cfg(back, device=kind)).radar

    chirp, chirp_back = made.frame.chirp, back.frame.chirp
    for got, sent, step in [
        (chirp_back.start_frequency_hz, chirp.start_frequency_hz, limits.frequency_step_hz),
        (chirp_back.slope_hz_per_s, chirp.slope_hz_per_s, limits.slope_step_hz_per_s),
        (chirp_back.adc_start_s, chirp.adc_start_s, limits.time_step_s),
        (chirp_back.ramp_duration_s, chirp.ramp_duration_s, limits.time_step_s),
        (chirp_back.sample_rate_hz, chirp.sample_rate_hz, limits.sample_rate_step_hz),
        (back.frame.interval_s, made.frame.interval_s, limits.time_step_s),
        (back.frame.period_s, made.frame.period_s, limits.period_step_s),
    ]:
        assert abs(got - sent) <= step * (1 + 1e-6)
    assert (chirp_back.n_samples, back.frame.n_chirps) == (chirp.n_samples, made.frame.n_chirps)
    assert back.array == made.array
    assert again == back


@given(start=st.integers(1437252998, 1455893897), slope=st.integers(100, 1200))
def test_what_the_chip_can_count_it_counts(start, slope):
    # 77.1 to 78.1 GHz in steps of 53.644 Hz. The demo turns numbers into steps by leaving
    # out the fraction: a number a little too small would end one step below.
    limits = device("xwr1642").limits
    made = radar(
        "xwr1642",
        start_frequency_hz=start * limits.frequency_step_hz,
        slope_hz_per_s=slope * limits.slope_step_hz_per_s,
        ramp_duration_s=57.4e-6,
    )
    assume(not device("xwr1642").find_broken_rules(made))

    numbers = numbers_of(format_ti_cfg(made, device="xwr1642"), "profileCfg")

    assert math.floor(numbers[1] * 2**26 / 3.6) == start
    assert math.floor(numbers[7] * 2**26 / (3.6e3 * 900)) == slope


def test_the_demo_of_sdk_3_is_told_all_that_its_visualizer_tells_it():
    text = format_ti_cfg(radar("xwr1843"), device="xwr1843")

    commands = [line.split()[0] for line in text.splitlines() if not line.startswith("%")]
    expected = """
        sensorStop flushCfg dfeDataOutputMode channelCfg adcCfg adcbufCfg profileCfg chirpCfg
        frameCfg lowPower guiMonitor cfarCfg multiObjBeamForming clutterRemoval calibDcRangeSig
        extendedMaxVelocity lvdsStreamCfg compRangeBiasAndRxChanPhase CQRxSatMonitor
        measureRangeBiasAndRxChanPhase CQSigImgMonitor analogMonitor aoaFovCfg cfarFovCfg
        calibData sensorStart"""
    assert set(expected.split()) == set(commands)
    assert commands[-1] == "sensorStart"
    assert len(numbers_of(text, "compRangeBiasAndRxChanPhase")) == 1 + 2 * 12  # 3 tx, 4 rx


def test_demos_that_run_on_the_dsp_are_also_told_that_no_code_is_sent():
    # mss_main.c of xwr16xx and xwr68xx refuses to start without bpmCfg; xwr18xx knows none.
    told = {kind: "bpmCfg -1 0 0 1" in format_ti_cfg(radar(kind), device=kind) for kind in KINDS}

    assert told == {"xwr1443": False, "xwr1642": True, "xwr1843": False, "xwr6843": True}


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
def test_samples_come_as_the_demo_of_the_chip_takes_them(kind, sdk, layout, low_power):
    # As the visualizer writes them: I first for the DSP of the first demos alone.
    text = format_ti_cfg(radar(kind), device=kind, sdk=sdk)

    assert numbers_of(text, "adcbufCfg") == layout
    assert numbers_of(text, "lowPower") == [0, low_power]


@pytest.mark.parametrize(("kind", "last_bin"), [("xwr1443", 229), ("xwr1642", 255)])
def test_peaks_are_grouped_over_the_bins_of_the_transform(kind, last_bin):
    # 240 samples are transformed to 256 bins; 229 is in every file for 14xx chips.
    text = format_ti_cfg(radar(kind, n_samples=240), device=kind, sdk=2)

    assert numbers_of(text, "peakGrouping")[-1] == last_bin


@pytest.mark.parametrize(("n_samples", "rate_hz"), [(256, 5.209e6), (272, 2.559e6), (64, 12.5e6)])
def test_slices_of_the_monitors_fit_into_a_chirp(n_samples, rate_hz):
    made = radar(
        "xwr1843",
        n_samples=n_samples,
        sample_rate_hz=rate_hz,
        ramp_duration_s=7e-6 + n_samples / rate_hz,
        slope_hz_per_s=8e12,
    )

    text = format_ti_cfg(made, device="xwr1843")

    _, _, ticks, n_long, _ = numbers_of(text, "CQRxSatMonitor")
    _, n_even, samples = numbers_of(text, "CQSigImgMonitor")
    assert (n_long + 1) / 2 * ticks * 0.16e-6 <= n_samples / rate_hz
    assert (n_even + 1) / 2 * samples <= n_samples
    assert n_long <= 127
    assert n_even <= 127


def test_every_broken_rule_of_the_device_is_told():
    made = radar("xwr1443", slope_hz_per_s=110e12, n_chirps=33, ramp_duration_s=58e-6)

    with pytest.raises(DechirpError) as error:
        format_ti_cfg(made, device="xwr1443")

    told = {mistake.setting for mistake in error.value.mistakes}
    assert {"radar.frame.chirp.slope", "radar.frame.n_chirps"} <= told


@pytest.mark.parametrize(
    ("made", "of", "setting"),
    [
        (replace(radar("xwr1843"), array=Array(tx_m=[(0, 0, 0), (0, 1, 0)])), "xwr1843", "tx_m"),
        (replace(radar("xwr1443"), frame=replace(radar("xwr1443").frame, period_s=None)),
         "xwr1443", "period_s"),
        (radar("xwr1843", sampling="real"), "xwr1843", "sampling"),
        (replace(radar("xwr1642"), frame=replace(radar("xwr1642").frame, multiplexing=SIGNS)),
         "xwr1642", "multiplexing"),
        (radar("xwr1843"), "xwr2944", "device"),
        (radar("xwr1843"), "bgt60tr13c", "device"),
        (radar("xwr1843"), "no such chip", "device"),
    ],
)  # fmt: skip
def test_what_the_demo_cannot_be_told_is_refused(made, of, setting):
    with pytest.raises(InvalidSetting) as error:
        format_ti_cfg(made, device=of)

    assert error.value.mistakes[0].setting.endswith(setting)


def test_receivers_come_in_the_order_of_their_samples():
    made = radar("xwr1843")
    turned = replace(made, array=replace(made.array, rx_m=made.array.rx_m[::-1]))

    with pytest.raises(InvalidSetting, match="receivers 4, 3, 2, 1"):
        format_ti_cfg(turned, device="xwr1843")


def test_an_sdk_without_a_demo_for_the_chip_is_refused():
    with pytest.raises(InvalidSetting, match="sdk: 2; expected 3"):
        format_ti_cfg(radar("xwr6843"), device="xwr6843", sdk=2)
    with pytest.raises(InvalidSetting, match="n_frames"):
        format_ti_cfg(radar("xwr6843"), device="xwr6843", n_frames=-1)
