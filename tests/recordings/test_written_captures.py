"""Real captures of TI radars, written again as captures: every code is as the chip gave it."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.recordings.convert import write
from recordings.opened import opened


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_a_capture_of_an_xwr1642_is_written_byte_by_byte_as_it_was(real_data, tmp_path, name):
    file = real_data / "awr1642_vibrating_pipe" / f"{name}.bin"

    written = write(opened(file.parent, file.name), tmp_path / "x.bin")

    assert written[0].read_bytes() == file.read_bytes()
    assert dc.open(written[0]).radar == dc.open(file).radar


def test_a_capture_of_the_packets_of_an_xwr1843_holds_their_payloads(real_data, tmp_path):
    folder = real_data / "dca1000_pcap"
    content = (folder / "one_frame.pcap").read_bytes()

    written = write(opened(folder, "one_frame.pcap"), tmp_path / "x.bin")

    words = written[0].read_bytes()
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
    recording = opened(real_data / folder, name)

    write(recording, tmp_path / "x.bin")

    back = dc.open(tmp_path / "x.bin")
    np.testing.assert_array_equal(back.cube.values, recording.cube.values)
    assert back.cube.attrs["scale"] == 2.0**-15
    assert back.radar == recording.radar
    assert back.contents.device == chip
    write(back, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "x.bin").read_bytes()
