"""Captures of TI radars: every byte is a sample of one receiver at one instant, or marked lost.

The writers here put the samples down one word after the other, as TI's application report
SWRA581 and the descriptions of the recorders say, without looking at the readers.
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
from dechirp.config.dumping import dump
from dechirp.core.errors import RecordingError
from dechirp.experiments.run import run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.dca1000 import _scan_packet_headers
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.samples.layouts import SampleCode, TwoLanes
from dechirp.recordings.settings.read import find_settings
from dechirp.recordings.streams.byte_sources import open_files
from dechirp.recordings.streams.packets import assemble_packets, to_run_step
from dechirp.recordings.streams.scan import scan_file
from dechirp.simulation.adc_codes import has_adc_codes
from formats.any_bytes import damaged, gives_a_cube_or_says_why

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


def codes(seed: int = 1, radar: Radar = RADAR, n_frames: int = N_FRAMES) -> np.ndarray:
    """Codes of a converter, (frame, chirp, rx, sample, part)."""
    shape = (n_frames, radar.frame.n_chirps, radar.array.n_rx, radar.frame.chirp.n_samples, 2)
    return np.random.default_rng(seed).integers(-32768, 32768, shape).astype(np.int16)


def samples_of(numbers: np.ndarray) -> np.ndarray:
    return ((numbers[..., 0] + 1j * numbers[..., 1]) / 32768).astype(np.complex64)


def two_lanes(numbers: np.ndarray, *, q_first: bool = False) -> bytes:
    """Chirp after chirp, receiver after receiver, two samples a group: A0 A1 B0 B1."""
    words = []
    a, b = (1, 0) if q_first else (0, 1)
    for chirp in numbers.reshape(-1, *numbers.shape[2:]):
        for rx in chirp:
            for n in range(0, len(rx), 2):
                words += [rx[n][a], rx[n + 1][a], rx[n][b], rx[n + 1][b]]
    return np.array(words, "<i2").tobytes()


def four_lanes(numbers: np.ndarray, receivers: tuple[int, ...] = (0, 1, 2, 3)) -> bytes:
    """Sample after sample: I of four receivers, then Q of four; those that are off are zero."""
    words = []
    for chirp in numbers.reshape(-1, *numbers.shape[2:]):
        for n in range(chirp.shape[1]):
            for part in (0, 1):
                lanes = [0, 0, 0, 0]
                for k, lane in enumerate(receivers):
                    lanes[lane] = chirp[k][n][part]
                words += lanes
    return np.array(words, "<i2").tobytes()


def pairs(numbers: np.ndarray) -> bytes:
    """Sample after sample, receiver after receiver, I and Q."""
    turned = np.moveaxis(numbers.reshape(-1, *numbers.shape[2:]), 1, 2)
    return np.ascontiguousarray(turned.astype("<i2")).tobytes()


def packets_of(stream: bytes) -> list[tuple[int, int, bytes]]:
    """Number, bytes before and payload of each packet of a stream."""
    return [
        (number, start, stream[start : start + 1456])
        for number, start in enumerate(range(0, len(stream), 1456), start=1)
    ]


def with_headers(packets: list[tuple[int, int, bytes]]) -> bytes:
    return b"".join(
        struct.pack("<II", number, len(payload)) + start.to_bytes(6, "little") + payload
        for number, start, payload in packets
    )


def udp(payload: bytes, *, port: int = 4098, tag: bytes = b"") -> bytes:
    """An Ethernet frame with a UDP packet in it."""
    datagram = struct.pack(">HHHH", 4096, port, 8 + len(payload), 0) + payload
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(datagram), 7, 0x4000, 64, 17, 0)
    return b"\x12" * 12 + tag + b"\x08\x00" + head + b"\xc0\xa8\x21\xb4\xc0\xa8\x21\x1e" + datagram


def samples_in(packet: tuple[int, int, bytes]) -> bytes:
    number, start, payload = packet
    return udp(struct.pack("<I", number) + start.to_bytes(6, "little") + payload)


def pcap(frames: list[bytes], *, order: str = "<", snap: int = 65535) -> bytes:
    head = struct.pack(f"{order}IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, snap, 1)
    return head + b"".join(
        struct.pack(f"{order}IIII", 0, 0, len(frame[:snap]), len(frame)) + frame[:snap]
        for frame in frames
    )


def pcapng(frames: list[bytes], *, order: str = "<", snap: int = 65535) -> bytes:
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


def opened(path: Path, content: bytes, **told) -> Recording:
    path.write_bytes(content)
    return open_recording(path, **{"radar": RADAR, "iq": "iq", **told})


def levels(recording: Recording) -> list[tuple[str, str]]:
    return [(finding.level, finding.setting) for finding in recording.findings]


@pytest.mark.parametrize("iq", ["iq", "qi"])
def test_two_lanes_hold_the_receivers_one_after_the_other(tmp_path, iq):
    numbers = codes()

    recording = opened(
        tmp_path / "x.bin", two_lanes(numbers, q_first=iq == "qi"), device="xwr1642", iq=iq
    )

    assert recording.format == "dca1000"
    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))


def test_four_lanes_hold_the_receivers_in_turn(tmp_path):
    numbers = codes()

    recording = opened(tmp_path / "x.bin", four_lanes(numbers), device="xwr1443", format="dca1000")

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))


def test_real_samples_have_no_second_part(tmp_path):
    chirp = replace(RADAR.frame.chirp, sampling="real")
    radar = replace(RADAR, frame=replace(RADAR.frame, chirp=chirp))
    numbers = codes()[..., 0]
    in_turn = np.swapaxes(numbers, 2, 3)

    one_by_one = opened(
        tmp_path / "a.bin", numbers.tobytes(), radar=radar, device="xwr1642", iq=None
    )
    alternating = opened(
        tmp_path / "b.bin",
        np.ascontiguousarray(in_turn).tobytes(),
        radar=radar,
        device="xwr1443",
        iq=None,
        format="dca1000",
    )

    for recording in (one_by_one, alternating):
        np.testing.assert_array_equal(recording.cube.values, (numbers / 32768).astype(np.float32))


def test_a_split_capture_is_joined_in_the_order_of_its_numbers(tmp_path):
    # Eleven parts, which do not end where frames end; by name, _10 would come before _2.
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=2))
    numbers = codes(radar=radar, n_frames=12)
    content = two_lanes(numbers)
    part = len(content) // 11 // 4 * 4 + 4
    assert part % 4096 != 0
    for n in range(11):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(content[n * part : (n + 1) * part])

    recording = open_recording(tmp_path / "adc_data_0.bin", radar=radar, device="xwr1642", iq="iq")

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
    assert "11 files of one capture" in str(recording.findings)


def test_captures_that_are_whole_by_themselves_are_not_joined(tmp_path):
    numbers = codes()
    for n in range(2):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(two_lanes(numbers))

    recording = open_recording(tmp_path / "adc_data_0.bin", radar=RADAR, device="xwr1642", iq="iq")

    assert recording.n_frames == N_FRAMES


def test_headers_of_packets_are_taken_out(tmp_path):
    numbers = codes()

    recording = opened(
        tmp_path / "adc_data_Raw_0.bin",
        with_headers(packets_of(two_lanes(numbers))),
        device="xwr1642",
    )

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
    assert "gap" not in recording.cube.coords


@pytest.mark.parametrize("container", [with_headers, "pcap", "pcapng"])
def test_lost_packets_are_marked_in_the_cube_and_all_else_is_exact(tmp_path, container):
    numbers = codes()
    packets = packets_of(two_lanes(numbers))
    lost = [3, 4, 9]
    kept = [packet for packet in packets if packet[0] not in lost]
    if container == "pcap":
        content = pcap([samples_in(packet) for packet in kept])
    elif container == "pcapng":
        content = pcapng([samples_in(packet) for packet in kept])
    else:
        content = container(kept)

    recording = opened(tmp_path / "x.bin", content, device="xwr1642")

    # A byte is lost with its packet; a chirp has 4 x 64 x 4 bytes.
    is_lost = np.zeros(numbers.nbytes, bool)
    for number in lost:
        is_lost[(number - 1) * 1456 : number * 1456] = True
    of_chirps = is_lost.reshape(N_FRAMES, RADAR.frame.n_chirps, -1)
    np.testing.assert_array_equal(recording.cube.gap.values, of_chirps.any(axis=-1))
    kept_words = two_lanes(numbers)
    words = np.where(is_lost, 0, np.frombuffer(kept_words, np.uint8)).astype(np.uint8)
    groups = words.view("<i2").reshape(*numbers.shape[:3], -1, 2, 2)
    expected = np.swapaxes(groups, -1, -2).reshape(numbers.shape)
    np.testing.assert_array_equal(recording.cube.values, samples_of(expected))
    one_frame = next(iter(recording.frames()))
    np.testing.assert_array_equal(one_frame.gap.values[0], of_chirps.any(axis=-1)[0])
    (warning,) = [f for f in recording.findings if "lost" in f.value]
    assert "4368 bytes lost in 2 ranges" in warning.value
    assert warning.level == "warning"


def test_packets_are_sorted_by_their_counters_not_by_arrival(tmp_path):
    numbers = codes()
    packets = packets_of(two_lanes(numbers))
    packets[2], packets[5] = packets[5], packets[2]
    packets.insert(8, packets[7])
    other = [udp(b"\x5a\xa5\x09\x00\x00\x00\xaa\xee", port=4096), b"\xff" * 60, b""]
    tagged = udp(
        struct.pack("<I", packets[0][0]) + bytes(6) + packets[0][2], tag=b"\x81\x00\x00\x05"
    )
    frames = [*other, tagged, *[samples_in(packet) for packet in packets[1:]], *other]

    for order in "<>":
        for container in (pcap, pcapng):
            recording = opened(tmp_path / "x.cap", container(frames, order=order), device="xwr1642")
            np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
            said = str(recording.findings)
            assert "out of order" in said
            assert "duplicate packets" in said


@pytest.mark.parametrize("first", [(1, 0), (0, 0, 1)], ids=["exchanged", "twice"])
def test_headers_are_known_whatever_became_of_the_first_two_packets(tmp_path, first):
    numbers = codes()
    packets = packets_of(two_lanes(numbers))
    content = with_headers([packets[place] for place in first] + packets[2:])

    recording = opened(tmp_path / "adc_data_Raw_0.bin", content, device="xwr1642")

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))


@pytest.mark.parametrize("cuts", [(10, 11), (4.25, 9.004), (9.996, 12.5)])
def test_a_capture_with_headers_may_be_split_anywhere(tmp_path, cuts):
    numbers = codes()
    content = with_headers(packets_of(two_lanes(numbers)))
    ends = [0, *(round(1470 * cut) for cut in cuts), len(content)]
    for n, (start, end) in enumerate(itertools.pairwise(ends)):
        (tmp_path / f"adc_data_Raw_{n}.bin").write_bytes(content[start:end])
    told = {"radar": RADAR, "device": "xwr1642", "iq": "iq"}

    recording = open_recording(tmp_path / "adc_data_Raw_0.bin", **told)

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
    assert [level for level, _ in levels(recording)] == ["note"]
    assert "3 files of one capture" in str(recording.findings)


def test_captures_with_headers_that_begin_anew_are_not_joined(tmp_path):
    content = with_headers(packets_of(two_lanes(codes())))
    for n in range(2):
        (tmp_path / f"adc_data_Raw_{n}.bin").write_bytes(content)
    told = {"radar": RADAR, "device": "xwr1642", "iq": "iq"}

    assert open_recording(tmp_path / "adc_data_Raw_0.bin", **told).n_frames == N_FRAMES


def test_a_part_of_a_split_capture_by_itself_is_pointed_out(tmp_path):
    content = two_lanes(codes(n_frames=5))
    half = len(content) // 2 + 8
    for n in range(2):
        (tmp_path / f"adc_data_{n}.bin").write_bytes(content[n * half : (n + 1) * half])

    part = open_recording(tmp_path / "adc_data_1.bin", radar=RADAR, device="xwr1642", iq="iq")

    assert "open adc_data_0.bin" in str(part.findings)


def test_two_boards_in_one_capture_are_not_mixed(tmp_path):
    both = zip(*(packets_of(two_lanes(codes(seed))) for seed in (1, 2)), strict=True)
    content = pcap([samples_in(packet) for pair in both for packet in pair])

    with pytest.raises(RecordingError, match="17 of 17 compared differ"):
        opened(tmp_path / "x.pcap", content, device="xwr1642")


def test_one_packet_whose_counter_is_wrong_costs_no_other(tmp_path):
    numbers = codes()
    packets = packets_of(two_lanes(numbers))
    packets[5] = (packets[5][0], packets[3][1], packets[5][2])

    recording = opened(
        tmp_path / "x.pcap", pcap([samples_in(packet) for packet in packets]), device="xwr1642"
    )

    is_lost = recording.cube.gap.values
    np.testing.assert_array_equal(recording.cube.values[~is_lost], samples_of(numbers)[~is_lost])
    assert "1 of 1 compared differ" in str(recording.findings)


def test_a_capture_that_joins_late_begins_with_the_frame_that_it_joined(tmp_path):
    numbers = codes(n_frames=6)
    packets = packets_of(two_lanes(numbers))
    frame_bytes = numbers[0].nbytes
    late = [packet for packet in packets if packet[1] > 2.5 * frame_bytes]

    recording = opened(
        tmp_path / "x.pcap", pcap([samples_in(packet) for packet in late]), device="xwr1642"
    )

    assert recording.n_frames == 4
    assert recording.cube.gap.values[0].any()
    assert not recording.cube.gap.values[1:].any()
    np.testing.assert_array_equal(recording.cube.values[1:], samples_of(numbers[3:]))


def test_a_capture_that_joins_late_is_judged_by_a_whole_frame(tmp_path):
    # Of the first frame that it joined, all but the last chirp are lost.
    numbers = np.concatenate([echoes(), echoes()])
    packets = packets_of(four_lanes(numbers[..., ::-1]))
    late = [packet for packet in packets if packet[1] > 2.8 * numbers[0].nbytes]

    recording = opened(tmp_path / "x.pcap", pcap([samples_in(packet) for packet in late]), iq=None)

    np.testing.assert_array_equal(recording.cube.values[1:], samples_of(numbers[3:]))
    lost = late[0][1] - 2 * numbers[0].nbytes
    (warning,) = [finding for finding in recording.findings if finding.level == "warning"]
    assert f"{lost} bytes lost in 1 ranges" in warning.value


def test_a_second_capture_in_one_file_is_left_out(tmp_path):
    numbers, more = codes(1), codes(2)
    frames = [samples_in(p) for n in (numbers, more) for p in packets_of(two_lanes(n))]

    recording = opened(tmp_path / "x.pcap", pcap(frames), device="xwr1642")

    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
    assert "2 captures" in str(recording.findings)


def test_counters_that_jump_are_refused_before_memory_is_taken(tmp_path):
    packets = packets_of(two_lanes(codes()))
    packets[-1] = (packets[-1][0], 2**47, packets[-1][2])

    with pytest.raises(RecordingError, match="counters span"):
        opened(tmp_path / "x.pcap", pcap([samples_in(packet) for packet in packets]))


def test_a_capture_of_commands_alone_has_no_samples(tmp_path):
    with pytest.raises(RecordingError, match="no packets of samples"):
        opened(tmp_path / "x.pcap", pcap([udp(b"\x5a\xa5\x09\x00\x00\x00\xaa\xee", port=4096)]))


@pytest.mark.parametrize("container", [pcap, pcapng])
def test_what_a_snap_length_cut_off_is_lost_and_pointed_out(tmp_path, container):
    numbers = codes()
    packets = packets_of(two_lanes(numbers))
    frames = [samples_in(packet) for packet in packets]
    # Of each packet but the last, which is short, 14 + 20 + 8 + 10 bytes of headers and 1348.
    assert len(frames[-1]) < 1400

    recording = opened(tmp_path / "x.cap", container(frames, snap=1400), device="xwr1642")

    place = np.arange(numbers.nbytes)
    is_lost = (place % 1456 >= 1348) & (place < 1456 * (len(packets) - 1))
    of_chirps = is_lost.reshape(N_FRAMES, RADAR.frame.n_chirps, -1).any(axis=-1)
    np.testing.assert_array_equal(recording.cube.gap.values, of_chirps)
    (said,) = [finding for finding in recording.findings if "snap" in finding.value]
    assert said.level == "warning"
    assert f"{len(packets) - 1} packets" in said.value
    assert "snap length of 1400 bytes" in said.value


@pytest.mark.parametrize("container", [pcap, pcapng])
@pytest.mark.parametrize("snap", [40, 96, 1400])
def test_a_capture_without_a_whole_packet_is_refused_for_its_snap_length(tmp_path, container, snap):
    packets = packets_of(two_lanes(codes()))[:-1]
    content = container([samples_in(packet) for packet in packets], snap=snap)

    with pytest.raises(RecordingError) as error:
        opened(tmp_path / "x.cap", content, device="xwr1642")

    (mistake,) = error.value.mistakes
    assert f"{len(packets)} packets captured with a snap length of {snap} bytes" in mistake.value
    assert "capture whole packets" in mistake.fix


def test_one_short_packet_that_is_whole_does_not_hide_a_snap_length(tmp_path):
    *packets, last = packets_of(two_lanes(codes()))
    packets.append((*last[:2], last[2][:40]))
    content = pcap([samples_in(packet) for packet in packets], snap=96)

    with pytest.raises(RecordingError, match="snap length of 96 bytes"):
        opened(tmp_path / "x.cap", content, device="xwr1642")


def test_a_capture_of_nothing_but_its_header_has_no_samples(tmp_path):
    with pytest.raises(RecordingError, match="no packets of samples"):
        opened(tmp_path / "x.pcap", pcap([]))


def test_a_cut_file_gives_its_whole_frames_and_says_so(tmp_path):
    numbers = codes()

    recording = opened(tmp_path / "x.bin", two_lanes(numbers)[:-400], device="xwr1642")

    assert recording.n_frames == N_FRAMES - 1
    assert "cut short" in str(recording.findings)


def test_offset_binary_is_known_by_its_codes(tmp_path):
    numbers = codes() // 8  # a signal well below full scale
    content = (np.frombuffer(pairs(numbers), "<i2").astype(np.int32) + 32768).astype("<u2")

    recording = opened(tmp_path / "x.dat", content.tobytes())

    assert recording.format == "tsw1400"
    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))


@pytest.mark.parametrize("told", [{"device": "xwr1443", "format": "dca1000"},
                                  {"format": "tsw1400"}])  # fmt: skip
def test_more_receivers_than_have_room_in_a_sample_are_refused(tmp_path, told):
    eight = replace(RADAR, array=Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(8))))

    with pytest.raises(RecordingError, match="8 receivers.*expected at most 4 receivers"):
        opened(tmp_path / "x.bin", pairs(codes()), radar=eight, **told)


def test_receivers_that_nobody_told_are_asked_for(tmp_path):
    untold = Radar(frame=RADAR.frame)

    recording = opened(tmp_path / "x.bin", two_lanes(codes()), radar=untold, device="xwr1642")

    assert recording.sizes["frame"] == 4 * N_FRAMES  # of one receiver: it cannot be known
    assert ("warning", "radar.array.rx") in levels(recording)


def test_twelve_bits_in_a_word_are_full_scale_whether_their_sign_was_extended_or_not(tmp_path):
    numbers = np.array([[[-2048, 2047], [1, -1]]], np.int16)
    for words in (numbers, numbers & 0x0FFF):
        out = np.empty((1, 1, 2), np.complex64)
        groups = np.array([[words[0, 0, 0], words[0, 1, 0], words[0, 0, 1], words[0, 1, 1]]])
        TwoLanes().decode(groups.astype(np.int16), out, SampleCode(bits=12))
        np.testing.assert_array_equal(out[0, 0], samples_of(numbers * 16)[0])


def cascade(folder: Path, numbers: np.ndarray, radar: Radar, *, n_told: int | None = None) -> None:
    """Four chips, each with (frame, chirp, sample, rx, I and Q) and a list of its frames."""
    for index, name in enumerate(("master", "slave1", "slave2", "slave3")):
        own = numbers[:, :, 4 * index : 4 * index + 4]
        (folder / f"{name}_0000_data.bin").write_bytes(pairs(own))
        n_frames = len(numbers) if n_told is None else n_told
        head = struct.pack("<4IQ", 1, 1, 0, n_frames, own.nbytes)
        (folder / f"{name}_0000_idx.bin").write_bytes(head + bytes(48 * n_frames))


@pytest.fixture(scope="session")
def cascade_radar() -> Radar:
    board = known_device("cascade")
    frame = replace(RADAR.frame, n_chirps=2, multiplexing=Tdm(order=tuple(range(12))))
    return Radar(frame=frame, array=board.select_antennas(0xFFF, 0xFFFF))


def test_four_chips_of_a_cascade_are_one_cube(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    shape = (N_FRAMES, frame.n_chirps_total, 16, frame.chirp.n_samples, 2)
    numbers = np.random.default_rng(3).integers(-999, 999, shape).astype(np.int16)
    cascade(tmp_path, numbers, cascade_radar)

    for path in (tmp_path, tmp_path / "slave2_0000_data.bin"):
        recording = open_recording(path, radar=cascade_radar, iq="iq")

        assert recording.format == "ti-cascade"
        np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
        assert recording.cube.transmitter.values[:13].tolist() == [*range(12), 0]
        assert has_adc_codes(recording.cube)


def test_a_cascade_says_which_file_told_how_its_samples_lie(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    cascade(tmp_path, numbers, cascade_radar)
    told = tmp_path / "capture.yaml"
    told.write_text(dump(cascade_radar))

    held = open_recording(tmp_path, radar=told, device="cascade", iq="iq").contents

    assert (held.settings_path, held.device) == (told, "cascade")


def test_the_parts_of_a_sample_have_one_order_in_all_chips_of_a_cascade(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    shape = (1, frame.n_chirps_total, 16, frame.chirp.n_samples)
    tone = np.exp(2j * np.pi * 0.2 * np.arange(frame.chirp.n_samples))
    beat = np.broadcast_to(tone, shape).copy()
    beat[:, :, 8:12] = beat[:, :, 8:12].conj()  # what noise alone may look like
    numbers = (999 * np.stack([beat.real, beat.imag], axis=-1)).astype(np.int16)
    cascade(tmp_path, numbers, cascade_radar)

    recording = open_recording(tmp_path, radar=cascade_radar)

    assert recording.contents.iq == "iq"
    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))


def test_a_chip_of_a_cascade_may_not_lie_elsewhere(tmp_path, cascade_radar):
    folder, elsewhere = tmp_path / "capture", tmp_path / "elsewhere.bin"
    folder.mkdir()
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    cascade(folder, numbers, cascade_radar)
    (folder / "slave1_0000_data.bin").rename(elsewhere)
    (folder / "slave1_0000_data.bin").symlink_to(elsewhere)

    with pytest.raises(RecordingError, match="slave1_0000_data.bin is a link"):
        open_recording(folder, radar=cascade_radar, iq="iq")


def test_a_cascade_without_one_of_its_chips_is_refused(tmp_path, cascade_radar):
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    cascade(tmp_path, numbers, cascade_radar)
    (tmp_path / "slave1_0000_data.bin").unlink()

    with pytest.raises(RecordingError, match="slave1_0000_data"):
        open_recording(tmp_path, radar=cascade_radar, iq="iq")


def echoes(seed: int = 5) -> np.ndarray:
    """Codes of two targets over noise, (frame, chirp, rx, sample, part), from two sides."""
    n = np.arange(RADAR.frame.chirp.n_samples)
    left, right = (np.exp(2j * np.pi * bin / n.size * n) for bin in (7.3, 15.6))
    rng = np.random.default_rng(seed)
    shape = (N_FRAMES, RADAR.frame.n_chirps, 4, n.size)
    rx = np.arange(4)[:, None]
    tones = 3000 * np.exp(1.1j * rx) * left + 2500 * np.exp(-2.0j * rx) * right
    noise = 100 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    beat = tones + noise
    return np.stack([beat.real, beat.imag], axis=-1).round().astype(np.int16)


@pytest.mark.parametrize("iq", ["iq", "qi"])
@pytest.mark.parametrize(
    ("write", "kind", "said"),
    [(two_lanes, "dca1000", "two lanes"), (four_lanes, "dca1000", "four lanes"),
     (pairs, "xwr14xx-capture", "")],
)  # fmt: skip
def test_bare_samples_tell_their_order_by_where_the_echoes_are(tmp_path, write, kind, said, iq):
    numbers = echoes()
    stored = numbers if iq == "iq" else numbers[..., ::-1]

    recording = opened(tmp_path / "capture", write(stored), iq=None)

    assert recording.format == kind
    assert recording.contents.iq == iq
    assert said in str(recording.findings)
    np.testing.assert_array_equal(recording.cube.values, samples_of(numbers))
    assert not [str(f) for f in recording.findings if f.level == "warning"]


def test_the_wrong_order_of_i_and_q_is_told(tmp_path):
    recording = opened(tmp_path / "x.bin", two_lanes(echoes()), device="xwr1642", iq="qi")

    assert ("warning", "iq") in levels(recording)


def whole_files() -> dict[str, bytes]:
    """A capture of each kind."""
    stream = two_lanes(codes())
    packets = packets_of(stream)
    return {
        "bare.bin": stream,
        "headers.bin": with_headers(packets),
        "network.pcap": pcap([samples_in(packet) for packet in packets]),
        "network.pcapng": pcapng([samples_in(packet) for packet in packets]),
    }


@pytest.mark.parametrize("name", whole_files())
@settings(max_examples=150)
@given(data=st.data())
def test_any_damage_gives_a_cube_or_says_why(tmp_path_factory, name, data):
    file = tmp_path_factory.mktemp("damaged") / name
    file.write_bytes(data.draw(damaged(whole_files()[name])))

    gives_a_cube_or_says_why(file, radar=RADAR, iq="iq")


@settings(max_examples=200)
@given(head=st.sampled_from([b"", b"\xd4\xc3\xb2\xa1", b"\x0a\x0d\x0d\x0a"]), rest=st.binary())
def test_any_bytes_give_a_cube_or_say_why(tmp_path_factory, head, rest):
    file = tmp_path_factory.mktemp("any") / "capture"
    file.write_bytes(head + rest)

    gives_a_cube_or_says_why(file, radar=RADAR)


@settings(max_examples=50)
@given(data=st.data())
def test_any_damage_to_a_cascade_gives_a_cube_or_says_why(tmp_path_factory, cascade_radar, data):
    folder = tmp_path_factory.mktemp("cascade")
    frame = cascade_radar.frame
    numbers = np.zeros((1, frame.n_chirps_total, 16, frame.chirp.n_samples, 2), np.int16)
    cascade(folder, numbers, cascade_radar)
    file = folder / data.draw(st.sampled_from(sorted(entry.name for entry in folder.iterdir())))
    file.write_bytes(data.draw(damaged(file.read_bytes())))

    gives_a_cube_or_says_why(folder, radar=cascade_radar, iq="iq")


def test_a_changed_radar_keeps_how_the_samples_lie(tmp_path, monkeypatch, capsys):
    """Lanes of receivers 1 and 3; a period that is set must not make it the first two."""
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
    (tmp_path / "capture.bin").write_bytes(four_lanes(numbers, (0, 2)))
    monkeypatch.chdir(tmp_path)

    found = []
    words = ["run", "capture.bin", "--format", "dca1000", "--json"]
    for changes in ([], ["--set", "radar.frame.period=60 ms"]):
        for radar in ([], ["--radar", "capture.cfg"]):
            with pytest.raises(SystemExit) as ended:
                main([*words, *changes, *radar])
            assert ended.value.code == 0
            found.append(json.loads(capsys.readouterr().out)["detections"])
            with pytest.raises(SystemExit):
                main(["run", "dechirp-run/scenario.yaml", "--json", "--out", "again"])
            assert json.loads(capsys.readouterr().out)["detections"] == found[-1]

    strengths = [[round(row["snr_db"], 6) for row in rows] for rows in found]
    assert strengths == [strengths[0]] * 4
    assert len(found[0]) == 3


def test_settings_of_the_studio_are_found_by_the_name_of_the_capture(tmp_path):
    (tmp_path / "adc_data_Raw_0.bin").write_bytes(with_headers(packets_of(two_lanes(codes()))))
    yaml = Path(__file__).parents[2] / "examples" / "radar.yaml"
    for name in ("adc_data_settings.yaml", "other.yaml"):
        (tmp_path / name).write_text(yaml.read_text())

    assert find_settings(tmp_path / "adc_data_Raw_0.bin").name == "adc_data_settings.yaml"


def test_points_cannot_be_run(tmp_path):
    stream = bytes.fromhex("0201040306050807") + struct.pack("<8I", 1, 40, 0xA1843, 7, 0, 0, 0, 0)
    (tmp_path / "points.dat").write_bytes(stream * 2)

    with pytest.raises(RecordingError, match="contains detections without samples"):
        run(Scenario(recording=RecordingSource(path=str(tmp_path / "points.dat"))))


@pytest.mark.parametrize("lost", [[], [5], [5, 6, 20]])
def test_what_is_kept_of_an_orderly_capture_grows_with_its_losses_alone(tmp_path, lost):
    stream = two_lanes(codes(n_frames=12))
    kept = [packet for packet in packets_of(stream) if packet[0] not in lost]
    file = tmp_path / "adc_data_Raw_0.bin"
    file.write_bytes(with_headers(kept))

    runs, _ = scan_file(file, to_run_step(_scan_packet_headers), 0)
    packets, findings = assemble_packets(file, open_files(file), runs)

    # A run before each place of loss, one to the end, and the last packet, which is shorter.
    n_places = sum(number - 1 not in lost for number in lost)
    assert len(packets.starts) == n_places + 2
    assert int(packets.counts.sum()) == len(kept)
    assert findings == ()
    for start, stop in ((0, len(stream)), (1455, 1457), (2912, 2913), (7000, 9000)):
        part = np.empty(stop - start, np.uint8)
        packets.read(start, part)
        whole = np.frombuffer(stream, np.uint8).copy()
        for number in lost:
            whole[(number - 1) * 1456 : number * 1456] = 0
        np.testing.assert_array_equal(part, whole[start:stop])
