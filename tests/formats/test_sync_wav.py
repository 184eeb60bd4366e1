"""WAV recordings of a beat signal and its sync: ramps, polarity, gaps, damaged files."""

import struct
import wave

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import MatchQuality, RecordingHints
from dechirp.recordings.readers.sync_wav import SyncWav
from dechirp.recordings.settings.base import RecordingSettings

LIGHT = 299_792_458.0
RATE = 8000
PERIOD = 200.4  # samples: no whole number, as in real recordings
SLOPE = 100e6 * RATE / 90  # 1.5 m a bin for 90 samples


def told(n_chirps=10, *, n_samples=90, interval_s=PERIOD / RATE, **more):
    chirp = Chirp(
        start_frequency_hz=2.4e9,
        slope_hz_per_s=SLOPE,
        adc_start_s=more.pop("adc_start_s", 0.0),
        ramp_duration_s=more.pop("ramp_s", PERIOD / 2 / RATE),
        sample_rate_hz=more.pop("rate_hz", RATE),
        n_samples=n_samples,
        sampling=more.pop("sampling", "real"),
    )
    array = Array(rx_m=tuple((0.0, 0.01 * n, 0.0) for n in range(more.pop("n_rx", 1))))
    period_s = more.pop("period_s", None)
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s, period_s=period_s)
    return RecordingHints(settings=RecordingSettings(radar=Radar(frame=frame, array=array)), **more)


def heard(n_ramps=20.0, *, up_m=15.0, down_m=30.0, amplitude=0.5, begin=0.6):
    """Beat signal and sync, within -1 to 1; a target seems elsewhere in down-ramps."""
    n = np.arange(round(n_ramps * PERIOD))
    since = (n / PERIOD + begin) % 1
    up = since < 0.5
    ramp_s = np.where(up, since, since - 0.5) * PERIOD / RATE
    beat_hz = 2 * SLOPE * np.where(up, up_m, down_m) / LIGHT
    return np.stack([amplitude * np.cos(2 * np.pi * beat_hz * ramp_s), np.where(up, 0.8, -0.8)])


def pcm(sound, n_bytes=2):
    """Whole numbers of a WAV file, (sample, channel)."""
    codes = np.round(sound.T * (2 ** (8 * n_bytes - 1) - 1)).astype(np.int64)
    return codes + 128 if n_bytes == 1 else codes


def save(file, sound, n_bytes=2, rate=RATE):
    with wave.open(str(file), "wb") as out:
        out.setnchannels(len(sound))
        out.setsampwidth(n_bytes)
        out.setframerate(rate)
        raw = pcm(sound, n_bytes).astype("<i8").reshape(-1, 1).view(np.uint8)
        out.writeframes(raw[:, :n_bytes].tobytes())
    return file


def decoded(file, what=None):
    contents = SyncWav().read(file, what or told())
    frame = contents.radar.frame
    frames = np.empty(
        (contents.n_frames, frame.n_chirps_total, 1, frame.chirp.n_samples), np.float32
    )
    for index, out in enumerate(frames):
        contents.decode(index, out)
    return contents, frames


def peak_m(contents, frames):
    power = np.sum(abs(np.fft.rfft(frames * np.hanning(90), 1024)) ** 2, axis=(0, 1, 2))
    return contents.radar.frame.chirp.range_bins_m(1024)[np.argmax(power)]


def warnings(contents):
    return [finding.setting for finding in contents.findings if finding.level == "warning"]


def test_up_ramps_are_read_of_a_card_that_inverts_and_down_ramps_as_if_it_did_not(tmp_path):
    file = save(tmp_path / "car.wav", -heard())

    up, of_up = decoded(file)
    down, of_down = decoded(file, told(encoding="upright"))

    # A bin is 1.5 m wide.
    assert peak_m(up, of_up) == pytest.approx(15.0, abs=0.3)
    assert peak_m(down, of_down) == pytest.approx(30.0, abs=0.3)
    assert "inverted" in " ".join(f.value for f in up.findings if f.setting == "encoding")
    assert warnings(up) == warnings(down) == []


def test_chirps_begin_where_the_sync_rises(tmp_path):
    sound = heard(21)
    file = save(tmp_path / "car.wav", sound)

    _, frames = decoded(file, told(encoding="upright"))

    rises = np.flatnonzero((sound[1, :-1] < 0) & (sound[1, 1:] > 0)) + 1
    expected = np.stack([sound[0, at : at + 90] for at in rises[:20]])
    assert np.allclose(frames.reshape(20, 90), expected, atol=1e-4)  # 16 bits
    _, later = decoded(file, told(encoding="upright", adc_start_s=5 / RATE))
    expected = np.stack([sound[0, at + 5 : at + 95] for at in rises[:20]])
    assert np.allclose(later.reshape(20, 90), expected, atol=1e-4)


def test_every_width_of_samples_gives_the_same_signal(tmp_path):
    sound = heard()
    reference = decoded(save(tmp_path / "4.wav", sound, 4), told(encoding="upright"))[1]
    for n_bytes in (1, 2, 3):
        file = save(tmp_path / f"{n_bytes}.wav", sound, n_bytes)
        frames = decoded(file, told(encoding="upright"))[1]
        assert np.allclose(frames, reference, atol=1.1 / 2 ** (8 * n_bytes - 1))
    for kind, n_bytes in (("<f4", 4), ("<f8", 8)):
        for form in (struct.pack("<HHIIHH", 3, 2, RATE, 0, 2 * n_bytes, 8 * n_bytes),):
            extended = struct.pack("<H", 0xFFFE) + form[2:] + bytes(8) + b"\3" + bytes(15)
            for head in (form, extended):
                data = sound.T.astype(kind).tobytes()
                (tmp_path / "f.wav").write_bytes(riff((b"fmt ", head), (b"data", data)))
                frames = decoded(tmp_path / "f.wav", told(encoding="upright"))[1]
                assert np.allclose(frames, reference, atol=1e-6)


def riff(*chunks, name=b"RIFF", sizes=None):
    """A WAV file made by hand; `sizes` are what the headers of the chunks say."""
    body = b"WAVE"
    for n, (kind, content) in enumerate(chunks):
        size = len(content) if sizes is None or sizes[n] is None else sizes[n]
        body += kind + struct.pack("<I", size) + content + b"\0" * (len(content) % 2)
    return name + struct.pack("<I", len(body)) + body


FORM = struct.pack("<HHIIHH", 1, 2, RATE, 4 * RATE, 4, 16)
DATA = pcm(-heard()).astype("<i2").tobytes()


@pytest.mark.parametrize(
    "content",
    [
        riff((b"fmt ", FORM), (b"data", DATA), sizes=[None, 0]),
        riff((b"fmt ", FORM), (b"data", DATA), sizes=[None, 0xFFFFFFFF]),
        riff((b"fmt ", FORM), (b"LIST", b"odd"), (b"data", DATA), sizes=[None, None, 10**7]),
    ],
)
def test_a_recorder_that_was_cut_off_leaves_all_its_samples(tmp_path, content):
    (tmp_path / "car.wav").write_bytes(content)

    contents, frames = decoded(tmp_path / "car.wav")

    whole = decoded(save(tmp_path / "whole.wav", -heard()))[1]
    assert np.array_equal(frames, whole)
    assert warnings(contents) == ["recording"]


def test_a_file_of_more_than_4_gb_says_its_size_elsewhere(tmp_path):
    sizes = struct.pack("<QQQI", 0, len(DATA), len(DATA) // 4, 0)
    chunks = (b"ds64", sizes), (b"fmt ", FORM), (b"data", DATA + b"\0" * 100)
    content = riff(*chunks, name=b"RF64", sizes=[None, None, 0xFFFFFFFF])
    (tmp_path / "car.wav").write_bytes(content)

    contents, frames = decoded(tmp_path / "car.wav")

    assert np.array_equal(frames, decoded(save(tmp_path / "whole.wav", -heard()))[1])
    assert warnings(contents) == []


def test_noise_less_than_half_of_the_sync_makes_no_ramps(tmp_path):
    quiet = -heard(41)
    noisy = quiet.copy()
    noisy[1] += np.random.default_rng(5).uniform(-0.18, 0.18, noisy.shape[1])
    expected = decoded(save(tmp_path / "quiet.wav", quiet))[1]

    contents, frames = decoded(save(tmp_path / "noisy.wav", noisy))

    assert np.array_equal(frames, expected)
    assert warnings(contents) == []


def test_missing_sync_leaves_marked_gaps_and_the_rest_in_its_place(tmp_path):
    sound = -heard(41)
    whole = decoded(save(tmp_path / "whole.wav", sound))[1].reshape(40, 90)
    first = round((12 + 0.4) * PERIOD)  # the recording begins 0.6 into a period
    sound[1, first - 20 : first + round(2.2 * PERIOD)] = 0.8  # low for three ramps

    contents, frames = decoded(save(tmp_path / "gap.wav", sound))

    lost = np.zeros(40, bool)
    lost[12:15] = True
    assert np.array_equal(contents.gaps.reshape(40), lost)
    frames = frames.reshape(40, 90)
    assert not frames[lost].any()
    assert np.array_equal(frames[~lost], whole[~lost])
    (warning,) = [finding for finding in contents.findings if finding.level == "warning"]
    assert "3 ramps missing" in warning.value
    assert "the longest interval, 0.1003 s, begins 0.2856 s after the start" in warning.value


def test_a_ramp_cut_by_a_dropout_of_the_sync_is_a_gap(tmp_path):
    sound = -heard(21)
    middle = round((5 + 0.4) * PERIOD) + 40
    sound[1, middle : middle + 10] = 0.8

    contents, frames = decoded(save(tmp_path / "gap.wav", sound))

    assert np.flatnonzero(contents.gaps.reshape(20)).tolist() == [5]
    assert not frames[0, 5].any()
    assert "pulses too short 2 times" in " ".join(f.value for f in contents.findings)


def test_blocks_of_a_long_recording_fit_together(tmp_path):
    n_ramps = 5300  # 1.06 million samples: five blocks, levels from a part of them
    sound = -heard(n_ramps)
    file = save(tmp_path / "long.wav", sound, n_bytes=1)

    contents, frames = decoded(file, told(100))

    assert frames.shape[0] == 53
    assert contents.gaps is None
    assert warnings(contents) == []
    assert peak_m(contents, frames) == pytest.approx(15.0, abs=0.3)
    short = decoded(save(tmp_path / "short.wav", sound[:, -30_000:], n_bytes=1), told(50))[1]
    assert abs(np.fft.rfft(frames[-1].mean(0)[0])).argmax() == 10
    assert np.allclose(short.mean((0, 1)), frames.mean((0, 1)), atol=0.02)


@pytest.mark.parametrize(("interval_s", "warned"), [(1.005, 0), (0.98, 1), (1.02, 1)])
def test_the_interval_of_the_sync_is_held_against_the_settings(tmp_path, interval_s, warned):
    file = save(tmp_path / "car.wav", -heard())

    contents, _ = decoded(file, told(n_samples=80, interval_s=interval_s * PERIOD / RATE))

    said = [f for f in contents.findings if f.setting == "radar.frame.interval"]
    assert len(said) == warned
    assert all("but 0.0250" in finding.value for finding in said)


def test_chirps_that_fill_no_frame_and_a_period_with_pauses_are_pointed_out(tmp_path):
    file = save(tmp_path / "car.wav", -heard(26))

    contents, frames = decoded(file, told(period_s=1.0))

    assert frames.shape[0] == 2
    assert contents.radar.frame.period_s is None
    assert "6 chirps that are left out" in " ".join(f.value for f in contents.findings)
    assert warnings(contents) == ["radar.frame.period"]


STILL = -heard()
STILL[1] = 0.3


@pytest.mark.parametrize(
    ("sound", "what", "named"),
    [
        (-heard(), told(rate_hz=16000.0), "sampled at 8000 Hz"),
        (-heard()[:1], told(), "1 channels"),
        (-heard(), told(adc_start_s=2e-3, ramp_s=14e-3), "is high 20 times, for 100"),
        (STILL, told(), "stays at -0.3"),
        (-heard(), told(21), "20 chirps"),
        (-heard(), told(sampling="complex"), "complex samples"),
        (-heard(), told(n_rx=2), "of 2 receivers"),
    ],
)
def test_a_recording_that_is_not_that_of_the_radar_is_refused(tmp_path, sound, what, named):
    with pytest.raises(RecordingError) as error:
        decoded(save(tmp_path / "car.wav", sound), what)

    assert named in error.value.mistakes[0].value


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"RIFF", "without its signature"),
        (riff(), "without samples"),
        (riff(*[(b"junk", b"")] * 2000, (b"data", DATA)), "without samples"),
        (riff((b"data", DATA), (b"fmt ", FORM)), "before their format"),
        (riff((b"fmt ", FORM[:10]), (b"data", DATA)), "before their format"),
        (riff((b"fmt ", FORM), (b"data", b"")), "with 0 bytes of samples"),
        (riff((b"fmt ", b"\x55\0" + FORM[2:]), (b"data", DATA)), "in encoding 85"),
        (riff((b"fmt ", FORM[:14] + b"\x0c\0"), (b"data", DATA)), "of 12 bits"),
        (riff((b"fmt ", FORM[:2] + b"\0\0" + FORM[4:]), (b"data", DATA)), "of 0 channels"),
    ],
)
def test_a_damaged_header_is_refused(tmp_path, content, named):
    (tmp_path / "car.wav").write_bytes(content)

    with pytest.raises(RecordingError) as error:
        decoded(tmp_path / "car.wav")

    assert named in error.value.mistakes[0].value


def test_samples_that_are_not_finite_are_refused(tmp_path):
    sound = -heard().astype("<f4")
    sound[0, 1130] = np.nan  # within a ramp
    form = struct.pack("<HHIIHH", 3, 2, RATE, 8 * RATE, 8, 32)
    content = riff((b"fmt ", form), (b"data", sound.T.tobytes()))
    (tmp_path / "car.wav").write_bytes(content)

    with pytest.raises(RecordingError, match="non-finite samples in chirp 5 of frame 0"):
        decoded(tmp_path / "car.wav")


def test_a_file_is_known_by_its_first_bytes(tmp_path):
    assert SyncWav().recognise(save(tmp_path / "car", heard())) == MatchQuality.CONTAINER
    (tmp_path / "film.avi").write_bytes(b"RIFF\0\0\0\0AVI ")
    assert SyncWav().recognise(tmp_path / "film.avi") == MatchQuality.NO
    assert SyncWav().recognise(tmp_path) == MatchQuality.NO


@settings(max_examples=150)
@given(st.data())
def test_no_bytes_do_anything_but_decode_or_be_refused(tmp_path_factory, data):
    form = data.draw(st.sampled_from([FORM, struct.pack("<HHIIHH", 3, 2, RATE, 0, 8, 32)]))
    content = bytearray(riff((b"fmt ", form), (b"data", DATA)))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, 60) | st.integers(0, len(content)))
        gone = data.draw(st.integers(0, 5000))
        content[at : at + gone] = data.draw(st.binary(max_size=8))
    file = tmp_path_factory.mktemp("fuzz") / "car.wav"
    file.write_bytes(content)
    try:
        contents, frames = decoded(file, told(2))
    except RecordingError:
        return
    assert np.isfinite(frames).all()
    assert contents.gaps is None or contents.gaps.shape == frames.shape[:2]
