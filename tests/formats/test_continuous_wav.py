"""WAV recordings without a sync: one channel, I and Q in two files or in two channels."""

import sys
import wave
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.readers.continuous_wav import ContinuousWav
from dechirp.recordings.recognise import recognise_formats
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import RecordingSettings
from nightly import n_examples

RATE, PERIOD, N, M = 8000, 200.4, 90, 8
SLOPE = 100e6 * RATE / N  # 1.5 m per range bin


def make_radar(sampling="complex", *, period_s=None, n_chirps=M):
    chirp = Chirp(
        start_frequency_hz=2.4e9,
        slope_hz_per_s=SLOPE,
        adc_start_s=5 / RATE,
        ramp_duration_s=100 / RATE,
        sample_rate_hz=RATE,
        n_samples=N,
        sampling=sampling,
    )
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=n_chirps, interval_s=PERIOD / RATE, period_s=period_s)
    )


def draw_iq(n_samples=4 * 1603 + 300, seed=1):
    """Draw samples of I and Q, (channel, sample), as codes of 16 bits."""
    return np.random.default_rng(seed).integers(-30_000, 30_000, (2, n_samples)).astype("<i2")


def write_wav(path, *channels, rate=RATE):
    with wave.open(str(path), "wb") as out:
        out.setnchannels(len(channels))
        out.setsampwidth(2)
        out.setframerate(rate)
        out.writeframes(np.stack(channels, axis=-1).tobytes())
    return path


def expected_chirps(signal, radar, n_frames):
    """Cut the chirps out of a signal, in a plain loop."""
    frame = radar.frame
    chirps = []
    for number in range(n_frames):
        for chirp in range(frame.n_chirps):
            start_s = frame.frame_start_s(number) + chirp * PERIOD / RATE
            start = round(start_s * RATE + 5)
            chirps.append(signal[start : start + N])
    return np.array(chirps).reshape(n_frames, frame.n_chirps, N)


@pytest.mark.parametrize(
    ("i_name", "q_name"),
    [
        ("walk_I.wav", "walk_Q.wav"),
        ("I.wav", "Q.wav"),
        ("i-walk-2.wav", "q-walk-2.wav"),
        ("walk3I.wav", "walk3Q.wav"),
    ],
)
def test_two_mono_files_are_i_and_q_of_each_sample(tmp_path, i_name, q_name):
    i_codes, q_codes = draw_iq()
    write_wav(tmp_path / i_name, i_codes)
    write_wav(tmp_path / q_name, q_codes[:-1])
    radar = make_radar()
    expected = expected_chirps((i_codes + 1j * q_codes) / 32768, radar, 4)

    for name in (i_name, q_name):
        assert recognise_formats(tmp_path / name) == ("continuous-wav",)
        recording = open_recording(tmp_path / name, radar=radar)
        assert np.array_equal(recording.cube.values[:, :, 0], expected.astype(np.complex64))
        text = " ".join(str(finding) for finding in recording.findings)
        assert "one after the other" in text  # one sample of Q is missing
    swapped = open_recording(tmp_path / i_name, radar=radar, iq="qi").cube.values[:, :, 0]
    assert np.array_equal(swapped, 1j * expected.astype(np.complex64).conj())


def test_two_channels_are_i_and_q_where_the_format_is_named(tmp_path):
    i_codes, q_codes = draw_iq()
    file = write_wav(tmp_path / "radio.wav", i_codes, q_codes)
    expected = expected_chirps((i_codes + 1j * q_codes) / 32768, make_radar(), 4)

    with pytest.raises(RecordingError, match="--format continuous-wav"):
        open_recording(file, radar=make_radar())
    recording = open_recording(file, radar=make_radar(), format="continuous-wav")

    assert np.array_equal(recording.cube.values[:, :, 0], expected.astype(np.complex64))


def test_one_channel_is_a_real_beat_signal_with_pauses_between_frames(tmp_path):
    (codes, _) = draw_iq(7000)
    file = write_wav(tmp_path / "beat.wav", codes)
    radar = make_radar("real", period_s=0.3)  # 2400 samples: frames begin at 0, 2400 and 4800

    recording = open_recording(file, radar=radar)

    expected = expected_chirps(codes / 32768, radar, 3)
    assert np.array_equal(recording.cube.values[:, :, 0], expected.astype(np.float32))
    last = next(recording.select_frames(2, 3).frames())
    assert np.array_equal(last.values[0, :, 0], expected[2].astype(np.float32))


@pytest.mark.parametrize("format", [None, "sync-wav", "continuous-wav"])
def test_missing_library_is_reported_with_its_extra(tmp_path, monkeypatch, format):
    file = write_wav(tmp_path / "beat.wav", draw_iq()[0])
    monkeypatch.setitem(sys.modules, "soundfile", None)

    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        open_recording(file, radar=make_radar("real"), format=format)


def test_single_chirps_are_joined_and_their_ambiguity_is_reported(tmp_path):
    codes = draw_iq(44 * 200 + 22)[0]
    file = write_wav(tmp_path / "beat.wav", codes)

    recording = open_recording(file, radar=make_radar("real", n_chirps=1))

    assert recording.radar.frame.n_chirps == 8  # a power of two in 0.3 s
    text_of_findings = " ".join(finding.value for finding in recording.findings)
    assert "5 complete frames of 8 chirps, and 4 chirps that are left out" in text_of_findings
    expected = expected_chirps(codes / 32768, recording.radar, recording.n_frames)
    assert np.array_equal(recording.cube.values[:, :, 0], expected.astype(np.float32))
    # lambda / (4 T): 0.1222 m / (4 * 25.05 ms) = 1.22 m/s, less than a person walks.
    (aliasing,) = (f for f in recording.findings if f.setting == "radar.frame.interval")
    assert "beyond 1.22 m/s are aliased, off by multiples of 2.44 m/s" in aliasing.value
    assert aliasing.level == "note" and "walk" not in aliasing.expected


def test_complete_frames_are_counted_to_the_sample(tmp_path):
    radar = make_radar("real", n_chirps=2)
    # The last chirp of frame 4 begins at round(9 * 200.4 + 5) = 1809.
    codes = draw_iq(1809 + N)[0]

    assert open_recording(write_wav(tmp_path / "a.wav", codes), radar=radar).n_frames == 5
    assert open_recording(write_wav(tmp_path / "b.wav", codes[:-1]), radar=radar).n_frames == 4


@pytest.mark.parametrize(
    ("files", "radar", "message"),
    [
        ({"walk_I.wav": 1}, make_radar(), r"walk_I\.wav and walk_Q\.wav in one folder"),
        ({"walk.wav": 1}, make_radar(), r"walk_I\.wav and walk_Q\.wav in one folder"),
        ({"walk_I.wav": 1, "walk_Q.wav": 1}, make_radar("real"), "complex for I and Q"),
        ({"walk_I.wav": 1, "walk_Q.wav": 2}, make_radar(), "2 channels"),
        ({"walk.wav": 1}, make_radar("real", n_chirps=300), "at least 600"),
    ],
)
def test_recording_that_contradicts_settings_names_the_fix(tmp_path, files, radar, message):
    i_codes, q_codes = draw_iq()
    for name, n_channels in files.items():
        write_wav(tmp_path / name, *(i_codes, q_codes)[:n_channels])

    with pytest.raises(RecordingError, match=message):
        open_recording(tmp_path / next(iter(files)), radar=radar)


def test_files_of_other_rates_are_refused(tmp_path):
    codes = draw_iq()[0]
    write_wav(tmp_path / "walk_I.wav", codes)
    write_wav(tmp_path / "walk_Q.wav", codes, rate=44_100)

    with pytest.raises(RecordingError, match=r"walk_Q\.wav.*44\.1 kHz.*8 kHz"):
        open_recording(tmp_path / "walk_I.wav", radar=make_radar())
    with pytest.raises(RecordingError, match=r"44\.1 kHz"):
        open_recording(tmp_path / "walk_Q.wav", radar=make_radar())


@given(st.binary(max_size=300), st.integers(0, 2000), st.integers(0, 1))
@settings(max_examples=n_examples(150), deadline=None)
def test_mutated_bytes_decode_or_raise_recording_error(tmp_path_factory, junk, position, which):
    folder = tmp_path_factory.mktemp("wav")
    names = ("walk_I.wav", "walk_Q.wav")
    for name, codes in zip(names, draw_iq(2000), strict=True):
        write_wav(folder / name, codes)
    content = bytearray((folder / names[which]).read_bytes())
    content[position : position + len(junk)] = junk
    (folder / names[which]).write_bytes(content[: 4000 - len(junk)])
    hints = RecordingHints(settings=RecordingSettings(radar=make_radar(n_chirps=2)))
    try:
        contents = ContinuousWav().read(folder / names[0], hints)
        out = np.empty((2, 1, N), np.complex64)
        contents.decode(contents.n_frames - 1, out)
    except RecordingError:
        return
    assert np.isfinite(out).all()


def test_other_sample_rate_than_in_settings_is_refused(tmp_path):
    file = write_wav(tmp_path / "beat.wav", draw_iq()[0])
    radar = make_radar("real")
    chirp = replace(radar.frame.chirp, sample_rate_hz=44_100.0)

    with pytest.raises(RecordingError, match="samples at 8 kHz"):
        open_recording(file, radar=replace(radar, frame=replace(radar.frame, chirp=chirp)))


def test_pair_without_settings_gets_an_example_of_complex_samples(tmp_path):
    for letter in "IQ":
        write_wav(tmp_path / f"walk_{letter}.wav", draw_iq()[0])

    with pytest.raises(RecordingError, match=r"sampling: complex.*radar\.yaml"):
        open_recording(tmp_path / "walk_I.wav")
