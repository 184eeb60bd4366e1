"""Live streams: packet reassembly, lost and foreign packets, growing files, and runs."""

import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from dechirp.experiments.scenario import RecordingSource
from dechirp.experiments.streaming import open_stream
from dechirp.recordings.live.reassembly import N_PACKETS, ReassemblyWindow
from dechirp.recordings.live.replay import build_dca1000_packet, iter_file_as_packets
from dechirp.recordings.live.socket_reader import PacketSlots, RecvfromReader, fastest_socket_reader
from nightly import nightly, nightly_except
from udp_packets import receive_packets, send_packets, wait_for_packets

pytestmark = pytest.mark.usefixtures("without_figures")


N_FRAMES = 12
RECORDING_OPTIONS = {"device": "xwr1843", "iq": "iq"}
IDLE_S = 20.0  # of streams that receive all expected data; only a failure waits so long


@pytest.fixture(scope="module")
def sensor() -> dc.Radar:
    """Four receivers, 16 chirps of 64 samples: 16,384 bytes a frame, 11.3 packets."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        adc_start_s=2e-6,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=64,
        sampling="complex",
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=16, interval_s=50e-6, period_s=50e-3),
        array=dc.Array(rx_m=tuple((0.0, 0.0019 * n, 0.0) for n in range(4))),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


@pytest.fixture(scope="module")
def capture(sensor, tmp_path_factory) -> Path:
    """DCA1000 capture of a car at 20 m, in int16."""
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), rcs_m2=10)])
    echo = dc.simulate(scene, sensor, n_frames=N_FRAMES, seed=1).values
    numbers = echo.view(np.float32).reshape(*echo.shape, 2) * (8000 / np.abs(echo).max())
    codes = numbers.round().astype("<i2")
    # Groups of two samples: I I Q Q.
    words = codes.reshape(*codes.shape[:-2], -1, 2, 2).swapaxes(-1, -2)
    path = tmp_path_factory.mktemp("capture") / "adc_data.bin"
    path.write_bytes(np.ascontiguousarray(words).tobytes())
    return path


@pytest.fixture(scope="module")
def recorded_frames(capture, sensor) -> list[xr.DataArray]:
    return list(dc.open(capture, radar=sensor, format="dca1000", **RECORDING_OPTIONS).frames())


def find_gap_chirps(lost_packets: Iterable[int], sensor: dc.Radar) -> np.ndarray:
    """Return a mask (frame, chirp) of chirps with bytes in the packets, counted from 0."""
    n_chirps = N_FRAMES * sensor.frame.n_chirps
    chirp_bytes = 4 * sensor.array.n_rx * sensor.frame.chirp.n_samples
    gap = np.zeros(n_chirps, bool)
    for packet in lost_packets:
        first, last = packet * 1456, min((packet + 1) * 1456, n_chirps * chirp_bytes) - 1
        gap[first // chirp_bytes : last // chirp_bytes + 1] = True
    return gap.reshape(N_FRAMES, -1)


def test_replayed_capture_gives_recorded_frames(capture, sensor, recorded_frames):
    frames, stream = receive_packets(iter_file_as_packets(capture), sensor, **RECORDING_OPTIONS)

    assert len(frames) == N_FRAMES
    for frame, expected in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), expected)
        assert not frame.gap.any()
    assert not stream.findings


def test_lost_packets_are_marked_and_order_and_duplicates_change_nothing(
    capture, sensor, recorded_frames
):
    rng = np.random.default_rng(3)
    packets = list(iter_file_as_packets(capture))
    lost_packets = {n for n in range(1, len(packets)) if rng.random() < 0.01}
    assert lost_packets
    arrivals = [n for n in range(len(packets)) if n not in lost_packets]
    arrivals += [n for n in arrivals if rng.random() < 0.05]
    arrivals.sort(key=lambda n: n + rng.uniform(0, 50))
    gap = find_gap_chirps(lost_packets, sensor)

    frames, stream = receive_packets((packets[n] for n in arrivals), sensor, **RECORDING_OPTIONS)

    assert len(frames) == N_FRAMES
    for number, (frame, expected) in enumerate(zip(frames, recorded_frames, strict=True)):
        np.testing.assert_array_equal(frame.gap.values[0], gap[number])
        is_complete = ~gap[number]
        np.testing.assert_array_equal(frame.values[0, is_complete], expected.values[0, is_complete])
    text = " ".join(str(finding) for finding in stream.findings)
    assert f"{gap.any(axis=1).sum()} of {N_FRAMES} frames have gaps" in text
    assert f"{sum(len(packets[n]) - 10 for n in lost_packets)} bytes lost" in text
    assert f"{len(arrivals) - len(set(arrivals))} packets duplicate or too late" in text
    assert "packets out of order" in text


def test_only_lost_samples_of_chirp_are_zero(capture, sensor, recorded_frames):
    packets = list(iter_file_as_packets(capture))

    frames, _ = receive_packets(packets[:3] + packets[4:], sensor, **RECORDING_OPTIONS)

    # Bytes 4368 to 5824: chirps 4 and 5, of 1024 bytes each, four receivers of 256 in each.
    assert frames[0].gap.values[0].nonzero()[0].tolist() == [4, 5]
    expected = recorded_frames[0].values[0].copy()
    expected[4, 1, 4:] = 0
    expected[4, 2:] = 0
    expected[5, :2] = 0
    expected[5, 2, :48] = 0
    np.testing.assert_array_equal(frames[0].values[0], expected)


def test_stream_joins_running_radar_at_current_frame(capture, sensor, recorded_frames):
    packets = list(iter_file_as_packets(capture))

    frames, stream = receive_packets(packets[30:], sensor, **RECORDING_OPTIONS)

    assert frames[0].frame.item() == pytest.approx(2 * sensor.frame.period_s)
    assert [bool(frame.gap.any()) for frame in frames] == [True] + [False] * (N_FRAMES - 3)
    for frame, expected in zip(frames[1:], recorded_frames[3:], strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), expected)
    (finding,) = stream.findings
    assert finding.level == "note"  # no packet was lost after the start
    assert "gaps at the beginning or end of the stream" in finding.value


def test_completely_lost_frames_are_omitted_and_counted(capture, sensor):
    packets = list(iter_file_as_packets(capture))
    # None of frames 2 and 3.
    frames, stream = receive_packets(packets[:12] + packets[48:], sensor, **RECORDING_OPTIONS)

    starts = [round(frame.frame.item() / sensor.frame.period_s) for frame in frames]

    assert starts == [0, 1, *range(4, N_FRAMES)]
    assert any("2 more were lost completely" in str(finding) for finding in stream.findings)


def test_invalid_packets_are_counted_and_discarded(capture, sensor, recorded_frames):
    packets = list(iter_file_as_packets(capture))
    invalid_packets = [
        b"",
        b"\x01",
        packets[0][:10],
        packets[0] + b"\x00",
        bytes(9000),
        (7).to_bytes(4, "little") + (2**47).to_bytes(6, "little") + bytes(1456),
        build_dca1000_packet(3_000_000_000, bytes(1456)),  # consistent counters, and 4 TB ahead
        bytes([255]) * 1466,
    ]
    all_packets = packets[:20] + invalid_packets + packets[20:]

    frames, stream = receive_packets(all_packets, sensor, **RECORDING_OPTIONS)

    for frame, expected in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), expected)
    (finding,) = stream.findings
    assert "5 not of 11 to 1466 bytes, 2 with inconsistent counters" in finding.value
    assert "1 sent more than 60 s ahead of the others" in finding.value


def test_packets_of_other_sender_are_ignored(capture, sensor, recorded_frames):
    stream = dc.listen("127.0.0.1:0", radar=sensor, **RECORDING_OPTIONS, idle_s=0.5)
    packets = list(iter_file_as_packets(capture))
    with stream:
        send_packets(stream, packets[:30])
        # From another port.
        send_packets(stream, [build_dca1000_packet(n, bytes(1456)) for n in range(20, 60)])
        wait_for_packets(stream, 70)
        frames = list(stream)

    assert len(frames) == 3
    for frame, expected in zip(frames[:2], recorded_frames, strict=False):
        np.testing.assert_array_equal(frame.values, expected.values)
    assert frames[2].gap.any()
    assert any("40 from another sender" in str(finding) for finding in stream.findings)


def test_restarted_radar_ends_stream(sensor):
    packets = [build_dca1000_packet(n, bytes(1456)) for n in range(1, 400)]

    frames, stream = receive_packets([*packets, *packets[:5]], sensor, **RECORDING_OPTIONS)

    assert len(frames) == -(-399 * 1456 // 16384)
    assert any("restarted" in str(finding) for finding in stream.findings)


@pytest.mark.parametrize(("n_before", "restart_number"), [(100, 1), (20, 3), (600, 2)])
def test_restart_is_detected_at_any_packet_number(sensor, n_before, restart_number):
    rng = np.random.default_rng(8)
    first_packets, second_packets = (
        [build_dca1000_packet(n, rng.bytes(1456)) for n in range(begin, begin + n_sent)]
        for begin, n_sent in ((1, n_before), (restart_number, 249))
    )

    frames, stream = receive_packets([*first_packets, *second_packets], sensor, **RECORDING_OPTIONS)
    expected_frames, _ = receive_packets(first_packets, sensor, **RECORDING_OPTIONS)

    assert any("restarted" in str(finding) for finding in stream.findings)
    assert len(frames) == len(expected_frames)
    for frame, expected in zip(frames, expected_frames, strict=True):
        np.testing.assert_array_equal(frame.values, expected.values)


def test_silent_port_raises_error(sensor):
    stream = dc.listen("127.0.0.1:0", radar=sensor, **RECORDING_OPTIONS, idle_s=0.05)
    with pytest.raises(dc.RecordingError, match="no packet of samples in 0.05 s"):
        list(stream)


def test_port_with_foreign_packets_only_raises_error(sensor):
    with pytest.raises(dc.RecordingError, match="but 3 not of 11 to 1466 bytes"):
        receive_packets([b"hello"] * 3, sensor, **RECORDING_OPTIONS)


def test_rejects_port_in_use(sensor):
    with (
        dc.listen("127.0.0.1:0", radar=sensor, **RECORDING_OPTIONS) as stream,
        pytest.raises(dc.InvalidSetting, match="a free port"),
    ):
        dc.listen(stream.address, radar=sensor, **RECORDING_OPTIONS)


def test_port_is_released_when_stream_ends(capture, sensor):
    _, stream = receive_packets(iter_file_as_packets(capture), sensor, **RECORDING_OPTIONS)

    with dc.listen(stream.address, radar=sensor, **RECORDING_OPTIONS) as second_stream:
        assert second_stream.address == stream.address


@pytest.mark.parametrize(
    "address", ["127.0.0.1:70000", "http://127.0.0.1:1", "1.2.3.4:0", "no such host:1", "[::1]:4"]
)
def test_rejects_addresses_of_other_machines(address, sensor):
    with pytest.raises(dc.InvalidSetting, match="address"):
        dc.listen(address, radar=sensor, **RECORDING_OPTIONS)


def test_address_without_host_listens_on_loopback_only(sensor):
    with dc.listen(":0", radar=sensor, **RECORDING_OPTIONS) as stream:
        assert stream.address.startswith("127.0.0.1:")


def test_radar_with_unknown_lanes_requires_device(sensor):
    radar = dc.Radar(frame=sensor.frame)
    with pytest.raises(dc.RecordingError, match="device"):
        dc.listen("127.0.0.1:0", radar=radar)


def test_single_and_batched_socket_readers_receive_same_packets():
    packets = [bytes([n]) * (n + 1) for n in range(40)] + [bytes(9000)]
    results = []
    for kind in (RecvfromReader, type(fastest_socket_reader(None, _make_slots()))):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            receiver.bind(("127.0.0.1", 0))
            receiver.setblocking(False)
            for packet in packets:
                sender.sendto(packet, receiver.getsockname())
            slots, n = _make_slots(), 0
            reader = kind(receiver, slots)
            while n < len(packets):
                n += reader.read_packets_into_slots(n, 64 - n)
            assert reader.read_packets_into_slots(n, 64 - n) == 0
            assert len(set(slots.senders[:n].tolist())) == 1
            results.append((slots.sizes[:n].tolist(), slots.content[:n].copy()))

    assert results[0][0][:40] == results[1][0][:40] == [len(packet) for packet in packets[:40]]
    assert results[0][0][40] == results[1][0][40] == 1472  # cut
    np.testing.assert_array_equal(results[0][1], results[1][1])


def _make_slots() -> PacketSlots:
    return PacketSlots(
        np.zeros((64, 1472), np.uint8), np.zeros(64, np.int64), np.zeros(64, np.int64)
    )


@pytest.mark.parametrize("frame_bytes", [512, 1456, 4096, 2**20])
def test_frames_of_any_size_are_reassembled_from_reordered_packets(frame_bytes):
    rng = np.random.default_rng(frame_bytes)
    stream = rng.integers(0, 256, 300 * 1456, dtype=np.uint8)
    order = np.argsort(np.arange(300) + rng.uniform(0, 50, 300))
    content, sizes = np.zeros((300, 1472), np.uint8), np.full(300, 1466, np.int64)
    for row, n in zip(content, order.tolist(), strict=True):
        packet = build_dca1000_packet(n + 1, stream[n * 1456 : (n + 1) * 1456].tobytes())
        row[:1466] = np.frombuffer(packet, np.uint8)
    window = ReassemblyWindow(frame_bytes, max_lost_frames=1200)

    contents = {}
    for frame in window.reassemble_frames(PacketSlots(content, sizes, np.zeros(300, np.int64))):
        contents[frame.number] = frame.content.copy()
    for frame in window.flush_frames_before(window.frame_number_in_progress + 1):
        contents[frame.number] = frame.content[frame.received_mask].copy()

    assert window.counters[N_PACKETS] == 300
    assert window.lost_bytes == 0
    np.testing.assert_array_equal(np.concatenate([contents[n] for n in sorted(contents)]), stream)


@pytest.mark.parametrize("frame_bytes", [512, 4096, 2**20])
def test_stream_joins_radar_after_packet_number_wraps(frame_bytes):
    first = 2**32 + 5  # the packet number has wrapped
    window, n_bytes = ReassemblyWindow(frame_bytes, max_lost_frames=1200), 0
    for number in range(first, first + 2000):
        row = np.zeros((1, 1472), np.uint8)
        row[0, :1466] = np.frombuffer(build_dca1000_packet(number, bytes(1456)), np.uint8)
        for frame in window.reassemble_frames(
            PacketSlots(row, np.array([1466]), np.zeros(1, np.int64))
        ):
            n_bytes += int(frame.received_mask.sum())
    n_bytes += sum(
        int(frame.received_mask.sum())
        for frame in window.flush_frames_before(window.frame_number_in_progress + 1)
    )

    assert n_bytes == 2000 * 1456
    assert window.lost_bytes == 0


def test_jump_of_packet_number_yields_no_frames_in_between():
    window, n_frames = ReassemblyWindow(512, max_lost_frames=2_000_000), 0
    for number in (1, 700_000, 1_400_000, 1):
        row = np.zeros((1, 1472), np.uint8)
        row[0, :1466] = np.frombuffer(build_dca1000_packet(number, bytes(1456)), np.uint8)
        slots = PacketSlots(row, np.array([1466]), np.zeros(1, np.int64))
        n_frames += sum(1 for _ in window.reassemble_frames(slots))

    assert n_frames <= 3 * 4
    assert window.frame_number_in_progress > 3_000_000  # no packet was rejected


def test_packet_more_than_60_s_ahead_is_rejected(capture, sensor, recorded_frames):
    packets = list(iter_file_as_packets(capture))
    # 1200 frames of 11.3 packets: 13,500.
    distant_packet = build_dca1000_packet(15_000, bytes(1456))
    frames, stream = receive_packets(
        [*packets[:20], distant_packet, *packets[20:]], sensor, **RECORDING_OPTIONS
    )

    assert len(frames) == N_FRAMES
    for frame, expected in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), expected)
    (finding,) = stream.findings
    assert "1 sent more than 60 s ahead of the others, by their counters" in finding.value


def test_gap_of_more_than_60_s_ends_stream(capture, sensor):
    late_packets = [build_dca1000_packet(n, bytes(1456)) for n in range(15_000, 15_100)]
    frames, stream = receive_packets(
        [*iter_file_as_packets(capture), *late_packets], sensor, **RECORDING_OPTIONS
    )

    assert len(frames) == N_FRAMES
    assert any("more than 60 s of it were lost" in finding.value for finding in stream.findings)


def test_growing_file_yields_each_frame_when_complete(capture, sensor, recorded_frames, tmp_path):
    path, content = tmp_path / "growing.bin", capture.read_bytes()
    path.touch()
    stream = dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=IDLE_S)
    frames = []

    def grow_file() -> None:
        rng, position = np.random.default_rng(5), 0
        with path.open("ab", buffering=0) as out:
            while position < len(content):
                n = int(rng.integers(1, 30_000))
                out.write(content[position : position + n])
                position += n
                time.sleep(5e-3)
                assert len(frames) <= position // 16384

    writer = threading.Thread(target=grow_file)
    writer.start()
    for frame in islice(stream, N_FRAMES):
        frames.append(frame)
    writer.join()

    for frame, expected in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(frame, expected)


def test_incomplete_last_frame_of_file_is_omitted_and_reported(capture, sensor, tmp_path):
    path = tmp_path / "growing.bin"
    path.write_bytes(capture.read_bytes()[: 2 * 16384 + 1001])
    stream = dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=0.1)

    assert len(list(stream)) == 2
    assert any(
        "1001 bytes after the last complete frame" in str(finding) for finding in stream.findings
    )


def test_bytes_after_requested_frames_are_not_reported(capture, sensor, tmp_path):
    path = tmp_path / "growing.bin"
    path.write_bytes(capture.read_bytes()[: 16384 + 1001])
    with dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=IDLE_S) as stream:
        assert len(list(islice(stream, 1))) == 1

    assert not stream.findings


def test_capture_continues_in_next_file(capture, sensor, recorded_frames, tmp_path):
    first, second = tmp_path / "adc_data_0.bin", tmp_path / "adc_data_1.bin"
    content = capture.read_bytes()
    first.write_bytes(content[:40_001])
    stream = dc.follow(first, radar=sensor, **RECORDING_OPTIONS, idle_s=IDLE_S)
    frames = []
    for frame in islice(stream, N_FRAMES):
        frames.append(frame)
        if len(frames) == 2:
            second.write_bytes(content[40_001:])

    for frame, expected in zip(frames, recorded_frames, strict=True):
        xr.testing.assert_identical(frame, expected)


def test_next_file_of_earlier_capture_is_ignored(capture, sensor, tmp_path):
    first, second = tmp_path / "adc_data_0.bin", tmp_path / "adc_data_1.bin"
    content = capture.read_bytes()
    second.write_bytes(content[40_001:])
    os.utime(second, (1e9, 1e9))
    first.write_bytes(content[:40_001])

    assert len(list(dc.follow(first, radar=sensor, **RECORDING_OPTIONS, idle_s=0.1))) == 2


@pytest.mark.parametrize("change", ["shrank", "was replaced", "cannot be read"])
def test_changed_file_ends_stream_with_finding(change, capture, sensor, tmp_path):
    path, new_file = tmp_path / "growing.bin", tmp_path / "other.bin"
    path.write_bytes(capture.read_bytes()[:20_000])
    stream = dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=IDLE_S)
    for _ in stream:
        match change:
            case "shrank":
                os.truncate(path, 100)
            case "was replaced":
                new_file.write_bytes(capture.read_bytes())
                new_file.replace(path)
            case _:
                path.unlink()

    assert any(change in str(finding) for finding in stream.findings)


def test_file_without_complete_frame_raises_error(sensor, tmp_path):
    path = tmp_path / "empty.bin"
    path.write_bytes(bytes(99))
    with pytest.raises(dc.RecordingError, match="99 bytes, and no complete frame in 0.05 s"):
        list(dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=0.05))


def test_follow_rejects_other_files_and_folders(sensor, tmp_path):
    path = tmp_path / "cube.bin"
    np.save(path.with_suffix(".npy"), np.zeros(20_000, np.int16))
    path.with_suffix(".npy").rename(path)
    with pytest.raises(dc.RecordingError, match="a NumPy array; expected raw samples"):
        list(dc.follow(path, radar=sensor, **RECORDING_OPTIONS, idle_s=0.05))
    with pytest.raises(dc.RecordingError, match="no such file"):
        dc.follow(tmp_path / "nothing.bin", radar=sensor)
    with pytest.raises(dc.RecordingError, match=": a folder; expected one file"):
        dc.follow(tmp_path, radar=sensor)


def get_exit_status(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    return int(exit_info.value.code or 0)


@pytest.fixture
def run_options(sensor, tmp_path, monkeypatch) -> list[str]:
    """Options of every run: radar, device and output folder."""
    monkeypatch.chdir(tmp_path)
    Path("radar.yaml").write_text(dump_yaml(sensor))
    return ["--radar", "radar.yaml", "--device", "xwr1843", "--iq", "iq", "--out", "out"]


@nightly
def test_live_stream_repairs_faults_as_run_does(capture, sensor, tmp_path):
    codes = np.frombuffer(capture.read_bytes(), "<i2").copy()
    codes.reshape(-1, sensor.array.n_rx, 2 * sensor.frame.chirp.n_samples)[:, 2] = 0
    path = tmp_path / "dead_receiver.bin"
    path.write_bytes(codes.tobytes())
    source = RecordingSource(path=str(path), device="xwr1843", iq="iq")
    scenario = dc.Scenario(recording=source, radar=sensor)

    live_result = dc.process_stream(scenario, open_stream(scenario, idle_s=0.05))
    recorded_result = dc.run(scenario)

    assert live_result.radar.array.n_rx == sensor.array.n_rx - 1
    assert live_result.cube.sizes["rx"] == sensor.array.n_rx - 1
    xr.testing.assert_identical(live_result.detections, recorded_result.detections)
    assert any("receiver 2 left out" in f.value for f in live_result.findings)
    assert any(f.setting == "recording.receivers" for f in live_result.findings)
    as_recorded = replace(scenario, recording=replace(source, repair_faults=False))
    live_result = dc.process_stream(as_recorded, open_stream(as_recorded, idle_s=0.05))
    assert live_result.radar.array.n_rx == sensor.array.n_rx


@nightly
def test_live_stream_gives_same_result_as_recording(capture, sensor):
    scenario = dc.Scenario(
        recording=RecordingSource(path=str(capture), device="xwr1843", iq="iq"), radar=sensor
    )
    frames = []

    live_result = dc.process_stream(
        scenario, open_stream(scenario, idle_s=0.05), on_frame=frames.append
    )
    recorded_result = dc.run(scenario)

    xr.testing.assert_identical(live_result.detections, recorded_result.detections)
    xr.testing.assert_identical(live_result.power, recorded_result.power)
    assert live_result.times_s == pytest.approx(recorded_result.times_s, rel=1e-12)
    assert recorded_result.detections.sizes["detection"] >= N_FRAMES
    assert [frame.number for frame in frames] == list(range(N_FRAMES))
    frame_detections = [frame.detections for frame in frames]
    xr.testing.assert_identical(
        xr.concat(frame_detections, "detection"), recorded_result.detections
    )


@nightly
def test_stream_result_contains_first_frame_only(capture, run_options, recorded_frames, capsys):
    arguments = ("run", str(capture), "--follow", "--idle", "50ms", "--json", "--frames", "3:9")
    assert get_exit_status(*arguments, *run_options) == 0

    out, err = capsys.readouterr()
    cube = dc.open("out/cube.zarr").cube
    np.testing.assert_allclose(cube.values, recorded_frames[3].values, atol=1e-7)
    document = json.loads(out)
    assert document["frames"] == 6
    assert {row["frame"] for row in document["detections"]} <= set(range(3, 9))
    assert any("first frame only" in finding["value"] for finding in document["findings"])
    assert [line.split(":")[0] for line in err.splitlines()] == [f"frame {n}" for n in range(3, 9)]


@pytest.mark.parametrize("signal_number", nightly_except(1, [signal.SIGINT, signal.SIGTERM]))
def test_signal_ends_run_on_udp_address_with_results(
    signal_number, capture, run_options, monkeypatch, capsys
):
    port, frame_lines = _find_free_port(), []
    monkeypatch.setattr("dechirp.cli.stream._print_frame_report", frame_lines.append)
    deadline = time.monotonic() + 5 * IDLE_S  # imports and figures, on a busy machine

    def send_and_interrupt() -> None:
        while not _is_port_in_use(port) and time.monotonic() < deadline:
            time.sleep(5e-3)
        dc.replay(capture, f"udp://127.0.0.1:{port}", bytes_per_s=2e6)
        while len(frame_lines) < 4 and time.monotonic() < deadline:
            time.sleep(5e-3)
        os.kill(os.getpid(), signal_number)

    sender = threading.Thread(target=send_and_interrupt)
    sender.start()
    code = get_exit_status(
        "run", f"udp://127.0.0.1:{port}", "--idle", "1 min", "--json", *run_options
    )
    sender.join()

    assert code == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames"] >= 4
    assert document["detections"]
    assert document["source"] == f"udp://127.0.0.1:{port}"
    assert document["source"] in Path("out/scenario.yaml").read_text()


@pytest.fixture
def default_sigint():
    """Set the default SIGINT handler; background processes of a shell ignore the signal."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, handler)


@pytest.mark.usefixtures("default_sigint")
@pytest.mark.parametrize(("signal_number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_after_last_frame_ends_run(signal_number, code, capture, run_options, monkeypatch):
    def interrupt(*_: object) -> None:
        os.kill(os.getpid(), signal_number)
        raise AssertionError("the signal was ignored")

    monkeypatch.setattr("dechirp.experiments.streaming.build_result", interrupt)

    assert get_exit_status("run", str(capture), "--follow", "--idle", "50ms", *run_options) == code

    assert not Path("out").exists()


def _is_port_in_use(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp_socket:
        try:
            udp_socket.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def _find_free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp_socket:
        udp_socket.bind(("127.0.0.1", 0))
        return int(udp_socket.getsockname()[1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    nightly_except(
        3,
        [
            (["--follow"], "given for a simulated scene"),
            (["--idle", "3s"], "given without --follow"),
            (["capture.bin", "--follow", "--idle", "3"], "--idle: 3"),
            (["capture.bin", "--follow", "--idle", "0s"], "idle_s"),
            (["capture.bin", "--follow", "--axes", "chirp,sample"], "--axes"),
            (["udp://127.0.0.1:99999"], "99999"),
            (["udp://127.0.0.1:0", "--idle", "10ms"], "no packet of samples in 0.01 s"),
        ],
    ),
)
def test_rejects_invalid_calls_and_writes_nothing(arguments, message, capture, run_options, capsys):
    Path("capture.bin").write_bytes(capture.read_bytes())
    options = run_options if arguments[0] not in ("--follow", "--idle") else run_options[-2:]

    assert get_exit_status("run", *arguments, *options) == 2

    assert message in capsys.readouterr().err
    assert not Path("out").exists()
