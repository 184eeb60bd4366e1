"""Real recordings in the variants that other recorders write, with equal samples."""

import wave

import numpy as np

from dechirp.recordings.recording import open as open_recording
from recordings.real_recordings import KTH


def test_walker_with_exchanged_channels_has_equal_chirps(real_data, tmp_path):
    file = real_data / "kth_walker" / "single_target_range.wav"
    exchanged = tmp_path / "exchanged.wav"
    with wave.open(str(file)) as original, wave.open(str(exchanged), "wb") as copy:
        copy.setparams(original.getparams())
        samples = np.frombuffer(original.readframes(original.getnframes()), "<i2").reshape(-1, 2)
        copy.writeframes(samples[:, ::-1].tobytes())

    expected, recording = (open_recording(path, radar=KTH) for path in (file, exchanged))

    assert np.array_equal(recording.cube.values, expected.cube.values)
    assert any("the sync is in channel 1" in finding.value for finding in recording.findings)


def test_people_are_timed_by_the_stamps_beside_the_samples(real_data):
    folder = real_data / "bgt60_people_room" / "RadarIfxAvian_00"
    times = np.loadtxt(folder / "radar_timestamp.csv")

    recording = open_recording(folder)

    # Times of today in float64 have steps of 0.24 us.
    assert np.allclose(recording.cube.frame, times - times[0], rtol=0, atol=1e-6)
    # A tenth of a second is up to 31 ms wrong.
    assert abs(recording.cube.frame.values - 0.1 * np.arange(154)).max() > 0.03
