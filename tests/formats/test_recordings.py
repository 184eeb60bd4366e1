"""Recordings as files: what they decode to, and what is said of files that cannot be right.

Files are made here byte by byte, not with the package, which must agree with them.
"""

import json
import pickle
import struct
from dataclasses import replace

import numpy as np
import psutil
import pytest

import dechirp as dc
from dechirp.core import memory
from dechirp.core.errors import NotEnoughMemory, RecordingError
from dechirp.experiments.run import run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.read import read_radar


def radar(*, n_chirps=4, n_rx=2, n_samples=8, sampling="complex") -> Radar:
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        adc_start_s=2e-6,
        ramp_duration_s=20e-6,
        sample_rate_hz=5e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    positions = tuple((0.0, 2e-3 * n, 0.0) for n in range(n_rx))
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=30e-6, period_s=1e-3)
    return Radar(frame=frame, array=Array(rx_m=positions))


def mistake(*args, **told):
    """Give the one mistake that a recording is refused for, at once or when it is decoded."""
    with pytest.raises(RecordingError) as error:
        _ = open_recording(*args, **told).cube
    (only,) = error.value.mistakes
    return only


# --- TI DCA1000 -----------------------------------------------------------------------


def dca1000_bytes(cube) -> bytes:
    """Integer complex samples (frame, chirp, rx, sample) as two-lane chips send them."""
    words = []
    for chirp in cube.reshape(-1, *cube.shape[2:]):
        for receiver in chirp:
            for first in range(0, receiver.size, 2):
                one, two = receiver[first], receiver[first + 1]
                words += [one.real, two.real, one.imag, two.imag]
    return struct.pack(f"<{len(words)}h", *(int(word) for word in words))


def integers(*shape, seed=1):
    rng = np.random.default_rng(seed)
    re, im = rng.integers(-32768, 32768, size=(2, *shape))
    return re + 1j * im


def test_a_two_lane_capture_decodes_to_the_samples_that_were_sent(tmp_path):
    sent = integers(3, 4, 2, 8)
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(sent))

    recording = open_recording(file, radar=radar(), iq="iq")
    swapped = open_recording(file, radar=radar(), iq="qi")

    assert recording.format == "dca1000"
    assert recording.cube.dtype == np.complex64
    # int16 over 32768 is exact in float32, so nothing is lost.
    assert np.array_equal(recording.cube.values * 32768, sent)
    assert np.array_equal(swapped.cube.values * 32768, sent.imag + 1j * sent.real)


def test_a_cube_carries_the_times_of_its_samples(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))

    cube = open_recording(file, radar=radar()).cube

    assert cube.dims == ("frame", "chirp", "rx", "sample")
    assert cube.attrs["units"] == "full scale"
    assert cube.frame.values == pytest.approx([0, 1e-3, 2e-3])
    assert cube.chirp.values == pytest.approx([0, 30e-6, 60e-6, 90e-6])
    assert cube.sample.values == pytest.approx(2e-6 + np.arange(8) * 0.2e-6)


def test_frames_one_by_one_are_the_frames_of_the_cube(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))
    recording = open_recording(file, radar=radar())

    for index, frame in enumerate(recording.frames()):
        assert frame.identical(recording.cube.isel(frame=[index]))


def test_only_the_frames_that_are_asked_for_are_decoded(tmp_path, monkeypatch):
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(integers(5, 4, 2, 8)))
    whole = open_recording(file, radar=radar(), iq="iq")
    part = open_recording(file, radar=radar(), iq="iq", frames=(2, 4))
    decoded = []
    decode = part.contents.decode
    counted = replace(
        part.contents, decode=lambda index, out: decoded.append(index) or decode(index, out)
    )

    frames = list(replace(part, contents=counted).frames())

    assert decoded == [2, 3]
    assert (part.n_frames, len(frames)) == (2, 2)
    assert part.cube.identical(whole.cube.isel(frame=slice(2, 4)))  # with the times of those
    assert frames[1].identical(whole.cube.isel(frame=[3]))


@pytest.mark.parametrize("frames", [(0, 6), (3, 3), (-1, 2)])
def test_frames_that_are_not_there_are_refused(tmp_path, frames):
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(integers(5, 4, 2, 8)))

    wrong = mistake(file, radar=radar(), frames=frames)

    assert f"of 5 frames, with frames {frames[0]}:{frames[1]} requested" in wrong.value


def test_a_result_holds_the_cube_of_its_recording_once_or_says_that_it_cannot(
    tmp_path, monkeypatch
):
    sent = integers(3, 32, 2, 64)
    (tmp_path / "capture.bin").write_bytes(dca1000_bytes(sent))
    source = RecordingSource(path=str(tmp_path / "capture.bin"), iq="iq", frames=(1, 3))
    small = radar(n_chirps=32, n_samples=64)
    result = run(Scenario(radar=small, recording=source))

    class Scarce:
        available = 2 * 32 * 2 * 64 * 8 - 1

    with monkeypatch.context() as patched, pytest.raises(NotEnoughMemory, match="capture.bin"):
        patched.setattr(psutil, "virtual_memory", Scarce)
        patched.setattr(memory, "SMALL_BYTES", 0)
        _ = result.cube
    assert np.array_equal(result.cube.values * 32768, sent[1:3])
    assert (result.first_frame, result.n_frames) == (1, 2)
    assert set(result.detections.frame.values.tolist()) <= {1, 2}


def test_a_recording_larger_than_memory_is_read_frame_by_frame(tmp_path, monkeypatch):
    file = tmp_path / "capture.bin"
    frame_bytes = 4 * 2 * 8 * 4
    with file.open("wb") as out:  # 1 GiB that takes no room on most disks
        out.truncate(2**30)

    class Scarce:
        available = 2**29

    monkeypatch.setattr(psutil, "virtual_memory", Scarce)
    recording = open_recording(file, radar=radar())

    assert recording.n_frames == 2**30 // frame_bytes
    assert next(recording.frames()).sizes["frame"] == 1
    with pytest.raises(NotEnoughMemory, match="2 GiB"):
        _ = recording.cube


def test_echoes_on_the_wrong_side_of_the_spectrum_are_pointed_out(tmp_path):
    chirp = 1000 * np.exp(2j * np.pi * 0.2 * np.arange(64))
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(np.round(np.tile(chirp, (1, 4, 2, 1)))))

    def warned(iq):
        recording = open_recording(file, radar=radar(n_samples=64), device="xwr1642", iq=iq)
        return [finding.setting for finding in recording.findings if finding.level == "warning"]

    assert warned("iq") == []
    assert warned("qi") == ["iq"]


def test_a_last_frame_cut_short_is_left_out_with_a_warning(tmp_path):
    sent = integers(3, 4, 2, 8)
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(sent)[:-8])

    recording = open_recording(file, radar=radar(), device="xwr1642", iq="iq")

    assert np.array_equal(recording.cube.values * 32768, sent[:2])
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert "cut short: 2 complete frames and 248 bytes" in warning.value


@pytest.mark.parametrize("size", [248, 256 + 4])
def test_a_capture_that_holds_no_frame_or_half_a_sample_is_refused(tmp_path, size):
    file = tmp_path / "capture.bin"
    file.write_bytes(bytes(size))

    wrong = mistake(file, radar=radar(), iq="iq")

    assert wrong.value == f"{size} bytes"
    assert "at least 256 bytes" in wrong.expected


# --- mmWave Studio log ----------------------------------------------------------------

LOG = """\
01-Jan-2026 10:00:00: API:select_chip_version,{chip},0,
01-Jan-2026 10:00:01: API:ChannelConfig,3,5,0,
01-Jan-2026 10:00:01: API:DataFmtConfig,15,2,1,{swap},1,0,
01-Jan-2026 10:00:02: API:ProfileConfig,0,1,1,1,1,0,0,1,0,64,1000,0,0,30,0,
01-Jan-2026 10:00:03: API:ProfileConfig,0,1435388860,700,600,6000,0,0,1657,0,8,2500,0,0,30,0,
01-Jan-2026 10:00:04: API:ChirpConfig,0,1,0,0,0,0,0,1,0,
01-Jan-2026 10:00:05: API:FrameConfig,0,{last},{frames},{loops},{period},0,512,0,
01-Jan-2026 10:00:06: API:SensorStart,0,
01-Jan-2026 10:00:07: API:FrameConfig,0,0,1,99,1,0,512,0,
"""


def log(*, chip="AR1642", swap=0, last=0, frames=3, loops=4, period=8_000_000) -> str:
    return LOG.format(chip=chip, swap=swap, last=last, frames=frames, loops=loops, period=period)


def test_a_studio_log_gives_the_settings_of_the_last_start(tmp_path):
    file = tmp_path / "LogFile.txt"
    file.write_text(log(last=1, loops=2))

    made = read_radar(file)

    # Steps of 53.644 Hz, 48.279 kHz/us (written with five digits), 10 ns and 5 ns.
    chirp = made.frame.chirp
    assert chirp.start_frequency_hz == pytest.approx(1435388860 * 53.644, rel=1e-5)
    assert chirp.slope_hz_per_s == pytest.approx(1657 * 48.279e9, rel=3e-5)
    assert chirp.adc_start_s == pytest.approx(6e-6)
    assert chirp.ramp_duration_s == pytest.approx(60e-6)
    assert chirp.sample_rate_hz == pytest.approx(2.5e6)
    assert (chirp.n_samples, chirp.sampling) == (8, "complex")
    assert made.frame.n_chirps == 4  # two chirps of one transmitter, twice
    assert made.frame.interval_s == pytest.approx(67e-6)
    assert made.frame.period_s == pytest.approx(40e-3)
    assert made.array.n_rx == 2  # mask 5


def test_a_60_ghz_chip_counts_in_smaller_steps(tmp_path):
    file = tmp_path / "LogFile.txt"
    file.write_text(log(chip="IWR6843"))

    # 2.7 GHz instead of 3.6 GHz in 2^26 steps: the same number stands for 3/4.
    assert read_radar(file).frame.chirp.start_frequency_hz == pytest.approx(57.75e9, rel=1e-4)


@pytest.mark.parametrize("swap", [0, 1])
def test_the_log_beside_a_capture_tells_its_layout(tmp_path, swap):
    sent = integers(3, 4, 2, 8)
    (tmp_path / "adc_data.bin").write_bytes(dca1000_bytes(sent))
    (tmp_path / "adc_data_LogFile.txt").write_text(log(swap=swap))

    recording = open_recording(tmp_path / "adc_data.bin")

    expected = sent.imag + 1j * sent.real if swap else sent
    assert np.array_equal(recording.cube.values * 32768, expected)
    assert recording.radar.array == device("AR1642").select_antennas(
        0b1, 0b101
    )  # as the log names it
    assert recording.radar.hardware is None


def test_frames_of_one_chirp_become_the_chirps_of_one_frame(tmp_path):
    (tmp_path / "a.bin").write_bytes(dca1000_bytes(integers(12, 1, 2, 8)))
    (tmp_path / "a.txt").write_text(log(frames=12, loops=1, period=200_000))

    recording = open_recording(tmp_path / "a.bin")

    assert (recording.n_frames, recording.radar.frame.n_chirps) == (1, 12)
    assert recording.radar.frame.interval_s == pytest.approx(1e-3)
    assert "12 frames of one chirp" in " ".join(finding.value for finding in recording.findings)


def test_frames_of_one_chirp_cut_short_are_a_frame_of_the_chirps_there_are(tmp_path):
    sent = integers(12, 1, 2, 8)
    (tmp_path / "a.bin").write_bytes(dca1000_bytes(sent)[:-8])
    (tmp_path / "a.txt").write_text(log(frames=12, loops=1, period=200_000))

    recording = open_recording(tmp_path / "a.bin")

    assert (recording.n_frames, recording.radar.frame.n_chirps) == (1, 11)
    assert np.array_equal(recording.cube.values[0] * 32768, sent[:11, 0])
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert "cut short: 11 complete chirps and 56 bytes" in warning.value


@pytest.mark.parametrize("size", [120, 132])
def test_frames_of_one_chirp_need_two_whole_chirps_and_samples(tmp_path, size):
    (tmp_path / "a.bin").write_bytes(bytes(size))
    (tmp_path / "a.txt").write_text(log(frames=12, loops=1, period=200_000))

    assert mistake(tmp_path / "a.bin").value == f"{size} bytes"


def test_a_capture_longer_than_the_radar_sent_does_not_fit_its_log(tmp_path):
    (tmp_path / "a.bin").write_bytes(dca1000_bytes(integers(4, 4, 2, 8)))
    (tmp_path / "a.txt").write_text(log(frames=3))

    wrong = mistake(tmp_path / "a.bin")

    assert wrong.value == "1024 bytes"
    assert "768 bytes" in wrong.expected


def test_a_capture_that_stopped_early_is_read_with_a_warning(tmp_path):
    (tmp_path / "a.bin").write_bytes(dca1000_bytes(integers(2, 4, 2, 8)))
    (tmp_path / "a.txt").write_text(log(frames=3))

    recording = open_recording(tmp_path / "a.bin")

    assert recording.n_frames == 2
    assert "warning" in [finding.level for finding in recording.findings]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("API:ChannelConfig", "API:Other", "no ChannelConfig"),
        ("15,2,1,0,1,0", "15,2,1,0,2,0", "chInterleave 2"),
        ("15,2,1,0,1,0", "15,2,3,0,1,0", "format 3"),
        ("0,8,2500,", "0,x,2500,", "ProfileConfig"),
        ("ChirpConfig,0,1,0,", "ChirpConfig,0,0,1,", "chirps 0 to 0"),
        ("0,8,2500,", "0,0,2500,", "Chirp.n_samples"),
    ],
)
def test_a_log_that_does_not_set_up_a_readable_capture_says_which_call(tmp_path, old, new, named):
    file = tmp_path / "LogFile.txt"
    text = log()
    assert old in text
    file.write_text(text.replace(old, new))

    with pytest.raises(RecordingError) as error:
        read_radar(file)

    assert named in str(error.value)
    assert str(file) in str(error.value)


def test_chirps_that_differ_are_not_taken_for_equal_ones(tmp_path):
    file = tmp_path / "LogFile.txt"
    second = "API:ChirpConfig,1,1,0,0,0,5,0,1,0,\nx: API:FrameConfig"
    file.write_text(log(last=1).replace("API:FrameConfig", second, 1))

    with pytest.raises(RecordingError, match="chirps 0 to 1 of the frame, which differ"):
        read_radar(file)


# --- Settings beside a recording ------------------------------------------------------


def test_settings_named_after_the_recording_come_before_others(tmp_path):
    for name in ("run_1", "run_10", "other"):
        (tmp_path / f"{name}.bin").write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))
        (tmp_path / f"{name}_LogFile.txt").write_text(log(period=10**6 * len(name)))

    recording = open_recording(tmp_path / "run_1.bin")

    assert recording.radar.frame.period_s == pytest.approx(25e-3)


def test_settings_of_the_folder_are_taken_when_there_is_one_file_of_them(tmp_path):
    (tmp_path / "capture.bin").write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))
    (tmp_path / "LogFile.txt").write_text(log())
    (tmp_path / "notes.txt").write_text("The antenna was tilted.")

    assert open_recording(tmp_path / "capture.bin").n_frames == 3


def test_settings_that_could_be_either_of_two_are_not_guessed(tmp_path):
    (tmp_path / "capture.bin").write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))
    for name in ("monday.txt", "tuesday.txt"):
        (tmp_path / name).write_text(log())

    wrong = mistake(tmp_path / "capture.bin")

    assert "monday.txt, tuesday.txt" in wrong.value
    assert "--radar" in wrong.fix


def test_the_description_of_a_collection_is_not_settings(tmp_path):
    (tmp_path / "capture.bin").write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))
    (tmp_path / "meta.json").write_text(json.dumps(config()))

    assert "no settings" in mistake(tmp_path / "capture.bin").value


def test_a_yaml_file_beside_a_recording_gives_its_radar(tmp_path):
    sent = integers(3, 4, 1, 8)
    (tmp_path / "capture.bin").write_bytes(dca1000_bytes(sent))
    (tmp_path / "capture.yaml").write_text(
        "frame:\n"
        "  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 20 us,\n"
        "          sample_rate: 5 MHz, n_samples: 8, sampling: complex}\n"
        "  n_chirps: 4\n"
        "  interval: 30 us\n"
    )

    recording = open_recording(tmp_path / "capture.bin", device="xwr1642", iq="iq")

    assert recording.radar.frame.interval_s == pytest.approx(30e-6)
    assert np.array_equal(recording.cube.values * 32768, sent)


# --- Infineon -------------------------------------------------------------------------


def config(**changes) -> dict:
    shape = {
        "start_frequency_Hz": 60_000_000_000,
        "end_frequency_Hz": 61_000_000_000,
        "num_samples_per_chirp": 8,
        "num_chirps_per_frame": 4,
        "sample_rate_Hz": 2_000_000,
        "chirp_repetition_time_s": 0.0005,
        "frame_repetition_time_s": 0.1,
        "rx_antennas": [1, 2, 3],
        "tx_antennas": [1],
        "mimo_mode": "off",
    }
    shape.update(changes)
    kept = {key: entry for key, entry in shape.items() if entry is not None}
    return {"device_config": {"fmcw_single_shape": kept}}


def infineon_folder(parent, codes, text=None):
    folder = parent / "RadarIfxAvian_00"
    folder.mkdir()
    np.save(folder / "radar.npy", codes)
    (folder / "config.json").write_text(json.dumps(config()) if text is None else text)
    return folder


def codes(*shape):
    return np.random.default_rng(2).integers(0, 4096, shape).astype(np.uint16)


def test_codes_of_a_12_bit_converter_span_full_scale(tmp_path):
    recorded = codes(2, 3, 4, 8)
    recorded[1, 2, 3, 4], recorded[1, 2, 3, 5] = 0, 4095
    folder = infineon_folder(tmp_path, recorded)

    recording = open_recording(folder)

    assert recording.cube.dtype == np.float32
    assert recording.cube.sizes == {"frame": 2, "chirp": 4, "rx": 3, "sample": 8}
    assert recording.cube.values[1, 3, 2, 4:6] == pytest.approx([-1, 1], abs=1e-6)
    expected = recorded.transpose(0, 2, 1, 3) / 4095 * 2 - 1
    # Rounded to float32 three times, each by up to 6e-8.
    assert np.allclose(recording.cube.values, expected, rtol=0, atol=2e-7)


def test_codes_of_an_infineon_radar_stay_whole_numbers_of_half_steps(tmp_path):
    recorded = codes(2, 3, 4, 8)
    recorded[1, 2, 3, 4], recorded[1, 2, 3, 5] = 0, 4095
    recording = open_recording(infineon_folder(tmp_path, recorded))
    dc.write(recording, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        assert file["cube"].dtype == np.int16
        assert np.array_equal(file["cube"], 2 * recorded.astype(int).transpose(0, 2, 1, 3) - 4095)
    assert np.array_equal(open_recording(tmp_path / "x.npz").cube.values, recording.cube.values)


def test_the_device_says_where_the_antennas_of_an_infineon_radar_are(tmp_path):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8))
    known = open_recording(folder, device="bgt60tr13c").radar.array
    told = open_recording(folder, radar=folder / "config.json", device="bgt60tr13c").radar.array
    assert known == told != open_recording(folder).radar.array


def test_two_transmitters_in_turn_are_read_in_either_order_of_their_chirps(tmp_path):
    sent = codes(2, 4, 2, 3, 8)  # frame, chirp of a transmitter, transmitter, rx, sample
    text = json.dumps(config(mimo_mode="tdm", tx_antennas=[1, 2]))
    as_sent = sent.reshape(2, 8, 3, 8).transpose(0, 2, 1, 3)
    by_pairs = sent.transpose(0, 2, 3, 1, 4).reshape(2, 6, 4, 8)
    cubes = []
    for name, order in (("sent", as_sent), ("pairs", by_pairs)):
        (tmp_path / name).mkdir()
        cubes.append(open_recording(infineon_folder(tmp_path / name, order, text)).cube)

    assert cubes[0].sizes == {"frame": 2, "chirp": 8, "rx": 3, "sample": 8}
    assert cubes[0].transmitter.values.tolist() == [0, 1] * 4
    expected = sent.reshape(2, 8, 3, 8) / 4095 * 2 - 1
    for cube in cubes:
        assert np.allclose(cube.values, expected, rtol=0, atol=2e-7)


def test_the_ramp_of_an_infineon_radar_lasts_as_long_as_its_samples(tmp_path):
    recording = open_recording(infineon_folder(tmp_path, codes(2, 3, 4, 8)))

    chirp = recording.radar.frame.chirp
    assert chirp.sampled_bandwidth_hz == pytest.approx(1e9)
    assert chirp.slope_hz_per_s == pytest.approx(1e9 / 4e-6)
    assert chirp.sampling == "real"
    assert recording.radar.frame.interval_s == 0.0005
    assert recording.cube.frame.values == pytest.approx([0, 0.1])


def test_an_infineon_recording_is_found_by_its_parent_and_by_its_samples(tmp_path):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8))

    for path in (tmp_path, folder, folder / "radar.npy"):
        recording = open_recording(path)
        assert (recording.format, recording.n_frames) == ("infineon", 2)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('{"device_config": {', "not JSON"),
        ("", "not JSON"),
        ("[" * 100_000, "nested too deeply"),
        ("[1, 2]", "no device_config.fmcw_single_shape"),
        ('{"device_config": {"fmcw_scene": {}}}', "no device_config.fmcw_single_shape"),
        (json.dumps(config(sample_rate_Hz=None, rx_antennas=None)), "sample_rate_Hz, rx_antennas"),
        (json.dumps(config(num_samples_per_chirp="8")), 'num_samples_per_chirp = "8"'),
        (json.dumps(config(num_chirps_per_frame=4.5)), "num_chirps_per_frame = 4.5"),
        (json.dumps(config(rx_antennas=3)), "rx_antennas = 3"),
        (json.dumps(config(end_frequency_Hz=10**400)), "end_frequency_Hz = 1000"),
        (json.dumps(config(end_frequency_Hz=59e9)), "Chirp.slope_hz_per_s"),
        (json.dumps(config(sample_rate_Hz=0)), "impossible settings"),
        (json.dumps(config(mimo_mode="bpm")), 'mimo_mode "bpm"'),
    ],
)
def test_a_config_that_is_not_right_is_named_with_what_is_wrong(tmp_path, text, named):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8), text)

    wrong = mistake(folder)

    assert named in wrong.value
    assert wrong.file == str(folder / "config.json")


def test_a_missing_config_is_asked_for(tmp_path):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8))
    (folder / "config.json").unlink()

    wrong = mistake(folder)

    assert wrong.file == str(folder / "config.json")
    assert open_recording(folder, radar=radar(n_rx=3, sampling="real")).n_frames == 2


@pytest.mark.parametrize(
    ("recorded", "named"),
    [
        (codes(2, 3, 4, 16), "(2, 3, 4, 16)"),
        (codes(3, 4, 8), "(3, 4, 8)"),
        (codes(2, 3, 4, 8) / 4095, "float64"),
        (codes(2, 3, 4, 8) + np.uint16(5000), "codes from"),
    ],
)
def test_samples_that_do_not_fit_the_config_are_refused(tmp_path, recorded, named):
    assert named in mistake(infineon_folder(tmp_path, recorded)).value


def test_samples_of_infineon_that_lie_elsewhere_are_refused(tmp_path):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8))
    (folder / "radar.npy").rename(tmp_path / "other.npy")
    (folder / "radar.npy").symlink_to(tmp_path / "other.npy")

    assert "radar.npy is a link" in mistake(folder).value


def test_two_recordings_in_a_folder_are_not_taken_for_one(tmp_path):
    folder = infineon_folder(tmp_path, codes(2, 3, 4, 8))
    folder.rename(tmp_path / "RadarIfxAvian_01")
    infineon_folder(tmp_path, codes(2, 3, 4, 8))

    assert "RadarIfxAvian_00, RadarIfxAvian_01" in mistake(tmp_path).value


# --- NumPy arrays ---------------------------------------------------------------------


def saved(tmp_path, array, name="cube.npy"):
    np.save(tmp_path / name, array)
    return tmp_path / name


def test_axes_come_in_the_order_the_user_names(tmp_path):
    sent = integers(3, 4, 2, 8)
    order = ["sample", "frame", "rx", "chirp"]
    file = saved(tmp_path, np.transpose(sent, (3, 0, 2, 1)))

    recording = open_recording(file, radar=radar(), axes=order, encoding="int16")
    by_text = open_recording(file, radar=radar(), axes=",".join(order), encoding="int16")

    assert np.array_equal(recording.cube.values * 32768, sent)
    assert by_text.cube.identical(recording.cube)


def test_every_encoding_gives_the_samples_that_were_meant(tmp_path):
    sent = integers(4, 2, 8)
    parts = np.stack([sent.real, sent.imag], axis=-1)
    ways = {
        "int16": parts.astype(np.int16),
        "uint16-wrapped": parts.astype(np.int16).view(np.uint16),
        "offset-binary": (parts + 32768).astype(np.uint16),
        "full-scale": parts / 32768,
    }

    for encoding, array in ways.items():
        pairs = saved(tmp_path, array, f"{encoding}.npy")
        joined = saved(tmp_path, array[..., 0] + 1j * array[..., 1], f"{encoding}-complex.npy")
        told = {"radar": radar(), "encoding": encoding}
        from_pairs = open_recording(pairs, axes="chirp,rx,sample,iq", **told)
        from_complex = open_recording(joined, axes="chirp,rx,sample", **told)
        assert np.array_equal(from_pairs.cube.values[0] * 32768, sent)
        assert np.array_equal(from_complex.cube.values[0] * 32768, sent)


def test_numbers_that_leave_no_doubt_need_no_encoding(tmp_path):
    sent = integers(4, 2, 8) / 32768
    pairs = np.stack([sent.real, sent.imag], axis=-1)
    as_integers = saved(tmp_path, (pairs * 32768).astype(np.int16), "integers.npy")
    as_floats = saved(tmp_path, sent, "floats.npy")

    for file, axes in ((as_integers, "chirp,rx,sample,iq"), (as_floats, "chirp,rx,sample")):
        assert np.array_equal(open_recording(file, radar=radar(), axes=axes).cube.values[0], sent)


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.float64])
def test_numbers_that_can_be_read_in_two_ways_ask_for_their_encoding(tmp_path, dtype):
    file = saved(tmp_path, np.full((4, 2, 8, 2), 40000, dtype))

    wrong = mistake(file, radar=radar(), axes="chirp,rx,sample,iq")

    assert "int16, uint16-wrapped, offset-binary, full-scale" in wrong.expected


def test_numbers_that_an_encoding_cannot_hold_are_refused(tmp_path):
    file = saved(tmp_path, np.full((4, 2, 8), 40000 + 1j))

    wrong = mistake(file, radar=radar(), axes="chirp,rx,sample", encoding="int16")

    assert "40000" in wrong.value


def test_an_unknown_encoding_lists_the_good_ones(tmp_path):
    file = saved(tmp_path, integers(4, 2, 8))

    wrong = mistake(file, radar=radar(), axes="chirp,rx,sample", encoding="int12")

    assert "int16, uint16-wrapped, offset-binary, full-scale" in wrong.expected


def test_an_array_without_axes_shows_its_shape_and_an_example(tmp_path):
    wrong = mistake(saved(tmp_path, integers(4, 2, 8)), radar=radar())

    assert "4 x 2 x 8" in wrong.value
    assert "--axes chirp,rx,sample" in wrong.fix


@pytest.mark.parametrize(
    "axes", ["chirp,sample", "chirp,rx,time", "chirp,chirp,sample", "frame,rx,sample"]
)
def test_axes_that_cannot_be_those_of_the_array_are_refused(tmp_path, axes):
    wrong = mistake(saved(tmp_path, integers(4, 2, 8)), radar=radar(), axes=axes)

    assert axes in wrong.value


def test_sizes_that_are_not_the_radars_are_named_by_axis(tmp_path):
    file = saved(tmp_path, integers(8, 2, 4))

    wrong = mistake(file, radar=radar(), axes="chirp,rx,sample", encoding="int16")

    assert wrong.value == "8 along chirp and 4 along sample"


def test_receivers_that_are_not_the_radars_are_refused_unless_it_has_none(tmp_path):
    file = saved(tmp_path, integers(4, 3, 8))
    told = {"axes": "chirp,rx,sample", "encoding": "int16"}

    assert "3 receivers" in mistake(file, radar=radar(n_rx=2), **told).value
    recording = open_recording(file, radar=Radar(frame=radar().frame), **told)
    assert recording.radar.array.n_rx == 3
    assert [finding.level for finding in recording.findings] == ["note"]


def test_real_and_complex_samples_are_not_confused(tmp_path):
    real, cmplx = radar(sampling="real"), radar()
    told = {"axes": "chirp,rx,sample", "encoding": "full-scale"}
    numbers = np.linspace(-1, 1, 64).reshape(4, 2, 8)

    assert "real numbers" in mistake(saved(tmp_path, numbers), radar=cmplx, **told).value
    assert "imaginary" in mistake(saved(tmp_path, numbers + 1e-3j), radar=real, **told).value
    # Some tools save real samples as complex numbers.
    recording = open_recording(saved(tmp_path, numbers + 0j), radar=real, **told)
    assert np.array_equal(recording.cube.values[0], numbers.astype(np.float32))


def test_samples_that_are_not_finite_are_counted_and_placed(tmp_path):
    samples = integers(3, 4, 2, 8) / 32768
    samples[2, 1, 0, 5], samples[2, 3, 1, 7] = np.nan, 1j * np.inf
    recording = open_recording(
        saved(tmp_path, samples), radar=radar(), axes="frame,chirp,rx,sample", encoding="full-scale"
    )

    frames = recording.frames()
    good = [next(frames), next(frames)]  # decoded one by one: the first two are whole
    with pytest.raises(RecordingError) as error:
        next(frames)

    assert len(good) == 2
    assert "2 of 64 samples of frame 2" in str(error.value)
    assert "chirp 1, rx 0, sample 5" in str(error.value)


# --- Files that are not what they should be -------------------------------------------


def header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


ABSURD = "{{'descr': '<c8', 'fortran_order': False, 'shape': {} }}\n"


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("cube.npy", b"", "an empty file"),
        ("capture.bin", b"", "an empty file"),
        ("cube.npy", b"one,two\n", "text"),
        ("capture.bin", b"one,two\n", "text"),
        ("capture.bin", b"\x89PNG\r\n\x1a\n" + bytes(64), "a PNG picture"),
        ("capture.jpg", b"\xff\xd8\xff\xe0" + bytes(64), "a JPEG picture"),
        ("cube.npy", bytes(range(64)), "bytes without the signature"),
        ("capture.pcapng", b"\n\r\r\n" + bytes(64), "a network capture (pcapng)"),
        ("cube.nc", b"CDF\1" + bytes(64), "a netCDF file of version 3"),
        ("cube.npy", b"\x93NUMPY\x01", "a damaged header"),
        ("cube.npy", header("{'descr': "), "a damaged header"),
        ("cube.npy", header("(" * 9000), "a damaged header"),
        ("cube.npy", header(ABSURD.format((10**9, 10**9, 10**9))), "a file of"),
        ("cube.npy", header(ABSURD.format((-4, -2, 8))) + bytes(512), "a file of"),
        ("cube.npy", header(ABSURD.format((0, 2, 8))), "a file of"),
        ("cube.npy", header(ABSURD.format((4, 2, 8))) + bytes(500), "a file of"),
        ("cube.npy", header(ABSURD.format((4, 2, 8))) + bytes(520), "a file of"),
        ("cube.npy", header(ABSURD.format((4, 2, 8)).replace("<c8", "<U2")), "<U2"),
    ],
)
def test_a_file_that_is_not_what_its_name_says_is_refused(tmp_path, name, content, named):
    file = tmp_path / name
    file.write_bytes(content)
    axes = "chirp,rx,sample" if name.endswith("npy") else None

    wrong = mistake(file, radar=radar(), axes=axes)

    assert named in wrong.value
    assert wrong.file == str(file)


def spring():
    pytest.fail("a pickle in a recording was opened")


class Trap:
    """Calls `spring` when unpickled."""

    def __reduce__(self):
        return spring, ()


def test_pickled_objects_are_never_opened(tmp_path):
    objects = np.empty((4, 2, 8), object)
    objects[:] = Trap()
    file = saved(tmp_path, objects)
    assert b"spring" in file.read_bytes()  # the trap is set

    assert "Python objects" in mistake(file, radar=radar(), axes="chirp,rx,sample").value

    (tmp_path / "bare.npy").write_bytes(pickle.dumps(Trap()))
    assert "npy" in mistake(tmp_path / "bare.npy", radar=radar(), axes="chirp,rx,sample").expected


def test_a_path_that_is_not_there_says_so(tmp_path):
    assert "no such file" in mistake(tmp_path / "capture.bin").value


def test_a_name_that_no_disk_takes_is_no_recording(tmp_path):
    assert "too long" in mistake(tmp_path / ("x" * 300)).value


def test_a_folder_without_a_recording_says_what_it_holds(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"\xff\xd8")

    assert "holiday.jpg" in mistake(tmp_path).value


def test_a_wrong_format_or_option_is_refused(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(dca1000_bytes(integers(3, 4, 2, 8)))

    assert "dca1000, hdf5, infineon" in mistake(file, radar=radar(), format="wav").expected
    assert "format npy" in mistake(file, radar=radar(), format="npy").expected
    assert "axes" in mistake(file, radar=radar(), axes="chirp,sample").value
    assert "iq, qi" in mistake(file, radar=radar(), iq="swapped").expected


def test_the_content_decides_over_the_name(tmp_path):
    file = saved(tmp_path, integers(4, 2, 8)).rename(tmp_path / "cube.bin")

    recording = open_recording(file, radar=radar(), axes="chirp,rx,sample", encoding="int16")

    assert recording.format == "npy"


def test_a_recorded_cube_and_a_simulated_one_are_the_same_thing(tmp_path, radar):
    target = dc.Target(position_m=(20, 1, 0), rcs_m2=10)
    simulated = dc.simulate(dc.Scene(targets=[target]), radar, seed=1, n_frames=2)
    np.save(tmp_path / "cube.npy", simulated.values)
    recorded = dc.open(
        tmp_path / "cube.npy",
        radar=radar,
        axes=("frame", "chirp", "rx", "sample"),
        encoding="full-scale",
    ).cube

    # They differ in their notes alone: units, and which kernels summed the echoes.
    assert recorded.assign_attrs(simulated.attrs).identical(simulated)
    assert dc.detect(recorded, radar).identical(dc.detect(simulated, radar))
