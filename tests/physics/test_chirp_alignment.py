"""Alignment of chirps that begin between two samples."""

import struct

import numpy as np
import pytest

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.mitigation.chirp_alignment import align_chirps
from dechirp.recordings.samples.continuous import chirp_start_offsets

RATE_HZ = 44_100


@pytest.mark.parametrize("frequency", [0.0, 0.01, 0.1, 0.3, 0.4])
@pytest.mark.parametrize("is_complex", [True, False])
def test_aligned_tone_equals_tone_sampled_later(frequency, is_complex):
    n, offsets = np.arange(400), np.array([-0.9, -0.5, -0.1, 0.0, 0.3, 0.7])

    def sample_tone(offset):
        tone = np.exp(2j * np.pi * frequency * (n + offset[:, None, None]) + 1j)
        return tone.astype(np.complex64) if is_complex else tone.real.astype(np.float32)

    aligned = align_chirps(sample_tone(np.zeros(6)), offsets)

    # Errors of the interpolation are 70 dB below the tone, and larger near the ends.
    error = np.abs(aligned - sample_tone(offsets))
    assert error[..., 12:-12].max() < 3e-4
    assert np.sqrt(np.mean(error**2)) < 0.15
    assert np.array_equal(aligned[3], sample_tone(offsets)[3])


def make_radar():
    chirp = dc.Chirp(
        start_frequency_hz=2.4e9,
        slope_hz_per_s=4e9,
        ramp_duration_s=20e-3,
        sample_rate_hz=RATE_HZ,
        n_samples=882,
        sampling="real",
    )
    return dc.Radar(frame=dc.Frame(chirp=chirp, n_chirps=1, interval_s=40.9e-3))


def write_sync_wav(path, radar, *, intervals, beats_hz):
    """Write beats of static echoes and the sync of ramps `intervals` sample intervals apart."""
    n = np.arange(round(66 * intervals))
    ramp, time = np.divmod(n - 100.3, intervals)
    is_up = (time < 890) & (ramp >= 0)
    beat = sum(0.2 * np.cos(2 * np.pi * f * time / RATE_HZ + f) for f in beats_hz) * is_up
    beat += np.random.default_rng(1).normal(0, 0.01, n.size)
    channels = np.stack([-beat, -np.where(is_up, 0.9, -0.9)], axis=1)
    data = np.round(channels * 32767).astype("<i2").tobytes()
    header = struct.pack("<HHIIHH", 1, 2, RATE_HZ, 4 * RATE_HZ, 4, 16)
    chunks = b"WAVEfmt " + struct.pack("<I", 16) + header + b"data" + struct.pack("<I", len(data))
    path.write_bytes(b"RIFF" + struct.pack("<I", len(chunks) + len(data)) + chunks + data)
    return path


def run_moving(path, radar, *, repairs_faults):
    source = RecordingSource(path=path, repair_faults=repairs_faults)
    result = dc.run(dc.Scenario(name="wav", radar=radar, recording=source))
    detections = result.detections
    return result, int((detections.moving == 1).sum()), int((abs(detections.velocity) > 0.3).sum())


def test_static_echoes_have_no_images_with_asynchronous_sound_card(tmp_path):
    radar = make_radar()
    # Every second ramp begins half an interval later after its first sample than the others.
    file = write_sync_wav(tmp_path / "a.wav", radar, intervals=1804.45, beats_hz=[3_000, 9_000])

    result, n_moving, n_fast = run_moving(file, radar, repairs_faults=True)
    _, n_images, n_fast_images = run_moving(file, radar, repairs_faults=False)

    assert n_images > 8 and n_fast_images > 8
    assert n_moving == n_fast == 0
    (note,) = [f for f in result.findings if "interpolated at equal times" in f.value]
    assert note.level == "note" and "repair_faults=false" in note.fix


def test_synchronous_chirps_stay_unchanged(tmp_path):
    radar = make_radar()
    file = write_sync_wav(tmp_path / "s.wav", radar, intervals=1804.0, beats_hz=[3_000])
    recording = dc.open(file, radar=radar)

    assert abs(recording.contents.start_offsets).max() < 1e-9
    frames = recording.cube.values[0]
    assert align_chirps(frames, recording.contents.start_offsets[0]) is frames


def test_offsets_of_continuous_chirps_are_rounding_errors_of_their_first_samples():
    frame = make_radar().frame
    offsets = chirp_start_offsets(frame, 5)

    # 40.9 ms are 1803.69 sample intervals.
    assert np.allclose(offsets[:, 0], [0, -0.31, 0.38, 0.07, -0.24], atol=1e-9)
