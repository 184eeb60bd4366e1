"""Settings files of vendors: TI .cfg, mmWave Studio and Infineon, valid and invalid."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidFile, RecordingError
from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.recordings.settings.read import find_settings_file, read_radar, read_settings
from nightly import n_examples


def read_settings_text(tmp_path, text, name="settings.cfg", device_name=None):
    (tmp_path / name).write_text(text)
    return read_settings(tmp_path / name, None if device_name is None else device(device_name))


# --- TI .cfg --------------------------------------------------------------------------

CFG = """\
% Platform:xWR18xx
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 10 6 60 0 0 30 1 256 5000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 32 0 50 1 0
lowPower 0 0
lvdsStreamCfg -1 0 1 0
sensorStart
"""


def test_cfg_gives_waveform_and_sample_layout(tmp_path):
    settings = read_settings_text(tmp_path, CFG)

    frame, chirp = settings.radar.frame, settings.radar.frame.chirp
    assert chirp.start_frequency_hz == pytest.approx(77e9)
    assert chirp.slope_hz_per_s == pytest.approx(30e12)
    assert chirp.adc_start_s == pytest.approx(6e-6)
    assert chirp.ramp_duration_s == pytest.approx(60e-6)
    assert chirp.sample_rate_hz == pytest.approx(5e6)
    assert (chirp.n_samples, chirp.sampling) == (256, "complex")
    assert frame.interval_s == pytest.approx(70e-6)  # idle, then the ramp
    assert frame.period_s == pytest.approx(50e-3)
    assert (frame.n_chirps, frame.n_chirps_total, frame.multiplexing) == (32, 64, Tdm(order=(0, 1)))
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("qi", False, 16)
    assert (settings.n_frames, settings.receivers, settings.device) == (
        None,
        (0, 1, 2, 3),
        "xwr1843",
    )


def test_cfg_masks_select_antenna_positions(tmp_path):
    board = device("xwr1843")

    settings = read_settings_text(tmp_path, CFG.replace("channelCfg 15 5 0", "channelCfg 6 5 0"))

    assert settings.radar.array == board.select_antennas(0b101, 0b0110)
    assert settings.receivers == (1, 2)
    assert settings.findings == ()


def test_cfg_of_board_with_inverted_receivers_is_calibrated(tmp_path):
    board = device("xwr6843aop")

    settings = read_settings_text(tmp_path, CFG.replace("xWR18xx", "xWR68xx_AOP"))

    assert settings.device == "xwr6843aop"
    assert settings.radar.array == board.select_antennas(0b101, 0b1111)
    assert settings.radar.element_corrections.real.tolist() == [1, -1, 1, -1] * 2


# Geometries of TI's settings for people tracking.
@pytest.mark.parametrize(
    ("left", "up", "kind"),
    [
        ("-1 -1 0 0 -3 -3 -2 -2 -1 -1 0 0", "-1 0 -1 0 -3 -2 -3 -2 -3 -2 -3 -2", "xwr6843aop"),
        ("0 0 -1 -1 -2 -2 -3 -3 -2 -2 -3 -3", "0 -1 -1 0 0 -1 -1 0 -2 -3 -3 -2", "xwr6843ods"),
        ("0 -1 -2 -3 -2 -3 -4 -5 -4 -5 -6 -7", "-1 -1 -1 -1 0 0 0 0 -1 -1 -1 -1", "xwr6843"),
        ("0 -1 -2 -3 -2 -3 -4 -5 -4 -5 -6 -8", "-1 -1 -1 -1 0 0 0 0 -1 -1 -1 -1", None),
        ("0 -1", "0 0 0", None),
    ],
)
def test_cfg_geometry_gives_board_without_platform(tmp_path, left, up, kind):
    cfg = CFG.replace("xWR18xx", "").replace("profileCfg 0 77", "profileCfg 0 60.75")
    cfg = cfg.replace("lowPower 0 0", f"antGeometry0 {left}\nantGeometry1 {up}")

    settings = read_settings_text(tmp_path, cfg)

    assert settings.device == kind
    if kind is not None:
        assert settings.radar.array == device(kind).select_antennas(0b101, 0b1111)
    # The name of a chip does not tell its boards apart; the name of a board takes precedence.
    named = read_settings_text(tmp_path, cfg.replace("Platform:", "Platform:xWR64xx"))
    assert named.device == (kind or "xwr6843")
    named = read_settings_text(tmp_path, cfg.replace("Platform:", "Platform:xWR68xx_ODS"))
    assert named.device == "xwr6843ods"


AOP_SIGNS = " ".join(["1 0 -1 0"] * 6)
ODS_SIGNS = " ".join(["1 0 -1 0 -1 0 1 0"] * 3)


@pytest.mark.parametrize(
    ("name", "platform", "signs", "kind", "level"),
    [
        ("a.cfg", "xWR68xx", AOP_SIGNS, "xwr6843aop", "note"),
        ("a.cfg", "xWR68xx", ODS_SIGNS, "xwr6843ods", "note"),
        ("a.cfg", "", ODS_SIGNS, "xwr6843ods", "note"),
        ("a.cfg", "xWR68xx", "1 0 " * 12, "xwr6843", "note"),
        ("a.cfg", "xWR68xx", "0.5 -1 " * 12, "xwr6843", "note"),
        ("68xx.cfg", "xWR68xx", "1 0 " * 12, "xwr6843", "note"),
        ("6843_isk.cfg", "xWR68xx", "1 0 " * 12, "xwr6843", None),
        ("a.cfg", "xWR6843ISK", "1 0 " * 12, "xwr6843", None),
        ("a.cfg", "xWR68xx_ISK", AOP_SIGNS, "xwr6843", None),
        ("a.cfg", "xWR18xx", "1 0 " * 12, "xwr1843", None),
        ("area_68xx_AOP.cfg", "xWR68xx", "1 0 " * 12, "xwr6843aop", "note"),
        ("6843-hand-ods.cfg", "xWR68xx", "1 0 " * 12, "xwr6843ods", "note"),
        ("6843_ods.cfg", "xWR68xx", AOP_SIGNS, "xwr6843ods", "warning"),
        ("6843AOP.cfg", "", "1 0 " * 12, "xwr6843aop", "note"),
        ("profile_ods.cfg", "", "1 0 " * 12, "xwr6843ods", "note"),
        ("6843.cfg", "", AOP_SIGNS, "xwr6843aop", "note"),
        ("6843.cfg", "", "1 0 " * 12, "xwr6843", "note"),
        ("1843_aop.cfg", "xWR68xx_AOP", "1 0 " * 12, "xwr6843aop", None),
        ("1642.cfg", "", "1 0 " * 12, None, "note"),  # not a chip of 60 GHz
        ("walk_1715.cfg", "", "1 0 " * 12, None, "note"),
    ],
)
def test_cfg_board_follows_from_name_and_signs(tmp_path, name, platform, signs, kind, level):
    cfg = CFG.replace("xWR18xx", platform).replace("profileCfg 0 77", "profileCfg 0 60.75")
    cfg = cfg.replace("lowPower 0 0", f"compRangeBiasAndRxChanPhase 0.0 {signs}")

    settings = read_settings_text(tmp_path, cfg, name)

    assert settings.device == kind
    assert [finding.level for finding in settings.findings] == ([level] if level else [])
    if kind is not None:
        board = device(kind)
        assert settings.radar.array == board.select_antennas(0b101, 0b1111)
        assert settings.radar.calibration == board.sign_calibration(0b101, 0b1111)
        assert level is None or any(
            words in settings.findings[0].value
            for words in (f"--device {kind}", "the ISK board assumed")
        )
    # Some files end their lines with a carriage return alone.
    (tmp_path / name).write_bytes(cfg.replace("\n", "\r").encode())
    assert read_settings(tmp_path / name) == settings


def test_cfg_accepts_back_off_and_phase_codes(tmp_path):
    # 20 dB and 354.4 degrees of each, a byte each: 1315860 and 16579836.
    cfg = CFG.replace("profileCfg 0 77 10 6 60 0 0", "profileCfg 0 77 10 6 60 1315860 16579836")

    assert cfg != CFG
    assert read_settings_text(tmp_path, cfg).radar == read_settings_text(tmp_path, CFG).radar


def test_cfg_of_newer_chip_error_names_chip(tmp_path):
    # frameCfg of this chip has one additional number, the sample count.
    cfg = CFG.replace("frameCfg 0 1 32 0 50", "frameCfg 0 1 32 0 256 50")

    with pytest.raises(InvalidFile, match="AWR2944"):
        read_settings_text(tmp_path, cfg)


def test_cfg_keeps_tdm_order(tmp_path):
    cfg = CFG.replace("0 0 0 0 0 4", "0 0 0 0 0 x").replace("0 0 0 0 0 1\n", "0 0 0 0 0 4\n")

    settings = read_settings_text(tmp_path, cfg.replace("0 0 0 0 0 x", "0 0 0 0 0 1"))

    assert settings.radar.frame.multiplexing == Tdm(order=(1, 0))
    assert settings.radar.array == device("xwr1843").select_antennas(0b101, 0b1111)


def test_cfg_rounds_in_loop_are_chirps_per_transmitter(tmp_path):
    # Transmitters 1, 3, 1, 3 in a loop of 32 give 64 chirps each.
    cfg = CFG.replace(
        "frameCfg 0 1", "chirpCfg 2 2 0 0 0 0 0 1\nchirpCfg 3 3 0 0 0 0 0 4\nframeCfg 0 3"
    )

    assert read_settings_text(tmp_path, cfg).radar.frame.n_chirps == 64


def test_cfg_with_single_transmitter_has_no_multiplexing(tmp_path):
    cfg = CFG.replace("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 1")

    frame = read_settings_text(tmp_path, cfg).radar.frame

    assert (frame.n_chirps, frame.multiplexing) == (64, None)


def test_cfg_with_a_pause_before_each_loop_is_read(tmp_path):
    # As TI's settings for vehicle cabins: profile 0 of the first chirp has a longer idle time.
    other = "profileCfg 1 77 10 6 60 0 0 30 1 256 5000 0 0 30\n"
    cfg = CFG.replace("profileCfg 0 77 10", "profileCfg 0 77 1000")
    cfg = cfg.replace("chirpCfg 0", other + "chirpCfg 0").replace("1 1 0 0", "1 1 1 0")

    frame = read_settings_text(tmp_path, cfg).radar.frame

    expected = read_settings_text(tmp_path, CFG).radar.frame
    multiplexing = frame.multiplexing
    assert multiplexing == Tdm(order=(0, 1), pause_s=multiplexing.pause_s)
    assert multiplexing.pause_s == pytest.approx(990e-6)
    assert replace(frame, multiplexing=expected.multiplexing) == expected
    for old, new, message in (
        ("profileCfg 1 77 10", "profileCfg 1 77 2000", "an idle time of 2000 us, after 1000 us"),
        ("profileCfg 1 77", "profileCfg 1 78", "with another one in the same frame"),
        ("0 0 0 0 4\n", "0 0 0 0 1\n", "a pause before each loop"),
    ):
        assert old in cfg
        with pytest.raises(DechirpError, match=message):
            read_settings_text(tmp_path, cfg.replace(old, new))


# The demo sends the first chirp with signs ++, the second with +-.
BPM = CFG.replace("0 0 0 0 0 1\n", "0 0 0 0 0 5\n").replace("0 0 0 0 0 4\n", "0 0 0 0 0 5\n")
BPM = BPM.replace("lowPower 0 0", "bpmCfg -1 1 0 1")


def test_cfg_with_bpm_is_read(tmp_path):
    settings = read_settings_text(tmp_path, BPM)

    frame = settings.radar.frame
    assert (frame.n_chirps, frame.n_chirps_total, frame.multiplexing) == (32, 64, Bpm(order=(0, 1)))
    assert frame.chirp_weights()[:4].tolist() == [[1, 1], [1, -1], [1, 1], [1, -1]]
    assert settings.radar.array == device("xwr1843").select_antennas(0b101, 0b1111)


@pytest.mark.parametrize(
    ("masks", "pair", "signs"),
    [
        # TI's settings for people tracking: ISK, AOP and ODS.
        ((5, 2, 5), (0, 2), [[1, 0, 1], [0, 1, 0], [1, 0, -1]]),
        ((1, 6, 6), (1, 2), [[1, 0, 0], [0, 1, 1], [0, 1, -1]]),
        ((3, 3, 4), (0, 1), [[1, 1, 0], [1, -1, 0], [0, 0, 1]]),
    ],
)
def test_bpm_pair_beside_a_third_transmitter_is_read(tmp_path, masks, pair, signs):
    chirps = "".join(f"chirpCfg {n} {n} 0 0 0 0 0 {mask}\n" for n, mask in enumerate(masks))
    cfg = CFG.replace("frameCfg 0 1", f"{chirps}frameCfg 0 2")
    cfg = cfg.replace("lowPower 0 0", f"bpmCfg -1 1 {pair[0]} {pair[1]}")
    cfg = cfg.replace("channelCfg 15 5", "channelCfg 15 7")

    settings = read_settings_text(tmp_path, cfg)

    frame = settings.radar.frame
    assert (frame.n_chirps, frame.n_chirps_total) == (32, 96)
    np.testing.assert_allclose(frame.weights, signs, atol=1e-15)
    assert settings.radar.array == device("xwr1843").select_antennas(0b111, 0b1111)
    # mmWave Studio sets the signs of transmitter 1 by bits 0 and 1, of 2 by 2 and 3, and so on.
    inverted = max(n for n, sign in enumerate(signs[pair[1]]) if sign)
    bpm = {"chirpStartIdx": pair[1], "chirpEndIdx": pair[1], "constBpmVal": hex(3 << 2 * inverted)}
    chip = make_chip([hex(mask) for mask in masks], rlBpmChirps=[{"rlBpmChirpCfg_t": bpm}])
    chip["rfConfig"]["rlBpmChirps"].insert(
        0, {"chirpStartIdx": 0, "chirpEndIdx": 2, "constBpmVal": "0x0"}
    )
    studio = read_settings_text(tmp_path, format_studio(chip), "a.mmwave.json", "xwr1843")
    assert studio.radar == settings.radar


def test_stream_with_headers_leaves_radar_readable_but_not_the_capture(tmp_path):
    expected = read_settings_text(tmp_path, CFG)
    for numbers, stream in (
        ("1 1 0", "header 1"),
        ("1 1 1", "header 1 and software 1"),
        ("0 4 0", "data_format 4"),
        ("1 0 1", ""),
    ):
        cfg = CFG.replace("lvdsStreamCfg -1 0 1 0", f"lvdsStreamCfg -1 {numbers}")
        settings = read_settings_text(tmp_path, cfg)
        description = f"lvdsStreamCfg with {stream}" if stream else ""
        assert settings == replace(expected, foreign_stream=description)
        samples = np.random.default_rng(1).integers(-99, 99, 64 * 4 * 256 * 2).astype("<i2")
        samples.tofile(tmp_path / "settings.bin")
        if stream:
            with pytest.raises(RecordingError, match=f"headers or other data.*{stream}"):
                dc.open(tmp_path / "settings.bin")
        else:
            assert dc.open(tmp_path / "settings.bin").n_frames == 1


def test_four_transmitters_at_once_are_refused_as_doppler_division(tmp_path):
    cfg = CFG.replace("0 0 0 0 0 1\n", "0 0 0 0 0 15\n").replace("0 0 0 0 0 4\n", "0 0 0 0 0 15\n")
    cfg = cfg.replace("xWR18xx", "xWR29xx").replace("channelCfg 15 5", "channelCfg 15 15")

    with pytest.raises(InvalidFile, match="of kind ddma"):
        read_settings_text(tmp_path, cfg)


def test_transmitters_that_send_together_are_one_antenna_at_their_centre(tmp_path):
    cfg = CFG.replace("0 0 0 0 0 1\n", "0 0 0 0 0 7\n").replace("0 0 0 0 0 4\n", "0 0 0 0 0 7\n")
    board = device("xwr6843aop").select_antennas(0b111, 0b1111)
    cfg = cfg.replace("xWR18xx", "xWR68xx_AOP").replace("channelCfg 15 5", "channelCfg 15 7")

    settings = read_settings_text(tmp_path, cfg)

    frame, array = settings.radar.frame, settings.radar.array
    assert (frame.n_chirps, frame.n_chirps_total, frame.multiplexing) == (64, 64, None)
    np.testing.assert_allclose(array.tx_m, [np.mean(board.tx_m, axis=0)])
    assert array.rx_m == board.rx_m
    assert settings.radar.element_corrections.real.tolist() == [1, -1, 1, -1]
    (note,) = settings.findings
    assert "transmitters 1+2+3 together" in note.value
    lua = LUA.replace("(0, 0, 0, 0, 0, 0, 0, 1, 0, 0)", "(0, 1, 0, 0, 0, 0, 0, 1, 1, 1)")
    lua = lua.replace("ar1.ChirpConfig(1, 1, 0, 0, 0, 0, 0, 0, 0, 1)\n", "")
    assert read_settings_text(tmp_path, lua, "a.lua").radar.frame.multiplexing is None
    phased = lua.replace("ar1.StartFrame", "ar1.BpmChirpConfig(1, 1, 0, 0, 0, 1)\nar1.StartFrame")
    with pytest.raises(RecordingError, match="several transmitters, with BpmChirpConfig in line"):
        read_settings_text(tmp_path, phased, "a.lua")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("bpmCfg -1 1 0 1", "bpmCfg -1 1 1 0"),
        ("bpmCfg -1 1 0 1", "bpmCfg -1 1 0 2"),
        ("chirpCfg 1 1 0 0 0 0 0 5", "chirpCfg 1 1 0 0 0 0 0 3"),
        ("0 0 0 0 0 5", "0 0 0 0 0 7"),
        ("0 0 0 0 0 5", "0 0 0 0 0 1"),
        ("frameCfg 0 1", "chirpCfg 2 2 0 0 0 0 0 5\nframeCfg 0 2"),
    ],
)
def test_rejects_cfg_with_unsupported_bpm_chirps(tmp_path, old, new):
    assert old in BPM
    with pytest.raises(InvalidFile, match="bpmCfg: enabled 1.*the same two transmitters"):
        read_settings_text(tmp_path, BPM.replace(old, new))


def test_unknown_device_gives_uniform_linear_virtual_array(tmp_path):
    settings = read_settings_text(tmp_path, CFG.replace("xWR18xx", "something"))

    half_m = settings.radar.frame.chirp.wavelength_m / 2
    array = settings.radar.array
    virtual = sorted(tx[1] + rx[1] for tx in array.tx_m for rx in array.rx_m)
    # From left to right, as the receivers of all boards of TI that have them in a row.
    assert virtual == pytest.approx([n * half_m for n in range(-7, 1)])
    assert array.rx_m[1][1] < 0
    (finding,) = settings.findings
    assert (finding.level, finding.setting) == ("note", "radar.array")
    assert settings.device is None


@pytest.mark.parametrize(("masks", "rx"), [(("0x1", "0x2", "0x4"), 15), (("0x2", "0x4"), 9)])
def test_unknown_device_with_third_transmitter_has_antennas_of_boost_boards(tmp_path, masks, rx):
    chip = make_chip(masks=masks)
    chip["rfConfig"]["rlChanCfg_t"]["rxChannelEn"] = rx
    settings = read_settings_text(tmp_path, format_studio(chip), "any.mmwave.json")

    board = device("xwr1843").select_antennas(sum(int(mask, 0) for mask in masks), rx)
    scale = settings.radar.frame.chirp.wavelength_m / 2 / abs(device("xwr1843").rx_m[1][1])
    for assumed_m, board_m in (
        (settings.radar.array.tx_m, board.tx_m),
        (settings.radar.array.rx_m, board.rx_m),
    ):
        # `Array` may place its first antenna anywhere.
        offsets_m = [
            [value - first for value, first in zip(position, assumed_m[0], strict=True)]
            for position in assumed_m
        ]
        expected_m = [
            [scale * (value - first) for value, first in zip(position, board_m[0], strict=True)]
            for position in board_m
        ]
        assert offsets_m == [pytest.approx(position, abs=1e-9) for position in expected_m]
    (finding,) = settings.findings
    assert (finding.level, finding.setting) == ("note", "radar.array")
    assert "TX2 between them and half a wavelength higher" in str(finding)
    assert "ambiguity numbers of velocities" in str(finding)


def test_given_device_takes_precedence_over_cfg(tmp_path):
    settings = read_settings_text(
        tmp_path,
        CFG.replace("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 2"),
        device_name="AWR1642",
    )

    assert settings.device == "xwr1642"
    assert settings.radar.array == device("xwr1642").select_antennas(0b11, 0b1111)


def test_cfg_of_first_demos_has_no_sub_frames(tmp_path):
    # adcbufCfg has four numbers, and the receivers of this chip are interleaved.
    text = CFG.replace("adcbufCfg -1 0 1 1 1", "adcbufCfg 0 0 0 1").replace("xWR18xx", "xWR14xx")

    settings = read_settings_text(tmp_path, text)

    assert (settings.iq, settings.is_interleaved, settings.device) == ("iq", True, "xwr1443")


def test_cfg_with_real_samples_has_no_iq_order(tmp_path):
    text = CFG.replace("adcCfg 2 1", "adcCfg 0 0").replace("adcbufCfg -1 0", "adcbufCfg -1 1")

    settings = read_settings_text(tmp_path, text)

    assert (settings.radar.frame.chirp.sampling, settings.iq, settings.bits) == ("real", None, 12)


def test_cfg_last_command_before_last_start_applies(tmp_path):
    profile = "profileCfg 0 78 20 6 60 0 0 30 1 128 5000 0 0 30\n"

    settings = read_settings_text(
        tmp_path, CFG.replace("frameCfg", profile + "frameCfg", 1) + profile
    )

    assert settings.radar.frame.chirp.n_samples == 128
    assert settings.radar.frame.interval_s == pytest.approx(80e-6)


def test_cfg_flush_discards_earlier_commands(tmp_path):
    with pytest.raises(InvalidFile) as error:
        read_settings_text(tmp_path, CFG.replace("lowPower", "flushCfg\nlowPower"))

    assert "profileCfg" in str(error.value)
    assert "missing" in str(error.value)


@pytest.mark.parametrize(
    ("n_frames", "period_ms", "merged"),
    # About 0.3 s of chirps, 8 to 256, of which the fewest are left out.
    [
        (200, 1, (200, 1)),
        (1000, 1, (250, 4)),
        (500, 40, (8, 62)),
        (600, 10, (30, 20)),
        (5, 40, (5, 1)),
    ],
)
def test_cfg_single_chirp_frames_are_merged(tmp_path, n_frames, period_ms, merged):
    settings = read_settings_text(
        tmp_path,
        CFG.replace("frameCfg 0 1 32 0 50", f"frameCfg 0 0 1 {n_frames} {period_ms}"),
    )

    assert settings.has_merged_frames
    assert (settings.radar.frame.n_chirps, settings.n_frames) == merged
    assert settings.radar.frame.interval_s == pytest.approx(period_ms * 1e-3)


def test_cfg_endless_single_chirp_frames_are_merged(tmp_path):
    settings = read_settings_text(
        tmp_path, CFG.replace("frameCfg 0 1 32 0 50", "frameCfg 0 0 1 0 10")
    )

    assert (settings.radar.frame.n_chirps, settings.n_frames) == (16, None)


def test_cfg_merged_frames_state_option_and_aliasing(tmp_path):
    settings = read_settings_text(
        tmp_path, CFG.replace("frameCfg 0 1 32 0 50", "frameCfg 0 0 1 200 1")
    )

    (note,) = (f for f in settings.findings if f.setting == "radar.frame.n_chirps")
    assert "chosen --set radar.frame.n_chirps=200 because" in note.value
    limit_m_per_s = settings.radar.frame.chirp.wavelength_m / 4 / 1e-3
    assert f"velocities beyond {limit_m_per_s:.3g} m/s are aliased" in note.value


def test_cfg_single_sub_frame_is_frame(tmp_path):
    cfg = CFG.replace("dfeDataOutputMode 1", "dfeDataOutputMode 3").replace(
        "frameCfg 0 1 32 0 50 1 0",
        "advFrameCfg 1 0 7 1 0\nsubFrameCfg 0 0 0 2 32 50 0 1 1 50",
    )

    settings = read_settings_text(tmp_path, cfg)

    assert settings.radar == read_settings_text(tmp_path, CFG).radar
    assert settings.n_frames == 7


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("channelCfg 15 5 0", "channelCfg 15 5", 5, "2 numbers"),
        ("channelCfg 15 5 0", "channelCfg 0 5 0", 5, "rx_mask 0"),
        ("channelCfg 15 5 0", "channelCfg 15 5 1", 5, "cascading 1"),
        ("adcCfg 2 1", "adcCfg 2 3", 6, "format 3"),
        ("adcCfg 2 1", "adcCfg 2 0", 7, "format 0 in adcCfg"),
        ("adcbufCfg -1 0 1 1 1", "adcbufCfg -1 0 1", 7, "3 numbers"),
        ("profileCfg 0 77", "profileCfg 0 x", 8, "start_ghz 'x'"),
        ("profileCfg 0 77", "profileCfg 0 nan", 8, "start_ghz 'nan'"),
        ("profileCfg 0 77", "profileCfg 0 1e999", 8, "start_ghz '1e999'"),
        ("256 5000", "256.5 5000", 8, "n_samples '256.5'"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 5", 10, "tx_mask 5"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 0", 10, "tx_mask 0"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 2 0 4", 10, "idle_variation 2"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 1 0 0 0 0 4", 10, "profile 1"),
        ("frameCfg 0 1", "frameCfg 0 2", 11, "without chirpCfg for 2"),
        ("frameCfg 0 1", "frameCfg 1 0", 11, "chirps 1 to 0"),
        ("frameCfg 0 1", f"frameCfg 0 {10**30}", 11, "last '1000"),
        ("lowPower 0 0", "bpmCfg -1 1 0 1", 12, "enabled 1"),
        ("dfeDataOutputMode 1", "dfeDataOutputMode 2", 4, "mode 2"),
    ],
)
def test_cfg_mistake_names_command_and_line(tmp_path, old, new, line, message):
    assert old in CFG
    with pytest.raises(InvalidFile) as error:
        read_settings_text(tmp_path, CFG.replace(old, new, 1))

    mistakes = [mistake for mistake in error.value.mistakes if mistake.line == line]
    assert mistakes, str(error.value)
    assert message in mistakes[0].value
    assert mistakes[0].setting in (CFG.splitlines()[line - 1].split()[0], new.split()[0])


def test_cfg_error_lists_all_mistakes(tmp_path):
    text = CFG.replace("adcCfg 2 1", "adcCfg 2").replace("profileCfg 0 77", "profileCfg 0 x")

    with pytest.raises(InvalidFile) as error:
        read_settings_text(tmp_path, text.replace("frameCfg", "% frameCfg"))

    assert [mistake.setting for mistake in error.value.mistakes] == [
        "adcCfg", "profileCfg", "frameCfg",
    ]  # fmt: skip


# Two chirps of transmitters that take turns, then two of both together.
SUB_FRAMES = CFG.replace("dfeDataOutputMode 1", "dfeDataOutputMode 3").replace(
    "frameCfg 0 1 32 0 50 1 0",
    """profileCfg 1 76 20 6 40 0 0 60 1 128 4000 0 0 30
chirpCfg 2 2 1 0 0 0 0 5
chirpCfg 3 3 1 0 0 0 0 5
bpmCfg 0 0 0 1
bpmCfg 1 1 2 3
advFrameCfg 2 0 9 1 0
subFrameCfg 0 0 0 2 32 50 0 1 1 50
subFrameCfg 1 0 2 2 16 30 0 1 1 30""",
)


def test_cfg_with_sub_frames_describes_each(tmp_path):
    first = read_settings_text(tmp_path, SUB_FRAMES)

    assert len(first.sub_frames) == 2
    assert (first.n_frames, first.sub_frame_index) == (9, 0)
    assert (first.radar.frame.n_chirps, first.radar.frame.multiplexing) == (32, Tdm(order=(0, 1)))
    second = first.with_sub_frame(1)
    assert (second.radar.frame.n_chirps, second.radar.frame.multiplexing) == (16, Bpm(order=(0, 1)))
    assert second.radar.frame.chirp.n_samples == 128
    assert second.radar.frame.interval_s == pytest.approx(60e-6)
    # A sub-frame repeats with the frame: after the periods of all sub-frames.
    for sub_frame in (first, second):
        assert sub_frame.radar.frame.period_s == pytest.approx(80e-3)
        assert "2 sub-frames" in sub_frame.findings[-1].value


def test_cfg_commands_apply_to_their_sub_frame(tmp_path):
    cfg = SUB_FRAMES.replace("adcbufCfg -1 0 1 1 1", "adcbufCfg 0 0 1 1 1\nadcbufCfg 1 0 0 1 1")

    settings = read_settings_text(tmp_path, cfg)

    assert [sub_frame.iq for sub_frame in settings.sub_frames] == ["qi", "iq"]


def test_cfg_sub_frame_without_stream_has_no_samples(tmp_path):
    cfg = SUB_FRAMES.replace(
        "lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg 0 0 0 0\nlvdsStreamCfg 1 0 1 0"
    )

    settings = read_settings_text(tmp_path, cfg)

    assert settings.sub_frames == ()
    assert settings.radar.frame.multiplexing == Bpm(order=(0, 1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("advFrameCfg 2 0", "advFrameCfg 0 0", "n_sub_frames 0"),
        ("advFrameCfg 2 0", "advFrameCfg 5 0", "n_sub_frames 5|for sub-frame 2"),
        ("advFrameCfg 2 0", "advFrameCfg 3 0", "subFrameCfg: missing for sub-frame 2"),
        ("advFrameCfg 2 0", "advFrameCfg 2 1", "force_profile 1"),
        ("subFrameCfg 1 0 2 2 16 30 0 1", "subFrameCfg 1 0 2 2 16 30 0 2", "n_bursts 2"),
        ("subFrameCfg 1 0 2 2", "subFrameCfg 1 0 2 3", "without chirpCfg for 4"),
        ("adcbufCfg -1", "adcbufCfg 0", "adcbufCfg: missing for sub-frame 1"),
        ("bpmCfg 1 1 2 3", "bpmCfg 1 1 0 1", "bpmCfg: enabled 1, for chirps 0 and 1"),
    ],
)
def test_rejects_cfg_with_invalid_sub_frames(tmp_path, old, new, message):
    assert old in SUB_FRAMES
    with pytest.raises(InvalidFile, match=message):
        read_settings_text(tmp_path, SUB_FRAMES.replace(old, new))


def test_rejects_cfg_with_irregular_transmitter_order(tmp_path):
    text = CFG.replace("frameCfg 0 1", "chirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2")

    with pytest.raises(InvalidFile, match="order 1 3 3"):
        read_settings_text(tmp_path, text)


def test_rejects_cfg_of_low_power_chips(tmp_path):
    text = "% xWRL6432\nchannelCfg 7 3 0\nchirpComnCfg 8 0 0 256 1 13 3\nframeCfg 64 0 1358 1 9 0\n"

    with pytest.raises(InvalidFile) as error:
        read_settings_text(tmp_path, text)

    (mistake,) = error.value.mistakes
    assert (mistake.setting, mistake.line) == ("chirpComnCfg", 3)


def test_rejects_cfg_with_antennas_missing_on_device(tmp_path):
    with pytest.raises(RecordingError, match="tx_mask"):
        read_settings_text(tmp_path, CFG, device_name="xwr1642")  # it has transmitters 1 and 2


def test_rejects_cfg_without_chirps(tmp_path):
    with pytest.raises(RecordingError, match="n_chirps"):
        read_settings_text(tmp_path, CFG.replace("frameCfg 0 1 32", "frameCfg 0 1 0"))


# --- TI mmWave Studio -----------------------------------------------------------------


def make_profile(**changes):
    numbers = {
        "profileId": 0,
        "startFreqConst_GHz": 77.0,
        "idleTimeConst_usec": 10.0,
        "adcStartTimeConst_usec": 6.0,
        "rampEndTime_usec": 60.0,
        "freqSlopeConst_MHz_usec": 30.0,
        "numAdcSamples": 256,
        "digOutSampleRate": "5000",
    }
    return {"rlProfileCfg_t": numbers | changes}


def make_chirp(index, mask, **changes):
    numbers = {
        "chirpStartIdx": index,
        "chirpEndIdx": index,
        "profileId": 0,
        "startFreqVar_MHz": 0.0,
        "freqSlopeVar_KHz_usec": 0.0,
        "idleTimeVar_usec": 0.0,
        "adcStartTimeVar_usec": 0.0,
        "txEnable": mask,
    }
    return {"rlChirpCfg_t": numbers | changes}


def make_chip(masks=("0x1", "0x4"), **changes):
    frame = {
        "chirpStartIdx": 0,
        "chirpEndIdx": len(masks) - 1,
        "numLoops": 32,
        "numFrames": 8,
        "framePeriodicity_msec": 50.0,
    }
    radio = {
        "waveformType": "legacyFrameChirp",
        "rlChanCfg_t": {"rxChannelEn": "0xF", "txChannelEn": "0x7"},
        "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 1}},
        "rlProfiles": [make_profile()],
        "rlChirps": [make_chirp(index, mask) for index, mask in enumerate(masks)],
        "rlFrameCfg_t": frame,
        "rlBpmChirps": [],
    }
    layout = {"rlDevDataFmtCfg_t": {"iqSwapSel": 1, "chInterleave": 1}}
    return {"rfConfig": radio | changes, "rawDataCaptureConfig": layout}


def format_studio(*chips):
    return json.dumps({"mmWaveDevices": list(chips or [make_chip()])})


SETUP = {"configUsed": "a.mmwave.json", "mmWaveDevice": "awr1843", "captureHardware": "DCA1000"}


def test_studio_json_equals_cfg_of_same_radar(tmp_path):
    expected = read_settings_text(tmp_path, CFG)

    settings = read_settings_text(tmp_path, format_studio(), "a.mmwave.json", device_name="xwr1843")

    assert settings.radar == expected.radar
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("qi", False, 16)
    assert (settings.n_frames, settings.receivers) == (8, (0, 1, 2, 3))


def test_setup_file_names_settings_and_chip(tmp_path):
    (tmp_path / "a.mmwave.json").write_text(format_studio())

    settings = read_settings_text(tmp_path, json.dumps(SETUP), "a.setup.json")

    assert settings.path == tmp_path / "a.setup.json"
    expected = read_settings_text(tmp_path, format_studio(), "a.mmwave.json", device_name="xwr1843")
    assert replace(settings, path=expected.path) == expected


def test_studio_lists_of_one_may_be_plain_objects(tmp_path):
    chip = make_chip(["0x1"])
    expected = read_settings_text(tmp_path, format_studio(chip), "a.mmwave.json")
    (profile,), (chirp,) = chip["rfConfig"]["rlProfiles"], chip["rfConfig"]["rlChirps"]
    plain_chip = make_chip(["0x1"], rlProfiles=profile, rlChirps=chirp, rlBpmChirps={})

    settings = read_settings_text(
        tmp_path, json.dumps({"mmWaveDevices": plain_chip}), "a.mmwave.json"
    )

    assert settings == expected
    plain_chip["rfConfig"]["rlBpmChirps"] = {"rlBpmChirpCfg_t": {"chirpStartIdx": 0}}
    with pytest.raises(RecordingError, match="rlBpmChirps"):
        read_settings_text(tmp_path, json.dumps({"mmWaveDevices": plain_chip}), "a.mmwave.json")


def test_studio_single_sub_frame_is_frame(tmp_path):
    sub_frame = {
        "chirpStartIdx": 0,
        "numOfChirps": 2,
        "numLoops": 32,
        "numOfBurst": 1,
        "numOfBurstLoops": 1,
        "subFramePeriodicity_msec": 50.0,
    }
    unused_sub_frame = {"rlSubFrameCfg_t": dict.fromkeys(sub_frame, 0)}
    sequence = {
        "numOfSubFrames": 1,
        "forceProfile": 0,
        "numFrames": 8,
        "subFrameCfg": [{"rlSubFrameCfg_t": sub_frame}, unused_sub_frame],
    }
    advanced_chip = make_chip(
        waveformType="advancedFrameChirp", rlAdvFrameCfg_t={"frameSeq": sequence}
    )

    settings = read_settings_text(tmp_path, format_studio(advanced_chip), "a.mmwave.json")

    assert settings.radar == read_settings_text(tmp_path, format_studio(), "a.mmwave.json").radar
    sequence["numOfSubFrames"] = 2
    with pytest.raises(RecordingError, match="numOfSubFrames"):
        read_settings_text(tmp_path, format_studio(advanced_chip), "a.mmwave.json")


def test_studio_cascade_is_tdm_over_all_chips(tmp_path):
    # Of four chips, the second transmits in chirp 0 and the first in chirp 1.
    chips = [make_chip(masks) for masks in (("0x0", "0x4"), ("0x1", "0x0"), ("0", "0"), ("0", "0"))]

    settings = read_settings_text(tmp_path, format_studio(*chips), "a.mmwave.json")

    assert settings.device == "cascade"
    assert settings.radar.array == device("cascade").select_antennas(1 << 2 | 1 << 3, 2**16 - 1)
    assert settings.radar.frame.multiplexing == Tdm(order=(1, 0))
    assert settings.receivers == tuple(range(16))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("[" * 100_000, "nested too deeply"),
        ("{", "not JSON"),
        ('{"mmWaveDevices": []}', "no list mmWaveDevices"),
        ('{"mmWaveDevices": [3]}', "mmWaveDevices[0].rfConfig.rlChanCfg_t missing"),
        (
            format_studio(make_chip(rlProfiles=[make_profile(numAdcSamples="many")])),
            'numAdcSamples = "many"',
        ),
        (
            format_studio(make_chip(rlProfiles=[make_profile(numAdcSamples=1e999)])),
            "numAdcSamples = Infinity",
        ),
        (
            format_studio(make_chip(rlProfiles=[make_profile(numAdcSamples=10**400)])),
            "numAdcSamples = 1000",
        ),
        (
            format_studio(make_chip(rlProfiles=[make_profile(startFreqConst_GHz=None)])),
            "GHz = null",
        ),
        (
            format_studio(make_chip(rlProfiles=[make_profile(startFreqConst_GHz=[[]])])),
            "GHz = a list",
        ),
        (
            format_studio(make_chip(rlAdcOutCfg_t={"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 3}})),
            "OutFmt = 3",
        ),
        (format_studio(make_chip(rlBpmChirps=[{"rlBpmChirpCfg_t": {}}])), "rlBpmChirps"),
        (format_studio(make_chip(["0x3", "0x1"])), "transmitters 1+2 at once"),
        (format_studio(make_chip(["0x0"])), "chirp 0 without transmitter"),
        (format_studio(make_chip(["-1"])), "chirp 0 without transmitter"),
        (format_studio(make_chip(rlChirps=[make_chirp(0, "1")])), "differ or are not set"),
        (
            format_studio(
                make_chip(rlChirps=[make_chirp(0, "1"), make_chirp(1, "2", idleTimeVar_usec=1)])
            ),
            "differ",
        ),
        (
            format_studio(make_chip(rlProfiles=[make_profile(freqSlopeConst_MHz_usec=-30)])),
            "slope_hz_per_s",
        ),
        (format_studio(make_chip(["0x1"]), make_chip(["0x9"])), "chirp 0 without transmitter"),
    ],
)
def test_invalid_studio_json_error_names_mistake(tmp_path, document, message):
    with pytest.raises(RecordingError) as error:
        read_settings_text(tmp_path, document, "a.mmwave.json" if "mmW" in document else "a.json")

    assert message in str(error.value)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    "name", ["/etc/hostname", "../a.mmwave.json", "sub/a.mmwave.json", "C:\\a.json", "..", "",
             "missing.mmwave.json", "\ud800", "x" * 254, "link.mmwave.json", "b.setup.json", None],
)  # fmt: skip
def test_setup_file_refers_only_to_own_folder(tmp_path, name):
    (tmp_path / "sub").mkdir()
    for path in (tmp_path / "a.mmwave.json", tmp_path / "sub" / "a.mmwave.json"):
        path.write_text(format_studio())
    folder = tmp_path / "sub"
    (folder / "link.mmwave.json").symlink_to(tmp_path / "a.mmwave.json")
    (folder / "a.mmwave.json").unlink()
    text = json.dumps(SETUP | {"configUsed": name})

    with pytest.raises(RecordingError) as error:
        read_settings_text(folder, text, "b.setup.json")

    assert "configUsed" in str(error.value)
    assert "next to it" in str(error.value)


LOG = """\
API:select_chip_version,{chip},0,
API:ChannelConfig,7,15,0,
API:DataFmtConfig,15,{bits},{form},0,{interleave},0,
API:ProfileConfig,0,1435388860,1000,600,6000,0,0,621,0,256,5000,0,0,30,0,
API:ChirpConfig,0,0,0,0,0,0,0,1,0,
API:ChirpConfig,1,1,0,0,0,0,0,4,0,
API:FrameConfig,0,1,8,32,10000000,0,512,0,
API:SensorStart,0,
"""


def format_log(chip="AR1243", bits=2, form=1, interleave=0):
    return LOG.format(chip=chip, bits=bits, form=form, interleave=interleave)


def test_studio_log_with_tdm_gives_multiplexing(tmp_path):
    settings = read_settings_text(tmp_path, format_log(), "LogFile.txt")

    assert settings.radar.frame.multiplexing == Tdm(order=(0, 1))
    assert (settings.radar.frame.n_chirps, settings.radar.frame.n_chirps_total) == (32, 64)
    assert settings.radar.array == device("AWR1243").select_antennas(0b101, 0b1111)
    assert (settings.device, settings.is_interleaved, settings.receivers) == (
        "xwr1443",
        True,
        (0, 1, 2, 3),
    )


def test_studio_log_transmitters_are_mask(tmp_path):
    # Mask 2 selects the second transmitter.
    settings = read_settings_text(
        tmp_path, format_log().replace("0,0,0,0,0,4,0,", "0,0,0,0,0,2,0,"), "LogFile.txt"
    )

    assert settings.radar.frame.multiplexing == Tdm(order=(0, 1))
    assert settings.radar.array == device("AWR1243").select_antennas(0b011, 0b1111)


def test_studio_log_gives_sample_format(tmp_path):
    settings = read_settings_text(
        tmp_path, format_log("other chip", bits=0, form=0, interleave=1), "LogFile.txt"
    )

    assert (settings.radar.frame.chirp.sampling, settings.iq) == ("real", None)
    assert (settings.bits, settings.is_interleaved, settings.device) == (12, False, None)
    assert [finding.setting for finding in settings.findings] == ["radar.array"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0,0,0,0,0,1,0,", "0,0,0,0,0,3,0,", "transmitters 1+2 at once"),
        ("0,0,0,0,0,1,0,", "0,0,0,0,0,0,0,", "chirp 0 without transmitter"),
        ("ChannelConfig,7,15,", "ChannelConfig,7,0,", "rx_mask"),
        ("DataFmtConfig,15,2,1", "DataFmtConfig,15,2,3", "format 3"),
        ("DataFmtConfig,15,2,1", "DataFmtConfig,15,3,1", "bits 3"),
        ("FrameConfig,0,1,", "FrameConfig,5,1,", "chirps 5 to 1"),
        ("FrameConfig,0,1,", f"FrameConfig,0,{10**30},", "FrameConfig with"),
        ("FrameConfig,0,1,8,32", "FrameConfig,0,1,8,0", "n_chirps"),
    ],
)
def test_unsupported_studio_log_error_names_mistake(tmp_path, old, new, message):
    assert old in format_log()
    with pytest.raises(RecordingError) as error:
        read_settings_text(tmp_path, format_log().replace(old, new, 1), "LogFile.txt")

    assert message in str(error.value)


# --- Infineon -------------------------------------------------------------------------


# The radar of CFG.
MMWAVELINK = """\
#rlChanCfg_t
LinkAdvanceFrameTest=0;
channelTx=5;
channelRx=15;
adcBits=2;
adcFormat=1;
iqSwapSel=1;
chInterleave=1;
#rlProfileCfg_t
profileId=0;
startFreqConst=1435384036;
idleTimeConst=1000;
adcStartTimeConst=600;
rampEndTime=6000;
freqSlopeConst=621;
#numAdcSamples=128;
numAdcSamples=256;
digOutSampleRate=5000;
numOfChirpsToConfig=2;
chirpStartIdx=0;
chirpEndIdx=0;
profileIdCPCFG=0;
startFreqVar=0;
freqSlopeVar=0;
idleTimeVar=0;
adcStartTimeVar=0;
txEnable=1;
chirpStartIdx=1;
chirpEndIdx=1;
profileIdCPCFG=0;
startFreqVar=0;
freqSlopeVar=0;
idleTimeVar=0;
adcStartTimeVar=0;
txEnable=4;
#rlFrameCfg_t
chirpStartIdxFCF=0;
chirpEndIdxFCF=1;
frameCount=8;
loopCount=32;
periodicity=10000000;
numAdcSamples=512;
"""


def test_mmwavelink_text_equals_cfg_of_same_radar(tmp_path):
    expected = read_settings_text(tmp_path, CFG)
    (tmp_path / "settings.cfg").unlink()

    settings = read_settings_text(tmp_path, MMWAVELINK, "mmwaveconfig.txt", "xwr1843")

    frame, chirp = settings.radar.frame, settings.radar.frame.chirp
    # The chip counts steps of 53.6 Hz and 48.3 kHz/us.
    assert chirp.start_frequency_hz == pytest.approx(77e9, abs=54)
    assert chirp.slope_hz_per_s == pytest.approx(30e12, abs=48.3e9)
    expected_frame = expected.radar.frame
    same = replace(
        chirp,
        start_frequency_hz=expected_frame.chirp.start_frequency_hz,
        slope_hz_per_s=expected_frame.chirp.slope_hz_per_s,
    )
    assert replace(frame, chirp=same) == expected_frame
    assert settings.radar.array == expected.radar.array
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("qi", False, 16)
    assert settings.n_frames == 8
    assert find_settings_file(tmp_path / "adc_data.bin").name == "mmwaveconfig.txt"
    # The signs of a chirp follow the chirps, with the same names of fields.
    bpm = MMWAVELINK.replace("txEnable=1", "txEnable=5").replace("txEnable=4", "txEnable=5")
    bpm += "chirpStartIdx = 1\nchirpEndIdx = 1\nconstBpmVal = 48 # 0x30\n"
    assert read_settings_text(tmp_path, bpm, "a.txt").radar.frame.multiplexing == Bpm(order=(0, 1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("LinkAdvanceFrameTest=0", "LinkAdvanceFrameTest=1", "LinkAdvanceFrameTest=1"),
        ("rampEndTime=6000;\n", "", "rampEndTime_usec = null"),
        ("idleTimeVar=0", "idleTimeVar=5", "differ"),
        ("periodicity", "period", "framePeriodicity_msec = null"),
    ],
)
def test_unsupported_mmwavelink_text_error_names_mistake(tmp_path, old, new, message):
    assert old in MMWAVELINK
    with pytest.raises(RecordingError, match=message):
        read_settings_text(tmp_path, MMWAVELINK.replace(old, new), "mmwaveconfig.txt")


LUA = """\
--[[ DataCaptureDemo
ar1.ProfileConfig(0, 60, 1) ]]
START_FREQ = 77 -- GHz
local idle_us = 2 * 5
RADAR.RAMP = 50 + idle_us
ar1.SelectChipVersion("AR1642")
ar1.SelectChipVersion("XWR1843")
if (ar1.ChanNAdcConfig(1, 0, 1, 1, 1, 1, 1, 2, 1, 1) == 0) then
    WriteToLog("ChanNAdcConfig -- success\\n", "green")
end
ar1.ProfileConfig(0, START_FREQ, idle_us, 6, RADAR.RAMP, 0, 0, 0, 0, 0, 0,
    30.0, 0, 0x100, 5e3, 0, 0, 30)
ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, 1, 0, 0)
-- ar1.ChirpConfig(1, 1, 0, 0, 0, 0, 0, 0, 1, 0)
ar1.ChirpConfig(1, 1, 0, 0, 0, 0, 0, 0, 0, 1)
ar1.FrameConfig(0, 1, 8, 32, 50, 0, 0, 1)
ar1.StartFrame()
ar1.FrameConfig(0, 1, 8, 64, 100, 0, 0, 1)
"""


def test_studio_lua_equals_cfg_of_same_radar(tmp_path):
    expected = read_settings_text(tmp_path, CFG)

    settings = read_settings_text(tmp_path, LUA, "capture.lua")

    assert settings.radar == expected.radar
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("qi", False, 16)
    assert (settings.n_frames, settings.receivers) == (8, (0, 1, 2, 3))
    assert (settings.device, settings.findings) == ("xwr1843", ())
    (tmp_path / "settings.cfg").unlink()
    assert find_settings_file(tmp_path / "adc_data.bin").name == "capture.lua"


def test_studio_lua_executes_loops_over_numbers(tmp_path):
    chirps = [line for line in LUA.splitlines() if line.startswith("ar1.ChirpConfig")]
    loop = (
        "local n_chirps = 2\nfor i = 0, n_chirps - 1, 1 do\n"
        "  ar1.ChirpConfig(i, i, 0, 0, 0, 0, 0, 1 - i, 0, i)\nend"
    )
    text = LUA.replace(chirps[0], loop).replace(chirps[1] + "\n", "")
    assert "ar1.ChirpConfig(0" not in text

    expected = read_settings_text(tmp_path, LUA, "calls.lua")
    assert read_settings_text(tmp_path, text, "loop.lua").radar == expected.radar
    # Countless turns and unknown limits leave the variable unknown.
    for limits in ("0, 1e8", "0, 1, 1e-300", "0, count()", "0, 1, 0"):
        with pytest.raises(dc.RecordingError, match="'i' of ChirpConfig in line"):
            read_settings_text(tmp_path, text.replace("0, n_chirps - 1, 1", limits), "unknown.lua")


def test_studio_lua_name_chooses_among_the_chips_it_selects(tmp_path):
    text = LUA.replace("(1, 1, 0, 0, 0, 0, 0, 0, 0, 1)", "(1, 1, 0, 0, 0, 0, 0, 0, 1, 0)")

    settings = read_settings_text(tmp_path, text, "1642_config.lua")

    assert settings.device == "xwr1642"
    assert settings.radar.array == device("xwr1642").select_antennas(0b11, 0b1111)
    (note,) = settings.findings
    assert "1642_config.lua" in note.value
    assert read_settings_text(tmp_path, text, "1443_config.lua").device == "xwr1843"


def test_studio_lua_receivers_and_samples_are_those_of_its_channels(tmp_path):
    text = LUA.replace("(1, 0, 1, 1, 1, 1, 1, 2, 1, 1)", "(1, 0, 1, 0, 1, 1, 0, 0, 0, 0)")

    settings = read_settings_text(tmp_path, text, "capture.lua")

    assert (settings.receivers, settings.bits) == ((1, 2), 12)
    assert settings.radar.frame.chirp.sampling == "real"
    without_channels = read_settings_text(tmp_path, LUA.replace("ar1.ChanN", "x.ChanN"), "a.lua")
    assert without_channels.receivers == (0, 1, 2, 3)
    assert without_channels.iq is None
    (warning,) = without_channels.findings
    assert "no ChanNAdcConfig" in warning.value


def test_studio_lua_profile_of_branches_is_that_of_the_device(tmp_path):
    other = "ar1.ProfileConfig(0, 60.25, 7, 6, 60, 0, 0, 0, 0, 0, 0, 29, 0, 256, 5000, 0, 0, 30)\n"
    text = LUA.replace("ar1.ChirpConfig(0", f"{other}ar1.ChirpConfig(0")

    assert read_settings_text(tmp_path, text, "a.lua").radar.frame.chirp.start_frequency_hz == 77e9
    at_60_ghz = read_settings_text(tmp_path, text, "a.lua", device_name="xwr6843")
    assert at_60_ghz.radar.frame.chirp.start_frequency_hz == 60.25e9
    unknown = read_settings_text(tmp_path, text.replace("SelectChip", "x"), "a.lua")
    assert unknown.radar.frame.chirp.start_frequency_hz == 60.25e9
    assert "2 different calls of ProfileConfig" in unknown.findings[-1].value


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("START_FREQ,", "start,", "start_ghz 'start' of ProfileConfig in line 11"),
        ("START_FREQ = 77", "START_FREQ = f(77)", "start_ghz 'START_FREQ'"),
        ("0x100", "256.5", "n_samples '256.5'"),
        ("0x100", "10^3", r"n_samples '10\^3'"),
        ("0x100", "1e99", "n_samples '1e99'"),
        ("idle_us = 2 * 5", "idle_us = 1 / 0", "idle_us 'idle_us'"),
        ("30.0, 0, ", "0, 0, 30.0, 0, ", "20 arguments in line 11|ProfileConfig with 20"),
        ("0, 0, 0, 0, 0, 1)", "0, 0, 0, 0, 0)", "ChirpConfig with 9 arguments in line 15"),
        ("ar1.FrameConfig(0, 1", "ar1.FrameConfig(0, 2", "chirps 0 to 2 of the frame"),
        ("ar1.ChirpConfig(1, 1, 0, 0", "ar1.ChirpConfig(1, 1, 0, 1", "which differ"),
        ("ar1.ChirpConfig(1, 1, 0", "ar1.ChirpConfig(1, 1, 2", "which differ"),
        ("ar1.ProfileConfig(0, S", "ar1.ProfileConfig(1, S", "profile 0, which is not set"),
        ("0, 0, 0, 0, 0, 1)", "0, 0, 0, 0, 1, 1)", "transmitters 2\\+3 at once"),
        ("1, 2, 1, 1) == 0", "1, 3, 1, 1) == 0", "bits 3"),
        ("ar1.FrameConfig", "x.FrameConfig", "no FrameConfig"),
        (
            "ar1.StartFrame",
            "ar1.AdvanceFrameConfig(1)\nar1.StartFrame",
            "AdvanceFrameConfig in line",
        ),
        ("ar1.ProfileConfig(0, S", "ar1.ProfileConfig_mult(1, 0, S", "cascade"),
        ("32, 50, 0", "0, 50, 0", "n_chirps"),
    ],
)
def test_rejects_studio_lua(tmp_path, old, new, message):
    assert old in LUA
    with pytest.raises(RecordingError, match=message):
        read_settings_text(tmp_path, LUA.replace(old, new), "capture.lua")


def format_infineon(**changes):
    shape = {
        "start_frequency_Hz": 60_000_000_000,
        "end_frequency_Hz": 61_000_000_000,
        "num_samples_per_chirp": 64,
        "num_chirps_per_frame": 16,
        "sample_rate_Hz": 2_000_000,
        "chirp_repetition_time_s": 0.0005,
        "frame_repetition_time_s": 0.1,
        "rx_antennas": [1, 3],
        "tx_antennas": [1],
        "mimo_mode": "off",
    }
    return json.dumps({"device_config": {"fmcw_single_shape": shape | changes}})


@pytest.mark.parametrize("mode", ["tdm", 1])
def test_two_infineon_transmitters_are_tdm(tmp_path, mode):
    settings = read_settings_text(
        tmp_path, format_infineon(mimo_mode=mode, tx_antennas=[1, 2]), "config.json"
    )

    frame = settings.radar.frame
    assert frame.multiplexing == Tdm(order=(0, 1))
    assert (frame.n_chirps, frame.n_chirps_total) == (16, 32)
    assert len(settings.radar.array.tx_m) == 2
    assert [finding.setting for finding in settings.findings] == ["radar.array"]


def test_device_gives_infineon_antennas(tmp_path):
    settings = read_settings_text(
        tmp_path, format_infineon(), "config.json", device_name="BGT60TR13C"
    )

    assert settings.radar.array == device("bgt60tr13c").select_antennas(0b1, 0b101)
    assert (settings.device, settings.bits, settings.receivers) == ("bgt60tr13c", 12, (0, 2))
    assert settings.findings == ()


@pytest.mark.parametrize(
    "changes",
    [
        {"mimo_mode": "other"},
        {"mimo_mode": []},
        {"tx_antennas": [1, 2]},
        {"rx_antennas": [0]},
        {"rx_antennas": ["a"]},
        {"rx_antennas": [1, 1]},
        {"rx_antennas": [[]] * 3},
        {"rx_antennas": [2**70]},
        {"num_chirps_per_frame": 0},
    ],
)
def test_rejects_unsupported_infineon_settings(tmp_path, changes):
    with pytest.raises(RecordingError) as error:
        read_settings_text(tmp_path, format_infineon(**changes), "config.json")

    assert "config.json" in str(error.value)


# --- Search for the settings of a recording -------------------------------------------


def test_setup_and_its_settings_are_one_candidate(tmp_path):
    recording = tmp_path / "adc_data.bin"
    (tmp_path / "walk.mmwave.json").write_text(format_studio())
    assert find_settings_file(recording) == tmp_path / "walk.mmwave.json"
    (tmp_path / "walk.setup.json").write_text(
        json.dumps(SETUP | {"configUsed": "walk.mmwave.json"})
    )

    assert find_settings_file(recording) == tmp_path / "walk.setup.json"


def test_either_file_of_settings_pair_may_have_name_of_recording(tmp_path):
    (tmp_path / "run.mmwave.json").write_text(format_studio())
    (tmp_path / "day.setup.json").write_text(json.dumps(SETUP | {"configUsed": "run.mmwave.json"}))
    (tmp_path / "other.cfg").write_text(CFG)

    assert find_settings_file(tmp_path / "run.bin") == tmp_path / "day.setup.json"
    with pytest.raises(RecordingError, match=re.escape("day.setup.json, other.cfg")):
        find_settings_file(tmp_path / "walk.bin")


def test_setup_file_belongs_to_only_settings_of_folder(tmp_path):
    (tmp_path / "renamed.mmwave.json").write_text(format_studio())

    settings = read_settings_text(tmp_path, json.dumps(SETUP), "a.setup.json")

    assert settings.device == "xwr1843"
    assert find_settings_file(tmp_path / "b.bin") == tmp_path / "a.setup.json"
    (tmp_path / "second.mmwave.json").write_text(format_studio())
    with pytest.raises(RecordingError, match="configUsed"):
        read_settings(tmp_path / "a.setup.json")


@pytest.mark.parametrize("folder", ["C:\\captures\\", "/home/someone/"])
def test_setup_file_names_settings_with_folder_of_recording_computer(tmp_path, folder):
    (tmp_path / "a.mmwave.json").write_text(format_studio())
    (tmp_path / "a.setup.json").write_text(
        json.dumps(SETUP | {"configUsed": f"{folder}a.mmwave.json"})
    )

    assert find_settings_file(tmp_path / "b.bin") == tmp_path / "a.setup.json"
    assert read_settings(tmp_path / "a.setup.json").device == "xwr1843"


def test_parts_of_split_capture_share_settings(tmp_path):
    (tmp_path / "adc_data.cfg").write_text(CFG)
    (tmp_path / "other.cfg").write_text(CFG.replace("256", "128"))

    for name in ("adc_data.bin", "adc_data_0.bin", "adc_data_1.bin", "adc_data_Raw_0.bin"):
        assert find_settings_file(tmp_path / name) == tmp_path / "adc_data.cfg"
    with pytest.raises(RecordingError, match=r"in the folder adc_data\.cfg, other\.cfg"):
        find_settings_file(tmp_path / "walk_0.bin")


def test_error_of_two_settings_files_names_both(tmp_path):
    for name in ("a.cfg", "b.cfg"):
        (tmp_path / name).write_text(CFG)

    with pytest.raises(
        RecordingError, match=r"in the folder a\.cfg, b\.cfg; .*/a\.cfg, --radar /.*/b\.cfg$"
    ):
        find_settings_file(tmp_path / "capture.bin")


def test_script_is_used_only_without_other_settings(tmp_path):
    (tmp_path / "demo.lua").write_text(LUA.replace("FREQ = 77", "FREQ = 78"))
    assert find_settings_file(tmp_path / "capture.bin") == tmp_path / "demo.lua"

    (tmp_path / "radar.cfg").write_text(CFG)

    assert find_settings_file(tmp_path / "capture.bin") == tmp_path / "radar.cfg"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_cfg_of_windows_tools_is_read(tmp_path, encoding):
    expected = read_settings_text(tmp_path, CFG)
    content = CFG.replace("\n", "\r\n").encode(encoding)
    mark = b"\xff\xfe" if encoding == "utf-16-le" else b""
    (tmp_path / "settings.cfg").write_bytes(mark + content)

    assert read_settings(tmp_path / "settings.cfg") == expected


def test_recognises_cfg_by_commands(tmp_path):
    (tmp_path / "radar.cfg").write_text(CFG)
    (tmp_path / "tool.cfg").write_text("[section]\nkey = 1\n")

    assert find_settings_file(tmp_path / "capture.bin") == tmp_path / "radar.cfg"


def test_cfg_without_settings_is_named(tmp_path):
    for name in ("tool.cfg", "empty.cfg"):
        (tmp_path / name).write_text("[section]\nkey = 1\n" if name == "tool.cfg" else "")

    with pytest.raises(RecordingError, match="not those of a radar: empty.cfg, tool.cfg"):
        find_settings_file(tmp_path / "capture.bin")


def test_links_out_of_folder_are_ignored(tmp_path):
    recording_folder, external_folder = tmp_path / "inside", tmp_path / "outside"
    recording_folder.mkdir()
    external_folder.mkdir()
    (external_folder / "radar.cfg").write_text(CFG)
    (recording_folder / "capture.cfg").symlink_to(external_folder / "radar.cfg")
    (recording_folder / "round.cfg").symlink_to(recording_folder / "round.cfg")

    with pytest.raises(RecordingError, match="no settings in the recording"):
        find_settings_file(recording_folder / "capture.bin")

    (recording_folder / "radar.cfg").write_text(CFG)
    (recording_folder / "capture_1.cfg").symlink_to(recording_folder / "radar.cfg")
    assert find_settings_file(recording_folder / "capture_1.bin").name == "capture_1.cfg"


def test_settings_content_takes_precedence_over_suffix(tmp_path):
    for name, text in [("a.txt", CFG), ("b.txt", format_studio()), ("c.dat", format_infineon())]:
        (tmp_path / name).write_text(text)
        assert read_radar(tmp_path / name).frame.period_s in (50e-3, 0.1)


# --- Random and corrupted settings ----------------------------------------------------

ODD_VALUES = st.sampled_from(
    ["0", "-1", "1e999", "nan", "inf", "1" * 40, "0x10", "4096", "65536", "0.5", "x", "", "1_0",
     "\u0661", "\0", "1 2"]
)  # fmt: skip
VALID_FILES = {
    "a.lua": LUA,
    "settings.cfg": CFG,
    "LogFile.txt": format_log(),
    "a.mmwave.json": format_studio(),
    "config.json": format_infineon(),
    "radar.yaml": CFG,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("odd")


def assert_settings_or_error(folder, name, text):
    """Fail unless a text gives complete settings or one of the documented errors."""
    (folder / name).write_bytes(text.encode("utf-8", errors="surrogatepass"))
    try:
        loaded_settings = read_settings(folder / name)
    except (RecordingError, InvalidFile) as error:
        assert str(error)
    else:
        assert loaded_settings.radar.frame.n_chirps_total > 0
        assert (
            len(loaded_settings.receivers or loaded_settings.radar.array.rx_m)
            == loaded_settings.radar.array.n_rx
        )


@settings(max_examples=n_examples(300))
@given(data=st.data(), name=st.sampled_from(sorted(VALID_FILES)))
def test_corrupted_settings_are_read_or_rejected(folder, data, name):
    words = re.split(r"(?<=[\s,:])|(?=[\s,:])", VALID_FILES[name])
    for _ in range(data.draw(st.integers(1, 4))):
        index = data.draw(st.integers(0, len(words) - 1))
        words[index] = data.draw(ODD_VALUES)
    text = "".join(words)
    cut = data.draw(st.integers(0, len(text)))

    assert_settings_or_error(folder, name, text[:cut] if cut % 3 == 0 else text)


@settings(max_examples=n_examples(100))
@given(text=st.text(max_size=200), name=st.sampled_from(sorted(VALID_FILES)))
def test_random_text_is_read_or_rejected(folder, text, name):
    assert_settings_or_error(folder, name, text)


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | ODD_VALUES,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["rfConfig", "fmt", "frameSeq", "a"]), inner)
    ),
    max_leaves=6,
)


@settings(max_examples=n_examples(200))
@given(data=st.data())
def test_random_json_value_is_read_or_rejected(folder, data):
    document = json.loads(
        data.draw(st.sampled_from([format_studio(), format_infineon(), json.dumps(SETUP)]))
    )
    node = document
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = data.draw(st.sampled_from(keys))
        is_container = isinstance(node[key], dict | list) and node[key]
        if not is_container or data.draw(st.integers(0, 3)) == 0:
            node[key] = data.draw(JSON_VALUES)
            break
        node = node[key]

    assert_settings_or_error(folder, "any.json", json.dumps(document))


def test_deeply_nested_json_is_read_or_rejected(tmp_path):
    nested_lists = "[" * 900 + "]" * 900  # accepted by the parser, too deep to print

    for text in (format_studio(), format_infineon(), json.dumps(SETUP)):
        for key in re.findall(r'"(\w+)": (?=[^{\[])', text):
            nested_text = re.sub(rf'"{key}": [^,}}\]]+', f'"{key}": {nested_lists}', text)
            assert_settings_or_error(tmp_path, "deep.json", nested_text)
