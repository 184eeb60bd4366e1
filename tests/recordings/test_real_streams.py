"""Real captures, sent again or written again: what arrives is what the file holds."""

import threading
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
import xarray as xr

import dechirp as dc
from dechirp.recordings.live.replay import build_packet, iter_packets
from recordings.opened import opened
from sent import heard

ADDRESSES = bytes.fromhex("c0a821b4c0a8211e")  # of the board, and of the computer
PORT = (4098).to_bytes(2, "big")


@pytest.fixture(scope="module")
def pipe(real_data) -> tuple[Path, dict[str, object]]:
    """A second of an xWR1642, and how it is told: as ten frames of 100 chirps."""
    folder = real_data / "awr1642_vibrating_pipe"
    radar = opened(folder, "vibration_2.bin").radar
    tenth = replace(radar, frame=replace(radar.frame, n_chirps=100))
    return folder / "vibration_2.bin", {
        "radar": tenth,
        "settings": folder / "vibration_2_LogFile.txt",
    }


def test_a_capture_that_is_sent_again_comes_as_it_was_recorded(pipe):
    path, told = pipe

    frames, stream = heard(iter_packets(path), **told)

    same = list(dc.open(path, **told).frames())
    assert len(frames) == len(same) == 10
    for one, other in zip(frames, same, strict=True):
        xr.testing.assert_identical(one.drop_vars("gap"), other)
        assert not one.gap.any()
    assert not any(finding.level == "warning" for finding in stream.findings)


def test_a_capture_that_is_written_again_comes_as_it_was_recorded(pipe, tmp_path):
    path, told = pipe
    content, growing = path.read_bytes(), tmp_path / "growing.bin"
    growing.touch()
    stream = dc.follow(growing, **told, idle_s=20)

    def write() -> None:
        with growing.open("ab", buffering=0) as out:
            for start in range(0, len(content), 61_001):
                out.write(content[start : start + 61_001])

    writer = threading.Thread(target=write)
    writer.start()
    frames = list(islice(stream, 10))
    writer.join()

    for one, other in zip(frames, dc.open(path, **told).frames(), strict=True):
        xr.testing.assert_identical(one, other)


def test_the_packets_of_a_real_dca1000_are_those_that_are_replayed(real_data):
    """Counters and payloads of a capture from the cable, and the frame that they make."""
    recording = opened(real_data / "dca1000_pcap", "one_frame.pcap")
    file = (real_data / "dca1000_pcap" / "one_frame.pcap").read_bytes()
    datagrams = [part for part in file.split(ADDRESSES)[1:] if part[2:4] == PORT]
    sent = [one[8 : int.from_bytes(one[4:6], "big")] for one in datagrams]
    assert len(sent) == 12
    assert [build_packet(n, one[10:]) for n, one in enumerate(sent, 1)] == sent

    frames, _ = heard(sent, recording.radar, device="xwr1843", iq="qi")

    xr.testing.assert_identical(frames[0].drop_vars("gap"), recording.cube)
