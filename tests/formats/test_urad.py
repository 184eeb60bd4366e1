"""uRAD recordings (text): sawtooth and triangle, ranges and velocities, damaged lines."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers import urad
from dechirp.recordings.readers.base import MatchQuality, RecordingHints
from dechirp.recordings.readers.urad import Urad
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import RecordingSettings
from formats.corruption import decode_frames
from nightly import n_examples

SPEED_OF_LIGHT = 299_792_458.0
N, RATE, SLOPE, START, INTERVAL = 100, 200e3, 240e6 / 0.5e-3, 24.005e9, 1e-3


def make_hints(
    n_chirps=8, *, n_samples=N, sampling="complex", n_rx=1, interval_s=INTERVAL, **options
):
    chirp = Chirp(
        start_frequency_hz=START,
        slope_hz_per_s=SLOPE,
        ramp_duration_s=n_samples / RATE,
        sample_rate_hz=RATE,
        n_samples=n_samples,
        sampling=sampling,
    )
    array = Array(rx_m=tuple((0.0, 0.01 * n, 0.0) for n in range(n_rx)))
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s)
    return RecordingHints(
        settings=RecordingSettings(radar=Radar(frame=frame, array=array)), **options
    )


def simulate_beat(range_m, velocity_m_per_s, *, n_chirps, down=False):
    """Simulate samples Tx x conj(Rx) of a moving target, (chirp, sample).

    Down-ramps fall from the frequency at which up-ramps end.
    """
    t = np.arange(N) / RATE
    time_s = t + INTERVAL * np.arange(n_chirps)[:, None]
    delay_s = 2 * (range_m + velocity_m_per_s * time_s) / SPEED_OF_LIGHT
    first_hz, slope = (START + SLOPE * (N - 1) / RATE, -SLOPE) if down else (START, SLOPE)
    return np.exp(2j * np.pi * (first_hz * delay_s + slope * delay_s * t))


def format_lines(*ramps, times=False, amplitude=900.0, offset=1900):
    """Format lines as the vendor's example: I of all ramps, then Q of all, then the time."""
    text = []
    for n, chirps in enumerate(zip(*ramps, strict=True)):
        numbers = [round(amplitude * x.real) + offset for chirp in chirps for x in chirp]
        numbers += [round(amplitude * x.imag) + offset for chirp in chirps for x in chirp]
        words = [str(number) for number in numbers] + [f"{1.7e9 + n * INTERVAL:.3f}"] * times
        text.append(" ".join(words) + ("" if times else " ") + "\n")
    return "".join(text)


def read_contents(tmp_path, text, hints=None):
    file = tmp_path / "IQ.txt"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    contents = Urad().read(file, hints or make_hints())
    return contents, decode_frames(contents)


def find_peak(contents, frame):
    """Return range and velocity of the highest map peak, without range-Doppler correction."""
    radar = contents.radar.frame
    samples_without_dc = frame[:, 0] - frame.mean(axis=(0, 1, 2))
    window = np.hanning(radar.n_chirps)[:, None] * np.hanning(N)
    power = abs(np.fft.fftshift(np.fft.fft2(samples_without_dc * window, (1024, 4096)), axes=0))
    row, column = np.unravel_index(np.argmax(power[:, :2048]), (1024, 2048))
    return radar.chirp.range_bins_m(4096)[column], radar.velocity_bins_m_per_s(1024)[row]


def test_target_has_simulated_range_and_velocity(tmp_path):
    text = format_lines(simulate_beat(12.0, 1.0, n_chirps=32))

    contents, frames = read_contents(tmp_path, text, make_hints(32))

    # A bin is 0.62 m and 0.195 m/s wide, coupling 5 cm; 12 bits round by 5e-4.
    assert find_peak(contents, frames[0]) == pytest.approx((12.05, 1.0), abs=0.05)
    assert contents.iq == "iq"


def test_triangle_ramps_have_opposite_range_doppler_coupling(tmp_path):
    v = 2.5
    up, down = (simulate_beat(12.0, v, n_chirps=32, down=is_down) for is_down in (False, True))
    text = format_lines(up, down)

    peaks = {}
    for ramp in ("up", "down"):
        contents, frames = read_contents(tmp_path, text, make_hints(32, encoding=ramp))
        peaks[ramp] = find_peak(contents, frames[0])

    coupling_m = contents.radar.frame.chirp.range_doppler_coupling_m(v)  # 0.125 m
    mean_m = 12.0 + v * 31 / 2 * INTERVAL
    assert peaks["up"] == pytest.approx((mean_m + coupling_m, v), abs=0.03)
    assert peaks["down"] == pytest.approx((mean_m - coupling_m, v), abs=0.03)
    assert "opposite sign" in " ".join(finding.expected for finding in contents.findings)


def test_12_bit_codes_with_offset_span_full_scale(tmp_path):
    codes = np.random.default_rng(3).integers(0, 4096, (8, 2 * N))
    codes[0, 0], codes[0, N] = 0, 4095
    text = "\n".join(" ".join(map(str, row)) for row in codes)  # no newline at the end

    _, frames = read_contents(tmp_path, text)
    _, swapped = read_contents(tmp_path, text, make_hints(iq="qi"))

    assert frames[0, 0, 0, 0] == pytest.approx(-1 + 1j)
    expected = (codes[:, :N] + 1j * codes[:, N:]) / 4095 * 2 - (1 + 1j)
    assert np.allclose(frames[0, :, 0], expected, atol=3e-7, rtol=0)  # both parts in float32
    assert np.array_equal(swapped, 1j * frames.conj())


def test_echoes_at_negative_beat_frequencies_give_warning(tmp_path):
    text = format_lines(simulate_beat(12.0, 0.0, n_chirps=8).conj())

    contents, _ = read_contents(tmp_path, text)

    warnings = [finding.setting for finding in contents.findings if finding.level == "warning"]
    assert warnings == ["iq"]


@pytest.mark.parametrize(("interval_s", "n_findings"), [(1.005e-3, 0), (2e-3, 1)])
def test_file_times_are_compared_with_chirp_interval(tmp_path, interval_s, n_findings):
    text = format_lines(simulate_beat(12.0, 0.0, n_chirps=64), times=True)

    contents, frames = read_contents(tmp_path, text, make_hints(interval_s=interval_s))

    assert frames.shape == (8, 8, 1, N)
    findings = [f for f in contents.findings if f.setting == "radar.frame.interval"]
    assert len(findings) == n_findings
    # Displayed velocities are half of the true ones.
    assert all("true velocities 2" in finding.fix for finding in findings)


@pytest.mark.parametrize("start_s", [0.05, 0.95])
def test_times_in_whole_seconds_give_the_interval_between_their_changes(tmp_path, start_s):
    n_lines, interval_s = 200, 60e-3
    lines = format_lines(simulate_beat(12.0, 0.0, n_chirps=n_lines)).splitlines()
    seconds = [int(1.7e9 + start_s + n * interval_s) for n in range(n_lines)]
    text = "".join(f"{line}{second}\n" for line, second in zip(lines, seconds, strict=True))

    contents, _ = read_contents(tmp_path, text, RecordingHints())

    # The first and the last time would give 55.3 ms for the first start. Each change is late by
    # less than an interval: the mean is off by less than one of the 166 between the changes.
    measured_s = contents.radar.frame.single_interval_s
    assert measured_s == pytest.approx(interval_s, rel=1 / 166)


def test_truncated_line_and_incomplete_frame_are_dropped(tmp_path):
    text = format_lines(simulate_beat(12.0, 0.0, n_chirps=20))

    contents, frames = read_contents(tmp_path, text[:-300])

    assert frames.shape[0] == 2
    text_of_findings = " ".join(finding.value for finding in contents.findings)
    assert "in line 20, the last" in text_of_findings
    assert "3 chirps that are left out" in text_of_findings


def format_halves(*ramps, times=True):
    """Format I and Q of the ramps as the two files of the programs for the Raspberry Pi."""
    texts = []
    for part in ("real", "imag"):
        lines = []
        for n, chirps in enumerate(zip(*ramps, strict=True)):
            words = [f"{900 * getattr(x, part) + 1900:.0f}" for chirp in chirps for x in chirp]
            lines.append(" ".join(words + [f"{1.7e9 + n * INTERVAL:.3f}"] * times) + "\n")
        texts.append("".join(lines))
    return texts


def write_halves(folder, i_text, q_text, names=("I_yard.txt", "Q_yard.txt")):
    for name, text in zip(names, (i_text, q_text), strict=True):
        (folder / name).write_text(text)
    return folder / names[0], folder / names[1]


@pytest.mark.parametrize("names", [("I_yard.txt", "Q_yard.txt"), ("yard-i.txt", "yard-q.txt"),
                                   ("I.txt", "Q.txt"), ("I", "Q")])  # fmt: skip
@pytest.mark.parametrize("n_ramps", [1, 2])
def test_i_and_q_files_equal_the_joint_file(tmp_path, names, n_ramps):
    ramps = [simulate_beat(12.0, 1.0, n_chirps=8), simulate_beat(12.0, 1.0, n_chirps=8, down=True)]
    _, expected = read_contents(tmp_path, format_lines(*ramps[:n_ramps], times=True))

    files = write_halves(tmp_path, *format_halves(*ramps[:n_ramps]), names)

    for file in files:
        assert Urad().recognise(file) == MatchQuality.CONTAINER
        assert np.array_equal(decode_frames(Urad().read(file, make_hints())), expected)


def test_one_half_without_the_other_is_refused(tmp_path):
    i_file, q_file = write_halves(tmp_path, *format_halves(simulate_beat(12.0, 0.0, n_chirps=8)))
    q_file.unlink()

    with pytest.raises(RecordingError, match="one half of an I/Q pair: Q_yard.txt is missing"):
        open_recording(i_file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("17000000", "17000001"), "of the first lines"),
        (lambda text: "".join(text.splitlines(keepends=True)[:5]), "8 and 5 lines"),
        (lambda text: "".join(f"12 {line}" for line in text.splitlines(True)), "100 and 101"),
        (lambda _: "", "0 numbers in line 1"),
    ],
)
def test_refuses_halves_of_different_recordings(tmp_path, change, message):
    i_text, q_text = format_halves(simulate_beat(12.0, 0.0, n_chirps=8))
    i_file, _ = write_halves(tmp_path, i_text, change(q_text))

    with pytest.raises(RecordingError, match=message):
        Urad().read(i_file, make_hints())


def test_half_that_stopped_a_line_earlier_ends_the_recording(tmp_path):
    i_text, q_text = format_halves(simulate_beat(12.0, 0.0, n_chirps=9))
    i_file, _ = write_halves(tmp_path, i_text, q_text[:-200])

    assert Urad().read(i_file, make_hints()).n_frames == 1


VALID_TEXT = format_lines(simulate_beat(12.0, 0.0, n_chirps=8), times=True)


@pytest.mark.parametrize(
    "text",
    [
        VALID_TEXT,
        VALID_TEXT.replace(" ", ", "),
        VALID_TEXT.replace(" ", "\t"),
        re.sub(r"\b(\d{3})(?= )", r"0\1", VALID_TEXT),
    ],
)
def test_only_the_first_line_is_checked_word_by_word(tmp_path, monkeypatch, text):
    n_checked = 0

    def count_word(word):
        nonlocal n_checked
        n_checked += 1
        return is_code(word)

    is_code = urad._is_code
    monkeypatch.setattr(urad, "_is_code", count_word)
    read_contents(tmp_path, text)

    assert n_checked == 2 * N


def test_lines_are_parsed_at_once_only_if_all_numbers_are_codes():
    """Every byte value at every place of two lines, among them all digits and separators."""
    line = b"0 17 4095 2048 1.5\n"
    text = line + line
    starts = np.array([0, len(line)])
    for place in range(len(line)):
        for byte in range(256):
            changed = text[:place] + bytes([byte]) + text[place + 1 :]
            codes = urad._parse_plain_lines(changed, starts, 4)
            words = changed[: len(line)].split(b" ")[:4]
            words[-1] = re.split(rb"\s", words[-1])[0]  # any blank ends the last code
            is_code = [word.isdigit() and len(word) <= 4 and int(word) <= 4095 for word in words]
            if codes is not None:
                assert all(is_code)
                assert codes.tolist() == [[*map(int, words)], [0, 17, 4095, 2048]]
            elif place < 14:  # the last code and a blank end there
                assert not all(is_code)


def test_leading_zeros_do_not_change_codes(tmp_path):
    _, expected = read_contents(tmp_path, VALID_TEXT)

    _, frames = read_contents(tmp_path, re.sub(r"\b(\d{3})(?= )", r"0\1", VALID_TEXT))

    assert np.array_equal(frames, expected)


def change_lines(text, change):
    return "".join(change(n, line) for n, line in enumerate(text.splitlines(keepends=True)))


@pytest.mark.parametrize(
    "text",
    [
        VALID_TEXT.replace(".000\n", "\n"),  # a time without decimal point
        change_lines(VALID_TEXT, lambda n, line: line.replace(".003", "") if n == 3 else line),
        change_lines(VALID_TEXT, lambda _, line: line[:-15] + line[-15:].replace(".", ",")),
        change_lines(VALID_TEXT, lambda _, line: line.replace(" ", ", ")),
        VALID_TEXT.replace(" ", ";"),
        VALID_TEXT.replace(" ", "\t").replace("\n", "\r\n"),
        "\ufeff# uRAD, BW 240\nI and Q\n\n" + VALID_TEXT.replace("\n", "\n\n"),
    ],
)
def test_lines_of_other_programs_have_the_same_samples(tmp_path, text):
    assert text != VALID_TEXT
    _, expected = read_contents(tmp_path, VALID_TEXT)

    contents, frames = read_contents(tmp_path, text)

    assert np.array_equal(frames, expected)
    assert Urad().recognise(tmp_path / "IQ.txt") == MatchQuality.CONTAINER
    assert contents.findings == ()


@pytest.mark.parametrize("scale", [1, 1_000, 1_000_000, 1_000_000_000])
def test_whole_times_may_count_smaller_units(tmp_path, scale):
    text = change_lines(
        format_lines(simulate_beat(12.0, 0.0, n_chirps=8)),
        lambda n, line: f"{line.rstrip()} {(1_700_000_000 + 2 * n) * scale}\n",
    )

    contents, _ = read_contents(tmp_path, text, make_hints(interval_s=2.0))

    assert contents.findings == ()


@pytest.mark.parametrize("n_ramps", [1, 2])
def test_without_settings_those_of_the_vendor_are_assumed(tmp_path, n_ramps):
    beat = np.exp(2j * np.pi * np.arange(200) * 20 / 200)[None].repeat(4, axis=0)
    file = tmp_path / "IQ.txt"
    file.write_text(format_lines(*[beat] * n_ramps, times=True))

    recording = open_recording(file)

    chirp, frame = recording.radar.frame.chirp, recording.radar.frame
    assert (chirp.n_samples, chirp.sample_rate_hz) == (200, 200e3)
    assert chirp.sampled_bandwidth_hz == pytest.approx(240e6)
    # Ramps cannot be shorter than their samples: 1 ms each, whatever the times.
    assert frame.single_interval_s == pytest.approx(n_ramps * 1e-3, rel=1e-4)
    # The vendor states c / (2 BW) as resolution: 20 cycles a ramp are 20 cells of 0.625 m.
    peak = np.argmax(abs(np.fft.fft(recording.cube.values[0, 0, 0])[1:])) + 1
    assert chirp.range_bins_m(200)[peak] == pytest.approx(12.49, abs=0.01)
    (warning,) = (f for f in recording.findings if f.setting == "radar")
    assert warning.level == "warning"
    assert "240 MHz from 24.005 GHz" in warning.value


def test_numbers_without_times_need_settings(tmp_path):
    file = tmp_path / "table.txt"
    file.write_text(format_lines(simulate_beat(12.0, 0.0, n_chirps=4)))

    with pytest.raises(RecordingError, match="no settings in the recording"):
        open_recording(file)


@pytest.mark.parametrize(
    ("text", "hints", "message"),
    [
        (VALID_TEXT.replace(" ", " x", 1), make_hints(), "'x"),
        (VALID_TEXT.replace(" ", " 4096", 1), make_hints(), "in line 1"),
        (VALID_TEXT.replace(" ", " -", 1), make_hints(), "'-"),
        (VALID_TEXT.replace(" ", " 000", 1), make_hints(), "'000"),  # more digits than a code has
        (VALID_TEXT.replace("\n", " \n12 13 ", 1), make_hints(), "in line 2"),
        (VALID_TEXT.replace(".000\n", ".0.0\n", 1), make_hints(), "in line 1"),
        ("", make_hints(), "0 numbers in line 1"),
        ("1 2 3\n" * 8, make_hints(), "3 numbers in line 1"),
        ("1 2 3 4\n" * 8 + "1 2 3 4 5 6\n", make_hints(), "6 numbers after lines of 4 in line 9"),
        ("1" * 70_000, make_hints(), "more than 65536 bytes in line 1"),
        (VALID_TEXT, make_hints(n_samples=90), "200 numbers a line"),
        (VALID_TEXT, make_hints(encoding="down"), "200 numbers a line"),
        (VALID_TEXT, make_hints(sampling="real"), "real samples"),
        (VALID_TEXT, make_hints(n_rx=2), "of 2 receivers"),
        (VALID_TEXT, make_hints(9), "8 chirps"),
    ],
)
def test_rejects_invalid_recording(tmp_path, text, hints, message):
    with pytest.raises(RecordingError) as error:
        read_contents(tmp_path, text, hints)

    assert message in error.value.mistakes[0].value


def test_recognises_file_by_its_lines(tmp_path):
    file = tmp_path / "anything"
    for text, quality in (
        (VALID_TEXT, MatchQuality.CONTAINER),
        (VALID_TEXT[:-300], MatchQuality.CONTAINER),
        (VALID_TEXT * 20, MatchQuality.CONTAINER),  # longer than the bytes that recognise() reads
        ("# 240 MHz\n" + VALID_TEXT, MatchQuality.CONTAINER),
        (format_lines(simulate_beat(12.0, 0.0, n_chirps=8)), MatchQuality.LIKELY),
        ("1 2 3 4\n" * 8, MatchQuality.POSSIBLE),
        ("1 2 3\n" * 8, MatchQuality.NO),
        (VALID_TEXT.replace(" ", " 4096 ", 1), MatchQuality.NO),
        (VALID_TEXT.replace(" ", " 0.5 ", 1), MatchQuality.NO),
        ("frame: 1\n", MatchQuality.NO),
        ("\x00\x01" * 300, MatchQuality.NO),
        ("", MatchQuality.NO),
    ):
        file.write_text(text)
        assert Urad().recognise(file) == quality
    assert Urad().recognise(tmp_path) == MatchQuality.NO


@settings(max_examples=n_examples(150))
@given(st.data())
def test_fuzzed_bytes_decode_or_raise_recording_error(tmp_path_factory, data):
    text = bytearray(VALID_TEXT.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        n_removed = data.draw(st.integers(0, 1000))
        text[start : start + n_removed] = data.draw(
            st.binary(max_size=6) | st.sampled_from([b"\n", b" ", b".", b"-1", b"1e3", b"nan"])
        )
    folder = tmp_path_factory.mktemp("fuzz")
    try:
        _, frames = read_contents(folder, bytes(text), make_hints(2))
    except RecordingError:
        return
    assert abs(frames.real).max() <= 1
    assert abs(frames.imag).max() <= 1
    Urad().recognise(folder / "IQ.txt")
