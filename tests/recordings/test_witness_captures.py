"""Captures of strangers, opened without an option: samples and truth."""

import numpy as np
import pytest
import scipy.io

from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.recognise import find_recording_in_folder
from dechirp.recordings.recording import open as open_recording
from dechirp.results.object_lists.can_logs import read_can_log, write_can_log
from dechirp.results.object_lists.can_mapping import read_vendor_layout
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list
from dechirp.witnesses.comma_radar import _find_dbc, _read_frames


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


def decode_urad_triangle(files):
    """Return I + j Q of the up-ramps, (line, 200), scaled to -1 ... 1, of one or two files."""
    lines = [[line.split()[:-1] for line in file.read_text().splitlines()] for file in files]
    codes = np.concatenate([np.array(file_lines, np.int64) for file_lines in lines], axis=1)
    assert codes.shape[1] == 800
    return (codes[:, :200] + 1j * codes[:, 400:600]) * 2 / 4095 - (1 + 1j)


def test_urad_opens_with_times_without_decimal_point(witness_data):
    file = witness_data / "urad_sweeps" / "IQ_0_1024_sweeps.txt"

    samples = open_recording(file).cube.values.reshape(1024, 200)

    assert np.allclose(samples, decode_urad_triangle([file]), rtol=0, atol=3e-7)


@pytest.mark.parametrize("name", ["I_trolley_test.txt", "Q_trolley_test.txt"])
def test_urad_opens_i_and_q_in_two_files(witness_data, name):
    folder = witness_data / "urad_sweeps"

    recording = open_recording(folder / name)

    samples = recording.cube.values.reshape(344, 200)
    halves = [folder / "I_trolley_test.txt", folder / "Q_trolley_test.txt"]
    assert np.allclose(samples, decode_urad_triangle(halves), rtol=0, atol=3e-7)
    # The trolley moves from cell 34 of 512 to the radar and back to cell 31.
    spectra = abs(np.fft.fft(samples - samples.mean(axis=0), 512)[:, 4:100])
    peaks = spectra.argmax(axis=1) + 4
    assert np.median(peaks[40:50]) == pytest.approx(34, abs=2)
    assert np.median(peaks[160:180]) < 10
    assert np.median(peaks[315:335]) == pytest.approx(31, abs=1)
    # The mean interval of the times in the file.
    assert recording.radar.frame.single_interval_s == pytest.approx(14.582 / 343, rel=1e-3)


def test_people_counting_points_equal_those_of_matlab_file(witness_data):
    folder = witness_data / "people_counting"

    points = open_recording(folder).points

    history = scipy.io.loadmat(
        folder / "fHistScene4_0001.mat", struct_as_record=False, squeeze_me=True
    )["fHist"]
    expected = np.concatenate([np.reshape(frame.pointCloud, (4, -1)) for frame in history], axis=1)
    columns = [points[name].values for name in ("range", "azimuth", "velocity", "snr")]
    assert np.array_equal(columns, expected * np.array([[1], [-1], [1], [1]]))


@pytest.mark.parametrize("folder", ["ti_mmwavelib", "ti_gtrack"])
def test_test_vectors_are_not_taken_for_samples(witness_data, folder):
    with pytest.raises(RecordingError, match="test (vectors|data) of TI's"):
        find_recording_in_folder(witness_data / folder, None, RecordingHints())


def test_objects_of_a_car_return_from_frames_of_its_own_dbc(witness_data, tmp_path):
    """All values are whole steps of their signals, so writing and reading changes none."""
    pytest.importorskip("cantools")
    folder = witness_data / "comma2k19_radar"
    try:
        dbc = _find_dbc(folder)
    except FileNotFoundError as error:
        pytest.skip(f"missing: {error}")
    layout = read_vendor_layout(dbc, "toyota-adas")
    objects = assemble_vendor_list(_read_frames(folder), layout)
    options = {"dbc": dbc, "mapping": "toyota-adas"}
    write_can_log(objects, tmp_path / "log.asc", **options)
    result = read_can_log(tmp_path / "log.asc", **options)
    assert dict(result.sizes) == dict(objects.sizes) == {"object": 10_100, "cycle": 1200}
    for name in ("number", "x", "y", "vx", "vy"):
        received, expected = (
            rows[name].values[np.lexsort((rows["number"].values, rows["frame"].values))]
            for rows in (result, objects)
        )
        np.testing.assert_allclose(received, expected, rtol=0, atol=1e-9, err_msg=name)
