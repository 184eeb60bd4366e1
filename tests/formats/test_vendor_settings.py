"""Settings files of vendors: what each says of the radar, and what is said of their mistakes."""

import json
import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import InvalidFile, RecordingError
from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.recordings.settings.read import find_settings, read_radar, read_settings


def from_text(tmp_path, text, name="settings.cfg", of=None):
    (tmp_path / name).write_text(text)
    return read_settings(tmp_path / name, None if of is None else device(of))


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


def test_a_cfg_gives_what_the_chip_sends_and_how_it_keeps_it(tmp_path):
    made = from_text(tmp_path, CFG)

    frame, chirp = made.radar.frame, made.radar.frame.chirp
    assert chirp.start_frequency_hz == pytest.approx(77e9)
    assert chirp.slope_hz_per_s == pytest.approx(30e12)
    assert chirp.adc_start_s == pytest.approx(6e-6)
    assert chirp.ramp_duration_s == pytest.approx(60e-6)
    assert chirp.sample_rate_hz == pytest.approx(5e6)
    assert (chirp.n_samples, chirp.sampling) == (256, "complex")
    assert frame.interval_s == pytest.approx(70e-6)  # idle, then the ramp
    assert frame.period_s == pytest.approx(50e-3)
    assert (frame.n_chirps, frame.n_chirps_total, frame.multiplexing) == (32, 64, Tdm(order=(0, 1)))
    assert (made.iq, made.is_interleaved, made.bits) == ("qi", False, 16)
    assert (made.n_frames, made.receivers, made.device) == (None, (0, 1, 2, 3), "xwr1843")


def test_positions_are_those_of_the_antennas_that_the_masks_switch_on(tmp_path):
    board = device("xwr1843")

    made = from_text(tmp_path, CFG.replace("channelCfg 15 5 0", "channelCfg 6 5 0"))

    assert made.radar.array == board.select_antennas(0b101, 0b0110)
    assert made.receivers == (1, 2)
    assert made.findings == ()


def test_codes_of_back_off_and_phase_of_three_transmitters_are_numbers(tmp_path):
    # 20 dB and 354.4 degrees of each, a byte each: 1315860 and 16579836.
    coded = CFG.replace("profileCfg 0 77 10 6 60 0 0", "profileCfg 0 77 10 6 60 1315860 16579836")

    assert coded != CFG
    assert from_text(tmp_path, coded).radar == from_text(tmp_path, CFG).radar


def test_a_frame_of_a_newer_chip_says_whose_it_is(tmp_path):
    # Its frameCfg has one number more, that of the samples.
    newer = CFG.replace("frameCfg 0 1 32 0 50", "frameCfg 0 1 32 0 256 50")

    with pytest.raises(InvalidFile, match="AWR2944"):
        from_text(tmp_path, newer)


def test_transmitters_keep_their_order_of_turns(tmp_path):
    swapped = CFG.replace("0 0 0 0 0 4", "0 0 0 0 0 x").replace("0 0 0 0 0 1\n", "0 0 0 0 0 4\n")

    made = from_text(tmp_path, swapped.replace("0 0 0 0 0 x", "0 0 0 0 0 1"))

    assert made.radar.frame.multiplexing == Tdm(order=(1, 0))
    assert made.radar.array == device("xwr1843").select_antennas(0b101, 0b1111)


def test_rounds_in_a_loop_are_chirps_of_each_transmitter(tmp_path):
    # Transmitters 1, 3, 1, 3 in a loop, 32 times, are 64 chirps of each.
    twice = CFG.replace(
        "frameCfg 0 1", "chirpCfg 2 2 0 0 0 0 0 1\nchirpCfg 3 3 0 0 0 0 0 4\nframeCfg 0 3"
    )

    assert from_text(tmp_path, twice).radar.frame.n_chirps == 64


def test_chirps_of_one_transmitter_need_no_multiplexing(tmp_path):
    alone = CFG.replace("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 1")

    frame = from_text(tmp_path, alone).radar.frame

    assert (frame.n_chirps, frame.multiplexing) == (64, None)


# The demo sends the first chirp with both plus, the second with the later one minus.
BPM = CFG.replace("0 0 0 0 0 1\n", "0 0 0 0 0 5\n").replace("0 0 0 0 0 4\n", "0 0 0 0 0 5\n")
BPM = BPM.replace("lowPower 0 0", "bpmCfg -1 1 0 1")


def test_two_transmitters_that_send_together_with_signs_are_read(tmp_path):
    made = from_text(tmp_path, BPM)

    frame = made.radar.frame
    assert (frame.n_chirps, frame.n_chirps_total, frame.multiplexing) == (32, 64, Bpm(order=(0, 1)))
    assert frame.chirp_weights()[:4].tolist() == [[1, 1], [1, -1], [1, 1], [1, -1]]
    assert made.radar.array == device("xwr1843").select_antennas(0b101, 0b1111)


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
def test_signs_on_other_chirps_than_the_two_of_a_pair_are_refused(tmp_path, old, new):
    assert old in BPM
    with pytest.raises(InvalidFile, match="bpmCfg: enabled 1.*the same two transmitters"):
        from_text(tmp_path, BPM.replace(old, new))


def test_without_a_known_device_the_virtual_array_is_assumed_to_be_a_line(tmp_path):
    made = from_text(tmp_path, CFG.replace("xWR18xx", "something"))

    half_m = made.radar.frame.chirp.wavelength_m / 2
    array = made.radar.array
    virtual = sorted(tx[1] + rx[1] for tx in array.tx_m for rx in array.rx_m)
    assert virtual == pytest.approx([n * half_m for n in range(8)])
    (assumed,) = made.findings
    assert (assumed.level, assumed.setting) == ("note", "radar.array")
    assert made.device is None


def test_a_device_that_is_given_comes_before_the_one_in_the_file(tmp_path):
    made = from_text(
        tmp_path, CFG.replace("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 2"), of="AWR1642"
    )

    assert made.device == "xwr1642"
    assert made.radar.array == device("xwr1642").select_antennas(0b11, 0b1111)


def test_the_first_demos_have_no_sub_frames(tmp_path):
    # Four numbers, of a chip whose receivers alternate.
    text = CFG.replace("adcbufCfg -1 0 1 1 1", "adcbufCfg 0 0 0 1").replace("xWR18xx", "xWR14xx")

    made = from_text(tmp_path, text)

    assert (made.iq, made.is_interleaved, made.device) == ("iq", True, "xwr1443")


def test_real_samples_have_no_order_of_their_parts(tmp_path):
    text = CFG.replace("adcCfg 2 1", "adcCfg 0 0").replace("adcbufCfg -1 0", "adcbufCfg -1 1")

    made = from_text(tmp_path, text)

    assert (made.radar.frame.chirp.sampling, made.iq, made.bits) == ("real", None, 12)


def test_the_last_command_before_the_last_start_holds(tmp_path):
    later = "profileCfg 0 78 20 6 60 0 0 30 1 128 5000 0 0 30\n"

    made = from_text(tmp_path, CFG.replace("frameCfg", later + "frameCfg", 1) + later)

    assert made.radar.frame.chirp.n_samples == 128
    assert made.radar.frame.interval_s == pytest.approx(80e-6)


def test_a_flush_forgets_what_was_before(tmp_path):
    with pytest.raises(InvalidFile) as error:
        from_text(tmp_path, CFG.replace("lowPower", "flushCfg\nlowPower"))

    assert "profileCfg" in str(error.value)
    assert "missing" in str(error.value)


def test_frames_of_one_chirp_are_the_chirps_of_one_frame(tmp_path):
    made = from_text(tmp_path, CFG.replace("frameCfg 0 1 32 0 50", "frameCfg 0 0 1 200 1"))

    assert made.has_merged_frames
    assert (made.radar.frame.n_chirps, made.n_frames) == (200, 1)
    assert made.radar.frame.interval_s == pytest.approx(1e-3)


def test_a_frame_of_one_sub_frame_is_a_frame(tmp_path):
    advanced = CFG.replace("dfeDataOutputMode 1", "dfeDataOutputMode 3").replace(
        "frameCfg 0 1 32 0 50 1 0",
        "advFrameCfg 1 0 7 1 0\nsubFrameCfg 0 0 0 2 32 50 0 1 1 50",
    )

    made = from_text(tmp_path, advanced)

    assert made.radar == from_text(tmp_path, CFG).radar
    assert made.n_frames == 7


@pytest.mark.parametrize(
    ("old", "new", "line", "named"),
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
        ("lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg -1 1 1 0", 13, "header 1"),
        ("lowPower 0 0", "bpmCfg -1 1 0 1", 12, "enabled 1"),
        ("dfeDataOutputMode 1", "dfeDataOutputMode 2", 4, "mode 2"),
    ],
)
def test_a_wrong_command_is_named_with_its_line(tmp_path, old, new, line, named):
    assert old in CFG
    with pytest.raises(InvalidFile) as error:
        from_text(tmp_path, CFG.replace(old, new, 1))

    wrong = [mistake for mistake in error.value.mistakes if mistake.line == line]
    assert wrong, str(error.value)
    assert named in wrong[0].value
    assert wrong[0].setting in (CFG.splitlines()[line - 1].split()[0], new.split()[0])


def test_all_mistakes_of_a_cfg_are_told_at_once(tmp_path):
    text = CFG.replace("adcCfg 2 1", "adcCfg 2").replace("profileCfg 0 77", "profileCfg 0 x")

    with pytest.raises(InvalidFile) as error:
        from_text(tmp_path, text.replace("frameCfg", "% frameCfg"))

    assert [mistake.setting for mistake in error.value.mistakes] == [
        "adcCfg", "profileCfg", "frameCfg",
    ]  # fmt: skip


def test_two_sub_frames_are_refused(tmp_path):
    advanced = CFG.replace("dfeDataOutputMode 1", "dfeDataOutputMode 3").replace(
        "frameCfg 0 1 32 0 50 1 0",
        "advFrameCfg 2 0 0 1 0\nsubFrameCfg 0 0 0 2 32 50 0 1 1 50\n"
        "subFrameCfg 1 0 0 2 32 50 0 1 1 50",
    )

    with pytest.raises(InvalidFile, match="n_sub_frames 2"):
        from_text(tmp_path, advanced)


def test_transmitters_out_of_turn_are_refused(tmp_path):
    text = CFG.replace("frameCfg 0 1", "chirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2")

    with pytest.raises(InvalidFile, match="order 1 3 3"):
        from_text(tmp_path, text)


def test_files_of_the_low_power_chips_are_refused_by_name(tmp_path):
    text = "% xWRL6432\nchannelCfg 7 3 0\nchirpComnCfg 8 0 0 256 1 13 3\nframeCfg 64 0 1358 1 9 0\n"

    with pytest.raises(InvalidFile) as error:
        from_text(tmp_path, text)

    (wrong,) = error.value.mistakes
    assert (wrong.setting, wrong.line) == ("chirpComnCfg", 3)


def test_antennas_that_the_device_has_not_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="tx_mask"):
        from_text(tmp_path, CFG, of="xwr1642")  # whose transmitters are 1 and 2


def test_frames_of_no_chirp_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="n_chirps"):
        from_text(tmp_path, CFG.replace("frameCfg 0 1 32", "frameCfg 0 1 0"))


# --- TI mmWave Studio -----------------------------------------------------------------


def profile(**changes):
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


def chirp(index, mask, **changes):
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


def chip(masks=("0x1", "0x4"), **changes):
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
        "rlProfiles": [profile()],
        "rlChirps": [chirp(index, mask) for index, mask in enumerate(masks)],
        "rlFrameCfg_t": frame,
        "rlBpmChirps": [],
    }
    layout = {"rlDevDataFmtCfg_t": {"iqSwapSel": 1, "chInterleave": 1}}
    return {"rfConfig": radio | changes, "rawDataCaptureConfig": layout}


def studio(*chips):
    return json.dumps({"mmWaveDevices": list(chips or [chip()])})


SETUP = {"configUsed": "a.mmwave.json", "mmWaveDevice": "awr1843", "captureHardware": "DCA1000"}


def test_what_studio_told_the_radar_is_what_the_cfg_of_the_same_radar_says(tmp_path):
    expected = from_text(tmp_path, CFG)

    made = from_text(tmp_path, studio(), "a.mmwave.json", of="xwr1843")

    assert made.radar == expected.radar
    assert (made.iq, made.is_interleaved, made.bits) == ("qi", False, 16)
    assert (made.n_frames, made.receivers) == (8, (0, 1, 2, 3))


def test_a_setup_file_names_the_settings_and_the_chip(tmp_path):
    (tmp_path / "a.mmwave.json").write_text(studio())

    made = from_text(tmp_path, json.dumps(SETUP), "a.setup.json")

    assert made.path == tmp_path / "a.setup.json"
    own = from_text(tmp_path, studio(), "a.mmwave.json", of="xwr1843")
    assert replace(made, path=own.path) == own


def test_one_sub_frame_is_a_frame_for_studio_too(tmp_path):
    sub_frame = {
        "chirpStartIdx": 0,
        "numOfChirps": 2,
        "numLoops": 32,
        "numOfBurst": 1,
        "numOfBurstLoops": 1,
        "subFramePeriodicity_msec": 50.0,
    }
    unused = {"rlSubFrameCfg_t": dict.fromkeys(sub_frame, 0)}
    sequence = {
        "numOfSubFrames": 1,
        "forceProfile": 0,
        "numFrames": 8,
        "subFrameCfg": [{"rlSubFrameCfg_t": sub_frame}, unused],
    }
    advanced = chip(waveformType="advancedFrameChirp", rlAdvFrameCfg_t={"frameSeq": sequence})

    made = from_text(tmp_path, studio(advanced), "a.mmwave.json")

    assert made.radar == from_text(tmp_path, studio(), "a.mmwave.json").radar
    sequence["numOfSubFrames"] = 2
    with pytest.raises(RecordingError, match="numOfSubFrames"):
        from_text(tmp_path, studio(advanced), "a.mmwave.json")


def test_chips_of_a_cascade_send_in_turn_with_all_their_antennas(tmp_path):
    # Four chips, of which the second sends in the first chirp and the first in the second.
    chips = [chip(masks) for masks in (("0x0", "0x4"), ("0x1", "0x0"), ("0", "0"), ("0", "0"))]

    made = from_text(tmp_path, studio(*chips), "a.mmwave.json")

    assert made.device == "cascade"
    assert made.radar.array == device("cascade").select_antennas(1 << 2 | 1 << 3, 2**16 - 1)
    assert made.radar.frame.multiplexing == Tdm(order=(1, 0))
    assert made.receivers == tuple(range(16))


@pytest.mark.parametrize(
    ("document", "named"),
    [
        ("[" * 100_000, "nested too deeply"),
        ("{", "not JSON"),
        ('{"mmWaveDevices": []}', "no list mmWaveDevices"),
        ('{"mmWaveDevices": [3]}', "mmWaveDevices[0].rfConfig.rlChanCfg_t missing"),
        (studio(chip(rlProfiles=[profile(numAdcSamples="many")])), 'numAdcSamples = "many"'),
        (studio(chip(rlProfiles=[profile(numAdcSamples=1e999)])), "numAdcSamples = Infinity"),
        (studio(chip(rlProfiles=[profile(numAdcSamples=10**400)])), "numAdcSamples = 1000"),
        (studio(chip(rlProfiles=[profile(startFreqConst_GHz=None)])), "GHz = null"),
        (studio(chip(rlProfiles=[profile(startFreqConst_GHz=[[]])])), "GHz = a list"),
        (studio(chip(rlAdcOutCfg_t={"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 3}})), "OutFmt = 3"),
        (studio(chip(rlBpmChirps=[{"rlBpmChirpCfg_t": {}}])), "rlBpmChirps"),
        (studio(chip(["0x3"])), "transmitters 1+2 at once"),
        (studio(chip(["0x0"])), "chirp 0 without transmitter"),
        (studio(chip(["-1"])), "chirp 0 without transmitter"),
        (studio(chip(rlChirps=[chirp(0, "1")])), "differ or are not set"),
        (studio(chip(rlChirps=[chirp(0, "1"), chirp(1, "2", idleTimeVar_usec=1)])), "differ"),
        (studio(chip(rlProfiles=[profile(freqSlopeConst_MHz_usec=-30)])), "slope_hz_per_s"),
        (studio(chip(["0x1"]), chip(["0x9"])), "chirp 0 without transmitter"),
    ],
)
def test_settings_of_studio_that_are_not_right_are_named_with_what_is_wrong(
    tmp_path, document, named
):
    with pytest.raises(RecordingError) as error:
        from_text(tmp_path, document, "a.mmwave.json" if "mmW" in document else "a.json")

    assert named in str(error.value)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    "name", ["/etc/hostname", "../a.mmwave.json", "sub/a.mmwave.json", "C:\\a.json", "..", "",
             "missing.mmwave.json", "\ud800", "x" * 254, "link.mmwave.json", "b.setup.json", None],
)  # fmt: skip
def test_a_setup_file_names_only_what_lies_beside_it(tmp_path, name):
    (tmp_path / "sub").mkdir()
    for path in (tmp_path / "a.mmwave.json", tmp_path / "sub" / "a.mmwave.json"):
        path.write_text(studio())
    beside = tmp_path / "sub"
    (beside / "link.mmwave.json").symlink_to(tmp_path / "a.mmwave.json")
    (beside / "a.mmwave.json").unlink()
    text = json.dumps(SETUP | {"configUsed": name})

    with pytest.raises(RecordingError) as error:
        from_text(beside, text, "b.setup.json")

    assert "configUsed" in str(error.value)
    assert "beside it" in str(error.value)


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


def log(chip="AR1243", bits=2, form=1, interleave=0):
    return LOG.format(chip=chip, bits=bits, form=form, interleave=interleave)


def test_a_log_of_transmitters_that_take_turns_has_their_multiplexing(tmp_path):
    made = from_text(tmp_path, log(), "LogFile.txt")

    assert made.radar.frame.multiplexing == Tdm(order=(0, 1))
    assert (made.radar.frame.n_chirps, made.radar.frame.n_chirps_total) == (32, 64)
    assert made.radar.array == device("AWR1243").select_antennas(0b101, 0b1111)
    assert (made.device, made.is_interleaved, made.receivers) == ("xwr1443", True, (0, 1, 2, 3))


def test_the_transmitters_of_a_chirp_in_a_log_are_a_mask(tmp_path):
    # 2 is the second transmitter, and no flag of the first.
    made = from_text(tmp_path, log().replace("0,0,0,0,0,4,0,", "0,0,0,0,0,2,0,"), "LogFile.txt")

    assert made.radar.frame.multiplexing == Tdm(order=(0, 1))
    assert made.radar.array == device("AWR1243").select_antennas(0b011, 0b1111)


def test_a_log_says_how_the_samples_were_kept(tmp_path):
    real = from_text(tmp_path, log("other chip", bits=0, form=0, interleave=1), "LogFile.txt")

    assert (real.radar.frame.chirp.sampling, real.iq) == ("real", None)
    assert (real.bits, real.is_interleaved, real.device) == (12, False, None)
    assert [finding.setting for finding in real.findings] == ["radar.array"]


@pytest.mark.parametrize(
    ("old", "new", "named"),
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
def test_a_log_of_what_is_not_read_says_so(tmp_path, old, new, named):
    assert old in log()
    with pytest.raises(RecordingError) as error:
        from_text(tmp_path, log().replace(old, new, 1), "LogFile.txt")

    assert named in str(error.value)


# --- Infineon -------------------------------------------------------------------------


def infineon(**changes):
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
def test_two_transmitters_of_infineon_take_turns(tmp_path, mode):
    made = from_text(tmp_path, infineon(mimo_mode=mode, tx_antennas=[1, 2]), "config.json")

    frame = made.radar.frame
    assert frame.multiplexing == Tdm(order=(0, 1))
    assert (frame.n_chirps, frame.n_chirps_total) == (16, 32)
    assert len(made.radar.array.tx_m) == 2
    assert [finding.setting for finding in made.findings] == ["radar.array"]


def test_antennas_of_infineon_are_known_once_the_device_is(tmp_path):
    made = from_text(tmp_path, infineon(), "config.json", of="BGT60TR13C")

    assert made.radar.array == device("bgt60tr13c").select_antennas(0b1, 0b101)
    assert (made.device, made.bits, made.receivers) == ("bgt60tr13c", 12, (0, 2))
    assert made.findings == ()


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
def test_settings_of_infineon_that_are_not_read_are_refused(tmp_path, changes):
    with pytest.raises(RecordingError) as error:
        from_text(tmp_path, infineon(**changes), "config.json")

    assert "config.json" in str(error.value)


# --- Which file belongs to a recording ------------------------------------------------


def test_a_setup_and_the_settings_it_names_are_one_candidate(tmp_path):
    recording = tmp_path / "adc_data.bin"
    (tmp_path / "walk.mmwave.json").write_text(studio())
    assert find_settings(recording) == tmp_path / "walk.mmwave.json"
    (tmp_path / "walk.setup.json").write_text(
        json.dumps(SETUP | {"configUsed": "walk.mmwave.json"})
    )

    assert find_settings(recording) == tmp_path / "walk.setup.json"


def test_settings_named_after_the_recording_may_be_either_of_a_pair(tmp_path):
    (tmp_path / "run.mmwave.json").write_text(studio())
    (tmp_path / "day.setup.json").write_text(json.dumps(SETUP | {"configUsed": "run.mmwave.json"}))
    (tmp_path / "other.cfg").write_text(CFG)

    assert find_settings(tmp_path / "run.bin") == tmp_path / "day.setup.json"
    with pytest.raises(RecordingError, match=re.escape("day.setup.json, other.cfg")):
        find_settings(tmp_path / "walk.bin")


def test_a_setup_file_of_another_folder_leaves_the_settings_themselves(tmp_path):
    (tmp_path / "a.mmwave.json").write_text(studio())
    (tmp_path / "a.setup.json").write_text(
        json.dumps(SETUP | {"configUsed": "C:\\captures\\a.mmwave.json"})
    )

    assert find_settings(tmp_path / "a.bin") == tmp_path / "a.mmwave.json"


def test_a_cfg_is_known_by_its_commands(tmp_path):
    (tmp_path / "radar.cfg").write_text(CFG)
    (tmp_path / "tool.cfg").write_text("[section]\nkey = 1\n")

    assert find_settings(tmp_path / "capture.bin") == tmp_path / "radar.cfg"


def test_links_that_leave_the_folder_are_left_alone(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    (outside / "radar.cfg").write_text(CFG)
    (inside / "capture.cfg").symlink_to(outside / "radar.cfg")
    (inside / "round.cfg").symlink_to(inside / "round.cfg")

    with pytest.raises(RecordingError, match="no settings in the recording"):
        find_settings(inside / "capture.bin")

    (inside / "radar.cfg").write_text(CFG)
    (inside / "capture_1.cfg").symlink_to(inside / "radar.cfg")
    assert find_settings(inside / "capture_1.bin").name == "capture_1.cfg"


def test_the_content_decides_over_the_ending(tmp_path):
    for name, text in [("a.txt", CFG), ("b.txt", studio()), ("c.dat", infineon())]:
        (tmp_path / name).write_text(text)
        assert read_radar(tmp_path / name).frame.period_s in (50e-3, 0.1)


# --- Anything at all ------------------------------------------------------------------

ODD = st.sampled_from(
    ["0", "-1", "1e999", "nan", "inf", "1" * 40, "0x10", "4096", "65536", "0.5", "x", "", "1_0",
     "\u0661", "\0", "1 2"]
)  # fmt: skip
WHOLE = {
    "settings.cfg": CFG,
    "LogFile.txt": log(),
    "a.mmwave.json": studio(),
    "config.json": infineon(),
    "radar.yaml": CFG,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("odd")


def read_or_refuse(folder, name, text):
    """Read a text, or be refused by one of the errors that say why."""
    (folder / name).write_bytes(text.encode("utf-8", errors="surrogatepass"))
    try:
        made = read_settings(folder / name)
    except (RecordingError, InvalidFile) as error:
        assert str(error)
    else:
        assert made.radar.frame.n_chirps_total > 0
        assert len(made.receivers or made.radar.array.rx_m) == made.radar.array.n_rx


@settings(max_examples=300)
@given(data=st.data(), name=st.sampled_from(sorted(WHOLE)))
def test_any_damage_is_read_or_refused(folder, data, name):
    words = re.split(r"(?<=[\s,:])|(?=[\s,:])", WHOLE[name])
    for _ in range(data.draw(st.integers(1, 4))):
        index = data.draw(st.integers(0, len(words) - 1))
        words[index] = data.draw(ODD)
    text = "".join(words)
    cut = data.draw(st.integers(0, len(text)))

    read_or_refuse(folder, name, text[:cut] if cut % 3 == 0 else text)


@settings(max_examples=100)
@given(text=st.text(max_size=200), name=st.sampled_from(sorted(WHOLE)))
def test_any_text_is_read_or_refused(folder, text, name):
    read_or_refuse(folder, name, text)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | ODD,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["rfConfig", "fmt", "frameSeq", "a"]), inner)
    ),
    max_leaves=6,
)


@settings(max_examples=200)
@given(data=st.data())
def test_any_json_in_the_place_of_any_part_is_read_or_refused(folder, data):
    document = json.loads(data.draw(st.sampled_from([studio(), infineon(), json.dumps(SETUP)])))
    thing = document
    while True:
        keys = list(thing) if isinstance(thing, dict) else list(range(len(thing)))
        key = data.draw(st.sampled_from(keys))
        deeper = isinstance(thing[key], dict | list) and thing[key]
        if not deeper or data.draw(st.integers(0, 3)) == 0:
            thing[key] = data.draw(JSON)
            break
        thing = thing[key]

    read_or_refuse(folder, "any.json", json.dumps(document))


def test_deep_nesting_is_refused_wherever_it_stands(tmp_path):
    deep = "[" * 900 + "]" * 900  # within what the parser takes, beyond what may be shown

    for text in (studio(), infineon(), json.dumps(SETUP)):
        for key in re.findall(r'"(\w+)": (?=[^{\[])', text):
            damaged = re.sub(rf'"{key}": [^,}}\]]+', f'"{key}": {deep}', text)
            read_or_refuse(tmp_path, "deep.json", damaged)
