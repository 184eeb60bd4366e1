"""Recordings of TI and Infineon radars and NumPy arrays: decoding, settings and invalid files.

The files are written byte by byte, not with the package.
"""

import gzip
import json
import os
import pickle
import re
import shlex
import struct
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.core import memory
from dechirp.core.errors import NotEnoughMemory, RecordingError
from dechirp.experiments.inspection import inspect
from dechirp.experiments.run import run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.read import choose_settings_file, read_radar
from nightly import nightly


def make_radar(*, n_chirps=4, n_rx=2, n_samples=8, sampling="complex") -> Radar:
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


def catch_mistake(*args, **options):
    """Return the single mistake that opening or decoding a recording raises."""
    with pytest.raises(RecordingError) as error:
        _ = open_recording(*args, **options).cube
    (mistake,) = error.value.mistakes
    return mistake


# --- TI DCA1000 -----------------------------------------------------------------------


def encode_dca1000(cube) -> bytes:
    """Encode integer complex samples (frame, chirp, rx, sample) as two-lane chips send them."""
    words = []
    for chirp in cube.reshape(-1, *cube.shape[2:]):
        for receiver in chirp:
            for first in range(0, receiver.size, 2):
                first_sample, second_sample = receiver[first], receiver[first + 1]
                words += [
                    first_sample.real,
                    second_sample.real,
                    first_sample.imag,
                    second_sample.imag,
                ]
    return struct.pack(f"<{len(words)}h", *(int(word) for word in words))


def draw_samples(*shape, seed=1):
    rng = np.random.default_rng(seed)
    re, im = rng.integers(-32768, 32768, size=(2, *shape))
    return re + 1j * im


def test_two_lane_capture_decodes_to_samples(tmp_path):
    samples = draw_samples(3, 4, 2, 8)
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(samples))

    recording = open_recording(file, radar=make_radar(), iq="iq")
    swapped = open_recording(file, radar=make_radar(), iq="qi")

    assert recording.format == "dca1000"
    assert recording.cube.dtype == np.complex64
    # 16-bit integers over 32768 are exact in float32.
    assert np.array_equal(recording.cube.values * 32768, samples)
    assert np.array_equal(swapped.cube.values * 32768, samples.imag + 1j * samples.real)


def test_cube_coordinates_are_sample_times(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))

    cube = open_recording(file, radar=make_radar()).cube

    assert cube.dims == ("frame", "chirp", "rx", "sample")
    assert cube.attrs["units"] == "1"
    assert cube.frame.values == pytest.approx([0, 1e-3, 2e-3])
    assert cube.chirp.values == pytest.approx([0, 30e-6, 60e-6, 90e-6])
    assert cube.sample.values == pytest.approx(2e-6 + np.arange(8) * 0.2e-6)


def test_frame_iterator_matches_cube(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
    recording = open_recording(file, radar=make_radar())

    for index, frame in enumerate(recording.frames()):
        assert frame.identical(recording.cube.isel(frame=[index]))


def test_decodes_requested_frames_only(tmp_path, monkeypatch):
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(draw_samples(5, 4, 2, 8)))
    full_recording = open_recording(file, radar=make_radar(), iq="iq")
    partial_recording = open_recording(file, radar=make_radar(), iq="iq", frames=(2, 4))
    frame_indices = []
    decode = partial_recording.contents.decode
    counting_contents = replace(
        partial_recording.contents,
        decode=lambda index, out: frame_indices.append(index) or decode(index, out),
    )

    frames = list(replace(partial_recording, contents=counting_contents).frames())

    assert frame_indices == [2, 3]
    assert (partial_recording.n_frames, len(frames)) == (2, 2)
    # Including the times of these frames.
    assert partial_recording.cube.identical(full_recording.cube.isel(frame=slice(2, 4)))
    assert frames[1].identical(full_recording.cube.isel(frame=[3]))


@pytest.mark.parametrize("frames", [(0, 6), (3, 3), (-1, 2)])
def test_rejects_frames_beyond_recording(tmp_path, frames):
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(draw_samples(5, 4, 2, 8)))

    mistake = catch_mistake(file, radar=make_radar(), frames=frames)

    assert f"of 5 frames, with frames {frames[0]}:{frames[1]} requested" in mistake.value


def test_result_cube_is_read_or_raises_not_enough_memory(tmp_path, monkeypatch):
    samples = draw_samples(3, 32, 2, 64)
    (tmp_path / "capture.bin").write_bytes(encode_dca1000(samples))
    source = RecordingSource(path=str(tmp_path / "capture.bin"), iq="iq", frames=(1, 3))
    small_radar = make_radar(n_chirps=32, n_samples=64)
    result = run(Scenario(radar=small_radar, recording=source))

    class Scarce:
        available = 2 * 32 * 2 * 64 * 8 - 1

    with monkeypatch.context() as patched, pytest.raises(NotEnoughMemory, match="capture.bin"):
        patched.setattr(psutil, "virtual_memory", Scarce)
        patched.setattr(memory, "SMALL_BYTES", 0)
        _ = result.cube
    assert np.array_equal(result.cube.values * 32768, samples[1:3])
    assert (result.first_frame, result.n_frames) == (1, 2)
    assert set(result.detections.frame.values.tolist()) <= {1, 2}


@nightly
def test_recording_larger_than_memory_is_read_by_frame(tmp_path, monkeypatch):
    file = tmp_path / "capture.bin"
    frame_bytes = 4 * 2 * 8 * 4
    with file.open("wb") as out:  # sparse file of 1 GiB
        out.truncate(2**30)

    class Scarce:
        available = 2**29

    monkeypatch.setattr(psutil, "virtual_memory", Scarce)
    recording = open_recording(file, radar=make_radar())

    assert recording.n_frames == 2**30 // frame_bytes
    assert next(recording.frames()).sizes["frame"] == 1
    with pytest.raises(NotEnoughMemory, match="2 GiB"):
        _ = recording.cube


def test_echoes_at_negative_beat_frequencies_give_warning(tmp_path):
    chirp = 1000 * np.exp(2j * np.pi * 0.2 * np.arange(64))
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(np.round(np.tile(chirp, (1, 4, 2, 1)))))

    def list_warnings(iq):
        recording = open_recording(file, radar=make_radar(n_samples=64), device="xwr1642", iq=iq)
        return [finding.setting for finding in recording.findings if finding.level == "warning"]

    assert list_warnings("iq") == []
    assert list_warnings("qi") == ["iq"]


@pytest.mark.parametrize("n_lost", [8, 3])
def test_truncated_last_frame_is_dropped_with_warning(tmp_path, n_lost):
    samples = draw_samples(3, 4, 2, 8)
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(samples)[:-n_lost])

    recording = open_recording(file, radar=make_radar(), device="xwr1642", iq="iq")

    assert np.array_equal(recording.cube.values * 32768, samples[:2])
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert f"cut short: 2 complete frames and {256 - n_lost} bytes" in warning.value


@pytest.mark.parametrize("size", [248, 200])
def test_rejects_capture_without_complete_frame(tmp_path, size):
    file = tmp_path / "capture.bin"
    file.write_bytes(bytes(size))

    mistake = catch_mistake(file, radar=make_radar(), iq="iq")

    assert mistake.value == f"{size} bytes"
    assert "at least 256 bytes" in mistake.expected


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


def format_log(*, chip="AR1642", swap=0, last=0, frames=3, loops=4, period=8_000_000) -> str:
    return LOG.format(chip=chip, swap=swap, last=last, frames=frames, loops=loops, period=period)


def test_studio_log_gives_settings_of_last_start(tmp_path):
    file = tmp_path / "LogFile.txt"
    file.write_text(format_log(last=1, loops=2))

    radar = read_radar(file)

    # Steps of 53.644 Hz, 48.279 kHz/us (written with five digits), 10 ns and 5 ns.
    chirp = radar.frame.chirp
    assert chirp.start_frequency_hz == pytest.approx(1435388860 * 53.644, rel=1e-5)
    assert chirp.slope_hz_per_s == pytest.approx(1657 * 48.279e9, rel=3e-5)
    assert chirp.adc_start_s == pytest.approx(6e-6)
    assert chirp.ramp_duration_s == pytest.approx(60e-6)
    assert chirp.sample_rate_hz == pytest.approx(2.5e6)
    assert (chirp.n_samples, chirp.sampling) == (8, "complex")
    assert radar.frame.n_chirps == 4  # two chirps of one transmitter, twice
    assert radar.frame.interval_s == pytest.approx(67e-6)
    assert radar.frame.period_s == pytest.approx(40e-3)
    assert radar.array.n_rx == 2  # mask 5


def test_60_ghz_chip_has_smaller_frequency_step(tmp_path):
    file = tmp_path / "LogFile.txt"
    file.write_text(format_log(chip="IWR6843"))

    # 2.7 GHz instead of 3.6 GHz over 2^26 steps: equal numbers give 3/4 of the frequency.
    assert read_radar(file).frame.chirp.start_frequency_hz == pytest.approx(57.75e9, rel=1e-4)


@pytest.mark.parametrize("swap", [0, 1])
def test_studio_log_of_capture_gives_sample_layout(tmp_path, swap):
    samples = draw_samples(3, 4, 2, 8)
    (tmp_path / "adc_data.bin").write_bytes(encode_dca1000(samples))
    (tmp_path / "adc_data_LogFile.txt").write_text(format_log(swap=swap))

    recording = open_recording(tmp_path / "adc_data.bin")

    expected = samples.imag + 1j * samples.real if swap else samples
    assert np.array_equal(recording.cube.values * 32768, expected)
    assert recording.radar.array == device("AR1642").select_antennas(0b1, 0b101)  # name in the log
    assert recording.radar.hardware is None


def test_single_chirp_frames_become_one_frame(tmp_path):
    (tmp_path / "a.bin").write_bytes(encode_dca1000(draw_samples(12, 1, 2, 8)))
    (tmp_path / "a.txt").write_text(format_log(frames=12, loops=1, period=200_000))

    recording = open_recording(tmp_path / "a.bin")

    assert (recording.n_frames, recording.radar.frame.n_chirps) == (1, 12)
    assert recording.radar.frame.interval_s == pytest.approx(1e-3)
    assert "12 frames of one chirp" in " ".join(finding.value for finding in recording.findings)


def test_truncated_single_chirp_frames_become_one_shorter_frame(tmp_path):
    samples = draw_samples(12, 1, 2, 8)
    (tmp_path / "a.bin").write_bytes(encode_dca1000(samples)[:-8])
    (tmp_path / "a.txt").write_text(format_log(frames=12, loops=1, period=200_000))

    recording = open_recording(tmp_path / "a.bin")

    assert (recording.n_frames, recording.radar.frame.n_chirps) == (1, 11)
    assert np.array_equal(recording.cube.values[0] * 32768, samples[:11, 0])
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert "cut short: 11 complete chirps and 56 bytes" in warning.value


@pytest.mark.parametrize("size", [120, 132])
def test_single_chirp_frames_need_two_complete_chirps(tmp_path, size):
    (tmp_path / "a.bin").write_bytes(bytes(size))
    (tmp_path / "a.txt").write_text(format_log(frames=12, loops=1, period=200_000))

    assert catch_mistake(tmp_path / "a.bin").value == f"{size} bytes"


def test_rejects_capture_longer_than_studio_log(tmp_path):
    (tmp_path / "a.bin").write_bytes(encode_dca1000(draw_samples(4, 4, 2, 8)))
    (tmp_path / "a.txt").write_text(format_log(frames=3))

    mistake = catch_mistake(tmp_path / "a.bin")

    assert mistake.value == "1024 bytes"
    assert "768 bytes" in mistake.expected


def test_capture_shorter_than_studio_log_gives_warning(tmp_path):
    (tmp_path / "a.bin").write_bytes(encode_dca1000(draw_samples(2, 4, 2, 8)))
    (tmp_path / "a.txt").write_text(format_log(frames=3))

    recording = open_recording(tmp_path / "a.bin")

    assert recording.n_frames == 2
    assert "warning" in [finding.level for finding in recording.findings]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("API:ChannelConfig", "API:Other", "no ChannelConfig"),
        ("15,2,1,0,1,0", "15,2,1,0,2,0", "chInterleave 2"),
        ("15,2,1,0,1,0", "15,2,3,0,1,0", "format 3"),
        ("0,8,2500,", "0,x,2500,", "ProfileConfig"),
        ("ChirpConfig,0,1,0,", "ChirpConfig,0,0,1,", "chirps 0 to 0"),
        ("0,8,2500,", "0,0,2500,", "Chirp.n_samples"),
    ],
)
def test_invalid_studio_log_error_names_call(tmp_path, old, new, message):
    file = tmp_path / "LogFile.txt"
    text = format_log()
    assert old in text
    file.write_text(text.replace(old, new))

    with pytest.raises(RecordingError) as error:
        read_radar(file)

    assert message in str(error.value)
    assert str(file) in str(error.value)


def test_rejects_studio_log_with_unequal_chirps(tmp_path):
    file = tmp_path / "LogFile.txt"
    second = "API:ChirpConfig,1,1,0,0,0,5,0,1,0,\nx: API:FrameConfig"
    file.write_text(format_log(last=1).replace("API:FrameConfig", second, 1))

    with pytest.raises(RecordingError, match="chirps 0 to 1 of the frame, which differ"):
        read_radar(file)


# --- Settings in the folder of a recording --------------------------------------------


def test_settings_with_name_of_recording_take_precedence(tmp_path):
    for name in ("run_1", "run_10", "other"):
        (tmp_path / f"{name}.bin").write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
        (tmp_path / f"{name}_LogFile.txt").write_text(format_log(period=10**6 * len(name)))

    recording = open_recording(tmp_path / "run_1.bin")

    assert recording.radar.frame.period_s == pytest.approx(25e-3)


def test_single_settings_file_of_folder_is_used(tmp_path):
    (tmp_path / "capture.bin").write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
    (tmp_path / "LogFile.txt").write_text(format_log())
    (tmp_path / "notes.txt").write_text("The antenna was tilted.")

    assert open_recording(tmp_path / "capture.bin").n_frames == 3


def test_empty_file_of_folder_is_named(tmp_path):
    (tmp_path / "adc_data.bin").touch()

    assert "adc_data.bin (0 bytes), no recording" in catch_mistake(tmp_path).value


def test_rejects_ambiguous_settings_files(tmp_path):
    (tmp_path / "capture.bin").write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
    for name, loops in (("monday.txt", 4), ("tuesday.txt", 2)):
        (tmp_path / name).write_text(format_log(loops=loops))

    mistake = catch_mistake(tmp_path / "capture.bin")

    assert "monday.txt, tuesday.txt" in mistake.value
    assert "--radar" in mistake.fix


def test_meta_json_is_not_settings_file(tmp_path):
    (tmp_path / "capture.bin").write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
    (tmp_path / "meta.json").write_text(json.dumps(make_config()))

    assert "no settings" in catch_mistake(tmp_path / "capture.bin").value


def test_yaml_file_of_recording_gives_radar(tmp_path):
    samples = draw_samples(3, 4, 4, 8)  # all four receivers of the board
    (tmp_path / "capture.bin").write_bytes(encode_dca1000(samples))
    (tmp_path / "capture.yaml").write_text(
        "frame:\n"
        "  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 20 us,\n"
        "          sample_rate: 5 MHz, n_samples: 8, sampling: complex}\n"
        "  n_chirps: 4\n"
        "  interval: 30 us\n"
    )

    recording = open_recording(tmp_path / "capture.bin", device="xwr1642", iq="iq")

    assert recording.radar.frame.interval_s == pytest.approx(30e-6)
    assert np.array_equal(recording.cube.values * 32768, samples)


# --- Infineon -------------------------------------------------------------------------


def make_config(**changes) -> dict:
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
    settings = {key: entry for key, entry in shape.items() if entry is not None}
    return {"device_config": {"fmcw_single_shape": settings}}


def write_infineon_folder(parent, samples, text=None):
    folder = parent / "RadarIfxAvian_00"
    folder.mkdir()
    np.save(folder / "radar.npy", samples)
    (folder / "config.json").write_text(json.dumps(make_config()) if text is None else text)
    return folder


def draw_codes(*shape):
    return np.random.default_rng(2).integers(0, 4096, shape).astype(np.uint16)


def test_12_bit_codes_span_full_scale(tmp_path):
    codes = draw_codes(2, 3, 4, 8)
    codes[1, 2, 3, 4], codes[1, 2, 3, 5] = 0, 4095
    folder = write_infineon_folder(tmp_path, codes)

    recording = open_recording(folder)

    assert recording.cube.dtype == np.float32
    assert recording.cube.sizes == {"frame": 2, "chirp": 4, "rx": 3, "sample": 8}
    assert recording.cube.values[1, 3, 2, 4:6] == pytest.approx([-1, 1], abs=1e-6)
    expected = codes.transpose(0, 2, 1, 3) / 4095 * 2 - 1
    # Rounded to float32 three times, each by up to 6e-8.
    assert np.allclose(recording.cube.values, expected, rtol=0, atol=2e-7)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_infineon_samples_of_the_vendors_library_are_normalised_floats(tmp_path, dtype):
    numbers = (draw_codes(2, 3, 4, 8) / 4095).astype(dtype)

    recording = open_recording(write_infineon_folder(tmp_path, numbers))

    assert np.array_equal(recording.cube.values, numbers.transpose(0, 2, 1, 3).astype(np.float32))


@pytest.mark.parametrize(
    ("header", "scale", "end"), [("", 1.0, "\n"), ("timestamp\n", 1e3, ""), ("", 1e9, ";x\r\n")]
)
def test_infineon_frames_are_timed_by_their_time_stamps(tmp_path, header, scale, end):
    folder = write_infineon_folder(tmp_path, draw_codes(5, 3, 4, 8))
    starts_s = np.array([0.0, 0.137, 0.2, 0.305, 0.4])
    rows = [f"{round((1653497534 + start_s) * scale, 6):.6f}{end}" for start_s in starts_s]
    text = "\n".join(rows) if not end else "".join(rows)
    (folder / "radar_timestamp.csv").write_text(header + text)

    recording = open_recording(folder)

    # Times of today in float64 have steps of 0.24 us.
    assert np.allclose(recording.cube.frame, starts_s, rtol=0, atol=1e-6)
    part = recording.select_frames(3, 5)
    assert np.allclose([frame.frame.item() for frame in part.frames()], [0.305, 0.4], atol=1e-6)
    note = next(f for f in recording.findings if f.setting == "radar_timestamp.csv")
    assert note.level == "note"
    assert "up to 37 ms off" in note.value


def test_inspection_and_list_load_no_library_of_settings_and_units(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    script = (
        "import sys; from dechirp.cli.main import main\n"
        "for words in (['inspect', sys.argv[1], '--quiet'], ['list', 'cfar', '--json']):\n"
        "    try: main(words)\n"
        "    except SystemExit as end: assert not end.code, end.code\n"
        "print(sorted({'pydantic', 'pint', 'numba', 'matplotlib.pyplot'} & set(sys.modules)))"
    )

    process = subprocess.run(
        [sys.executable, "-c", script, str(folder)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )

    assert process.stderr == ""
    assert process.stdout.endswith("\n[]\n")
    assert (tmp_path / "dechirp-inspect" / "map.png").is_file()


def test_infineon_time_stamps_reveal_missing_frames_and_survive_conversion(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(4, 3, 4, 8))
    (folder / "radar_timestamp.csv").write_text("100.0\n100.1\n100.42\n100.5\n")

    recording = open_recording(folder)

    assert any("2 frames missing" in f.value and f.level == "warning" for f in recording.findings)
    for name in ("copy.h5", "copy.zarr"):
        dc.write(recording.select_frames(1, 4), tmp_path / name)
        copy = open_recording(tmp_path / name)
        assert np.allclose(copy.cube.frame, [0, 0.32, 0.4], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "text",
    ["", "1.0\n", "1.0\n0.9\n", "1.0\nnan\n", "1.0\nno time\n", "1\n1e300\n", "1.0\n31.0\n", "\0"],
)
def test_invalid_infineon_time_stamps_are_ignored_with_warning(tmp_path, text):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    (folder / "radar_timestamp.csv").write_text(text)

    recording = open_recording(folder)

    assert np.allclose(recording.cube.frame, [0, 0.1])
    assert any(
        f.setting == "radar_timestamp.csv" and f.level == "warning" for f in recording.findings
    )


def test_infineon_codes_are_written_as_half_step_integers(tmp_path):
    codes = draw_codes(2, 3, 4, 8)
    codes[1, 2, 3, 4], codes[1, 2, 3, 5] = 0, 4095
    recording = open_recording(write_infineon_folder(tmp_path, codes))
    dc.write(recording, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        assert file["cube"].dtype == np.int16
        assert np.array_equal(file["cube"], 2 * codes.astype(int).transpose(0, 2, 1, 3) - 4095)
    assert np.array_equal(open_recording(tmp_path / "x.npz").cube.values, recording.cube.values)


def test_device_gives_antenna_positions_of_infineon_radar(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    device_array = open_recording(folder, device="bgt60tr13c").radar.array
    settings_array = open_recording(
        folder, radar=folder / "config.json", device="bgt60tr13c"
    ).radar.array
    assert device_array == settings_array != open_recording(folder).radar.array

    # The recording software names the chip in a second file.
    (folder / "meta.json").write_text('{"description": "BGT60TR13C FMCW Radar Sensor"}')
    assert open_recording(folder).radar.array == device_array


@pytest.mark.parametrize(
    "text", ["", "[]", '{"description": 1}', '{"description": ""}', '{"description": "x"}', "["]
)
def test_infineon_chip_that_is_not_named_leaves_assumed_positions(tmp_path, text):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    assumed_array = open_recording(folder).radar.array

    (folder / "meta.json").write_text(text)

    assert open_recording(folder).radar.array == assumed_array


def test_infineon_tdm_is_read_in_both_chirp_orders(tmp_path):
    samples = draw_codes(2, 4, 2, 3, 8)  # frame, chirp of a transmitter, transmitter, rx, sample
    text = json.dumps(make_config(mimo_mode="tdm", tx_antennas=[1, 2]))
    transmit_order = samples.reshape(2, 8, 3, 8).transpose(0, 2, 1, 3)
    receiver_pairs = samples.transpose(0, 2, 3, 1, 4).reshape(2, 6, 4, 8)
    cubes = []
    for name, order in (("sent", transmit_order), ("pairs", receiver_pairs)):
        (tmp_path / name).mkdir()
        cubes.append(open_recording(write_infineon_folder(tmp_path / name, order, text)).cube)

    assert cubes[0].sizes == {"frame": 2, "chirp": 8, "rx": 3, "sample": 8}
    assert cubes[0].transmitter.values.tolist() == [0, 1] * 4
    expected = samples.reshape(2, 8, 3, 8) / 4095 * 2 - 1
    for cube in cubes:
        assert np.allclose(cube.values, expected, rtol=0, atol=2e-7)


def test_infineon_ramp_duration_equals_sampling_window(tmp_path):
    recording = open_recording(write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8)))

    chirp = recording.radar.frame.chirp
    assert chirp.sampled_bandwidth_hz == pytest.approx(1e9)
    assert chirp.slope_hz_per_s == pytest.approx(1e9 / 4e-6)
    assert chirp.sampling == "real"
    assert recording.radar.frame.interval_s == 0.0005
    assert recording.cube.frame.values == pytest.approx([0, 0.1])


def test_infineon_recording_opens_by_parent_folder_or_file(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))

    for path in (tmp_path, folder, folder / "radar.npy"):
        recording = open_recording(path)
        assert (recording.format, recording.n_frames) == ("infineon", 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"device_config": {', "not JSON"),
        ("", "not JSON"),
        ("[" * 100_000, "nested too deeply"),
        ("[1, 2]", "no device_config.fmcw_single_shape"),
        ('{"device_config": {"fmcw_scene": {}}}', "no device_config.fmcw_single_shape"),
        (
            json.dumps(make_config(sample_rate_Hz=None, rx_antennas=None)),
            "sample_rate_Hz, rx_antennas",
        ),
        (json.dumps(make_config(num_samples_per_chirp="8")), 'num_samples_per_chirp = "8"'),
        (json.dumps(make_config(num_chirps_per_frame=4.5)), "num_chirps_per_frame = 4.5"),
        (json.dumps(make_config(rx_antennas=3)), "rx_antennas = 3"),
        (json.dumps(make_config(end_frequency_Hz=10**400)), "end_frequency_Hz = 1000"),
        (json.dumps(make_config(end_frequency_Hz=59e9)), "Chirp.slope_hz_per_s"),
        (json.dumps(make_config(sample_rate_Hz=0)), "impossible settings"),
        (json.dumps(make_config(mimo_mode="bpm")), 'mimo_mode "bpm"'),
    ],
)
def test_invalid_infineon_config_error_names_mistake(tmp_path, text, message):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8), text)

    mistake = catch_mistake(folder)

    assert message in mistake.value
    assert mistake.file == str(folder / "config.json")


def test_missing_infineon_config_error_names_file(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    (folder / "config.json").unlink()

    mistake = catch_mistake(folder)

    assert mistake.file == str(folder / "config.json")
    assert "radar.npy without config.json" in mistake.value
    assert open_recording(folder, radar=make_radar(n_rx=3, sampling="real")).n_frames == 2


@pytest.mark.parametrize(
    ("codes", "message"),
    [
        (draw_codes(2, 3, 4, 16), "(2, 3, 4, 16)"),
        (draw_codes(3, 4, 8), "(3, 4, 8)"),
        (draw_codes(2, 3, 4, 8) / 1000, "numbers from 0"),
        (np.full((2, 3, 4, 8), np.nan), "numbers from nan"),
        (draw_codes(2, 3, 4, 8) / 4095 + 0j, "complex128"),
        (draw_codes(2, 3, 4, 8) + np.uint16(5000), "codes from"),
    ],
)
def test_rejects_infineon_samples_that_contradict_config(tmp_path, codes, message):
    assert message in catch_mistake(write_infineon_folder(tmp_path, codes)).value


def test_rejects_infineon_samples_behind_link(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    (folder / "radar.npy").rename(tmp_path / "other.npy")
    (folder / "radar.npy").symlink_to(tmp_path / "other.npy")

    assert "radar.npy is a link" in catch_mistake(folder).value


def test_rejects_folder_with_two_infineon_recordings(tmp_path):
    folder = write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))
    folder.rename(tmp_path / "RadarIfxAvian_01")
    write_infineon_folder(tmp_path, draw_codes(2, 3, 4, 8))

    assert "RadarIfxAvian_00, RadarIfxAvian_01" in catch_mistake(tmp_path).value


# --- NumPy arrays ---------------------------------------------------------------------


def save_array(tmp_path, array, name="cube.npy"):
    np.save(tmp_path / name, array)
    return tmp_path / name


def test_axes_follow_requested_order(tmp_path):
    samples = draw_samples(3, 4, 2, 8)
    order = ["sample", "frame", "rx", "chirp"]
    file = save_array(tmp_path, np.transpose(samples, (3, 0, 2, 1)))

    recording = open_recording(file, radar=make_radar(), axes=order, encoding="int16")
    by_text = open_recording(file, radar=make_radar(), axes=",".join(order), encoding="int16")

    assert np.array_equal(recording.cube.values * 32768, samples)
    assert by_text.cube.identical(recording.cube)


def test_every_encoding_decodes_to_equal_samples(tmp_path):
    samples = draw_samples(4, 2, 8)
    parts = np.stack([samples.real, samples.imag], axis=-1)
    arrays = {
        "int16": parts.astype(np.int16),
        "uint16-wrapped": parts.astype(np.int16).view(np.uint16),
        "offset-binary": (parts + 32768).astype(np.uint16),
        "full-scale": parts / 32768,
    }

    for encoding, array in arrays.items():
        pair_file = save_array(tmp_path, array, f"{encoding}.npy")
        complex_file = save_array(
            tmp_path, array[..., 0] + 1j * array[..., 1], f"{encoding}-complex.npy"
        )
        options = {"radar": make_radar(), "encoding": encoding}
        from_pairs = open_recording(pair_file, axes="chirp,rx,sample,iq", **options)
        from_complex = open_recording(complex_file, axes="chirp,rx,sample", **options)
        assert np.array_equal(from_pairs.cube.values[0] * 32768, samples)
        assert np.array_equal(from_complex.cube.values[0] * 32768, samples)


def test_unambiguous_numbers_need_no_encoding(tmp_path):
    samples = draw_samples(4, 2, 8) / 32768
    pairs = np.stack([samples.real, samples.imag], axis=-1)
    as_integers = save_array(tmp_path, (pairs * 32768).astype(np.int16), "integers.npy")
    as_floats = save_array(tmp_path, samples, "floats.npy")

    for file, axes in ((as_integers, "chirp,rx,sample,iq"), (as_floats, "chirp,rx,sample")):
        assert np.array_equal(
            open_recording(file, radar=make_radar(), axes=axes).cube.values[0], samples
        )


@pytest.mark.parametrize("numbers", [3000, 70000, [20000, 60000, 100]])
@pytest.mark.parametrize("dtype", [np.uint32, np.float64])
def test_rejects_ambiguous_numbers_without_encoding(tmp_path, dtype, numbers):
    file = save_array(tmp_path, np.resize(np.array(numbers, dtype), (4, 2, 8, 2)))

    mistake = catch_mistake(file, radar=make_radar(), axes="chirp,rx,sample,iq")

    assert "int16, uint16-wrapped, offset-binary, full-scale" in mistake.expected


@pytest.mark.parametrize(
    ("encoding", "dtype"),
    [
        ("int16", np.int64),
        ("int16", np.float32),
        ("uint16-wrapped", np.uint16),
        ("uint16-wrapped", np.float64),
        ("offset-binary", np.uint16),
        ("offset-binary", np.float64),
    ],
)
def test_numbers_of_the_first_frame_choose_the_encoding(tmp_path, encoding, dtype):
    codes = np.random.default_rng(2).integers(-4000, 4000, (4, 2, 8, 2))
    offset = {"int16": 0, "uint16-wrapped": 2**16 * (codes < 0), "offset-binary": 2**15}[encoding]
    file = save_array(tmp_path, (codes + offset).astype(dtype))

    recording = open_recording(file, radar=make_radar(), axes="chirp,rx,sample,iq")

    assert f"chosen --encoding {encoding} because" in str(recording.findings)
    np.testing.assert_allclose(recording.cube.values[0], (codes @ [1, 1j]) / 2**15, rtol=1e-6)


def test_rejects_numbers_beyond_encoding(tmp_path):
    file = save_array(tmp_path, np.full((4, 2, 8), 40000 + 1j))

    mistake = catch_mistake(file, radar=make_radar(), axes="chirp,rx,sample", encoding="int16")

    assert "40000" in mistake.value


def test_unknown_encoding_error_lists_encodings(tmp_path):
    file = save_array(tmp_path, draw_samples(4, 2, 8))

    mistake = catch_mistake(file, radar=make_radar(), axes="chirp,rx,sample", encoding="int12")

    assert "int16, uint16-wrapped, offset-binary, full-scale" in mistake.expected


def test_missing_axes_error_gives_shape_and_example(tmp_path):
    mistake = catch_mistake(save_array(tmp_path, draw_samples(4, 2, 8)), radar=make_radar())

    assert "4 x 2 x 8" in mistake.value
    assert "--axes chirp,rx,sample" in mistake.fix


@pytest.mark.parametrize(
    "axes", ["chirp,sample", "chirp,rx,time", "chirp,chirp,sample", "frame,rx,sample"]
)
def test_rejects_axes_that_do_not_fit_array(tmp_path, axes):
    mistake = catch_mistake(
        save_array(tmp_path, draw_samples(4, 2, 8)), radar=make_radar(), axes=axes
    )

    assert axes in mistake.value


def test_shape_mismatch_error_names_axes(tmp_path):
    file = save_array(tmp_path, draw_samples(8, 2, 4))

    mistake = catch_mistake(file, radar=make_radar(), axes="chirp,rx,sample", encoding="int16")

    assert mistake.value == "8 along chirp and 4 along sample"


def test_rejects_receiver_mismatch_unless_radar_has_no_array(tmp_path):
    file = save_array(tmp_path, draw_samples(4, 3, 8))
    options = {"axes": "chirp,rx,sample", "encoding": "int16"}

    assert "3 receivers" in catch_mistake(file, radar=make_radar(n_rx=2), **options).value
    recording = open_recording(file, radar=Radar(frame=make_radar().frame), **options)
    assert recording.radar.array.n_rx == 3
    assert [finding.level for finding in recording.findings] == ["note"]


def test_rejects_samples_of_other_sampling_kind(tmp_path):
    real_radar, complex_radar = make_radar(sampling="real"), make_radar()
    options = {"axes": "chirp,rx,sample", "encoding": "full-scale"}
    numbers = np.linspace(-1, 1, 64).reshape(4, 2, 8)

    assert (
        "real numbers"
        in catch_mistake(save_array(tmp_path, numbers), radar=complex_radar, **options).value
    )
    assert (
        "imaginary"
        in catch_mistake(save_array(tmp_path, numbers + 1e-2j), radar=real_radar, **options).value
    )
    # Some tools save real samples as complex numbers.
    recording = open_recording(save_array(tmp_path, numbers + 0j), radar=real_radar, **options)
    assert np.array_equal(recording.cube.values[0], numbers.astype(np.float32))


def test_non_finite_samples_error_gives_count_and_position(tmp_path):
    samples = draw_samples(3, 4, 2, 8) / 32768
    samples[2, 1, 0, 5], samples[2, 3, 1, 7] = np.nan, 1j * np.inf
    recording = open_recording(
        save_array(tmp_path, samples),
        radar=make_radar(),
        axes="frame,chirp,rx,sample",
        encoding="full-scale",
    )

    frames = recording.frames()
    valid_frames = [next(frames), next(frames)]  # frames 0 and 1 are finite
    with pytest.raises(RecordingError) as error:
        next(frames)

    assert len(valid_frames) == 2
    assert "2 of 64 samples of frame 2" in str(error.value)
    assert "chirp 1, rx 0, sample 5" in str(error.value)


# --- Invalid files --------------------------------------------------------------------


def encode_npy_header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


HEADER_TEXT = "{{'descr': '<c8', 'fortran_order': False, 'shape': {} }}\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
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
        ("cube.npy", encode_npy_header("{'descr': "), "a damaged header"),
        ("cube.npy", encode_npy_header("(" * 9000), "a damaged header"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((10**9, 10**9, 10**9))), "a file of"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((-4, -2, 8))) + bytes(512), "a file of"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((0, 2, 8))), "a file of"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((4, 2, 8))) + bytes(500), "a file of"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((4, 2, 8))) + bytes(520), "a file of"),
        ("cube.npy", encode_npy_header(HEADER_TEXT.format((4, 2, 8)).replace("<c8", "<U2")), "<U2"),
    ],
)
def test_rejects_file_whose_content_contradicts_name(tmp_path, name, content, message):
    file = tmp_path / name
    file.write_bytes(content)
    axes = "chirp,rx,sample" if name.endswith("npy") else None

    mistake = catch_mistake(file, radar=make_radar(), axes=axes)

    assert message in mistake.value
    assert mistake.file == str(file)


def fail_on_unpickling():
    pytest.fail("a pickle in a recording was opened")


class Trap:
    """Object that calls `fail_on_unpickling` when unpickled."""

    def __reduce__(self):
        return fail_on_unpickling, ()


def test_never_unpickles_objects(tmp_path):
    objects = np.empty((4, 2, 8), object)
    objects[:] = Trap()
    file = save_array(tmp_path, objects)
    assert b"fail_on_unpickling" in file.read_bytes()  # the file holds the trap

    assert "Python objects" in catch_mistake(file, radar=make_radar(), axes="chirp,rx,sample").value

    (tmp_path / "bare.npy").write_bytes(pickle.dumps(Trap()))
    mistake = catch_mistake(tmp_path / "bare.npy", radar=make_radar(), axes="chirp,rx,sample")
    assert "pickle" in mistake.value


def test_missing_path_is_reported(tmp_path):
    assert "no such file" in catch_mistake(tmp_path / "capture.bin").value


def test_rejects_overlong_file_name(tmp_path):
    assert "too long" in catch_mistake(tmp_path / ("x" * 300)).value


def test_folder_without_recording_error_lists_files(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"\xff\xd8")

    assert "holiday.jpg" in catch_mistake(tmp_path).value


def test_rejects_wrong_format_or_option(tmp_path):
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))

    assert (
        "dca1000, float-points, hdf5, infineon"
        in catch_mistake(file, radar=make_radar(), format="wav").expected
    )
    assert "format npy" in catch_mistake(file, radar=make_radar(), format="npy").expected
    assert "axes" in catch_mistake(file, radar=make_radar(), axes="chirp,sample").value
    assert "iq, qi" in catch_mistake(file, radar=make_radar(), iq="swapped").expected


def test_content_takes_precedence_over_name(tmp_path):
    file = save_array(tmp_path, draw_samples(4, 2, 8)).rename(tmp_path / "cube.bin")

    recording = open_recording(file, radar=make_radar(), axes="chirp,rx,sample", encoding="int16")

    assert recording.format == "npy"


def test_recorded_and_simulated_cubes_are_identical(tmp_path, radar):
    target = dc.Target(position_m=(20, 1, 0), rcs_m2=10)
    simulated_cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=1, n_frames=2)
    np.save(tmp_path / "cube.npy", simulated_cube.values)
    recorded_cube = dc.open(
        tmp_path / "cube.npy",
        radar=radar,
        axes=("frame", "chirp", "rx", "sample"),
        encoding="full-scale",
    ).cube

    # Attributes alone differ: units, and the simulation kernels.
    assert recorded_cube.assign_attrs(simulated_cube.attrs).identical(simulated_cube)
    assert dc.detect(recorded_cube, radar).identical(dc.detect(simulated_cube, radar))


def write_capture_folder(folder, name="capture", radar=None):
    """Write a capture with its radar into a folder; return the path of the capture."""
    folder.mkdir(exist_ok=True)
    (folder / "radar.yaml").write_text(dump_yaml(radar or make_radar()))
    file = folder / f"{name}.bin"
    file.write_bytes(encode_dca1000(draw_samples(3, 4, 2, 8)))
    return file


def test_folder_with_one_recording_and_other_files_opens(tmp_path):
    file = write_capture_folder(tmp_path)
    (tmp_path / "README.md").write_text("A walk.\n")
    (tmp_path / "map.png").write_bytes(b"\x89PNG\r\n" + bytes(50))
    (tmp_path / "cut.jpg").write_bytes(b"\xff\xd8")
    (tmp_path / "meta.json").write_text('{"truth": [1, 2]}')
    (tmp_path / ".DS_Store").write_bytes(bytes(4096))
    (tmp_path / "gone.bin").symlink_to("absent.bin")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "dechirp-run").mkdir()
    (tmp_path / "dechirp-run" / "run.json").write_text("{}")
    (tmp_path / "dechirp-run" / ".zattrs").write_text("{}")

    recording = open_recording(tmp_path)

    assert recording.path == file
    assert recording.cube.identical(open_recording(file).cube)
    assert inspect(tmp_path).recording.path == file


def test_folder_names_truth_table_that_it_does_not_read(tmp_path):
    file = write_capture_folder(tmp_path)
    np.save(tmp_path / "truth.npy", np.arange(6.0).reshape(2, 3))

    recording = open_recording(tmp_path)

    assert recording.path == file
    assert "truth.npy" in recording.findings[0].value


@pytest.mark.parametrize("read", [open_recording, lambda path: inspect(path).recording])
def test_first_of_several_recordings_is_chosen_with_a_note(tmp_path, read):
    folder = tmp_path / "two walks"
    for name in ("walk 10", "walk 2"):
        write_capture_folder(folder, name)

    recording = read(folder)

    note = next(f for f in recording.findings if f.setting == "recording")
    assert recording.path == folder / "walk 2.bin"
    assert note.value == (
        "chosen walk 2.bin, the first of 2 recordings of the folder; others: walk 10.bin"
    )
    assert note.fix.endswith(f"'{folder / 'walk 10.bin'}'")


def test_recordings_that_cannot_be_read_are_passed_over(tmp_path):
    write_capture_folder(tmp_path, "second")
    (tmp_path / "first.bin").write_bytes(bytes(100))

    recording = open_recording(tmp_path)

    assert recording.path.name == "second.bin"
    assert "the first of 2 recordings of the folder that can be read" in recording.findings[0].value


def test_commands_in_error_of_missing_settings_and_axes_read_the_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cube = np.exp(0.3j * np.arange(100)) * np.ones((16, 4, 1))
    for name in ("a", "b"):
        np.savez(f"{name}.npz", cube=cube)

    mistake = catch_mistake(tmp_path)
    advice = f"give one of them: dechirp run {tmp_path / 'a.npz'}; for this one, "
    assert mistake.fix.startswith(advice)
    own_fix = mistake.fix.removeprefix(advice)
    mistake = catch_mistake(tmp_path / "a.npz")
    assert mistake.fix == own_fix
    axes = re.search(r"--axes (\S+)", mistake.fix).group(1)
    assert "the radar, as --radar FILE" in mistake.fix
    # Four lines of 80 columns. With the axes, the radar is asked for, with an example.
    assert len(f"recording: {mistake.value}; {mistake.expected}; {mistake.fix}") <= 300
    mistake = catch_mistake(tmp_path / "a.npz", axes=axes)
    command, repeated_axes = re.search(
        rf"(echo '.*' > radar.yaml); dechirp run {tmp_path / 'a.npz'} --axes (\S+)", mistake.fix
    ).groups()
    assert repeated_axes == axes
    subprocess.run(["sh", "-c", command], check=True)

    recording = dc.open("a.npz", axes=axes, radar="radar.yaml")
    assert recording.cube.shape == (1, *cube.shape)
    assert recording.radar.frame.chirp.sampling == "complex"


def test_arrays_of_a_file_without_settings_are_listed(tmp_path):
    np.savez(tmp_path / "walk.npz", one=np.ones((4, 8), complex), time=np.ones((4, 2)))

    mistake = catch_mistake(tmp_path / "walk.npz")

    assert "one (complex128 of 4 x 8), time (float64 of 4 x 2)" in mistake.value
    pairs = np.zeros((4, 8), [("real", "<f8"), ("imag", "<f8")])
    np.savez(tmp_path / "pairs.npz", one=pairs, two=pairs)
    assert "one (pairs of float64 of 4 x 8), two" in catch_mistake(tmp_path / "pairs.npz").value
    assert mistake.fix.endswith(f"dechirp run {tmp_path / 'walk.npz' / 'one'}")
    with pytest.raises(dc.RecordingError) as error:
        open_recording(tmp_path / "walk.npz" / "one", axes=("chirp", "sample"))
    command = f"dechirp run {tmp_path / 'walk.npz' / 'one'} --axes chirp,sample --radar radar.yaml"
    assert error.value.mistakes[0].fix.endswith(command)


def test_capture_of_fewer_chirps_than_a_frame_is_one_shorter_frame(tmp_path):
    samples = draw_samples(1, 4, 2, 8)
    file = tmp_path / "capture.bin"
    file.write_bytes(encode_dca1000(samples[:, :3]))

    recording = open_recording(file, radar=make_radar(), iq="iq")

    assert recording.sizes == {"frame": 1, "chirp": 3, "rx": 2, "sample": 8}
    (note,) = (found for found in recording.findings if "radar.frame.n_chirps" in found.setting)
    assert note.level == "note"  # as of all options that are chosen
    assert note.value.startswith("chosen --set radar.frame.n_chirps=3")
    np.testing.assert_array_equal(recording.cube.values * 2**15, samples[:, :3])


def write_settings_of_two_slopes(folder, *names):
    for slope, name in enumerate(names, 60):
        (folder / name).write_text(f"profileCfg 0 77 7 7 58 0 0 {slope} 1 256 5500 0 0 30\n")


def test_words_of_names_choose_the_settings_of_a_recording(tmp_path):
    for name in ("wall.bin", "wall_wide.bin"):
        (tmp_path / name).write_bytes(bytes(2**16))
    write_settings_of_two_slopes(tmp_path, "radar_wide.cfg", "radar_narrow.cfg")

    chosen = {
        name: choose_settings_file(tmp_path / f"{name}.bin") for name in ("wall", "wall_wide")
    }

    assert [finding.level for _, (finding,) in chosen.values()] == ["note", "note"]
    assert chosen["wall_wide"][0].name == "radar_wide.cfg"
    assert "shares a word with the name of the recording: wide" in chosen["wall_wide"][1][0].value
    assert chosen["wall"][0].name == "radar_narrow.cfg"
    assert "words of other recordings in their names: wide" in chosen["wall"][1][0].value


def test_settings_without_distinguishing_words_are_all_named(tmp_path):
    (tmp_path / "wall.bin").write_bytes(bytes(2**16))
    write_settings_of_two_slopes(tmp_path, "radar_wide.cfg", "radar_narrow.cfg")

    fix = catch_mistake(tmp_path / "wall.bin").fix

    assert "radar_wide.cfg" in fix and "radar_narrow.cfg" in fix


def test_slow_time_files_name_the_command_that_reads_them(tmp_path):
    times_s = np.arange(100) / 20
    for name in ("first", "second"):
        phase = np.cos(2 * np.pi * 0.3 * times_s)
        rows = np.column_stack([times_s, np.cos(phase), np.sin(phase)])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,I,Q", comments="")

    assert catch_mistake(tmp_path).fix.endswith("first.csv --vital-signs")
    assert catch_mistake(tmp_path / "second.csv").fix.endswith("second.csv --vital-signs")


def test_arrays_of_one_column_are_no_recordings_of_a_folder(tmp_path):
    np.save(tmp_path / "speed.npy", np.arange(1000.0))
    np.save(tmp_path / "address.npy", np.arange(3000))

    assert catch_mistake(tmp_path).value.endswith("no recording among them")

    np.save(tmp_path / "cube.npy", np.ones((2, 16, 4, 64), np.complex64))
    assert "cube.npy: recording: an array of complex64" in str(catch_mistake(tmp_path))


@pytest.mark.parametrize("heading", ["f,P,T,rho,gamma\n(GHz),(hPa),(K),(g/cm3),(dB/km)\n", ""])
def test_text_tables_of_many_quantities_are_no_recordings_of_a_folder(tmp_path, heading):
    for name in ("first", "second"):
        (tmp_path / f"{name}.csv").write_text(heading + "1,2,3,4,5\n" * 20)

    problem = "no recording among them" if heading else "a folder with 2 recordings"
    assert problem in catch_mistake(tmp_path).value


def test_channels_of_an_oscilloscope_are_recordings_of_a_folder(tmp_path):
    for name in ("first", "second"):
        heading = "Time,CH1,CH2,CH3,CH4,CH5,CH6\ns,V,V,V,V,V,V\n"
        (tmp_path / f"{name}.csv").write_text(heading + "1,2,3,4,5,6,7\n" * 20)

    assert "a folder with 2 recordings" in catch_mistake(tmp_path).value


def test_folder_of_an_archive_names_it(tmp_path):
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("walk.bin", b"0")

    assert "walk.zip is a ZIP archive with walk.bin: unpack it" in catch_mistake(tmp_path).fix


def test_recordings_with_one_stem_are_both_named(tmp_path):
    write_capture_folder(tmp_path, "walk")
    (tmp_path / "walk.cf32").write_bytes(draw_samples(3, 4, 2, 8).astype(np.complex64).tobytes())

    assert "chosen walk.bin" in open_recording(tmp_path).findings[0].value
    assert "others: walk.cf32" in open_recording(tmp_path).findings[0].value


def test_parts_of_split_capture_are_one_recording_of_folder(tmp_path):
    content = write_capture_folder(tmp_path, "whole_0").read_bytes()
    (tmp_path / "whole_0.bin").write_bytes(content[:-100])
    (tmp_path / "whole_1.bin").write_bytes(content[-100:])

    recording = open_recording(tmp_path)

    assert (recording.path.name, recording.n_frames) == ("whole_0.bin", 3)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ([], "an empty folder"),
        (["map.png"], "a folder with map.png, no recording among them"),
        (["radar.yaml"], "the settings of a recording, without its samples: radar.yaml"),
    ],
)
def test_folder_without_recording_is_described(tmp_path, names, message):
    for name in names:
        text = dump_yaml(make_radar()).encode() if name.endswith("yaml") else b"\x89PNG\r\n"
        (tmp_path / name).write_bytes(text)

    assert message in catch_mistake(tmp_path).value


def test_folder_of_pointer_or_nested_recording_names_next_step(tmp_path):
    nested = tmp_path / "outer" / "inner"
    (tmp_path / "outer").mkdir()
    write_capture_folder(nested)
    pointers = tmp_path / "pointers"
    pointers.mkdir()
    (pointers / "walk.bin").write_text("version https://git-lfs.github.com/spec/v1\nsize 9\n")

    assert catch_mistake(tmp_path / "outer").fix.endswith(f"dechirp run {nested}")
    assert "a pointer of Git LFS" in catch_mistake(pointers).value


@pytest.mark.parametrize(
    ("name", "content", "value", "fix"),
    [
        (
            "walk.bin.gz",
            gzip.compress(bytes(100), mtime=0),
            "beside walk.bin.gz",
            "unpack it: gunzip FILE",
        ),
        ("walk.bin", b"", "beside walk.bin (0 bytes)", "copy the recording into the folder"),
    ],
)
def test_folder_of_settings_names_what_is_no_recording(tmp_path, name, content, value, fix):
    (tmp_path / "radar.yaml").write_text(dump_yaml(make_radar()))
    (tmp_path / name).write_bytes(content)

    mistake = catch_mistake(tmp_path)
    assert mistake.value.endswith(value)
    assert fix in mistake.fix


def test_settings_in_the_folder_above_are_named(tmp_path, monkeypatch):
    (tmp_path / "day 1").mkdir()
    file = write_capture_folder(tmp_path / "day 1" / "walk")
    above = str(tmp_path / "day 1" / "radar.yaml")
    (file.parent / "radar.yaml").rename(above)

    for path in (file, file.parent):
        mistake = catch_mistake(path)
        assert mistake.value.endswith("in the folder above radar.yaml")
        assert mistake.fix.endswith(f"--radar {shlex.quote(above)}")
    assert f"run {shlex.quote(str(file.parent))} --radar" in catch_mistake(tmp_path / "day 1").fix
    monkeypatch.chdir(file.parent)
    assert f"--radar {shlex.quote(above)}" in catch_mistake(Path(file.name)).fix


@pytest.mark.parametrize("read", [open_recording, inspect])
def test_unreadable_recording_or_folder_is_named(tmp_path, read, monkeypatch):
    file = write_capture_folder(tmp_path / "locked file")
    monkeypatch.setattr(os, "access", lambda path, _: path != file)
    real_open = type(file).open

    def refuse(path, *args, **options):
        if path == file:
            raise PermissionError(13, "Permission denied", str(path))
        return real_open(path, *args, **options)

    monkeypatch.setattr(type(file), "open", refuse)

    with pytest.raises(RecordingError, match=r"capture\.bin: recording: not readable \(Permission"):
        read(file.parent)


def test_text_document_gets_short_message(tmp_path):
    (tmp_path / "README.md").write_text("# A walk\n\nRecorded on Monday.\n")

    mistake = catch_mistake(tmp_path / "README.md")

    assert mistake.value == "a text document"
    assert "raddet" not in str(mistake) and "copy it again" not in str(mistake)


def test_scenario_in_place_of_its_radar_is_recognised(tmp_path):
    (tmp_path / "scenario.yaml").write_text("radar:\n  frame: {n_chirps: 2}\n")
    (tmp_path / "walk.cf32").write_bytes(np.ones(64, np.complex64).tobytes())

    with pytest.raises(RecordingError, match="a scenario, which contains a radar; expected"):
        open_recording(tmp_path / "walk.cf32", radar=tmp_path / "scenario.yaml")
