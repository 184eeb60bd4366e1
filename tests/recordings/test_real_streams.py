"""Real captures, replayed as packets or followed as growing files."""

import threading
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
import xarray as xr

import dechirp as dc
from dechirp.recordings.live.replay import build_dca1000_packet, iter_file_as_packets
from recordings.real_recordings import open_real_recording
from udp_packets import receive_packets

ADDRESSES = bytes.fromhex("c0a821b4c0a8211e")  # board and computer
PORT = (4098).to_bytes(2, "big")


@pytest.fixture(scope="module")
def pipe_capture(real_data) -> tuple[Path, dict[str, object]]:
    """Return a capture of 1 s of an xWR1642, and options that divide it into ten frames."""
    folder = real_data / "awr1642_vibrating_pipe"
    radar = open_real_recording(folder, "vibration_2.bin").radar
    radar_100_chirps = replace(radar, frame=replace(radar.frame, n_chirps=100))
    return folder / "vibration_2.bin", {
        "radar": radar_100_chirps,
        "settings": folder / "vibration_2_LogFile.txt",
    }


def test_replayed_capture_equals_recording(pipe_capture):
    path, options = pipe_capture

    frames, stream = receive_packets(iter_file_as_packets(path), **options)

    recorded_frames = list(dc.open(path, **options).frames())
    assert len(frames) == len(recorded_frames) == 10
    for received_frame, recorded_frame in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(received_frame.drop_vars("gap"), recorded_frame)
        assert not received_frame.gap.any()
    assert not any(finding.level == "warning" for finding in stream.findings)


def test_followed_growing_capture_equals_recording(pipe_capture, tmp_path):
    path, options = pipe_capture
    content, growing_file = path.read_bytes(), tmp_path / "growing.bin"
    growing_file.touch()
    stream = dc.follow(growing_file, **options, idle_s=20)

    def write_in_parts() -> None:
        with growing_file.open("ab", buffering=0) as out:
            for start in range(0, len(content), 61_001):
                out.write(content[start : start + 61_001])

    writer = threading.Thread(target=write_in_parts)
    writer.start()
    frames = list(islice(stream, 10))
    writer.join()

    for followed_frame, recorded_frame in zip(
        frames, dc.open(path, **options).frames(), strict=True
    ):
        xr.testing.assert_identical(followed_frame, recorded_frame)


def test_replayed_packets_equal_packets_of_real_dca1000(real_data):
    """Compare counters and payloads with a captured packet stream, and the resulting frame."""
    recording = open_real_recording(real_data / "dca1000_pcap", "one_frame.pcap")
    file = (real_data / "dca1000_pcap" / "one_frame.pcap").read_bytes()
    datagrams = [part for part in file.split(ADDRESSES)[1:] if part[2:4] == PORT]
    packets = [datagram[8 : int.from_bytes(datagram[4:6], "big")] for datagram in datagrams]
    assert len(packets) == 12
    assert [
        build_dca1000_packet(n, datagram[10:]) for n, datagram in enumerate(packets, 1)
    ] == packets

    frames, _ = receive_packets(packets, recording.radar, device="xwr1843", iq="qi")

    xr.testing.assert_identical(frames[0].drop_vars("gap"), recording.cube)
