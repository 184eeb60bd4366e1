"""Streams: frames that arrive are the frames that were sent, and what was lost is marked."""

import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump
from dechirp.experiments.scenario import RecordingSource
from dechirp.experiments.streaming import open_stream
from dechirp.recordings.live.reassembly import N_PACKETS, ReassemblyWindow
from dechirp.recordings.live.replay import build_packet, iter_packets
from dechirp.recordings.live.socket_reader import PacketSlots, RecvfromReader, fastest_socket_reader
from sent import heard, send, wait_for

N_FRAMES = 12
TOLD = {"device": "xwr1843", "iq": "iq"}
IDLE_S = 20.0  # of streams that are sent all they wait for; only a failure waits so long


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
    """A car at 20 m as a DCA1000 records it, in int16."""
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), rcs_m2=10)])
    echo = dc.simulate(scene, sensor, n_frames=N_FRAMES, seed=1).values
    numbers = echo.view(np.float32).reshape(*echo.shape, 2) * (8000 / np.abs(echo).max())
    codes = numbers.round().astype("<i2")
    # Two samples a group: I I Q Q.
    words = codes.reshape(*codes.shape[:-2], -1, 2, 2).swapaxes(-1, -2)
    path = tmp_path_factory.mktemp("capture") / "adc_data.bin"
    path.write_bytes(np.ascontiguousarray(words).tobytes())
    return path


@pytest.fixture(scope="module")
def recorded(capture, sensor) -> list[xr.DataArray]:
    return list(dc.open(capture, radar=sensor, format="dca1000", **TOLD).frames())


def touched(lost: Iterable[int], sensor: dc.Radar) -> np.ndarray:
    """(frame, chirp), whether a chirp has bytes in any of these packets, counted from 0."""
    n_chirps = N_FRAMES * sensor.frame.n_chirps
    chirp_bytes = 4 * sensor.array.n_rx * sensor.frame.chirp.n_samples
    gap = np.zeros(n_chirps, bool)
    for one in lost:
        first, last = one * 1456, min((one + 1) * 1456, n_chirps * chirp_bytes) - 1
        gap[first // chirp_bytes : last // chirp_bytes + 1] = True
    return gap.reshape(N_FRAMES, -1)


def test_what_is_replayed_comes_as_it_was_recorded(capture, sensor, recorded):
    frames, stream = heard(iter_packets(capture), sensor, **TOLD)

    assert len(frames) == N_FRAMES
    for frame, same in zip(frames, recorded, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), same)
        assert not frame.gap.any()
    assert not stream.findings


def test_loss_is_marked_where_it_is_and_order_and_copies_change_nothing(capture, sensor, recorded):
    rng = np.random.default_rng(3)
    sent = list(iter_packets(capture))
    lost = {n for n in range(1, len(sent)) if rng.random() < 0.01}
    assert lost
    kept = [n for n in range(len(sent)) if n not in lost]
    kept += [n for n in kept if rng.random() < 0.05]
    kept.sort(key=lambda n: n + rng.uniform(0, 50))
    gap = touched(lost, sensor)

    frames, stream = heard((sent[n] for n in kept), sensor, **TOLD)

    assert len(frames) == N_FRAMES
    for number, (frame, same) in enumerate(zip(frames, recorded, strict=True)):
        np.testing.assert_array_equal(frame.gap.values[0], gap[number])
        whole = ~gap[number]
        np.testing.assert_array_equal(frame.values[0, whole], same.values[0, whole])
    said = " ".join(str(one) for one in stream.findings)
    assert f"{gap.any(axis=1).sum()} of {N_FRAMES} frames have gaps" in said
    assert f"{sum(len(sent[n]) - 10 for n in lost)} bytes lost" in said
    assert f"{len(kept) - len(set(kept))} packets duplicate or too late" in said
    assert "packets out of order" in said


def test_lost_samples_are_zero_and_the_rest_of_their_chirp_is_not(capture, sensor, recorded):
    sent = list(iter_packets(capture))

    frames, _ = heard(sent[:3] + sent[4:], sensor, **TOLD)

    # Bytes 4368 to 5824: chirps 4 and 5, of 1024 bytes each, four receivers of 256 in each.
    assert frames[0].gap.values[0].nonzero()[0].tolist() == [4, 5]
    came = recorded[0].values[0].copy()
    came[4, 1, 4:] = 0
    came[4, 2:] = 0
    came[5, :2] = 0
    came[5, 2, :48] = 0
    np.testing.assert_array_equal(frames[0].values[0], came)


def test_a_running_radar_is_joined_at_the_frame_it_is_in(capture, sensor, recorded):
    sent = list(iter_packets(capture))

    frames, stream = heard(sent[30:], sensor, **TOLD)

    assert frames[0].frame.item() == pytest.approx(2 * sensor.frame.period_s)
    assert [bool(frame.gap.any()) for frame in frames] == [True] + [False] * (N_FRAMES - 3)
    for frame, same in zip(frames[1:], recorded[3:], strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), same)
    (said,) = stream.findings
    assert said.level == "note"  # nothing that was sent since was lost
    assert "gaps at the beginning or end of the stream" in said.value


def test_frames_of_which_nothing_came_are_left_out_and_counted(capture, sensor):
    sent = list(iter_packets(capture))
    frames, stream = heard(sent[:12] + sent[48:], sensor, **TOLD)  # none of frames 2 and 3

    starts = [round(frame.frame.item() / sensor.frame.period_s) for frame in frames]

    assert starts == [0, 1, *range(4, N_FRAMES)]
    assert any("2 more were lost completely" in str(one) for one in stream.findings)


def test_packets_that_are_none_are_counted_and_nothing_of_them_is_kept(capture, sensor, recorded):
    sent = list(iter_packets(capture))
    wrong = [
        b"",
        b"\x01",
        sent[0][:10],
        sent[0] + b"\x00",
        bytes(9000),
        (7).to_bytes(4, "little") + (2**47).to_bytes(6, "little") + bytes(1456),
        build_packet(3_000_000_000, bytes(1456)),  # in step, and 4 TB away
        bytes([255]) * 1466,
    ]
    mixed = sent[:20] + wrong + sent[20:]

    frames, stream = heard(mixed, sensor, **TOLD)

    for frame, same in zip(frames, recorded, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), same)
    (said,) = stream.findings
    assert "5 not of 11 to 1466 bytes, 2 with inconsistent counters" in said.value
    assert "1 sent more than 60 s ahead of the others" in said.value


def test_packets_of_another_sender_change_nothing(capture, sensor, recorded):
    stream = dc.listen("127.0.0.1:0", radar=sensor, **TOLD, idle_s=0.5)
    sent = list(iter_packets(capture))
    with stream:
        send(stream, sent[:30])
        send(stream, [build_packet(n, bytes(1456)) for n in range(20, 60)])  # from another port
        wait_for(stream, 70)
        frames = list(stream)

    assert len(frames) == 3
    for frame, same in zip(frames[:2], recorded, strict=False):
        np.testing.assert_array_equal(frame.values, same.values)
    assert frames[2].gap.any()
    assert any("40 from another sender" in str(one) for one in stream.findings)


def test_a_radar_that_begins_anew_ends_the_stream(sensor):
    before = [build_packet(n, bytes(1456)) for n in range(1, 400)]

    frames, stream = heard([*before, *before[:5]], sensor, **TOLD)

    assert len(frames) == -(-399 * 1456 // 16384)
    assert any("restarted" in str(one) for one in stream.findings)


@pytest.mark.parametrize(("n_before", "first"), [(100, 1), (20, 3), (600, 2)])
def test_a_radar_that_begins_anew_is_noticed_wherever_it_was(sensor, n_before, first):
    rng = np.random.default_rng(8)
    before, after = (
        [build_packet(n, rng.bytes(1456)) for n in range(begin, begin + n_sent)]
        for begin, n_sent in ((1, n_before), (first, 249))
    )

    frames, stream = heard([*before, *after], sensor, **TOLD)
    alone, _ = heard(before, sensor, **TOLD)

    assert any("restarted" in str(one) for one in stream.findings)
    assert len(frames) == len(alone)
    for frame, same in zip(frames, alone, strict=True):
        np.testing.assert_array_equal(frame.values, same.values)


def test_an_empty_line_says_so(sensor):
    stream = dc.listen("127.0.0.1:0", radar=sensor, **TOLD, idle_s=0.05)
    with pytest.raises(dc.RecordingError, match="no packet of samples in 0.05 s"):
        list(stream)


def test_a_line_with_other_things_on_it_says_what(sensor):
    with pytest.raises(dc.RecordingError, match="but 3 not of 11 to 1466 bytes"):
        heard([b"hello"] * 3, sensor, **TOLD)


def test_a_port_that_another_has_is_refused(sensor):
    with (
        dc.listen("127.0.0.1:0", radar=sensor, **TOLD) as first,
        pytest.raises(dc.InvalidSetting, match="a free port"),
    ):
        dc.listen(first.address, radar=sensor, **TOLD)


def test_a_port_is_let_go_when_the_stream_ends(capture, sensor):
    _, stream = heard(iter_packets(capture), sensor, **TOLD)

    with dc.listen(stream.address, radar=sensor, **TOLD) as again:
        assert again.address == stream.address


@pytest.mark.parametrize(
    "address", ["127.0.0.1:70000", "http://127.0.0.1:1", "1.2.3.4:0", "no such host:1", "[::1]:4"]
)
def test_what_is_no_address_of_this_machine_is_refused(address, sensor):
    with pytest.raises(dc.InvalidSetting, match="address"):
        dc.listen(address, radar=sensor, **TOLD)


def test_without_a_host_nothing_but_loopback_is_listened_to(sensor):
    with dc.listen(":0", radar=sensor, **TOLD) as stream:
        assert stream.address.startswith("127.0.0.1:")


def test_a_radar_of_unknown_lanes_is_asked_for_its_chip(sensor):
    one = dc.Radar(frame=sensor.frame)
    with pytest.raises(dc.RecordingError, match="device"):
        dc.listen("127.0.0.1:0", radar=one)


def test_packets_taken_one_by_one_are_those_taken_at_once():
    sent = [bytes([n]) * (n + 1) for n in range(40)] + [bytes(9000)]
    took = []
    for kind in (RecvfromReader, type(fastest_socket_reader(None, _slots()))):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as into,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
        ):
            into.bind(("127.0.0.1", 0))
            into.setblocking(False)
            for one in sent:
                out.sendto(one, into.getsockname())
            slots, n = _slots(), 0
            taking = kind(into, slots)
            while n < len(sent):
                n += taking.read_packets(n, 64 - n)
            assert taking.read_packets(n, 64 - n) == 0
            assert len(set(slots.senders[:n].tolist())) == 1
            took.append((slots.sizes[:n].tolist(), slots.content[:n].copy()))

    assert took[0][0][:40] == took[1][0][:40] == [len(one) for one in sent[:40]]
    assert took[0][0][40] == took[1][0][40] == 1472  # cut
    np.testing.assert_array_equal(took[0][1], took[1][1])


def _slots() -> PacketSlots:
    return PacketSlots(
        np.zeros((64, 1472), np.uint8), np.zeros(64, np.int64), np.zeros(64, np.int64)
    )


@pytest.mark.parametrize("frame_bytes", [512, 1456, 4096, 2**20])
def test_frames_of_any_size_come_whole_out_of_packets_in_any_near_order(frame_bytes):
    rng = np.random.default_rng(frame_bytes)
    stream = rng.integers(0, 256, 300 * 1456, dtype=np.uint8)
    order = np.argsort(np.arange(300) + rng.uniform(0, 50, 300))
    content, sizes = np.zeros((300, 1472), np.uint8), np.full(300, 1466, np.int64)
    for row, n in zip(content, order.tolist(), strict=True):
        made = build_packet(n + 1, stream[n * 1456 : (n + 1) * 1456].tobytes())
        row[:1466] = np.frombuffer(made, np.uint8)
    window = ReassemblyWindow(frame_bytes, max_lost_frames=1200)

    found = {}
    for one in window.reassemble(PacketSlots(content, sizes, np.zeros(300, np.int64))):
        found[one.number] = one.content.copy()
    for one in window.flush_before(window.frame_in_progress + 1):
        found[one.number] = one.content[one.received_mask].copy()

    assert window.counters[N_PACKETS] == 300
    assert window.lost_bytes == 0
    np.testing.assert_array_equal(np.concatenate([found[n] for n in sorted(found)]), stream)


@pytest.mark.parametrize("frame_bytes", [512, 4096, 2**20])
def test_a_radar_that_has_run_for_days_is_joined(frame_bytes):
    first = 2**32 + 5  # the number of a packet has begun again from 0
    window, n_bytes = ReassemblyWindow(frame_bytes, max_lost_frames=1200), 0
    for number in range(first, first + 2000):
        row = np.zeros((1, 1472), np.uint8)
        row[0, :1466] = np.frombuffer(build_packet(number, bytes(1456)), np.uint8)
        for one in window.reassemble(PacketSlots(row, np.array([1466]), np.zeros(1, np.int64))):
            n_bytes += int(one.received_mask.sum())
    n_bytes += sum(
        int(one.received_mask.sum()) for one in window.flush_before(window.frame_in_progress + 1)
    )

    assert n_bytes == 2000 * 1456
    assert window.lost_bytes == 0


def test_no_frames_are_given_for_the_way_that_a_packet_jumps():
    window, n_given = ReassemblyWindow(512, max_lost_frames=2_000_000), 0
    for number in (1, 700_000, 1_400_000, 1):
        row = np.zeros((1, 1472), np.uint8)
        row[0, :1466] = np.frombuffer(build_packet(number, bytes(1456)), np.uint8)
        slots = PacketSlots(row, np.array([1466]), np.zeros(1, np.int64))
        n_given += sum(1 for _ in window.reassemble(slots))

    assert n_given <= 3 * 4
    assert window.frame_in_progress > 3_000_000  # none of them was refused


def test_a_packet_of_more_than_a_minute_later_is_refused_and_changes_nothing(
    capture, sensor, recorded
):
    sent = list(iter_packets(capture))
    in_a_minute = build_packet(15_000, bytes(1456))  # 1200 frames of 11.3 packets: 13,500
    frames, stream = heard([*sent[:20], in_a_minute, *sent[20:]], sensor, **TOLD)

    assert len(frames) == N_FRAMES
    for frame, same in zip(frames, recorded, strict=True):
        xr.testing.assert_identical(frame.drop_vars("gap"), same)
    (said,) = stream.findings
    assert "1 sent more than 60 s ahead of the others, by their counters" in said.value


def test_a_radar_that_was_not_heard_for_more_than_a_minute_ends_the_stream(capture, sensor):
    late = [build_packet(n, bytes(1456)) for n in range(15_000, 15_100)]
    frames, stream = heard([*iter_packets(capture), *late], sensor, **TOLD)

    assert len(frames) == N_FRAMES
    assert any("more than 60 s of it were lost" in one.value for one in stream.findings)


def test_a_file_that_grows_gives_each_frame_once_its_bytes_are_there(
    capture, sensor, recorded, tmp_path
):
    path, content = tmp_path / "growing.bin", capture.read_bytes()
    path.touch()
    stream = dc.follow(path, radar=sensor, **TOLD, idle_s=IDLE_S)
    taken = []

    def write() -> None:
        rng, at = np.random.default_rng(5), 0
        with path.open("ab", buffering=0) as out:
            while at < len(content):
                n = int(rng.integers(1, 30_000))
                out.write(content[at : at + n])
                at += n
                time.sleep(5e-3)
                assert len(taken) <= at // 16384

    writer = threading.Thread(target=write)
    writer.start()
    for frame in islice(stream, N_FRAMES):
        taken.append(frame)
    writer.join()

    for frame, same in zip(taken, recorded, strict=True):
        xr.testing.assert_identical(frame, same)


def test_a_part_of_a_frame_is_waited_for_and_left_out_when_nothing_follows(
    capture, sensor, tmp_path
):
    path = tmp_path / "growing.bin"
    path.write_bytes(capture.read_bytes()[: 2 * 16384 + 1001])
    stream = dc.follow(path, radar=sensor, **TOLD, idle_s=0.1)

    assert len(list(stream)) == 2
    assert any("1001 bytes after the last complete frame" in str(one) for one in stream.findings)


def test_what_follows_the_frames_that_were_asked_for_is_not_said_to_be_left_out(
    capture, sensor, tmp_path
):
    path = tmp_path / "growing.bin"
    path.write_bytes(capture.read_bytes()[: 16384 + 1001])
    with dc.follow(path, radar=sensor, **TOLD, idle_s=IDLE_S) as stream:
        assert len(list(islice(stream, 1))) == 1

    assert not stream.findings


def test_a_capture_goes_on_in_the_next_file(capture, sensor, recorded, tmp_path):
    first, second = tmp_path / "adc_data_0.bin", tmp_path / "adc_data_1.bin"
    content = capture.read_bytes()
    first.write_bytes(content[:40_001])
    stream = dc.follow(first, radar=sensor, **TOLD, idle_s=IDLE_S)
    frames = []
    for frame in islice(stream, N_FRAMES):
        frames.append(frame)
        if len(frames) == 2:
            second.write_bytes(content[40_001:])

    for frame, same in zip(frames, recorded, strict=True):
        xr.testing.assert_identical(frame, same)


def test_the_file_of_an_earlier_capture_is_not_joined(capture, sensor, tmp_path):
    first, second = tmp_path / "adc_data_0.bin", tmp_path / "adc_data_1.bin"
    content = capture.read_bytes()
    second.write_bytes(content[40_001:])
    os.utime(second, (1e9, 1e9))
    first.write_bytes(content[:40_001])

    assert len(list(dc.follow(first, radar=sensor, **TOLD, idle_s=0.1))) == 2


@pytest.mark.parametrize("how", ["shrank", "was replaced", "cannot be read"])
def test_a_file_that_does_not_only_grow_ends_the_stream_and_it_is_said(
    how, capture, sensor, tmp_path
):
    path, other = tmp_path / "growing.bin", tmp_path / "other.bin"
    path.write_bytes(capture.read_bytes()[:20_000])
    stream = dc.follow(path, radar=sensor, **TOLD, idle_s=IDLE_S)
    for _ in stream:
        match how:
            case "shrank":
                os.truncate(path, 100)
            case "was replaced":
                other.write_bytes(capture.read_bytes())
                other.replace(path)
            case _:
                path.unlink()

    assert any(how in str(one) for one in stream.findings)


def test_a_file_without_a_frame_says_what_it_has(sensor, tmp_path):
    path = tmp_path / "empty.bin"
    path.write_bytes(bytes(99))
    with pytest.raises(dc.RecordingError, match="99 bytes, and no complete frame in 0.05 s"):
        list(dc.follow(path, radar=sensor, **TOLD, idle_s=0.05))


def test_what_is_no_bare_capture_is_not_followed(sensor, tmp_path):
    path = tmp_path / "cube.bin"
    np.save(path.with_suffix(".npy"), np.zeros(20_000, np.int16))
    path.with_suffix(".npy").rename(path)
    with pytest.raises(dc.RecordingError, match="a NumPy array; expected raw samples"):
        list(dc.follow(path, radar=sensor, **TOLD, idle_s=0.05))
    with pytest.raises(dc.RecordingError, match="no such file"):
        dc.follow(tmp_path / "nothing.bin", radar=sensor)
    with pytest.raises(dc.RecordingError, match=": a folder; expected one file"):
        dc.follow(tmp_path, radar=sensor)


def status(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return int(ended.value.code or 0)


@pytest.fixture
def called(sensor, tmp_path, monkeypatch) -> list[str]:
    """What every call says of the radar, and where results go."""
    monkeypatch.chdir(tmp_path)
    Path("radar.yaml").write_text(dump(sensor))
    return ["--radar", "radar.yaml", "--device", "xwr1843", "--iq", "iq", "--out", "out"]


def test_following_finds_what_reading_finds(capture, sensor):
    scenario = dc.Scenario(
        recording=RecordingSource(path=str(capture), device="xwr1843", iq="iq"), radar=sensor
    )
    seen = []

    live = dc.process_stream(scenario, open_stream(scenario, idle_s=0.05), on_frame=seen.append)
    read = dc.run(scenario)

    xr.testing.assert_identical(live.detections, read.detections)
    xr.testing.assert_identical(live.power, read.power)
    assert live.times_s == pytest.approx(read.times_s, rel=1e-12)
    assert read.detections.sizes["detection"] >= N_FRAMES
    assert [one.number for one in seen] == list(range(N_FRAMES))
    of_each = [one.detections for one in seen]
    xr.testing.assert_identical(xr.concat(of_each, "detection"), read.detections)


def test_results_of_a_stream_keep_the_first_frame_alone(capture, called, recorded, capsys):
    arguments = ("run", str(capture), "--follow", "--idle", "50ms", "--json", "--frames", "3:9")
    assert status(*arguments, *called) == 0

    out, told = capsys.readouterr()
    cube = dc.open("out/cube.zarr").cube
    np.testing.assert_allclose(cube.values, recorded[3].values, atol=1e-7)
    made = json.loads(out)
    assert made["frames"] == 6
    assert {row["frame"] for row in made["detections"]} <= set(range(3, 9))
    assert any("first frame only" in finding["value"] for finding in made["findings"])
    assert [line.split(":")[0] for line in told.splitlines()] == [f"frame {n}" for n in range(3, 9)]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_a_run_listens_to_an_address_and_a_signal_ends_it_with_results(
    ending, capture, called, monkeypatch, capsys
):
    port, seen = _free_port(), []
    monkeypatch.setattr("dechirp.cli.stream._print_frame", seen.append)
    deadline = time.monotonic() + 5 * IDLE_S  # imports and pictures, on a busy machine

    def send_and_interrupt() -> None:
        while not _is_taken(port) and time.monotonic() < deadline:
            time.sleep(5e-3)
        dc.replay(capture, f"udp://127.0.0.1:{port}", bytes_per_s=2e6)
        while len(seen) < 4 and time.monotonic() < deadline:
            time.sleep(5e-3)
        os.kill(os.getpid(), ending)

    sender = threading.Thread(target=send_and_interrupt)
    sender.start()
    code = status("run", f"udp://127.0.0.1:{port}", "--idle", "1 min", "--json", *called)
    sender.join()

    assert code == 0
    made = json.loads(capsys.readouterr().out)
    assert made["frames"] >= 4
    assert made["detections"]
    assert made["source"] == f"udp://127.0.0.1:{port}"
    assert made["source"] in Path("out/scenario.yaml").read_text()


@pytest.fixture
def interruptible():
    """Ctrl-C as in a terminal: what a shell starts in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize(("ending", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_after_the_last_frame_ends_the_run(ending, code, capture, called, monkeypatch):
    def interrupted(*_: object) -> None:
        os.kill(os.getpid(), ending)
        raise AssertionError("was swallowed")

    monkeypatch.setattr("dechirp.experiments.streaming.build_result", interrupted)

    assert status("run", str(capture), "--follow", "--idle", "50ms", *called) == code

    assert not Path("out").exists()


def _is_taken(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--follow"], "given for a scene that is simulated"),
        (["--idle", "3s"], "given without --follow"),
        (["capture.bin", "--follow", "--idle", "3"], "--idle: 3"),
        (["capture.bin", "--follow", "--idle", "0s"], "idle_s"),
        (["capture.bin", "--follow", "--axes", "chirp,sample"], "--axes"),
        (["udp://127.0.0.1:99999"], "99999"),
        (["udp://127.0.0.1:0", "--idle", "10ms"], "no packet of samples in 0.01 s"),
    ],
)
def test_a_wrong_call_is_told_and_nothing_is_written(arguments, says, capture, called, capsys):
    Path("capture.bin").write_bytes(capture.read_bytes())
    options = called if arguments[0] not in ("--follow", "--idle") else called[-2:]

    assert status("run", *arguments, *options) == 2

    assert says in capsys.readouterr().err
    assert not Path("out").exists()
