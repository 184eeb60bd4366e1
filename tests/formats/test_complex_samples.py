"""Bare complex samples: types of numbers, pauses between chirps, damaged files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.complex_samples import holds_float32_numbers
from dechirp.recordings.recognise import recognise_formats
from dechirp.recordings.recording import open as open_recording
from nightly import n_examples

N, M, RATE = 64, 8, 10e6
GAP = 26  # samples of each pause


def make_radar(*, gap=0, n_rx=1, sampling="complex"):
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=N / RATE,
        sample_rate_hz=RATE,
        n_samples=N,
        sampling=sampling,
    )
    array = Array(rx_m=tuple((0.0, 2e-3 * n, 0.0) for n in range(n_rx)))
    return Radar(frame=Frame(chirp=chirp, n_chirps=M, interval_s=(N + gap) / RATE), array=array)


def simulate_parts(n_chirps=3 * M, *, gap=0, amplitude=0.5, cycles=9.3):
    """Simulate the tone of one target, (chirp, sample, iq), with noise in the pauses."""
    rng = np.random.default_rng(5)
    n = np.arange(N)
    phases = rng.random((n_chirps, 1)) if gap else np.zeros((n_chirps, 1))
    tone = amplitude * np.exp(2j * np.pi * (cycles * n / N + phases))
    noise = 1e-3 * (rng.standard_normal((n_chirps, N + gap, 2))).view(complex)[..., 0]
    noise[:, :N] += tone
    return np.stack([noise.real, noise.imag], axis=-1)


TYPES = {
    "cf32": ("<f4", 1.0, 0),
    "fc32": ("<f4", 1.0, 0),
    "cfile": ("<f4", 1.0, 0),
    "cf64": ("<f8", 1.0, 0),
    "cs8": ("i1", 128, 0),
    "cu8": ("u1", 128, 128),
    "cs16": ("<i2", 32768, 0),
    "sc16": ("<i2", 32768, 0),
    "cu16": ("<u2", 32768, 32768),
    "ci32": ("<i4", 2**31, 0),
    "iq": ("<f4", 1.0, 0),
    "bin": ("<f4", 1.0, 0),
}


@pytest.mark.parametrize("suffix", TYPES)
def test_every_type_gives_every_sample(tmp_path, suffix):
    dtype, full_scale, zero = TYPES[suffix]
    parts = simulate_parts()
    numbers = parts * full_scale + zero
    codes = (numbers if "f" in dtype else np.round(numbers)).astype(dtype)
    file = tmp_path / f"capture.{suffix}"
    codes.tofile(file)

    recording = open_recording(file, radar=make_radar())

    assert (recording.format, recording.n_frames) == ("complex-samples", 3)
    expected = ((codes.astype(float) - zero) / full_scale).reshape(3, M, 1, N, 2)
    # Single precision of numbers up to 1: 6e-8.
    assert np.allclose(recording.cube.real, expected[..., 0], rtol=0, atol=1e-7)
    assert np.allclose(recording.cube.imag, expected[..., 1], rtol=0, atol=1e-7)
    assert next(recording.select_frames(2, 3).frames()).equals(recording.cube[2:])


def test_undecided_suffix_is_decided_by_the_numbers_and_by_encoding(tmp_path):
    file = tmp_path / "capture.iq"
    codes = np.round(simulate_parts() * 2000).astype("<i2")
    codes.tofile(file)

    recording = open_recording(file, radar=make_radar())
    named = open_recording(file, radar=make_radar(), encoding="cs16")

    assert np.array_equal(recording.cube.real.values.ravel(), codes[..., 0].ravel() / 32768)
    assert named.cube.equals(recording.cube)
    (warning,) = set(recording.findings) - set(named.findings)
    assert "assumed to be cs16" in warning.value


def test_order_qi_exchanges_the_parts_and_wrong_order_is_warned_of(tmp_path):
    file = tmp_path / "capture.cf32"
    simulate_parts()[..., ::-1].astype("<f4").tofile(file)

    wrong = open_recording(file, radar=make_radar())
    right = open_recording(file, radar=make_radar(), iq="qi")

    assert any(f.setting == "iq" and f.level == "warning" for f in wrong.findings)
    assert not any(f.setting == "iq" for f in right.findings)
    assert np.array_equal(right.cube.values, 1j * wrong.cube.values.conj())


def test_pauses_between_chirps_are_recognised(tmp_path):
    radar = make_radar(gap=GAP)
    parts = simulate_parts(gap=GAP).astype("<f4")
    parts.tofile(tmp_path / "with_pauses.cf32")
    np.ascontiguousarray(parts[:, :N]).tofile(tmp_path / "without.cf32")

    expected = parts[:, :N].astype(np.float64).view(complex).reshape(3, M, 1, N)
    for name, text in (("with_pauses", "with the pauses"), ("without", "without pauses")):
        recording = open_recording(tmp_path / f"{name}.cf32", radar=radar)
        assert np.array_equal(recording.cube.values, expected.astype(np.complex64))
        (finding,) = recording.findings
        assert f"assumed to be chirps {'one' if name == 'without' else 'with'}" in finding.value
        assert text in finding.value


def test_several_receivers_need_axis_names(tmp_path):
    file = tmp_path / "capture.cf32"
    parts = simulate_parts(2 * 2 * M).astype("<f4")
    parts.tofile(file)

    with pytest.raises(RecordingError, match="--axes frame,chirp,rx,sample"):
        open_recording(file, radar=make_radar(n_rx=2))
    recording = open_recording(file, radar=make_radar(n_rx=2), axes="frame,chirp,rx,sample")

    assert np.array_equal(recording.cube.real.values.ravel(), parts[..., 0].ravel())


@pytest.mark.parametrize(
    ("n_bytes", "message"),
    [(0, "an empty file"), (3, "only 3 bytes"), (4095, "511 complex samples")],
)
def test_too_short_file_is_refused(tmp_path, n_bytes, message):
    file = tmp_path / "capture.cf32"
    file.write_bytes(simulate_parts().astype("<f4").tobytes()[:n_bytes])

    with pytest.raises(RecordingError, match=message):
        open_recording(file, radar=make_radar())


def test_truncated_file_keeps_complete_frames_and_warns(tmp_path):
    file = tmp_path / "capture.cf32"
    file.write_bytes(simulate_parts().astype("<f4").tobytes()[:-9])

    recording = open_recording(file, radar=make_radar())

    assert recording.n_frames == 2
    assert any("cut short" in f.value for f in recording.findings)
    assert any("7 bytes after the last complete sample" in f.value for f in recording.findings)


def test_missing_settings_and_real_sampling_name_the_fix(tmp_path):
    file = tmp_path / "capture.cf32"
    simulate_parts().astype("<f4").tofile(file)

    with pytest.raises(RecordingError, match="--radar FILE"):
        open_recording(file)
    with pytest.raises(RecordingError, match="sampling: complex"):
        open_recording(file, radar=make_radar(sampling="real"))


def test_samples_that_are_not_finite_name_their_frame(tmp_path):
    file = tmp_path / "capture.cf32"
    parts = simulate_parts().astype("<f4")
    parts[M + 2, 3, 1] = np.nan
    parts.tofile(file)

    recording = open_recording(file, radar=make_radar())

    assert np.isfinite(next(recording.select_frames(0, 1).frames())).all()
    with pytest.raises(RecordingError, match="frame 1"):
        _ = recording.cube


@pytest.mark.parametrize("width", [3, 300, 3000, 12_000])
def test_words_of_converters_are_not_taken_for_floats(tmp_path, width):
    rng = np.random.default_rng(width)
    words = np.round(width * rng.standard_normal(8192)).clip(-32768, 32767).astype("<i2")
    for name, content in {"signed": words, "offset": words.astype("<i4") + 32768}.items():
        file = tmp_path / f"{name}.bin"
        content.astype("<u2").tofile(file)
        assert not holds_float32_numbers(file)
        assert "complex-samples" not in recognise_formats(file)


@given(junk=st.binary(max_size=200), position=st.integers(0, 12_000), length=st.integers(0, 12_288))
@settings(max_examples=n_examples(150), deadline=None)
def test_mutated_file_gives_finite_samples_or_error(tmp_path_factory, junk, position, length):
    content = bytearray(simulate_parts().astype("<f4").tobytes())
    content[position : position + len(junk)] = junk
    file = tmp_path_factory.mktemp("iq") / "capture.cf32"
    file.write_bytes(content[:length])
    try:
        cube = open_recording(file, radar=make_radar(gap=3)).cube
    except RecordingError:
        return
    assert np.isfinite(cube).all()
