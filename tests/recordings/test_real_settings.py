"""Settings files of real recordings, compared with the known waveforms of their radars."""

import json

import pytest

from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.recordings.settings.read import find_settings_file, read_settings
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg

CFGS = [
    ("dca1000_pcap/xwr18xx_profile.cfg", None),
    ("xwr1443_known_angles/radar_full_band.cfg", "xwr1443"),
    ("xwr1443_known_angles/radar_1GHz.cfg", "xwr1443"),
]


def load_waveform(folder):
    return json.loads((folder / "meta.json").read_text(encoding="utf-8"))["waveform"]


def assert_waveform(frame, waveform, *, slope_hz_per_s=None):
    """Compare a frame with all independent values of a waveform table."""
    chirp = frame.chirp
    values = {
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
    for name, value in values.items():
        if waveform.get(name) is not None:
            assert value == pytest.approx(waveform[name], rel=1e-6), name
    # The table rounds it to 0.1 um.
    assert chirp.range_resolution_m == pytest.approx(waveform["range_bin_m"], abs=1e-6)


@pytest.mark.parametrize("name", ["indoor_walking.mmwave.json", "indoor_walking.setup.json"])
def test_both_studio_files_give_known_waveform(real_data, name):
    folder = real_data / "mmwavestudio_json"

    settings = read_settings(folder / name)

    waveform = load_waveform(folder)
    assert_waveform(settings.radar.frame, waveform)
    assert settings.n_frames == waveform["num_frames"]
    assert settings.radar.frame.multiplexing is None  # both are enabled, but one transmits
    assert (settings.iq, settings.is_interleaved, settings.bits) == ("iq", True, 16)
    assert settings.receivers == (0, 1, 2, 3)
    assert settings.device == ("xwr1443" if "setup" in name else None)


def test_finds_studio_pair_by_setup_file(real_data):
    folder = real_data / "mmwavestudio_json"

    assert find_settings_file(folder / "adc_data.bin").name == "indoor_walking.setup.json"


def test_cfg_of_known_angles_gives_known_waveform(real_data):
    folder = real_data / "xwr1443_known_angles"

    settings = read_settings(folder / "radar_full_band.cfg", device("xWR1443"))

    waveform = load_waveform(folder)
    frame = settings.radar.frame
    assert_waveform(frame, waveform)
    assert frame.multiplexing == Tdm(order=(0, 1))
    assert settings.radar.array == device("xwr1443").select_antennas(0b101, 0b1111)
    assert (settings.n_frames, settings.is_interleaved, settings.iq) == (1, True, "iq")
    narrow_chirp = read_settings(folder / "radar_1GHz.cfg").radar.frame.chirp
    slope = waveform["alternative_slope_hz_per_s_for_1GHz_files"]
    assert narrow_chirp.slope_hz_per_s == pytest.approx(slope, rel=1e-6)


def test_reads_visualizer_cfg(real_data):
    settings = read_settings(real_data / "dca1000_pcap" / "xwr18xx_profile.cfg")

    frame = settings.radar.frame
    assert frame.chirp.n_samples == load_waveform(real_data / "dca1000_pcap")["samples_per_chirp"]
    assert frame.multiplexing == Tdm(order=(0, 1))
    # Comments of the visualizer in the file header: 0.044 m, 0.13 m/s and 1 m/s.
    assert frame.chirp.range_resolution_m == pytest.approx(0.044, abs=5e-4)
    assert frame.velocity_resolution_m_per_s == pytest.approx(0.13, abs=0.01)
    assert frame.max_velocity_m_per_s == pytest.approx(1, abs=0.05)
    assert (settings.device, settings.iq, settings.is_interleaved) == ("xwr1843", "qi", False)


@pytest.mark.parametrize(("name", "device_name"), CFGS)
def test_real_cfg_round_trip_is_exact(real_data, tmp_path, name, device_name):
    settings = read_settings(real_data / name, None if device_name is None else device(device_name))

    text = format_ti_cfg(settings.radar, device=settings.device, n_frames=settings.n_frames or 0)
    (tmp_path / "radar.cfg").write_text(text)
    copy = read_settings(tmp_path / "radar.cfg")

    assert copy.radar == settings.radar
    assert copy.n_frames == settings.n_frames
    # Waveform commands are equal, number for number.
    commands = ("channelCfg", "adcCfg", "profileCfg", "chirpCfg", "frameCfg")
    if settings.device == "xwr1443":
        # The capture demo stores I first; the out-of-the-box demo stores Q first.
        assert (settings.iq, copy.iq) == ("iq", "qi")
    else:
        assert copy.iq == settings.iq
        commands = (*commands, "adcbufCfg")
    original = (real_data / name).read_text().splitlines()
    assert [line for line in text.splitlines() if line.startswith(commands)] == [
        line for line in original if line.startswith(commands)
    ]


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_studio_log_gives_chip_and_antennas(real_data, name):
    folder = real_data / "awr1642_vibrating_pipe"

    settings = read_settings(folder / f"{name}_LogFile.txt")

    assert (settings.device, settings.is_interleaved, settings.bits) == ("xwr1642", False, 16)
    assert settings.radar.array == device("xwr1642").select_antennas(0b1, 0b1111)


@pytest.mark.parametrize("name", ["bgt60_breathing", "bgt60_people_room", "bgt60_two_reflectors"])
def test_given_device_gives_infineon_antennas(real_data, name):
    file = real_data / name / "RadarIfxAvian_00" / "config.json"
    board = device("bgt60tr13c")

    assumed_settings, device_settings = read_settings(file), read_settings(file, board)

    assert device_settings.radar.frame == assumed_settings.radar.frame
    rx_mask = sum(1 << receiver for receiver in device_settings.receivers)
    assert device_settings.radar.array == board.select_antennas(0b1, rx_mask)
    waveform = load_waveform(real_data / name)
    chirp = device_settings.radar.frame.chirp
    assert chirp.slope_hz_per_s == pytest.approx(waveform["slope_hz_per_s"], rel=1e-6)
