"""Settings files of real recordings say what is known of their radars."""

import json

import pytest

from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.recordings.settings.read import find_settings, read_settings
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg

CFGS = [
    ("dca1000_pcap/xwr18xx_profile.cfg", None),
    ("xwr1443_known_angles/radar_full_band.cfg", "xwr1443"),
    ("xwr1443_known_angles/radar_1GHz.cfg", "xwr1443"),
]


def said(folder):
    return json.loads((folder / "meta.json").read_text(encoding="utf-8"))["waveform"]


def agrees(frame, waveform, *, slope_hz_per_s=None):
    """Compare with every value of a table that is no follow-up of others."""
    chirp = frame.chirp
    got = {
        "start_frequency_hz": chirp.start_frequency_hz,
        "slope_hz_per_s": chirp.slope_hz_per_s,
        "sample_rate_hz": chirp.sample_rate_hz,
        "samples_per_chirp": chirp.n_samples,
        "chirp_repetition_time_s": frame.interval_s,
        "same_tx_repetition_time_s": frame.repetition_s,
        "chirps_per_frame": frame.n_chirps,
        "frame_period_s": frame.period_s,
        "sampled_bandwidth_hz": chirp.sampled_bandwidth_hz,
        "adc_start_time_s": chirp.adc_start_s,
        "ramp_end_time_s": chirp.ramp_duration_s,
        "idle_time_s": frame.interval_s - chirp.ramp_duration_s,
    }
    for name, value in got.items():
        if waveform.get(name) is not None:
            assert value == pytest.approx(waveform[name], rel=1e-6), name
    # The table has it rounded to 0.1 um.
    assert chirp.range_resolution_m == pytest.approx(waveform["range_bin_m"], abs=1e-6)


@pytest.mark.parametrize("name", ["indoor_walking.mmwave.json", "indoor_walking.setup.json"])
def test_both_files_of_studio_give_the_known_waveform(real_data, name):
    folder = real_data / "mmwavestudio_json"

    settings = read_settings(folder / name)

    waveform = said(folder)
    agrees(settings.radar.frame, waveform)
    assert settings.n_frames == waveform["num_frames"]
    assert settings.radar.frame.multiplexing is None  # both are on, but one sends
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("iq", True, 16)
    assert settings.receivers == (0, 1, 2, 3)
    assert settings.device == ("xwr1443" if "setup" in name else None)


def test_the_pair_of_studio_is_found_as_one(real_data):
    folder = real_data / "mmwavestudio_json"

    assert find_settings(folder / "adc_data.bin").name == "indoor_walking.setup.json"


def test_the_cfg_of_known_angles_gives_the_known_waveform(real_data):
    folder = real_data / "xwr1443_known_angles"

    settings = read_settings(folder / "radar_full_band.cfg", device("xWR1443"))

    waveform = said(folder)
    frame = settings.radar.frame
    agrees(frame, waveform)
    assert frame.multiplexing == Tdm(order=(0, 1))
    assert settings.radar.array == device("xwr1443").select_antennas(0b101, 0b1111)
    assert (settings.n_frames, settings.is_interleaved, settings.iq) == (1, True, "iq")
    narrow = read_settings(folder / "radar_1GHz.cfg").radar.frame.chirp
    slope = waveform["alternative_slope_hz_per_s_for_1GHz_files"]
    assert narrow.slope_hz_per_s == pytest.approx(slope, rel=1e-6)


def test_a_cfg_of_the_visualizer_is_read(real_data):
    settings = read_settings(real_data / "dca1000_pcap" / "xwr18xx_profile.cfg")

    frame = settings.radar.frame
    assert frame.chirp.n_samples == said(real_data / "dca1000_pcap")["samples_per_chirp"]
    assert frame.multiplexing == Tdm(order=(0, 1))
    # The comments at its head, which the visualizer wrote: 0.044 m, 0.13 m/s and 1 m/s.
    assert frame.chirp.range_resolution_m == pytest.approx(0.044, abs=5e-4)
    assert frame.velocity_resolution_m_per_s == pytest.approx(0.13, abs=0.01)
    assert frame.max_velocity_m_per_s == pytest.approx(1, abs=0.05)
    assert (settings.device, settings.iq, settings.is_interleaved) == ("xwr1843", "qi", False)


@pytest.mark.parametrize(("name", "told"), CFGS)
def test_a_real_cfg_survives_being_written_and_read(real_data, tmp_path, name, told):
    settings = read_settings(real_data / name, None if told is None else device(told))

    text = format_ti_cfg(settings.radar, device=settings.device, n_frames=settings.n_frames or 0)
    (tmp_path / "radar.cfg").write_text(text)
    back = read_settings(tmp_path / "radar.cfg")

    assert back.radar == settings.radar
    assert back.n_frames == settings.n_frames
    # The commands that say what is sent are the same, number for number.
    sent = ("channelCfg", "adcCfg", "profileCfg", "chirpCfg", "frameCfg")
    if settings.device == "xwr1443":
        # That was for the capture demo, which keeps I first; the out-of-the-box demo has Q first.
        assert (settings.iq, back.iq) == ("iq", "qi")
    else:
        assert back.iq == settings.iq
        sent = (*sent, "adcbufCfg")
    original = (real_data / name).read_text().splitlines()
    assert [line for line in text.splitlines() if line.startswith(sent)] == [
        line for line in original if line.startswith(sent)
    ]


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_the_log_names_the_chip_and_so_its_antennas(real_data, name):
    folder = real_data / "awr1642_vibrating_pipe"

    settings = read_settings(folder / f"{name}_LogFile.txt")

    assert (settings.device, settings.is_interleaved, settings.bits) == ("xwr1642", False, 16)
    assert settings.radar.array == device("xwr1642").select_antennas(0b1, 0b1111)


@pytest.mark.parametrize("name", ["bgt60_breathing", "bgt60_people_room", "bgt60_two_reflectors"])
def test_antennas_of_infineon_are_those_of_the_device_that_is_given(real_data, name):
    file = real_data / name / "RadarIfxAvian_00" / "config.json"
    board = device("bgt60tr13c")

    assumed, known = read_settings(file), read_settings(file, board)

    assert known.radar.frame == assumed.radar.frame
    rx_mask = sum(1 << receiver for receiver in known.receivers)
    assert known.radar.array == board.select_antennas(0b1, rx_mask)
    waveform = said(real_data / name)
    chirp = known.radar.frame.chirp
    assert chirp.slope_hz_per_s == pytest.approx(waveform["slope_hz_per_s"], rel=1e-6)
