"""WAV recordings of a beat signal and its sync: ramps, polarity, gaps, damaged files."""

import re
import struct
import wave
from uuid import UUID

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import MatchQuality, RecordingHints
from dechirp.recordings.readers.sync_wav import SyncWav
from dechirp.recordings.settings.base import RecordingSettings
from nightly import n_examples

SPEED_OF_LIGHT = 299_792_458.0
RATE = 8000
PERIOD = 200.4  # samples; fractional, as in real recordings
FLOAT_SUBTYPE = UUID("00000003-0000-0010-8000-00aa00389b71")  # of WAVE_FORMAT_EXTENSIBLE
SLOPE = 100e6 * RATE / 90  # 1.5 m per range bin with 90 samples


def make_hints(n_chirps=10, *, n_samples=90, interval_s=PERIOD / RATE, **options):
    chirp = Chirp(
        start_frequency_hz=2.4e9,
        slope_hz_per_s=SLOPE,
        adc_start_s=options.pop("adc_start_s", 0.0),
        ramp_duration_s=options.pop("ramp_s", PERIOD / 2 / RATE),
        sample_rate_hz=options.pop("rate_hz", RATE),
        n_samples=n_samples,
        sampling=options.pop("sampling", "real"),
    )
    array = Array(rx_m=tuple((0.0, 0.01 * n, 0.0) for n in range(options.pop("n_rx", 1))))
    period_s = options.pop("period_s", None)
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s, period_s=period_s)
    return RecordingHints(
        settings=RecordingSettings(radar=Radar(frame=frame, array=array)), **options
    )


def simulate_channels(n_ramps=20.0, *, up_m=15.0, down_m=30.0, amplitude=0.5, begin=0.6):
    """Simulate beat signal and sync within -1 to 1; up- and down-ramps differ in range."""
    n = np.arange(round(n_ramps * PERIOD))
    phase = (n / PERIOD + begin) % 1
    up = phase < 0.5
    ramp_s = np.where(up, phase, phase - 0.5) * PERIOD / RATE
    beat_hz = 2 * SLOPE * np.where(up, up_m, down_m) / SPEED_OF_LIGHT
    return np.stack([amplitude * np.cos(2 * np.pi * beat_hz * ramp_s), np.where(up, 0.8, -0.8)])


def encode_pcm(channels, n_bytes=2):
    """Convert channels to the integers of a WAV file, (sample, channel)."""
    codes = np.round(channels.T * (2 ** (8 * n_bytes - 1) - 1)).astype(np.int64)
    return codes + 128 if n_bytes == 1 else codes


def write_wav(path, channels, n_bytes=2, rate=RATE):
    with wave.open(str(path), "wb") as out:
        out.setnchannels(len(channels))
        out.setsampwidth(n_bytes)
        out.setframerate(rate)
        raw = encode_pcm(channels, n_bytes).astype("<i8").reshape(-1, 1).view(np.uint8)
        out.writeframes(raw[:, :n_bytes].tobytes())
    return path


def decode_file(file, hints=None):
    contents = SyncWav().read(file, hints or make_hints())
    frame = contents.radar.frame
    frames = np.empty(
        (contents.n_frames, frame.n_chirps_total, 1, frame.chirp.n_samples), np.float32
    )
    for index, out in enumerate(frames):
        contents.decode(index, out)
    return contents, frames


def find_peak_m(contents, frames):
    power = np.sum(abs(np.fft.rfft(frames * np.hanning(90), 1024)) ** 2, axis=(0, 1, 2))
    return contents.radar.frame.chirp.range_bins_m(1024)[np.argmax(power)]


def list_warnings(contents):
    return [finding.setting for finding in contents.findings if finding.level == "warning"]


def test_reads_up_ramps_unless_encoding_is_upright(tmp_path):
    file = write_wav(tmp_path / "car.wav", -simulate_channels())

    up_contents, up_frames = decode_file(file)
    down_contents, down_frames = decode_file(file, make_hints(encoding="upright"))

    # A bin is 1.5 m wide.
    assert find_peak_m(up_contents, up_frames) == pytest.approx(15.0, abs=0.3)
    assert find_peak_m(down_contents, down_frames) == pytest.approx(30.0, abs=0.3)
    assert "inverted" in " ".join(f.value for f in up_contents.findings if f.setting == "encoding")
    assert list_warnings(up_contents) == list_warnings(down_contents) == []


def test_chirps_start_at_rising_sync_edges(tmp_path):
    channels = simulate_channels(21)
    file = write_wav(tmp_path / "car.wav", channels)

    _, frames = decode_file(file, make_hints(encoding="upright"))

    rises = np.flatnonzero((channels[1, :-1] < 0) & (channels[1, 1:] > 0)) + 1
    expected = np.stack([channels[0, start : start + 90] for start in rises[:20]])
    assert np.allclose(frames.reshape(20, 90), expected, atol=1e-4)  # 16 bits
    _, delayed_frames = decode_file(file, make_hints(encoding="upright", adc_start_s=5 / RATE))
    expected = np.stack([channels[0, start + 5 : start + 95] for start in rises[:20]])
    assert np.allclose(delayed_frames.reshape(20, 90), expected, atol=1e-4)


@pytest.mark.parametrize(
    "beat",
    ["tone", "silence", "noise"],
)
def test_sync_is_found_in_either_channel(tmp_path, beat):
    channels = -simulate_channels(40)
    if beat == "silence":
        channels[0] = 0.0
    elif beat == "noise":
        channels[0] = np.random.default_rng(3).normal(0, 0.2, channels.shape[1]).clip(-1, 1)
    expected = decode_file(write_wav(tmp_path / "beat_first.wav", channels))

    contents, frames = decode_file(write_wav(tmp_path / "sync_first.wav", channels[::-1]))

    assert np.array_equal(frames, expected[1])
    (note,) = set(contents.findings) - set(expected[0].findings)
    assert "the sync is in channel 1" in note.value
    assert list_warnings(contents) == []


def test_every_sample_width_gives_equal_signal(tmp_path):
    channels = simulate_channels()
    reference = decode_file(
        write_wav(tmp_path / "4.wav", channels, 4), make_hints(encoding="upright")
    )[1]
    for n_bytes in (1, 2, 3):
        file = write_wav(tmp_path / f"{n_bytes}.wav", channels, n_bytes)
        frames = decode_file(file, make_hints(encoding="upright"))[1]
        assert np.allclose(frames, reference, atol=1.1 / 2 ** (8 * n_bytes - 1))
    for kind, n_bytes in (("<f4", 4), ("<f8", 8)):
        for format_chunk in (struct.pack("<HHIIHH", 3, 2, RATE, 0, 2 * n_bytes, 8 * n_bytes),):
            extended_chunk = (
                struct.pack("<H", 0xFFFE)
                + format_chunk[2:]
                + struct.pack("<HHI", 22, 8 * n_bytes, 3)
                + FLOAT_SUBTYPE.bytes_le
            )
            for chunk in (format_chunk, extended_chunk):
                data = channels.T.astype(kind).tobytes()
                (tmp_path / "f.wav").write_bytes(encode_riff((b"fmt ", chunk), (b"data", data)))
                frames = decode_file(tmp_path / "f.wav", make_hints(encoding="upright"))[1]
                assert np.allclose(frames, reference, atol=1e-6)


def test_twelve_bits_in_sixteen_are_read(tmp_path):
    content = encode_riff((b"fmt ", FORMAT_CHUNK[:14] + b"\x0c\0"), (b"data", SAMPLE_BYTES))
    (tmp_path / "car.wav").write_bytes(content)

    frames = decode_file(tmp_path / "car.wav")[1]

    expected = decode_file(write_wav(tmp_path / "whole.wav", -simulate_channels()))[1]
    assert np.array_equal(frames, expected)


def encode_riff(*chunks, name=b"RIFF", sizes=None):
    """Encode a WAV file; `sizes` replace the sizes in the chunk headers."""
    body = b"WAVE"
    for n, (kind, content) in enumerate(chunks):
        size = len(content) if sizes is None or sizes[n] is None else sizes[n]
        body += kind + struct.pack("<I", size) + content + b"\0" * (len(content) % 2)
    return name + struct.pack("<I", len(body)) + body


FORMAT_CHUNK = struct.pack("<HHIIHH", 1, 2, RATE, 4 * RATE, 4, 16)
SAMPLE_BYTES = encode_pcm(-simulate_channels()).astype("<i2").tobytes()


@pytest.mark.parametrize(
    "content",
    [
        encode_riff((b"fmt ", FORMAT_CHUNK), (b"data", SAMPLE_BYTES), sizes=[None, 0]),
        encode_riff((b"fmt ", FORMAT_CHUNK), (b"data", SAMPLE_BYTES), sizes=[None, 0xFFFFFFFF]),
        encode_riff(
            (b"fmt ", FORMAT_CHUNK),
            (b"LIST", b"odd"),
            (b"data", SAMPLE_BYTES),
            sizes=[None, None, 10**7],
        ),
    ],
)
def test_interrupted_recording_keeps_all_samples(tmp_path, content):
    (tmp_path / "car.wav").write_bytes(content)

    contents, frames = decode_file(tmp_path / "car.wav")

    expected = decode_file(write_wav(tmp_path / "whole.wav", -simulate_channels()))[1]
    assert np.array_equal(frames, expected)
    assert list_warnings(contents) == ["recording"]


def test_rf64_size_is_read_from_ds64_chunk(tmp_path):
    sizes = struct.pack("<QQQI", 0, len(SAMPLE_BYTES), len(SAMPLE_BYTES) // 4, 0)
    chunks = (b"ds64", sizes), (b"fmt ", FORMAT_CHUNK), (b"data", SAMPLE_BYTES + b"\0" * 100)
    content = encode_riff(*chunks, name=b"RF64", sizes=[None, None, 0xFFFFFFFF])
    (tmp_path / "car.wav").write_bytes(content)

    contents, frames = decode_file(tmp_path / "car.wav")

    assert np.array_equal(
        frames, decode_file(write_wav(tmp_path / "whole.wav", -simulate_channels()))[1]
    )
    assert list_warnings(contents) == []


def test_sync_noise_below_half_amplitude_adds_no_ramps(tmp_path):
    quiet = -simulate_channels(41)
    noisy = quiet.copy()
    noisy[1] += np.random.default_rng(5).uniform(-0.18, 0.18, noisy.shape[1])
    expected = decode_file(write_wav(tmp_path / "quiet.wav", quiet))[1]

    contents, frames = decode_file(write_wav(tmp_path / "noisy.wav", noisy))

    assert np.array_equal(frames, expected)
    assert list_warnings(contents) == []


def test_missing_sync_gives_gaps_at_lost_ramps_only(tmp_path):
    channels = -simulate_channels(41)
    expected = decode_file(write_wav(tmp_path / "whole.wav", channels))[1].reshape(40, 90)
    first = round((12 + 0.4) * PERIOD)  # the recording starts at 0.6 of a period
    channels[1, first - 20 : first + round(2.2 * PERIOD)] = 0.8  # sync low for three ramps

    contents, frames = decode_file(write_wav(tmp_path / "gap.wav", channels))

    gaps = np.zeros(40, bool)
    gaps[12:15] = True
    assert np.array_equal(contents.gaps.reshape(40), gaps)
    frames = frames.reshape(40, 90)
    assert not frames[gaps].any()
    assert np.array_equal(frames[~gaps], expected[~gaps])
    (warning,) = [finding for finding in contents.findings if finding.level == "warning"]
    assert "3 ramps missing" in warning.value
    assert "the longest interval, 100.2 ms, begins 285.6 ms after the start" in warning.value


def test_ramp_with_sync_dropout_is_gap(tmp_path):
    channels = -simulate_channels(21)
    middle = round((5 + 0.4) * PERIOD) + 40
    channels[1, middle : middle + 10] = 0.8

    contents, frames = decode_file(write_wav(tmp_path / "gap.wav", channels))

    assert np.flatnonzero(contents.gaps.reshape(20)).tolist() == [5]
    assert not frames[0, 5].any()
    assert "pulses too short 2 times" in " ".join(f.value for f in contents.findings)


def test_long_recording_is_continuous_across_blocks(tmp_path):
    n_ramps = 5300  # 1.06 million samples: five blocks
    channels = -simulate_channels(n_ramps)
    file = write_wav(tmp_path / "long.wav", channels, n_bytes=1)

    contents, frames = decode_file(file, make_hints(100))

    assert frames.shape[0] == 53
    assert contents.gaps is None
    assert list_warnings(contents) == []
    assert find_peak_m(contents, frames) == pytest.approx(15.0, abs=0.3)
    short_frames = decode_file(
        write_wav(tmp_path / "short.wav", channels[:, -30_000:], n_bytes=1), make_hints(50)
    )[1]
    assert abs(np.fft.rfft(frames[-1].mean(0)[0])).argmax() == 10
    assert np.allclose(short_frames.mean((0, 1)), frames.mean((0, 1)), atol=0.02)


@pytest.mark.parametrize(("interval_s", "n_findings"), [(1.005, 0), (0.98, 1), (1.02, 1)])
def test_sync_interval_is_compared_with_settings(tmp_path, interval_s, n_findings):
    file = write_wav(tmp_path / "car.wav", -simulate_channels())

    contents, _ = decode_file(file, make_hints(n_samples=80, interval_s=interval_s * PERIOD / RATE))

    findings = [f for f in contents.findings if f.setting == "radar.frame.interval"]
    assert len(findings) == n_findings
    assert all("but 25" in finding.value for finding in findings)


def test_incomplete_frame_and_frame_period_give_findings(tmp_path):
    file = write_wav(tmp_path / "car.wav", -simulate_channels(26))

    contents, frames = decode_file(file, make_hints(period_s=1.0))

    assert frames.shape[0] == 2
    assert contents.radar.frame.period_s is None
    assert "6 chirps that are left out" in " ".join(f.value for f in contents.findings)
    assert list_warnings(contents) == ["radar.frame.period"]


CONSTANT_SYNC = -simulate_channels()
CONSTANT_SYNC[1] = 0.3


@pytest.mark.parametrize(
    ("channels", "hints", "message"),
    [
        (-simulate_channels(), make_hints(rate_hz=16000.0), "sampled at 8 kHz"),
        (-simulate_channels()[:1], make_hints(), "1 channels"),
        (
            -simulate_channels(),
            make_hints(adc_start_s=2e-3, ramp_s=14e-3),
            "is high 20 times, for 100",
        ),
        (CONSTANT_SYNC, make_hints(), "stays at -0.3"),
        (-simulate_channels(), make_hints(21), "20 chirps"),
        (-simulate_channels(), make_hints(sampling="complex"), "complex samples"),
        (-simulate_channels(), make_hints(n_rx=2), "of 2 receivers"),
    ],
)
def test_rejects_recording_that_contradicts_radar(tmp_path, channels, hints, message):
    with pytest.raises(RecordingError) as error:
        decode_file(write_wav(tmp_path / "car.wav", channels), hints)

    assert message in error.value.mistakes[0].value


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"RIFF", "Format not recognised"),
        (encode_riff(), "No 'data' chunk"),
        (encode_riff(*[(b"junk", b"")] * 2000, (b"data", SAMPLE_BYTES)), "No 'data' chunk"),
        (encode_riff((b"data", SAMPLE_BYTES), (b"fmt ", FORMAT_CHUNK)), "No 'data' chunk"),
        (encode_riff((b"fmt ", FORMAT_CHUNK[:10]), (b"data", SAMPLE_BYTES)), "Short 'fmt ' chunk"),
        (encode_riff((b"fmt ", FORMAT_CHUNK), (b"data", b"")), "0 bytes of samples"),
        (
            encode_riff((b"fmt ", b"\x55\0" + FORMAT_CHUNK[2:]), (b"data", SAMPLE_BYTES)),
            "Malformed 'fmt ' chunk",
        ),
        (
            encode_riff((b"fmt ", b"\7\0" + FORMAT_CHUNK[2:]), (b"data", SAMPLE_BYTES)),
            "samples of type ULAW",
        ),
        (
            encode_riff(
                (b"fmt ", FORMAT_CHUNK[:2] + b"\0\0" + FORMAT_CHUNK[4:]), (b"data", SAMPLE_BYTES)
            ),
            "Channel count is zero",
        ),
    ],
)
def test_rejects_damaged_header(tmp_path, content, message):
    (tmp_path / "car.wav").write_bytes(content)

    with pytest.raises(RecordingError) as error:
        decode_file(tmp_path / "car.wav")

    assert message in error.value.mistakes[0].value


def test_rejects_non_finite_samples(tmp_path):
    channels = -simulate_channels().astype("<f4")
    channels[0, 1130] = np.nan  # within a ramp
    format_chunk = struct.pack("<HHIIHH", 3, 2, RATE, 8 * RATE, 8, 32)
    content = encode_riff((b"fmt ", format_chunk), (b"data", channels.T.tobytes()))
    (tmp_path / "car.wav").write_bytes(content)

    with pytest.raises(RecordingError, match="non-finite samples in chirp 5 of frame 0"):
        decode_file(tmp_path / "car.wav")


def test_recognises_wav_by_first_bytes(tmp_path):
    assert (
        SyncWav().recognise(write_wav(tmp_path / "car", simulate_channels()))
        == MatchQuality.CONTAINER
    )
    (tmp_path / "film.avi").write_bytes(b"RIFF\0\0\0\0AVI ")
    assert SyncWav().recognise(tmp_path / "film.avi") == MatchQuality.NO
    assert SyncWav().recognise(tmp_path) == MatchQuality.NO


@settings(max_examples=n_examples(150))
@given(st.data())
def test_fuzzed_bytes_decode_or_raise_recording_error(tmp_path_factory, data):
    format_chunk = data.draw(
        st.sampled_from([FORMAT_CHUNK, struct.pack("<HHIIHH", 3, 2, RATE, 0, 8, 32)])
    )
    content = bytearray(encode_riff((b"fmt ", format_chunk), (b"data", SAMPLE_BYTES)))
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, 60) | st.integers(0, len(content)))
        n_removed = data.draw(st.integers(0, 5000))
        content[start : start + n_removed] = data.draw(st.binary(max_size=8))
    file = tmp_path_factory.mktemp("fuzz") / "car.wav"
    file.write_bytes(content)
    try:
        contents, frames = decode_file(file, make_hints(2))
    except RecordingError:
        return
    assert np.isfinite(frames).all()
    assert contents.gaps is None or contents.gaps.shape == frames.shape[:2]


def test_missing_settings_are_advised_with_the_times_of_the_sync(tmp_path):
    file = write_wav(tmp_path / "car.wav", -simulate_channels())

    with pytest.raises(RecordingError) as caught:
        dc.open(file)
    fix = caught.value.mistakes[0].fix
    command = re.search(r"echo '(.*)' > radar.yaml", fix)[1]
    (tmp_path / "radar.yaml").write_text(command)

    recording = dc.open(file)
    assert "sample_rate, n_samples, interval are of the recording" in fix
    assert list_warnings(recording.contents) == []  # joined chirps: a note on aliasing
    chirp = recording.radar.frame.chirp
    # The sync is high for a whole ramp; the settings of the other tests leave some samples out.
    assert chirp.sample_rate_hz == RATE and 90 <= chirp.n_samples <= 100
