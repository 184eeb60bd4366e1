"""Captures of strangers, opened without an option: samples and truth."""

import numpy as np
import pytest

from dechirp.recordings.recording import open as open_recording


def test_iwr1843_opens_with_lists_of_one_as_plain_objects(witness_data):
    recording = open_recording(witness_data / "iwr1843_reflectors" / "1_Raw_0.bin")

    # Two lanes: I of two samples, then Q of them, one receiver after the other.
    words = np.fromfile(recording.path, "<i2").reshape(20, 3, 4, 256, 2, 2)
    samples = (words[..., 0, :] + 1j * words[..., 1, :]).reshape(20, 3, 4, 512)
    assert np.array_equal(recording.cube.values * 2**15, samples)
    assert recording.contents.device == "xwr1843"
    assert recording.findings == ()
    # The author states 0.17 m before the correction of an offset; a cell is 0.042 m wide.
    spectra = np.fft.fft(samples * np.hanning(512))
    peak = np.argmax((abs(spectra) ** 2).mean(axis=(0, 1, 2)))
    assert recording.radar.frame.chirp.range_bins_m(512)[peak] == pytest.approx(0.17, abs=0.021)
