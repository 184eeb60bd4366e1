"""SiRad recordings (JSON): ranges, order of I and Q, and files that cannot be right."""

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
from dechirp.recordings.readers.sirad import Sirad
from dechirp.recordings.settings.base import RecordingSettings
from formats.any_bytes import decoded

LIGHT = 299_792_458.0
HEAD = {
    "Bandwidth": 6000,
    "SamplingFrequency": 2.571,
    "Ramps": 1,
    "Samps": 32,
    "PRI": "0.01577",
    "Gain": 8,
}
# 6 GHz in 32 + 37.5 sample periods.
SLOPE = 6e9 * 2.571e6 / (32 + 37.5)


def echo(*, range_m=0.5, velocity_m_per_s=0.0, n_chirps=64, amplitude=500.0):
    """Complex samples (chirp, sample) of a target at mid-band 122 GHz, near it."""
    t = np.arange(32) / 2.571e6
    ranges_m = range_m + velocity_m_per_s * 0.01577 * np.arange(n_chirps)[:, None]
    delay_s = 2 * ranges_m / LIGHT
    return amplitude * np.exp(2j * np.pi * ((122e9 - SLOPE * t.mean() + SLOPE * t) * delay_s))


def document(samples, *, order="iq", **changes):
    """The recording as its software writes it."""
    parts = (samples.real, samples.imag) if order == "iq" else (samples.imag, samples.real)
    rows = np.stack([np.round(part) for part in parts], axis=-1).reshape(len(samples), -1)
    return json.dumps({**HEAD, **changes, "data": rows.astype(int).tolist()})


def read(tmp_path, text, told=None):
    file = tmp_path / "walk.json"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    contents = Sirad().read(file, told or RecordingHints())
    return contents, decoded(contents)


def peak_m(contents, chirps):
    chirp = contents.radar.frame.chirp
    power = np.sum(abs(np.fft.fft(chirps * np.hanning(32), 1024)) ** 2, axis=(0, 1))
    return chirp.range_bins_m(1024)[np.argmax(power)]


@pytest.mark.parametrize("order", ["iq", "qi"])
def test_a_target_is_at_its_range_whichever_part_of_a_sample_comes_first(tmp_path, order):
    contents, frames = read(tmp_path, document(echo(range_m=0.7), order=order))

    # A bin is 5.4 cm wide, a step of the padded spectrum 1.7 mm.
    assert peak_m(contents, frames[0]) == pytest.approx(0.7, abs=2e-3)
    assert contents.iq == order
    (guessed,) = [finding for finding in contents.findings if finding.setting == "iq"]
    assert f"taken as {order}" in guessed.value


@pytest.mark.parametrize("order", ["iq", "qi"])
def test_a_receding_target_has_positive_velocity(tmp_path, order):
    sent = echo(velocity_m_per_s=0.01)

    contents, frames = read(tmp_path, document(sent, order=order))

    along = np.fft.fft(frames[0, :, 0, 0], 4096)
    doppler_hz = np.fft.fftfreq(4096, 0.01577)[np.argmax(abs(along))]
    velocity = doppler_hz * contents.radar.frame.chirp.wavelength_m / 2
    # A velocity bin of 64 chirps is 1.2 mm/s wide.
    assert velocity == pytest.approx(0.01, abs=0.3e-3)


def test_the_order_that_is_told_is_kept_even_if_echoes_lie_on_the_wrong_side(tmp_path):
    contents, frames = read(tmp_path, document(echo()), RecordingHints(iq="qi"))

    sent = np.round(echo().real) + 1j * np.round(echo().imag)
    assert np.allclose(frames[0, :, 0] * 2048, sent.imag + 1j * sent.real)
    warned = [finding for finding in contents.findings if finding.level == "warning"]
    assert [finding.setting for finding in warned] == ["iq"]


def test_frames_of_one_ramp_are_the_chirps_of_one_frame(tmp_path):
    contents, frames = read(tmp_path, document(echo(n_chirps=40)))

    frame = contents.radar.frame
    assert frames.shape == (1, 40, 1, 32)
    assert frame.interval_s == pytest.approx(0.01577)
    assert frame.chirp.sampled_bandwidth_hz == pytest.approx(6e9 * 32 / 69.5)
    assert frame.chirp.mid_window_frequency_hz == pytest.approx(122e9)
    said = {finding.setting: finding.value for finding in contents.findings}
    assert "119 GHz" in said["radar.frame.chirp.start_frequency"]
    assert "40 frames of one chirp" in said["radar.frame.n_chirps"]
    assert "12 bits" in said["encoding"]
    assert contents.scale == 1 / 2048


def told_radar(n_chirps, n_samples=32, sampling="complex"):
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


def test_a_radar_that_is_told_divides_the_chirps_into_frames(tmp_path):
    whole = read(tmp_path, document(echo(n_chirps=40)))[1]

    contents, frames = read(tmp_path, document(echo(n_chirps=40)), told_radar(16))

    assert np.array_equal(frames.reshape(32, 32), whole[0, :32, 0])
    assert "8 chirps that are left out" in " ".join(f.value for f in contents.findings)


@pytest.mark.parametrize(
    ("told", "named"),
    [
        (told_radar(41), "40 chirps"),
        (told_radar(8, n_samples=16), "32 samples a chirp"),
        (told_radar(8, sampling="real"), "real samples"),
    ],
)
def test_a_radar_that_cannot_be_that_of_the_recording_is_refused(tmp_path, told, named):
    with pytest.raises(RecordingError, match=named):
        read(tmp_path, document(echo(n_chirps=40)), told)


def test_a_long_recording_is_read_in_blocks_of_text(tmp_path):
    codes = np.random.default_rng(1).integers(-2048, 2048, (3500, 64))
    text = json.dumps({**HEAD, "data": codes.tolist()}, indent=2)
    assert len(text) > 2 * 2**20  # more than two blocks, cut at any place

    _, frames = read(tmp_path, text, RecordingHints(iq="iq"))

    assert np.array_equal(frames.view(np.float32).reshape(3500, 64) * 2048, codes)


@pytest.mark.parametrize("indent", [None, 2])
@pytest.mark.parametrize("n_chirps", [1, 15, 16, 50, 3500])
def test_frames_are_read_from_anywhere_in_a_recording(tmp_path, n_chirps, indent):
    # Rows of different lengths, beyond the places that are remembered, every 16 of them.
    codes = np.random.default_rng(2).integers(-2048, 2048, (3500, 64))
    codes[::3] //= 100
    text = json.dumps({**HEAD, "data": codes.tolist()}, indent=indent)

    contents, frames = read(tmp_path, text, replace(told_radar(n_chirps), iq="iq"))
    again = np.empty_like(frames[0])
    contents.decode(0, again)

    sent = codes[: len(frames) * n_chirps].reshape(len(frames), n_chirps, 64)
    assert np.array_equal(frames[:, :, 0].view(np.float32) * 2048, sent)
    assert np.array_equal(again, frames[0])


def test_a_recording_that_changed_since_it_was_opened_is_refused(tmp_path):
    contents, frames = read(tmp_path, document(echo(n_chirps=40)), told_radar(8))
    for text in (GOOD, document(echo(n_chirps=40)).replace("], [", ", ")):
        (tmp_path / "walk.json").write_text(text)
        with pytest.raises(RecordingError):
            for index in range(len(frames)):
                contents.decode(index, frames[index])


RESIDENT = """
import re, sys
from pathlib import Path
import numpy as np
from test_sirad import Sirad, told_radar
def most():  # MiB; what `resource` says begins with the most of who started this
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 2**10
before = most()
contents = Sirad().read(Path(sys.argv[1]), told_radar(64))
out = np.empty((64, 1, 32), np.complex64)
for index in (0, contents.n_frames - 1):
    contents.decode(index, out)
print(most() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="measured as Linux counts")
def test_a_long_recording_is_not_kept_in_memory(tmp_path):
    file = tmp_path / "walk.json"
    row = b"[" + b",".join([b"1"] * 64) + b"]"  # 129 bytes of text for 128 of codes
    head = json.dumps(HEAD)[:-1].encode()
    file.write_bytes(head + b', "data": [' + b",\n".join([row] * 500_000) + b"]}")

    here = Path(__file__).parent
    paths = [str(Path(dechirp.__file__).parents[1]), str(here), str(here.parent)]
    found = subprocess.run(
        [sys.executable, "-c", RESIDENT, str(file)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=True,
    )

    # Of 65 MB: a block of text as numbers of Python, some chirps and places. All codes are 61.
    assert float(found.stdout) < 50


def test_a_file_is_known_by_its_first_kilobyte(tmp_path):
    file = tmp_path / "anything.bin"
    for text, fit in (
        (document(echo()), MatchQuality.SELF_DESCRIBING),
        (json.dumps({"data": [[1, 2]], **HEAD}), MatchQuality.NO),
        (json.dumps({"data": [[1, 2]]}), MatchQuality.NO),
        ("[" + document(echo()) + "]", MatchQuality.NO),
        ("", MatchQuality.NO),
    ):
        file.write_text(text)
        assert Sirad().recognise(file) == fit
    assert Sirad().recognise(tmp_path) == MatchQuality.NO


GOOD = document(echo(n_chirps=3))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (GOOD[:-1], "do not end in"),
        (GOOD[:-40], "do not end in"),
        (GOOD + "x", "do not end in"),
        (GOOD.replace('"data": [[', '"data": [[NaN, '), "'N' among numbers"),
        (GOOD.replace('"data": [[', '"data": [[1.5, '), "'.' among numbers"),
        (GOOD.replace('"data": [[', '"data": [[7, '), "a row of 65 numbers"),
        (GOOD.replace('"data": [[', '"data": [7, ['), "a number outside of a row"),
        (GOOD.replace('"data": [[', '"data": [[[], '), "a row of 65 numbers"),
        (
            json.dumps({**HEAD, "Samps": 1, "data": [[[1], [2]]] * 3}),
            "text other than a list of numbers",
        ),
        (json.dumps({**HEAD, "Samps": 1, "data": [[[1], [2]]] * 2 + [[1, 2]]}), "16-bit"),
        (GOOD.replace("], [", "], , [", 1), "text other than a list of numbers"),
        (GOOD.replace("], [", "9" * 30 + "], [", 1), "a value other than a 16-bit integer"),
        (
            GOOD.replace('"data": [[', '"data": [[' + "9" * 5000),
            "text other than a list of numbers",
        ),
        (json.dumps({**HEAD, "data": []}), "do not end in"),
        (GOOD.replace('"Ramps": 1', '"Ramps": 4'), "Ramps 4"),
        (GOOD.replace('"Samps": 32', '"Samps": 32.5'), "Samps '32.5'"),
        (GOOD.replace('"Samps": 32', '"Samps": 1e99'), "Samps '1e"),
        (GOOD.replace('"0.01577"', '"soon"'), "PRI 'soon'"),
        (GOOD.replace('"0.01577"', "true"), "PRI 'True'"),
        (GOOD.replace("6000", "NaN"), "Bandwidth 'nan'"),
        (GOOD.replace("2.571", "1e-9"), "impossible settings"),
        (GOOD.replace('"Gain": 8', '"Gain": 8,'), "no settings of a recording"),
        ('{"data": [[1, 2]]}', "no settings of a recording"),
    ],
)
def test_a_damaged_recording_is_refused_with_what_is_wrong(tmp_path, text, named):
    with pytest.raises(RecordingError) as error:
        read(tmp_path, text)

    assert named in error.value.mistakes[0].value


def test_the_place_of_the_damage_is_told(tmp_path):
    text = GOOD[:700] + "?" + GOOD[701:]

    with pytest.raises(RecordingError, match="at byte 700 "):
        read(tmp_path, text)


@settings(max_examples=150)
@given(st.data())
def test_no_bytes_do_anything_but_decode_or_be_refused(tmp_path_factory, data):
    text = bytearray(GOOD.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        gone = data.draw(st.integers(0, 20))
        text[at : at + gone] = data.draw(
            st.binary(max_size=6) | st.sampled_from([b"[", b"]", b",", b"-", b"{", b'"', b"9e9"])
        )
    try:
        _, frames = read(tmp_path_factory.mktemp("fuzz"), bytes(text))
    except RecordingError:
        return
    assert np.isfinite(frames).all()
    assert abs(frames).max() < 1.5
