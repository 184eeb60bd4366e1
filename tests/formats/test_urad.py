"""uRAD recordings (text): sawtooth and triangle, ranges and velocities, damaged lines."""

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
from dechirp.recordings.readers.urad import Urad
from dechirp.recordings.settings.base import RecordingSettings
from formats.any_bytes import decoded

LIGHT = 299_792_458.0
N, RATE, SLOPE, START, INTERVAL = 100, 200e3, 240e6 / 0.5e-3, 24.005e9, 1e-3


def told(n_chirps=8, *, n_samples=N, sampling="complex", n_rx=1, interval_s=INTERVAL, **more):
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
    return RecordingHints(settings=RecordingSettings(radar=Radar(frame=frame, array=array)), **more)


def beat(range_m, velocity_m_per_s, *, n_chirps, down=False):
    """Samples (chirp, sample) of a moving target, from what Tx x conj(Rx) is.

    Down-ramps fall from the frequency at which up-ramps end.
    """
    t = np.arange(N) / RATE
    sent_s = t + INTERVAL * np.arange(n_chirps)[:, None]
    delay_s = 2 * (range_m + velocity_m_per_s * sent_s) / LIGHT
    first_hz, slope = (START + SLOPE * (N - 1) / RATE, -SLOPE) if down else (START, SLOPE)
    return np.exp(2j * np.pi * (first_hz * delay_s + slope * delay_s * t))


def lines(*ramps, times=False, amplitude=900.0, offset=1900):
    """Text of the vendor's example: I of all ramps, then Q of all, then the time."""
    text = []
    for n, chirps in enumerate(zip(*ramps, strict=True)):
        numbers = [round(amplitude * x.real) + offset for chirp in chirps for x in chirp]
        numbers += [round(amplitude * x.imag) + offset for chirp in chirps for x in chirp]
        words = [str(number) for number in numbers] + [f"{1.7e9 + n * INTERVAL:.3f}"] * times
        text.append(" ".join(words) + ("" if times else " ") + "\n")
    return "".join(text)


def read(tmp_path, text, what=None):
    file = tmp_path / "IQ.txt"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    contents = Urad().read(file, what or told())
    return contents, decoded(contents)


def found(contents, frame):
    """Range without regard to coupling, and velocity, of the highest peak of a map."""
    radar = contents.radar.frame
    still = frame[:, 0] - frame.mean(axis=(0, 1, 2))
    taper = np.hanning(radar.n_chirps)[:, None] * np.hanning(N)
    power = abs(np.fft.fftshift(np.fft.fft2(still * taper, (1024, 4096)), axes=0))
    row, column = np.unravel_index(np.argmax(power[:, :2048]), (1024, 2048))
    return radar.chirp.range_bins_m(4096)[column], radar.velocity_bins_m_per_s(1024)[row]


def test_a_target_is_at_its_range_and_recedes_with_its_velocity(tmp_path):
    text = lines(beat(12.0, 1.0, n_chirps=32))

    contents, frames = read(tmp_path, text, told(32))

    # A bin is 0.62 m and 0.195 m/s wide, coupling 5 cm; 12 bits round by 5e-4.
    assert found(contents, frames[0]) == pytest.approx((12.05, 1.0), abs=0.05)
    assert contents.iq == "iq"


def test_both_ramps_of_a_triangle_tell_range_and_velocity_with_opposite_coupling(tmp_path):
    v = 2.5
    up, down = (beat(12.0, v, n_chirps=32, down=is_down) for is_down in (False, True))
    text = lines(up, down)

    seen = {}
    for ramp in ("up", "down"):
        contents, frames = read(tmp_path, text, told(32, encoding=ramp))
        seen[ramp] = found(contents, frames[0])

    coupling_m = contents.radar.frame.chirp.range_doppler_coupling_m(v)  # 0.125 m
    mean_m = 12.0 + v * 31 / 2 * INTERVAL
    assert seen["up"] == pytest.approx((mean_m + coupling_m, v), abs=0.03)
    assert seen["down"] == pytest.approx((mean_m - coupling_m, v), abs=0.03)
    assert "opposite sign" in " ".join(finding.expected for finding in contents.findings)


def test_codes_of_12_bits_span_full_scale_with_their_offset(tmp_path):
    codes = np.random.default_rng(3).integers(0, 4096, (8, 2 * N))
    codes[0, 0], codes[0, N] = 0, 4095
    text = "\n".join(" ".join(map(str, row)) for row in codes)  # without a last line end

    _, frames = read(tmp_path, text)
    _, swapped = read(tmp_path, text, told(iq="qi"))

    assert frames[0, 0, 0, 0] == pytest.approx(-1 + 1j)
    expected = (codes[:, :N] + 1j * codes[:, N:]) / 4095 * 2 - (1 + 1j)
    assert np.allclose(frames[0, :, 0], expected, atol=3e-7, rtol=0)  # both parts in float32
    assert np.array_equal(swapped, 1j * frames.conj())


def test_echoes_on_the_wrong_side_of_the_spectrum_are_pointed_out(tmp_path):
    text = lines(beat(12.0, 0.0, n_chirps=8).conj())

    contents, _ = read(tmp_path, text)

    warned = [finding.setting for finding in contents.findings if finding.level == "warning"]
    assert warned == ["iq"]


@pytest.mark.parametrize(("interval_s", "warned"), [(1.005e-3, 0), (2e-3, 1)])
def test_times_in_the_file_are_held_against_the_interval(tmp_path, interval_s, warned):
    text = lines(beat(12.0, 0.0, n_chirps=64), times=True)

    contents, frames = read(tmp_path, text, told(interval_s=interval_s))

    assert frames.shape == (8, 8, 1, N)
    said = [f for f in contents.findings if f.setting == "radar.frame.interval"]
    assert len(said) == warned
    assert all("true velocities 2" in finding.fix for finding in said)  # shown as half of them


def test_a_last_line_cut_short_and_chirps_that_fill_no_frame_are_left_out(tmp_path):
    text = lines(beat(12.0, 0.0, n_chirps=20))

    contents, frames = read(tmp_path, text[:-300])

    assert frames.shape[0] == 2
    said = " ".join(finding.value for finding in contents.findings)
    assert "in line 20, the last" in said
    assert "3 chirps that are left out" in said


GOOD = lines(beat(12.0, 0.0, n_chirps=8), times=True)


@pytest.mark.parametrize(
    ("text", "what", "named"),
    [
        (GOOD.replace(" ", " x", 1), told(), "'x"),
        (GOOD.replace(" ", " 4096", 1), told(), "in line 1"),
        (GOOD.replace(" ", " -", 1), told(), "'-"),
        (GOOD.replace(" ", " 000", 1), told(), "'000"),  # more digits than a code has
        (GOOD.replace("\n", " \n12 13 ", 1), told(), "in line 2"),
        (GOOD.replace("\n", "\n\n", 1), told(), "in line 2"),
        (GOOD.replace(".000\n", ".0.0\n", 1), told(), "in line 1"),
        ("", told(), "0 numbers in line 1"),
        ("1 2 3\n" * 8, told(), "3 numbers in line 1"),
        ("1 2 3 4\n" * 8 + "1 2 3 4 5 6\n", told(), "6 numbers after lines of 4 in line 9"),
        ("1" * 70_000, told(), "more than 65536 bytes in line 1"),
        (GOOD, told(n_samples=90), "200 numbers a line"),
        (GOOD, told(encoding="down"), "200 numbers a line"),
        (GOOD, told(sampling="real"), "real samples"),
        (GOOD, told(n_rx=2), "of 2 receivers"),
        (GOOD, told(9), "8 chirps"),
    ],
)
def test_a_recording_that_cannot_be_right_is_refused(tmp_path, text, what, named):
    with pytest.raises(RecordingError) as error:
        read(tmp_path, text, what)

    assert named in error.value.mistakes[0].value


def test_a_file_is_known_by_its_lines(tmp_path):
    file = tmp_path / "anything"
    for text, fit in (
        (GOOD, MatchQuality.LIKELY),
        (GOOD[:-300], MatchQuality.LIKELY),
        (GOOD * 20, MatchQuality.LIKELY),  # longer than what is looked at
        ("1 2 3 4\n" * 8, MatchQuality.POSSIBLE),
        ("1 2 3\n" * 8, MatchQuality.NO),
        (GOOD.replace(" ", " 4096 ", 1), MatchQuality.NO),
        (GOOD.replace(" ", " 0.5 ", 1), MatchQuality.NO),
        ("frame: 1\n", MatchQuality.NO),
        ("\x00\x01" * 300, MatchQuality.NO),
        ("", MatchQuality.NO),
    ):
        file.write_text(text)
        assert Urad().recognise(file) == fit
    assert Urad().recognise(tmp_path) == MatchQuality.NO


@settings(max_examples=150)
@given(st.data())
def test_no_bytes_do_anything_but_decode_or_be_refused(tmp_path_factory, data):
    text = bytearray(GOOD.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        gone = data.draw(st.integers(0, 1000))
        text[at : at + gone] = data.draw(
            st.binary(max_size=6) | st.sampled_from([b"\n", b" ", b".", b"-1", b"1e3", b"nan"])
        )
    file = tmp_path_factory.mktemp("fuzz")
    try:
        _, frames = read(file, bytes(text), told(2))
    except RecordingError:
        return
    assert abs(frames.real).max() <= 1
    assert abs(frames.imag).max() <= 1
    Urad().recognise(file / "IQ.txt")
