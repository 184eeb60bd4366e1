"""SiRad recordings (JSON): ranges, order of I and Q, and invalid files."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp
from dechirp.core.errors import RecordingError
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import MatchQuality, RecordingHints
from dechirp.recordings.readers.sirad import Sirad, _parse_rows_to_codes
from dechirp.recordings.settings.base import RecordingSettings
from formats.corruption import decode_frames
from nightly import n_examples, nightly, nightly_except

SPEED_OF_LIGHT = 299_792_458.0
HEADER = {
    "Bandwidth": 6000,
    "SamplingFrequency": 2.571,
    "Ramps": 1,
    "Samps": 32,
    "PRI": "0.01577",
    "Gain": 8,
}
# 6 GHz in 32 + 37.5 sample periods.
SLOPE = 6e9 * 2.571e6 / (32 + 37.5)


def simulate_echo(*, range_m=0.5, velocity_m_per_s=0.0, n_chirps=64, amplitude=500.0):
    """Simulate complex samples (chirp, sample) of one target, with the band centred at 122 GHz."""
    t = np.arange(32) / 2.571e6
    ranges_m = range_m + velocity_m_per_s * 0.01577 * np.arange(n_chirps)[:, None]
    delay_s = 2 * ranges_m / SPEED_OF_LIGHT
    return amplitude * np.exp(2j * np.pi * ((122e9 - SLOPE * t.mean() + SLOPE * t) * delay_s))


def format_document(samples, *, order="qi", **changes):
    """Format a recording as the vendor's software writes it: with Q first."""
    parts = (samples.real, samples.imag) if order == "iq" else (samples.imag, samples.real)
    rows = np.stack([np.round(part) for part in parts], axis=-1).reshape(len(samples), -1)
    return json.dumps({**HEADER, **changes, "data": rows.astype(int).tolist()})


def read_contents(tmp_path, text, hints=None):
    file = tmp_path / "walk.json"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    contents = Sirad().read(file, hints or RecordingHints())
    return contents, decode_frames(contents)


def find_peak_m(contents, chirps):
    chirp = contents.radar.frame.chirp
    power = np.sum(abs(np.fft.fft(chirps * np.hanning(32), 1024)) ** 2, axis=(0, 1))
    return chirp.range_bins_m(1024)[np.argmax(power)]


def test_target_has_true_range_beside_stronger_coupling(tmp_path):
    # The coupling, 20 dB stronger, lies on the other side of zero.
    coupling = 10 * simulate_echo(range_m=-0.05, amplitude=150.0)
    samples = coupling + simulate_echo(range_m=0.46, velocity_m_per_s=0.01, amplitude=150.0)

    contents, frames = read_contents(tmp_path, format_document(samples))

    moving = frames[0] - frames[0].mean(axis=0)
    middle_m = 0.46 + 0.01 * 0.01577 * (len(moving) - 1) / 2
    # A bin is 5.4 cm wide, a step of the padded spectrum 1.7 mm.
    assert find_peak_m(contents, moving) == pytest.approx(middle_m, abs=2e-3)
    assert contents.iq == "qi"
    assert not [finding for finding in contents.findings if finding.setting == "iq"]


def test_receding_target_has_positive_velocity(tmp_path):
    samples = simulate_echo(velocity_m_per_s=0.01)

    contents, frames = read_contents(tmp_path, format_document(samples))

    slow_time_spectrum = np.fft.fft(frames[0, :, 0, 0], 4096)
    doppler_hz = np.fft.fftfreq(4096, 0.01577)[np.argmax(abs(slow_time_spectrum))]
    velocity = doppler_hz * contents.radar.frame.chirp.wavelength_m / 2
    # A velocity bin of 64 chirps is 1.2 mm/s wide.
    assert velocity == pytest.approx(0.01, abs=0.3e-3)


def test_requested_iq_order_is_kept_with_warning(tmp_path):
    contents, frames = read_contents(
        tmp_path, format_document(simulate_echo()), RecordingHints(iq="iq")
    )

    samples = np.round(simulate_echo().real) + 1j * np.round(simulate_echo().imag)
    assert np.allclose(frames.reshape(-1, 32) * 2048, samples.imag + 1j * samples.real)
    warnings = [finding for finding in contents.findings if finding.level == "warning"]
    assert [finding.setting for finding in warnings] == ["iq"]


def test_single_ramp_frames_are_joined(tmp_path):
    contents, frames = read_contents(tmp_path, format_document(simulate_echo(n_chirps=40)))

    frame = contents.radar.frame
    assert frames.shape == (2, 16, 1, 32)  # about 0.3 s at 15.77 ms
    assert frame.interval_s == pytest.approx(0.01577)
    assert frame.chirp.sampled_bandwidth_hz == pytest.approx(6e9 * 32 / 69.5)
    assert frame.chirp.mid_window_frequency_hz == pytest.approx(122e9)
    values = {finding.setting: finding.value for finding in contents.findings}
    assert "119 GHz" in values["radar.frame.chirp.start_frequency"]
    assert "--set radar.frame.n_chirps=16" in values["radar.frame.n_chirps"]
    assert "12 bits" in values["encoding"]
    assert contents.scale == 1 / 2048


def make_hints(n_chirps, n_samples=32, sampling="complex"):
    chirp = Chirp(
        start_frequency_hz=119e9,
        slope_hz_per_s=SLOPE,
        ramp_duration_s=69.5 / 2.571e6,
        sample_rate_hz=2.571e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=0.01577)
    return RecordingHints(settings=RecordingSettings(radar=Radar(frame=frame)))


def test_given_radar_divides_chirps_into_frames(tmp_path):
    expected = read_contents(tmp_path, format_document(simulate_echo(n_chirps=40)))[1]

    contents, frames = read_contents(
        tmp_path, format_document(simulate_echo(n_chirps=40)), make_hints(32)
    )

    assert np.array_equal(frames.reshape(32, 32), expected.reshape(32, 32))
    assert "8 chirps that are left out" in " ".join(f.value for f in contents.findings)


@pytest.mark.parametrize(
    ("hints", "message"),
    [
        (make_hints(41), "40 chirps"),
        (make_hints(8, n_samples=16), "32 samples a chirp"),
        (make_hints(8, sampling="real"), "real samples"),
    ],
)
def test_rejects_radar_that_contradicts_recording(tmp_path, hints, message):
    with pytest.raises(RecordingError, match=message):
        read_contents(tmp_path, format_document(simulate_echo(n_chirps=40)), hints)


def test_long_recording_is_read_in_blocks(tmp_path):
    codes = np.random.default_rng(1).integers(-2048, 2048, (3500, 64))
    text = json.dumps({**HEADER, "data": codes.tolist()}, indent=2)
    assert len(text) > 2 * 2**20  # more than two blocks of 1 MiB, split within rows

    _, frames = read_contents(tmp_path, text, RecordingHints(iq="iq"))

    # 218 frames of 16 chirps
    assert np.array_equal(frames.view(np.float32).reshape(3488, 64) * 2048, codes[:3488])


@pytest.mark.parametrize("indent", nightly_except(1, [None, 2]))
@pytest.mark.parametrize("n_chirps", nightly_except((2, 16), [2, 15, 16, 50, 3500]))
def test_frames_decode_in_any_order(tmp_path, n_chirps, indent):
    # Rows differ in length; the reader indexes every 16th row.
    codes = np.random.default_rng(2).integers(-2048, 2048, (3500, 64))
    codes[::3] //= 100
    text = json.dumps({**HEADER, "data": codes.tolist()}, indent=indent)

    contents, frames = read_contents(tmp_path, text, replace(make_hints(n_chirps), iq="iq"))
    repeated_frame = np.empty_like(frames[0])
    contents.decode(0, repeated_frame)

    expected = codes[: len(frames) * n_chirps].reshape(len(frames), n_chirps, 64)
    assert np.array_equal(frames[:, :, 0].view(np.float32) * 2048, expected)
    assert np.array_equal(repeated_frame, frames[0])


def test_rejects_recording_changed_after_opening(tmp_path):
    contents, frames = read_contents(
        tmp_path, format_document(simulate_echo(n_chirps=40)), make_hints(8)
    )
    for text in (VALID_TEXT, format_document(simulate_echo(n_chirps=40)).replace("], [", ", ")):
        (tmp_path / "walk.json").write_text(text)
        with pytest.raises(RecordingError):
            for index in range(len(frames)):
                contents.decode(index, frames[index])


MEMORY_SCRIPT = """
import re, sys
from pathlib import Path
import numpy as np
from test_sirad import Sirad, make_hints
def peak_mib():  # `resource` would include the peak of the parent process
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 2**10
base_mib = peak_mib()
contents = Sirad().read(Path(sys.argv[1]), make_hints(64))
out = np.empty((64, 1, 32), np.complex64)
for index in (0, contents.n_frames - 1):
    contents.decode(index, out)
print(peak_mib() - base_mib)
"""


@nightly
@pytest.mark.skipif(
    sys.platform != "linux", reason="memory is measured with /proc, which only Linux has"
)
def test_long_recording_is_read_in_bounded_memory(tmp_path):
    file = tmp_path / "walk.json"
    row = b"[" + b",".join([b"1"] * 64) + b"]"  # 129 bytes of text for 128 bytes of codes
    header = json.dumps(HEADER)[:-1].encode()
    file.write_bytes(header + b', "data": [' + b",\n".join([row] * 500_000) + b"]}")

    folder = Path(__file__).parent
    paths = [str(Path(dechirp.__file__).parents[1]), str(folder), str(folder.parent)]
    process = subprocess.run(
        [sys.executable, "-c", MEMORY_SCRIPT, str(file)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=True,
    )

    # Limit of 50 MiB: the text has 65 MB, all codes together 61 MiB.
    assert float(process.stdout) < 50


def test_recognises_file_by_first_kilobyte(tmp_path):
    file = tmp_path / "anything.bin"
    for text, quality in (
        (format_document(simulate_echo()), MatchQuality.SELF_DESCRIBING),
        (json.dumps({"data": [[1, 2]], **HEADER}), MatchQuality.NO),
        (json.dumps({"data": [[1, 2]]}), MatchQuality.NO),
        ("[" + format_document(simulate_echo()) + "]", MatchQuality.NO),
        ("", MatchQuality.NO),
    ):
        file.write_text(text)
        assert Sirad().recognise(file) == quality
    assert Sirad().recognise(tmp_path) == MatchQuality.NO


VALID_TEXT = format_document(simulate_echo(n_chirps=3))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (VALID_TEXT[:-1], "do not end in"),
        (VALID_TEXT[:-40], "do not end in"),
        (VALID_TEXT + "x", "do not end in"),
        (VALID_TEXT.replace('"data": [[', '"data": [[NaN, '), "'N' among numbers"),
        (VALID_TEXT.replace('"data": [[', '"data": [[1.5, '), "'.' among numbers"),
        (VALID_TEXT.replace('"data": [[', '"data": [[7, '), "a row of 65 numbers"),
        (VALID_TEXT.replace('"data": [[', '"data": [7, ['), "a number outside of a row"),
        (VALID_TEXT.replace('"data": [[', '"data": [[[], '), "a row of 65 numbers"),
        (
            json.dumps({**HEADER, "Samps": 1, "data": [[[1], [2]]] * 3}),
            "text other than a list of numbers",
        ),
        (json.dumps({**HEADER, "Samps": 1, "data": [[[1], [2]]] * 2 + [[1, 2]]}), "16-bit"),
        (VALID_TEXT.replace("], [", "], , [", 1), "text other than a list of numbers"),
        (VALID_TEXT.replace("], [", "9" * 30 + "], [", 1), "a value other than a 16-bit integer"),
        (
            VALID_TEXT.replace('"data": [[', '"data": [[' + "9" * 5000),
            "text other than a list of numbers",
        ),
        (json.dumps({**HEADER, "data": []}), "do not end in"),
        (VALID_TEXT.replace('"Ramps": 1', '"Ramps": 4'), "Ramps 4"),
        (VALID_TEXT.replace('"Samps": 32', '"Samps": 32.5'), "Samps '32.5'"),
        (VALID_TEXT.replace('"Samps": 32', '"Samps": 1e99'), "Samps '1e"),
        (VALID_TEXT.replace('"0.01577"', '"soon"'), "PRI 'soon'"),
        (VALID_TEXT.replace('"0.01577"', "true"), "PRI 'True'"),
        (VALID_TEXT.replace("6000", "NaN"), "Bandwidth 'nan'"),
        (VALID_TEXT.replace("2.571", "1e-9"), "impossible settings"),
        (VALID_TEXT.replace('"Gain": 8', '"Gain": 8,'), "no settings of a recording"),
        ('{"data": [[1, 2]]}', "no settings of a recording"),
    ],
)
def test_damaged_recording_error_names_mistake(tmp_path, text, message):
    with pytest.raises(RecordingError) as error:
        read_contents(tmp_path, text)

    assert message in error.value.mistakes[0].value


def test_lowest_and_highest_code_of_16_bits_are_read(tmp_path):
    rows = np.full((2, 64), 7)
    rows[0, 0], rows[1, 63] = -(2**15), 2**15 - 1

    contents, cube = read_contents(tmp_path, json.dumps({**HEADER, "data": rows.tolist()}))

    codes = cube.reshape(2, 32) / contents.scale
    assert codes[0, 0] == 7 - 32768j  # Q precedes I
    assert codes[1, 31] == 32767 + 7j


def mutate_rows(rng):
    """Return the text of three rows of four numbers, with up to three changed characters."""
    text = bytearray(b"[1,-2, 30,4],\n [5,6,-700,8],[0,-0,32767,-32768]")
    for _ in range(rng.integers(4)):
        place = rng.integers(len(text))
        inserted = rng.choice([b"", b"0", b"-", b",", b" ", b"[", b"]"])
        text[place : place + rng.integers(2)] = inserted
    return bytes(text)


def test_rows_are_accepted_exactly_if_they_are_json():
    rng = np.random.default_rng(31)
    n_valid = 0
    for _ in range(n_examples(2000)):
        text = mutate_rows(rng)
        try:
            expected = json.loads(b"[" + text + b"]")
            is_valid = all(len(row) == 4 for row in expected)
            is_valid = is_valid and all(-(2**15) <= x < 2**15 for row in expected for x in row)
        except (ValueError, TypeError):
            is_valid = False
        n_valid += is_valid
        if is_valid:
            rows = _parse_rows_to_codes(Path("rows.json"), 0, text, 4)
            np.testing.assert_array_equal(rows, expected)
        else:
            with pytest.raises(RecordingError):
                _parse_rows_to_codes(Path("rows.json"), 0, text, 4)
    assert 0 < n_valid < n_examples(2000)


def test_damaged_recording_error_gives_byte_offset(tmp_path):
    text = VALID_TEXT[:700] + "?" + VALID_TEXT[701:]

    with pytest.raises(RecordingError, match="at byte 700 "):
        read_contents(tmp_path, text)


@settings(max_examples=n_examples(150))
@given(st.data())
def test_fuzzed_bytes_decode_or_raise_recording_error(tmp_path_factory, data):
    text = bytearray(VALID_TEXT.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        n_removed = data.draw(st.integers(0, 20))
        text[start : start + n_removed] = data.draw(
            st.binary(max_size=6) | st.sampled_from([b"[", b"]", b",", b"-", b"{", b'"', b"9e9"])
        )
    try:
        _, frames = read_contents(tmp_path_factory.mktemp("fuzz"), bytes(text))
    except RecordingError:
        return
    assert np.isfinite(frames).all()
    assert abs(frames).max() < 1.5


def test_byte_order_mark_and_windows_line_ends_are_read(tmp_path):
    text = format_document(simulate_echo()).replace("], [", "],\r\n[")
    _, plain = read_contents(tmp_path, text)
    (tmp_path / "walk.json").write_bytes(b"\xef\xbb\xbf" + text.encode())

    recording = dechirp.open(tmp_path)

    assert recording.format == "sirad"
    assert np.array_equal(recording.cube.values.reshape(plain.shape), plain)
