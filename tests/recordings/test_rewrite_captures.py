"""Real captures of TI radars, rewritten as DCA1000 captures with unchanged codes."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.recordings.convert import write
from recordings.real_recordings import open_real_recording


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_rewritten_xwr1642_capture_has_equal_bytes(real_data, tmp_path, name):
    file = real_data / "awr1642_vibrating_pipe" / f"{name}.bin"

    paths = write(open_real_recording(file.parent, file.name), tmp_path / "x.bin")

    assert paths[0].read_bytes() == file.read_bytes()
    assert dc.open(paths[0]).radar == dc.open(file).radar


def test_rewritten_xwr1843_capture_holds_packet_payloads(real_data, tmp_path):
    folder = real_data / "dca1000_pcap"
    content = (folder / "one_frame.pcap").read_bytes()

    paths = write(open_real_recording(folder, "one_frame.pcap"), tmp_path / "x.bin")

    words = paths[0].read_bytes()
    assert len(words) == 4 * 4 * 256 * 4  # chirps, receivers, samples, bytes
    payloads = [words[start : start + 1456] for start in range(0, len(words), 1456)]
    assert all(payload in content for payload in payloads)


@pytest.mark.parametrize(
    ("folder", "name", "chip"),
    [
        ("xwr1443_known_angles", "az_30.raw", "xwr1443"),
        ("xwr1443_known_angles", "az_10_1GHz.raw", "xwr1443"),
        ("awr1243_interference", "20180613-190347.bin", "xwr1843"),
        ("dca1000_pcap", "one_frame.pcap", "xwr1843"),
    ],
)
def test_captures_of_other_recorders_keep_every_code(real_data, tmp_path, folder, name, chip):
    recording = open_real_recording(real_data / folder, name)

    write(recording, tmp_path / "x.bin")

    copy = dc.open(tmp_path / "x.bin")
    np.testing.assert_array_equal(copy.cube.values, recording.cube.values)
    assert copy.cube.attrs["scale"] == 2.0**-15
    assert copy.radar == recording.radar
    assert copy.contents.device == chip
    write(copy, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "x.bin").read_bytes()
