"""Captures of TI radars: sample layouts, packet headers, lost packets, split and damaged files.

The encoders follow TI's application report SWRA581 and the documentation of the recorders word
by word, independently of the readers.
"""

import itertools
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from dechirp.core.errors import RecordingError
from dechirp.experiments.run import run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.dca1000 import _scan_packet_headers
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.samples.layouts import SampleCode, TwoLanes
from dechirp.recordings.settings.read import find_settings_file, read_settings
from dechirp.recordings.streams.byte_sources import open_concatenated_files
from dechirp.recordings.streams.packets import (
    assemble_packet_payloads,
    wrap_scan_to_return_packet_runs,
)
from dechirp.recordings.streams.scan import scan_file_in_windows
from dechirp.simulation.adc_codes import has_adc_codes
from formats.corruption import assert_cube_or_error, corrupted_bytes
from nightly import n_examples, nightly, nightly_except

RADAR = Radar(
    frame=Frame(
        chirp=Chirp(
            start_frequency_hz=77e9,
            slope_hz_per_s=30e12,
            ramp_duration_s=30e-6,
            sample_rate_hz=10e6,
            n_samples=64,
            sampling="complex",
        ),
        n_chirps=8,
        interval_s=50e-6,
    ),
    array=Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(4))),
)
N_FRAMES = 3


def draw_codes(seed: int = 1, radar: Radar = RADAR, n_frames: int = N_FRAMES) -> np.ndarray:
    """Draw random ADC codes, (frame, chirp, rx, sample, part)."""
    shape = (n_frames, radar.frame.n_chirps, radar.array.n_rx, radar.frame.chirp.n_samples, 2)
    return np.random.default_rng(seed).integers(-32768, 32768, shape).astype(np.int16)


def scale_samples(numbers: np.ndarray) -> np.ndarray:
    return ((numbers[..., 0] + 1j * numbers[..., 1]) / 32768).astype(np.complex64)


def encode_two_lanes(numbers: np.ndarray, *, q_first: bool = False) -> bytes:
    """Encode chirps, then receivers, then groups of two samples: A0 A1 B0 B1."""
    words = []
    a, b = (1, 0) if q_first else (0, 1)
    for chirp in numbers.reshape(-1, *numbers.shape[2:]):
        for rx in chirp:
            for n in range(0, len(rx), 2):
                words += [rx[n][a], rx[n + 1][a], rx[n][b], rx[n + 1][b]]
    return np.array(words, "<i2").tobytes()


def encode_four_lanes(numbers: np.ndarray, receivers: tuple[int, ...] = (0, 1, 2, 3)) -> bytes:
    """Encode per sample I of four receivers, then Q; inactive receivers are zero."""
    words = []
    for chirp in numbers.reshape(-1, *numbers.shape[2:]):
        for n in range(chirp.shape[1]):
            for part in (0, 1):
                lanes = [0, 0, 0, 0]
                for k, lane in enumerate(receivers):
                    lanes[lane] = chirp[k][n][part]
                words += lanes
    return np.array(words, "<i2").tobytes()


def encode_pairs(numbers: np.ndarray) -> bytes:
    """Encode samples, then receivers, then I and Q."""
    receivers_last = np.moveaxis(numbers.reshape(-1, *numbers.shape[2:]), 1, 2)
    return np.ascontiguousarray(receivers_last.astype("<i2")).tobytes()


def split_packets(stream: bytes) -> list[tuple[int, int, bytes]]:
    """Split a stream into packets: number, byte offset and payload."""
    return [
        (number, start, stream[start : start + 1456])
        for number, start in enumerate(range(0, len(stream), 1456), start=1)
    ]


def encode_with_headers(packets: list[tuple[int, int, bytes]]) -> bytes:
    return b"".join(
        struct.pack("<II", number, len(payload)) + start.to_bytes(6, "little") + payload
        for number, start, payload in packets
    )


def encode_udp(payload: bytes, *, port: int = 4098, tag: bytes = b"") -> bytes:
    """Encode an Ethernet frame that contains a UDP packet."""
    datagram = struct.pack(">HHHH", 4096, port, 8 + len(payload), 0) + payload
    ip_header = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(datagram), 7, 0x4000, 64, 17, 0)
    return (
        b"\x12" * 12
        + tag
        + b"\x08\x00"
        + ip_header
        + b"\xc0\xa8\x21\xb4\xc0\xa8\x21\x1e"
        + datagram
    )


def encode_sample_packet(packet: tuple[int, int, bytes]) -> bytes:
    number, start, payload = packet
    return encode_udp(struct.pack("<I", number) + start.to_bytes(6, "little") + payload)


def encode_pcap(frames: list[bytes], *, order: str = "<", snap: int = 65535) -> bytes:
    file_header = struct.pack(f"{order}IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, snap, 1)
    return file_header + b"".join(
        struct.pack(f"{order}IIII", 0, 0, len(frame[:snap]), len(frame)) + frame[:snap]
        for frame in frames
    )


def encode_pcapng(frames: list[bytes], *, order: str = "<", snap: int = 65535) -> bytes:
    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = 12 + len(body)
        return struct.pack(f"{order}II", kind, size) + body + struct.pack(f"{order}I", size)

    section = block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    interface = block(1, struct.pack(f"{order}HHI", 1, 0, snap))
    comment = block(0x0BAD, b"an unknown block")
    packets = [
        block(6, struct.pack(f"{order}5I", 0, 0, 0, len(f[:snap]), len(f)) + f[:snap])
        for f in frames
    ]
    return section + interface + comment + b"".join(packets)


def open_capture(path: Path, content: bytes, **options) -> Recording:
    path.write_bytes(content)
    return open_recording(path, **{"radar": RADAR, "iq": "iq", **options})


def list_levels(recording: Recording) -> list[tuple[str, str]]:
    return [(finding.level, finding.setting) for finding in recording.findings]


@pytest.mark.parametrize("iq", ["iq", "qi"])
def test_two_lane_samples_are_sequential_by_receiver(tmp_path, iq):
    numbers = draw_codes()

    recording = open_capture(
        tmp_path / "x.bin", encode_two_lanes(numbers, q_first=iq == "qi"), device="xwr1642", iq=iq
    )

    assert recording.format == "dca1000"
    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))


def test_four_lane_samples_are_interleaved_by_receiver(tmp_path):
    numbers = draw_codes()

    recording = open_capture(
        tmp_path / "x.bin", encode_four_lanes(numbers), device="xwr1443", format="dca1000"
    )

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))


def test_real_samples_decode_in_both_layouts(tmp_path):
    chirp = replace(RADAR.frame.chirp, sampling="real")
    radar = replace(RADAR, frame=replace(RADAR.frame, chirp=chirp))
    numbers = draw_codes()[..., 0]
    interleaved_codes = np.swapaxes(numbers, 2, 3)

    sequential_recording = open_capture(
        tmp_path / "a.bin", numbers.tobytes(), radar=radar, device="xwr1642", iq=None
    )
    interleaved_recording = open_capture(
        tmp_path / "b.bin",
        np.ascontiguousarray(interleaved_codes).tobytes(),
        radar=radar,
        device="xwr1443",
        iq=None,
        format="dca1000",
    )

    for recording in (sequential_recording, interleaved_recording):
        np.testing.assert_array_equal(recording.cube.values, (numbers / 32768).astype(np.float32))


def test_split_capture_is_joined_in_numeric_order(tmp_path):
    # Eleven parts that end within frames; _10 precedes _2 in alphabetic order.
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=2))
    numbers = draw_codes(radar=radar, n_frames=12)
    content = encode_two_lanes(numbers)
    part = len(content) // 11 // 4 * 4 + 4
    assert part % 4096 != 0
    for n in range(11):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(content[n * part : (n + 1) * part])

    recording = open_recording(tmp_path / "adc_data_0.bin", radar=radar, device="xwr1642", iq="iq")

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    assert "11 files of one capture" in str(recording.findings)


def test_complete_captures_are_not_joined(tmp_path):
    numbers = draw_codes()
    for n in range(2):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(encode_two_lanes(numbers))

    recording = open_recording(tmp_path / "adc_data_0.bin", radar=RADAR, device="xwr1642", iq="iq")

    assert recording.n_frames == N_FRAMES


def test_packet_headers_are_removed(tmp_path):
    numbers = draw_codes()

    recording = open_capture(
        tmp_path / "adc_data_Raw_0.bin",
        encode_with_headers(split_packets(encode_two_lanes(numbers))),
        device="xwr1642",
    )

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    assert "gap" not in recording.cube.coords


@pytest.mark.parametrize("container", [encode_with_headers, "pcap", "pcapng"])
def test_lost_packets_are_gaps_and_other_samples_exact(tmp_path, container):
    numbers = draw_codes()
    packets = split_packets(encode_two_lanes(numbers))
    lost_numbers = [3, 4, 9]
    received_packets = [packet for packet in packets if packet[0] not in lost_numbers]
    if container == "pcap":
        content = encode_pcap([encode_sample_packet(packet) for packet in received_packets])
    elif container == "pcapng":
        content = encode_pcapng([encode_sample_packet(packet) for packet in received_packets])
    else:
        content = container(received_packets)

    recording = open_capture(tmp_path / "x.bin", content, device="xwr1642")

    # Each chirp has 4 x 64 x 4 bytes.
    is_lost = np.zeros(numbers.nbytes, bool)
    for number in lost_numbers:
        is_lost[(number - 1) * 1456 : number * 1456] = True
    chirp_losses = is_lost.reshape(N_FRAMES, RADAR.frame.n_chirps, -1)
    np.testing.assert_array_equal(recording.cube.gap.values, chirp_losses.any(axis=-1))
    stream = encode_two_lanes(numbers)
    words = np.where(is_lost, 0, np.frombuffer(stream, np.uint8)).astype(np.uint8)
    groups = words.view("<i2").reshape(*numbers.shape[:3], -1, 2, 2)
    expected = np.swapaxes(groups, -1, -2).reshape(numbers.shape)
    np.testing.assert_array_equal(recording.cube.values, scale_samples(expected))
    one_frame = next(iter(recording.frames()))
    np.testing.assert_array_equal(one_frame.gap.values[0], chirp_losses.any(axis=-1)[0])
    (warning,) = [f for f in recording.findings if "lost" in f.value]
    assert "4368 bytes lost in 2 ranges" in warning.value
    assert warning.level == "warning"


def test_packets_are_sorted_by_counter(tmp_path):
    numbers = draw_codes()
    packets = split_packets(encode_two_lanes(numbers))
    packets[2], packets[5] = packets[5], packets[2]
    packets.insert(8, packets[7])
    foreign_packets = [
        encode_udp(b"\x5a\xa5\x09\x00\x00\x00\xaa\xee", port=4096),
        b"\xff" * 60,
        b"",
    ]
    tagged_packet = encode_udp(
        struct.pack("<I", packets[0][0]) + bytes(6) + packets[0][2], tag=b"\x81\x00\x00\x05"
    )
    frames = [
        *foreign_packets,
        tagged_packet,
        *[encode_sample_packet(packet) for packet in packets[1:]],
        *foreign_packets,
    ]

    for order in "<>":
        for container in (encode_pcap, encode_pcapng):
            recording = open_capture(
                tmp_path / "x.cap", container(frames, order=order), device="xwr1642"
            )
            np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
            findings = str(recording.findings)
            assert "out of order" in findings
            assert "duplicate packets" in findings


@pytest.mark.parametrize(
    "first_packets", [(1, 0), (0, 0, 1)], ids=["swapped-packets", "repeated-packet"]
)
def test_recognises_headers_after_swapped_or_repeated_packets(tmp_path, first_packets):
    numbers = draw_codes()
    packets = split_packets(encode_two_lanes(numbers))
    content = encode_with_headers([packets[index] for index in first_packets] + packets[2:])

    recording = open_capture(tmp_path / "adc_data_Raw_0.bin", content, device="xwr1642")

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))


@pytest.mark.parametrize("cuts", [(10, 11), (4.25, 9.004), (9.996, 12.5)])
def test_capture_with_headers_may_be_split_anywhere(tmp_path, cuts):
    numbers = draw_codes()
    content = encode_with_headers(split_packets(encode_two_lanes(numbers)))
    ends = [0, *(round(1470 * cut) for cut in cuts), len(content)]
    for n, (start, end) in enumerate(itertools.pairwise(ends)):
        (tmp_path / f"adc_data_Raw_{n}.bin").write_bytes(content[start:end])
    options = {"radar": RADAR, "device": "xwr1642", "iq": "iq"}

    recording = open_recording(tmp_path / "adc_data_Raw_0.bin", **options)

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    assert [level for level, _ in list_levels(recording)] == ["note"]
    assert "3 files of one capture" in str(recording.findings)


def test_captures_with_restarted_counters_are_not_joined(tmp_path):
    content = encode_with_headers(split_packets(encode_two_lanes(draw_codes())))
    for n in range(2):
        (tmp_path / f"adc_data_Raw_{n}.bin").write_bytes(content)
    options = {"radar": RADAR, "device": "xwr1642", "iq": "iq"}

    assert open_recording(tmp_path / "adc_data_Raw_0.bin", **options).n_frames == N_FRAMES


def test_part_of_split_capture_gives_finding(tmp_path):
    content = encode_two_lanes(draw_codes(n_frames=5))
    n_bytes = len(content) // 2 + 8
    for n in range(2):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(content[n * n_bytes : (n + 1) * n_bytes])

    part = open_recording(tmp_path / "adc_data_1.bin", radar=RADAR, device="xwr1642", iq="iq")

    assert "open adc_data_0.bin" in str(part.findings)


def test_rejects_packets_of_two_boards(tmp_path):
    packet_pairs = zip(
        *(split_packets(encode_two_lanes(draw_codes(seed))) for seed in (1, 2)), strict=True
    )
    content = encode_pcap(
        [encode_sample_packet(packet) for pair in packet_pairs for packet in pair]
    )

    with pytest.raises(RecordingError, match="17 of 17 compared differ"):
        open_capture(tmp_path / "x.pcap", content, device="xwr1642")


def test_wrong_packet_counter_damages_no_other_packet(tmp_path):
    numbers = draw_codes()
    packets = split_packets(encode_two_lanes(numbers))
    packets[5] = (packets[5][0], packets[3][1], packets[5][2])

    recording = open_capture(
        tmp_path / "x.pcap",
        encode_pcap([encode_sample_packet(packet) for packet in packets]),
        device="xwr1642",
    )

    is_lost = recording.cube.gap.values
    np.testing.assert_array_equal(recording.cube.values[~is_lost], scale_samples(numbers)[~is_lost])
    assert "1 of 1 compared differ" in str(recording.findings)


def test_late_capture_starts_with_partial_frame(tmp_path):
    numbers = draw_codes(n_frames=6)
    packets = split_packets(encode_two_lanes(numbers))
    frame_bytes = numbers[0].nbytes
    late_packets = [packet for packet in packets if packet[1] > 2.5 * frame_bytes]

    recording = open_capture(
        tmp_path / "x.pcap",
        encode_pcap([encode_sample_packet(packet) for packet in late_packets]),
        device="xwr1642",
    )

    assert recording.n_frames == 4
    assert recording.cube.gap.values[0].any()
    assert not recording.cube.gap.values[1:].any()
    np.testing.assert_array_equal(recording.cube.values[1:], scale_samples(numbers[3:]))


def test_late_capture_layout_is_detected_in_complete_frame(tmp_path):
    # The first captured frame lacks all but its last chirp.
    numbers = np.concatenate([simulate_echoes(), simulate_echoes()])
    packets = split_packets(encode_four_lanes(numbers[..., ::-1]))
    late_packets = [packet for packet in packets if packet[1] > 2.8 * numbers[0].nbytes]

    recording = open_capture(
        tmp_path / "x.pcap",
        encode_pcap([encode_sample_packet(packet) for packet in late_packets]),
        iq=None,
    )

    np.testing.assert_array_equal(recording.cube.values[1:], scale_samples(numbers[3:]))
    n_lost_bytes = late_packets[0][1] - 2 * numbers[0].nbytes
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert f"{n_lost_bytes} bytes lost in 1 ranges" in warning.value


def test_second_capture_in_file_is_ignored_with_finding(tmp_path):
    numbers, second_codes = draw_codes(1), draw_codes(2)
    frames = [
        encode_sample_packet(p)
        for n in (numbers, second_codes)
        for p in split_packets(encode_two_lanes(n))
    ]

    recording = open_capture(tmp_path / "x.pcap", encode_pcap(frames), device="xwr1642")

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    assert "2 captures" in str(recording.findings)


def test_rejects_jumping_counters_before_allocation(tmp_path):
    packets = split_packets(encode_two_lanes(draw_codes()))
    packets[-1] = (packets[-1][0], 2**47, packets[-1][2])

    with pytest.raises(RecordingError, match="counters span"):
        open_capture(
            tmp_path / "x.pcap", encode_pcap([encode_sample_packet(packet) for packet in packets])
        )


def test_rejects_capture_of_commands_only(tmp_path):
    with pytest.raises(RecordingError, match="no packets of samples"):
        open_capture(
            tmp_path / "x.pcap",
            encode_pcap([encode_udp(b"\x5a\xa5\x09\x00\x00\x00\xaa\xee", port=4096)]),
        )


@pytest.mark.parametrize("container", [encode_pcap, encode_pcapng])
def test_snap_length_losses_are_gaps_with_warning(tmp_path, container):
    numbers = draw_codes()
    packets = split_packets(encode_two_lanes(numbers))
    frames = [encode_sample_packet(packet) for packet in packets]
    # Each packet but the short last one keeps 52 bytes of headers (14 + 20 + 8 + 10) and 1348.
    assert len(frames[-1]) < 1400

    recording = open_capture(tmp_path / "x.cap", container(frames, snap=1400), device="xwr1642")

    byte_index = np.arange(numbers.nbytes)
    is_lost = (byte_index % 1456 >= 1348) & (byte_index < 1456 * (len(packets) - 1))
    chirp_losses = is_lost.reshape(N_FRAMES, RADAR.frame.n_chirps, -1).any(axis=-1)
    np.testing.assert_array_equal(recording.cube.gap.values, chirp_losses)
    (finding,) = [finding for finding in recording.findings if "snap" in finding.value]
    assert finding.level == "warning"
    assert f"{len(packets) - 1} packets" in finding.value
    assert "snap length of 1400 bytes" in finding.value


@pytest.mark.parametrize("container", [encode_pcap, encode_pcapng])
@pytest.mark.parametrize("snap", [40, 96, 1400])
def test_rejects_capture_without_complete_packets(tmp_path, container, snap):
    packets = split_packets(encode_two_lanes(draw_codes()))[:-1]
    content = container([encode_sample_packet(packet) for packet in packets], snap=snap)

    with pytest.raises(RecordingError) as error:
        open_capture(tmp_path / "x.cap", content, device="xwr1642")

    (mistake,) = error.value.mistakes
    assert f"{len(packets)} packets captured with a snap length of {snap} bytes" in mistake.value
    assert "capture whole packets" in mistake.fix


def test_complete_short_packet_does_not_hide_snap_length(tmp_path):
    *packets, last_packet = split_packets(encode_two_lanes(draw_codes()))
    packets.append((*last_packet[:2], last_packet[2][:40]))
    content = encode_pcap([encode_sample_packet(packet) for packet in packets], snap=96)

    with pytest.raises(RecordingError, match="snap length of 96 bytes"):
        open_capture(tmp_path / "x.cap", content, device="xwr1642")


def test_rejects_capture_without_packets(tmp_path):
    with pytest.raises(RecordingError, match="no packets of samples"):
        open_capture(tmp_path / "x.pcap", encode_pcap([]))


@pytest.mark.parametrize("n_lost", [400, 3])
def test_truncated_file_gives_complete_frames_with_finding(tmp_path, n_lost):
    content = encode_two_lanes(draw_codes())[:-n_lost]

    recording = open_capture(tmp_path / "x.bin", content, device="xwr1642")

    assert recording.n_frames == N_FRAMES - 1
    assert "cut short" in str(recording.findings)


def test_recognises_offset_binary_by_codes(tmp_path):
    numbers = draw_codes() // 8  # a signal well below full scale
    content = (np.frombuffer(encode_pairs(numbers), "<i2").astype(np.int32) + 32768).astype("<u2")

    recording = open_capture(tmp_path / "x.dat", content.tobytes())

    assert recording.format == "tsw1400"
    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))


def test_offset_binary_has_the_four_lanes_of_the_card_where_no_array_is_given(tmp_path):
    numbers = draw_codes() // 8
    content = (np.frombuffer(encode_pairs(numbers), "<i2").astype(np.int32) + 32768).astype("<u2")

    recording = open_capture(
        tmp_path / "x.dat", content.tobytes(), radar=replace(RADAR, array=Array())
    )

    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    (note,) = (finding for finding in recording.findings if finding.setting == "radar.array.rx")
    assert note.value == "4 receivers at unknown positions, assumed half a wavelength apart along y"


@pytest.mark.parametrize("options", [{"device": "xwr1443", "format": "dca1000"},
                                  {"format": "tsw1400"}])  # fmt: skip
def test_rejects_more_receivers_than_layout_holds(tmp_path, options):
    radar_8_rx = replace(RADAR, array=Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(8))))

    with pytest.raises(RecordingError, match="8 receivers.*expected at most 4 receivers"):
        open_capture(tmp_path / "x.bin", encode_pairs(draw_codes()), radar=radar_8_rx, **options)


def test_missing_receiver_count_gives_warning(tmp_path):
    radar_without_array = Radar(frame=RADAR.frame)

    recording = open_capture(
        tmp_path / "x.bin",
        encode_two_lanes(draw_codes()),
        radar=radar_without_array,
        device=None,
    )

    assert recording.sizes["frame"] == 4 * N_FRAMES  # one receiver is assumed
    assert ("warning", "radar.array.rx") in list_levels(recording)


@pytest.mark.parametrize("in_file", [False, True])
def test_board_without_array_uses_all_receivers_of_board(tmp_path, in_file):
    radar = Radar(frame=RADAR.frame)
    if in_file:
        (tmp_path / "radar.yaml").write_text(dump_yaml(radar, omitted_settings=["array"]))
    codes = draw_codes()

    recording = open_capture(
        tmp_path / "x.bin",
        encode_two_lanes(codes),
        radar=tmp_path / "radar.yaml" if in_file else radar,
        device="xwr1642",
        iq="iq",
    )

    assert recording.radar.array == known_device("xwr1642").select_antennas(1, 0b1111)
    assert np.array_equal(recording.cube.values, scale_samples(codes))
    assert ("note", "radar.array") in list_levels(recording)


def test_settings_without_array_use_as_many_transmitters_of_board_as_take_turns(tmp_path):
    chirp = RADAR.frame.chirp
    frame = Frame(chirp=chirp, n_chirps=4, interval_s=50e-6, multiplexing=Tdm(order=(1, 0)))
    board = known_device("xwr6843aop")
    radar = Radar(frame=frame, array=board.select_antennas(0b11, 0b1111))
    (tmp_path / "radar.yaml").write_text(dump_yaml(radar, omitted_settings=["array"]))

    settings = read_settings(tmp_path / "radar.yaml", board)

    assert settings.radar == replace(radar, calibration=board.sign_calibration(0b11, 0b1111))
    # A file with an array keeps it.
    (tmp_path / "radar.yaml").write_text(dump_yaml(radar))
    assert read_settings(tmp_path / "radar.yaml", known_device("xwr1843")).radar == radar


SUB_FRAME_CFG = """\
% Platform:xWR18xx
dfeDataOutputMode 3
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 0 1 1
profileCfg 0 77 10 6 60 0 0 30 1 64 5000 0 0 30
profileCfg 1 76 20 6 40 0 0 60 1 32 4000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 1 0 0 0 0 5
chirpCfg 2 2 1 0 0 0 0 5
bpmCfg 1 1 1 2
advFrameCfg 2 0 0 1 0
subFrameCfg 0 0 0 1 6 50 0 1 1 50
subFrameCfg 1 0 1 2 4 30 0 1 1 30
sensorStart
"""


def draw_sub_frames(n_frames: int = 3) -> tuple[list[np.ndarray], bytes]:
    """Draw the codes of both sub-frames, (frame, chirp, rx, sample, part), and their bytes."""
    generator = np.random.default_rng(7)
    codes = [
        generator.integers(-(2**15), 2**15, (n_frames, n_chirps, 4, n_samples, 2)).astype(np.int16)
        for n_chirps, n_samples in ((6, 64), (8, 32))
    ]
    frames = (
        encode_two_lanes(sub_frame[index : index + 1])
        for index in range(n_frames)
        for sub_frame in codes
    )
    return codes, b"".join(frames)


def test_each_sub_frame_is_a_recording(tmp_path):
    codes, content = draw_sub_frames()
    (tmp_path / "adc_data.bin").write_bytes(content)
    (tmp_path / "adc_data.cfg").write_text(SUB_FRAME_CFG)

    for name, sub_frame in (("adc_data.bin", 0), ("adc_data.bin/0", 0), ("adc_data.bin/1", 1),
                            ("adc_data.bin/subframe1", 1)):  # fmt: skip
        recording = open_recording(tmp_path / name)
        assert np.array_equal(recording.cube.values, scale_samples(codes[sub_frame]))
        assert ("note", "recording") in list_levels(recording)
    assert recording.radar.frame.multiplexing == Bpm(order=(0, 1))
    for name in ("2", "x"):
        with pytest.raises(RecordingError, match="expected a number from 0 to 1"):
            open_recording(tmp_path / "adc_data.bin" / name)


def test_name_of_sub_frame_is_refused_without_sub_frames(tmp_path):
    (tmp_path / "x.bin").write_bytes(encode_two_lanes(draw_codes()))

    with pytest.raises(RecordingError, match="frames of a single sub-frame"):
        open_recording(tmp_path / "x.bin" / "1", radar=RADAR, format="dca1000")


def test_lost_packets_mark_chirps_of_their_sub_frame(tmp_path):
    codes, content = draw_sub_frames()
    packets = split_packets(content)
    # Frames have 6 chirps of 1024 bytes and 8 of 512: packet 2 is bytes 2912 to 4367.
    lost = packets.pop(2)
    assert lost[1] == 2912
    (tmp_path / "adc_Raw_0.bin").write_bytes(encode_with_headers(packets))
    (tmp_path / "adc.cfg").write_text(SUB_FRAME_CFG)

    first, second = (open_recording(tmp_path / "adc_Raw_0.bin" / name) for name in "01")

    assert np.flatnonzero(first.cube.gap.values).tolist() == [2, 3, 4]
    assert "gap" not in second.cube.coords
    assert np.array_equal(second.cube.values, scale_samples(codes[1]))
    packets = split_packets(content)
    lost = packets.pop(6)  # bytes 8736 to 10191: 2592 to 4047 of the second sub-frame
    (tmp_path / "adc_Raw_0.bin").write_bytes(encode_with_headers(packets))
    first, second = (open_recording(tmp_path / "adc_Raw_0.bin" / name) for name in "01")
    assert np.flatnonzero(second.cube.gap.values).tolist() == [5, 6, 7]
    assert "gap" not in first.cube.coords


def test_12_bit_codes_are_full_scale_with_and_without_sign_extension(tmp_path):
    numbers = np.array([[[-2048, 2047], [1, -1]]], np.int16)
    for words in (numbers, numbers & 0x0FFF):
        out = np.empty((1, 1, 2), np.complex64)
        groups = np.array([[words[0, 0, 0], words[0, 1, 0], words[0, 0, 1], words[0, 1, 1]]])
        TwoLanes().decode(groups.astype(np.int16), out, SampleCode(bits=12))
        np.testing.assert_array_equal(out[0, 0], scale_samples(numbers * 16)[0])


def write_cascade(
    folder: Path, numbers: np.ndarray, radar: Radar, *, n_listed_frames: int | None = None
) -> None:
    """Write four chips, each with samples (frame, chirp, sample, rx, I and Q) and a frame list."""
    for index, name in enumerate(("master", "slave1", "slave2", "slave3")):
        chip_samples = numbers[:, :, 4 * index : 4 * index + 4]
        (folder / f"{name}_0000_data.bin").write_bytes(encode_pairs(chip_samples))
        n_frames = len(numbers) if n_listed_frames is None else n_listed_frames
        index_header = struct.pack("<4IQ", 1, 1, 0, n_frames, chip_samples.nbytes)
        (folder / f"{name}_0000_idx.bin").write_bytes(index_header + bytes(48 * n_frames))


@pytest.fixture(scope="session")
def cascade_radar() -> Radar:
    board = known_device("cascade")
    frame = replace(RADAR.frame, n_chirps=2, multiplexing=Tdm(order=tuple(range(12))))
    return Radar(frame=frame, array=board.select_antennas(0xFFF, 0xFFFF))


def test_four_cascade_chips_form_one_cube(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    shape = (N_FRAMES, frame.n_chirps_total, 16, frame.chirp.n_samples, 2)
    numbers = np.random.default_rng(3).integers(-999, 999, shape).astype(np.int16)
    write_cascade(tmp_path, numbers, cascade_radar)

    for path in (tmp_path, tmp_path / "slave2_0000_data.bin"):
        recording = open_recording(path, radar=cascade_radar, iq="iq")

        assert recording.format == "ti-cascade"
        np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
        assert recording.cube.transmitter.values[:13].tolist() == [*range(12), 0]
        assert has_adc_codes(recording.cube)


def test_cascade_reports_settings_file_and_device(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    write_cascade(tmp_path, numbers, cascade_radar)
    settings_file = tmp_path / "capture.yaml"
    settings_file.write_text(dump_yaml(cascade_radar))

    contents = open_recording(tmp_path, radar=settings_file, device="cascade", iq="iq").contents

    assert (contents.settings_path, contents.device) == (settings_file, "cascade")


def test_all_cascade_chips_share_iq_order(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    shape = (1, frame.n_chirps_total, 16, frame.chirp.n_samples)
    tone = np.exp(2j * np.pi * 0.2 * np.arange(frame.chirp.n_samples))
    beat = np.broadcast_to(tone, shape).copy()
    beat[:, :, 8:12] = beat[:, :, 8:12].conj()  # noise alone can give such a spectrum
    numbers = (999 * np.stack([beat.real, beat.imag], axis=-1)).astype(np.int16)
    write_cascade(tmp_path, numbers, cascade_radar)

    recording = open_recording(tmp_path, radar=cascade_radar)

    assert recording.contents.iq == "iq"
    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))


def test_rejects_cascade_chip_behind_link(tmp_path, cascade_radar):
    folder, external_file = tmp_path / "capture", tmp_path / "elsewhere.bin"
    folder.mkdir()
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    write_cascade(folder, numbers, cascade_radar)
    (folder / "slave1_0000_data.bin").rename(external_file)
    (folder / "slave1_0000_data.bin").symlink_to(external_file)

    with pytest.raises(RecordingError, match="slave1_0000_data.bin is a link"):
        open_recording(folder, radar=cascade_radar, iq="iq")


def test_rejects_cascade_with_missing_chip(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    write_cascade(tmp_path, numbers, cascade_radar)
    (tmp_path / "slave1_0000_data.bin").unlink()

    with pytest.raises(RecordingError, match="slave1_0000_data"):
        open_recording(tmp_path, radar=cascade_radar, iq="iq")


def simulate_echoes(seed: int = 5) -> np.ndarray:
    """Simulate codes of two targets at two angles in noise, (frame, chirp, rx, sample, part)."""
    n = np.arange(RADAR.frame.chirp.n_samples)
    left_tone, right_tone = (np.exp(2j * np.pi * bin / n.size * n) for bin in (7.3, 15.6))
    rng = np.random.default_rng(seed)
    shape = (N_FRAMES, RADAR.frame.n_chirps, 4, n.size)
    rx = np.arange(4)[:, None]
    tones = 3000 * np.exp(1.1j * rx) * left_tone + 2500 * np.exp(-2.0j * rx) * right_tone
    noise = 100 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    beat = tones + noise
    return np.stack([beat.real, beat.imag], axis=-1).round().astype(np.int16)


@pytest.mark.parametrize("iq", ["iq", "qi"])
@pytest.mark.parametrize(
    ("encode", "kind", "message"),
    [(encode_two_lanes, "dca1000", "two lanes"), (encode_four_lanes, "dca1000", "four lanes"),
     (encode_pairs, "xwr14xx-capture", "")],
)  # fmt: skip
def test_echoes_determine_layout_and_iq_order(tmp_path, encode, kind, message, iq):
    numbers = simulate_echoes()
    stored_codes = numbers if iq == "iq" else numbers[..., ::-1]

    recording = open_capture(tmp_path / "capture", encode(stored_codes), iq=None)

    assert recording.format == kind
    assert recording.contents.iq == iq
    assert message in str(recording.findings)
    np.testing.assert_array_equal(recording.cube.values, scale_samples(numbers))
    assert not [str(f) for f in recording.findings if f.level == "warning"]


def test_wrong_iq_order_gives_warning(tmp_path):
    recording = open_capture(
        tmp_path / "x.bin", encode_two_lanes(simulate_echoes()), device="xwr1642", iq="qi"
    )

    assert ("warning", "iq") in list_levels(recording)


def encode_valid_captures() -> dict[str, bytes]:
    """Encode a valid capture of each kind."""
    stream = encode_two_lanes(draw_codes())
    packets = split_packets(stream)
    return {
        "bare.bin": stream,
        "headers.bin": encode_with_headers(packets),
        "network.pcap": encode_pcap([encode_sample_packet(packet) for packet in packets]),
        "network.pcapng": encode_pcapng([encode_sample_packet(packet) for packet in packets]),
    }


@pytest.mark.parametrize("name", nightly_except(2, encode_valid_captures()))
@settings(max_examples=n_examples(150))
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, name, data):
    file = tmp_path_factory.mktemp("damaged") / name
    file.write_bytes(data.draw(corrupted_bytes(encode_valid_captures()[name])))

    assert_cube_or_error(file, radar=RADAR, iq="iq")


@settings(max_examples=n_examples(200))
@given(
    signature=st.sampled_from([b"", b"\xd4\xc3\xb2\xa1", b"\x0a\x0d\x0d\x0a"]), content=st.binary()
)
def test_random_bytes_give_cube_or_error(tmp_path_factory, signature, content):
    file = tmp_path_factory.mktemp("any") / "capture"
    file.write_bytes(signature + content)

    assert_cube_or_error(file, radar=RADAR)


@settings(max_examples=n_examples(50))
@given(data=st.data())
def test_corrupted_cascade_gives_cube_or_error(tmp_path_factory, cascade_radar, data):
    folder = tmp_path_factory.mktemp("cascade")
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    write_cascade(folder, numbers, cascade_radar)
    file = folder / data.draw(st.sampled_from(sorted(entry.name for entry in folder.iterdir())))
    file.write_bytes(data.draw(corrupted_bytes(file.read_bytes())))

    assert_cube_or_error(folder, radar=cascade_radar, iq="iq")


@nightly
@pytest.mark.usefixtures("without_figures")
def test_changed_radar_keeps_sample_layout(tmp_path, monkeypatch, capsys):
    """Cover receivers 1 and 3: setting the frame period must not select receivers 1 and 2."""
    settings = (
        "% Platform:xWR14xx\nchannelCfg 5 1 0\nadcCfg 2 1\nadcbufCfg 0 0 0 1\n"
        "profileCfg 0 77 20 6 30 0 0 30 1 64 10000 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\n"
        "frameCfg 0 0 32 3 50 1 0\nsensorStart\n"
    )
    rng = np.random.default_rng(2)
    tone = 3000 * np.exp(2j * np.pi * 0.2 * np.arange(64))
    shape = (3, 32, 2, 64)
    beat = tone + 100 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    numbers = np.stack([beat.real, beat.imag], axis=-1).round().astype(np.int16)
    (tmp_path / "capture.cfg").write_text(settings)
    (tmp_path / "capture.bin").write_bytes(encode_four_lanes(numbers, (0, 2)))
    monkeypatch.chdir(tmp_path)

    detections = []
    arguments = ["run", "capture.bin", "--format", "dca1000", "--json"]
    for changes in ([], ["--set", "radar.frame.period=60 ms"]):
        for radar in ([], ["--radar", "capture.cfg"]):
            with pytest.raises(SystemExit) as exit_info:
                main([*arguments, *changes, *radar])
            assert exit_info.value.code == 0
            detections.append(json.loads(capsys.readouterr().out)["detections"])
            with pytest.raises(SystemExit):
                main(["run", "dechirp-run/scenario.yaml", "--json", "--out", "again"])
            assert json.loads(capsys.readouterr().out)["detections"] == detections[-1]

    strengths = [[round(row["snr_db"], 6) for row in rows] for rows in detections]
    assert strengths == [strengths[0]] * 4
    assert len(detections[0]) == 3


def test_finds_studio_settings_by_capture_name(tmp_path):
    (tmp_path / "adc_data_Raw_0.bin").write_bytes(
        encode_with_headers(split_packets(encode_two_lanes(draw_codes())))
    )
    yaml = Path(__file__).parents[2] / "examples" / "radar.yaml"
    for name in ("adc_data_settings.yaml", "other.yaml"):
        (tmp_path / name).write_text(yaml.read_text())

    assert find_settings_file(tmp_path / "adc_data_Raw_0.bin").name == "adc_data_settings.yaml"


def test_rejects_run_of_points_without_samples(tmp_path):
    stream = bytes.fromhex("0201040306050807") + struct.pack("<8I", 1, 40, 0xA1843, 7, 0, 0, 0, 0)
    (tmp_path / "points.dat").write_bytes(stream * 2)

    with pytest.raises(RecordingError, match="contains detections without samples"):
        run(Scenario(recording=RecordingSource(path=str(tmp_path / "points.dat"))))


@pytest.mark.parametrize("lost_numbers", [[], [5], [5, 6, 20]])
def test_packet_index_size_grows_with_losses_only(tmp_path, lost_numbers):
    stream = encode_two_lanes(draw_codes(n_frames=12))
    received_packets = [packet for packet in split_packets(stream) if packet[0] not in lost_numbers]
    file = tmp_path / "adc_data_Raw_0.bin"
    file.write_bytes(encode_with_headers(received_packets))

    runs, _ = scan_file_in_windows(file, wrap_scan_to_return_packet_runs(_scan_packet_headers), 0)
    packets, findings = assemble_packet_payloads(file, open_concatenated_files(file), runs)

    # One run before each gap, one up to the end, and one for the shorter last packet.
    n_gaps = sum(number - 1 not in lost_numbers for number in lost_numbers)
    assert len(packets.starts) == n_gaps + 2
    assert int(packets.counts.sum()) == len(received_packets)
    assert findings == ()
    for start, stop in ((0, len(stream)), (1455, 1457), (2912, 2913), (7000, 9000)):
        part = np.empty(stop - start, np.uint8)
        packets.read(start, part)
        expected = np.frombuffer(stream, np.uint8).copy()
        for number in lost_numbers:
            expected[(number - 1) * 1456 : number * 1456] = 0
        np.testing.assert_array_equal(part, expected[start:stop])
