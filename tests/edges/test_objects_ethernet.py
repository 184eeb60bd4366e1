"""Object lists as UDP datagrams: messages of ASAM OSI, lost and damaged datagrams, loopback."""

import socket
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from osi3.osi_sensordata_pb2 import SensorData
from osi3.osi_sensorview_pb2 import SensorView

import dechirp as dc
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.results.object_lists.ethernet import (
    MAX_OBJECTS_PER_LIST,
    encode_datagrams,
    object_list_from_datagrams,
    open_receiver,
    receive_datagrams,
    send_datagrams,
)
from dechirp.results.object_lists.files import read_objects, write_objects
from dechirp.results.object_lists.list_columns import MEASURED
from dechirp.results.object_lists.priority import sort_by_priority
from nightly import nightly
from sample_object_lists import (
    check_object_lists_agree,
    longest_object_list,
    random_object_list,
    single_object_list,
)

LARGEST_UDP_DATAGRAM = 65507  # 65535 bytes less 20 of IP and 8 of UDP


def random_tracks(*n_objects):
    """Return random tracks by priority, without SNR, which OSI has no field for."""
    tracks = random_object_list(*n_objects)
    n = tracks.sizes["object"]
    status = np.random.default_rng(1).choice(["confirmed", "tentative"], n)
    return sort_by_priority(
        tracks.assign(status=("object", status), snr=("object", np.full(n, np.nan)))
    )


def test_datagram_is_an_osi_message_of_a_list():
    objects = single_object_list(x=1.5, width=0.25, number=7, frame=3, time=0.5)

    (datagram,) = encode_datagrams(objects)

    message = SensorData.FromString(datagram)
    (moving_object,) = message.moving_object
    assert (message.timestamp.seconds, message.timestamp.nanos) == (0, 500_000_000)
    assert message.moving_object_header.cycle_counter == 3
    assert moving_object.header.tracking_id.value == 7
    assert moving_object.base.position.x == 1.5
    assert moving_object.base.dimension.width == 0.25
    assert moving_object.base.velocity.x == -5.0
    assert not moving_object.base.position.HasField("z")


def test_datagrams_and_traces_contain_the_same_list(tmp_path):
    objects = random_object_list(60, 0, 3)
    write_objects(objects, tmp_path / "objects.osi")

    result = object_list_from_datagrams(encode_datagrams(objects))

    check_object_lists_agree(result, read_objects(tmp_path / "objects.osi"), {})


@pytest.mark.parametrize("status", ["detection", "confirmed"])
def test_longest_list_fits_in_a_datagram_and_longer_ones_keep_the_nearest(status):
    (datagram,) = encode_datagrams(longest_object_list(status, MAX_OBJECTS_PER_LIST, frame=2**53))
    assert len(datagram) <= LARGEST_UDP_DATAGRAM

    objects = longest_object_list(status, MAX_OBJECTS_PER_LIST + 3)
    objects["x"] = ("object", np.arange(objects.sizes["object"]) + 1.0)
    with pytest.warns(dc.PhysicsWarning, match="3 objects left out of 1 list .* nearest at 401 m"):
        result = object_list_from_datagrams(encode_datagrams(objects))
    assert sorted(result.x.values) == list(range(1, MAX_OBJECTS_PER_LIST + 1))


@given(
    st.lists(st.floats(-1e150, 1e150), min_size=5, max_size=5),
    st.integers(0, 2**53),
    st.floats(-1e9, 1e9),
)
def test_double_precision_values_read_back_exactly(values, number, time):
    objects = single_object_list(
        **dict(zip(MEASURED, values, strict=False)), number=number, time=time
    )

    result = object_list_from_datagrams(encode_datagrams(objects))

    check_object_lists_agree(result, objects, {"time": 1e-6})
    np.testing.assert_array_equal([result[name].item() for name in MEASURED[:5]], values)


def test_snr_of_tracks_and_extent_of_detections_are_unknown_after_reading():
    known = {"snr": 100.0, "length": 4.5, "width": 1.8}
    (track,) = encode_datagrams(single_object_list(**known))
    (detection,) = encode_datagrams(single_object_list(**known, status="detection"))

    track_read, detection_read = (object_list_from_datagrams([one]) for one in (track, detection))

    assert np.isnan(track_read.snr.item()) and track_read.length.item() == 4.5
    assert detection_read.snr.item() == pytest.approx(100.0)
    assert np.isnan(detection_read.length.item()) and np.isnan(detection_read.width.item())


def test_lists_survive_udp_loopback():
    objects = random_tracks(300, 0, 3)
    with open_receiver(0) as receiver:
        port = receiver.getsockname()[1]
        first = objects.isel(cycle=[0, 1], object=slice(300))
        assert send_datagrams(first, "127.0.0.1", port) == 2
        last = objects.isel(cycle=[2], object=slice(300, None))
        assert send_datagrams(last, "localhost", port) == 1
        result = receive_datagrams(receiver, idle_s=0.1)

    check_object_lists_agree(result, objects, {})
    assert result.cycle_frame.values.tolist() == [0, 1, 2]


def test_host_name_with_ipv4_and_ipv6_addresses_reaches_receiver(monkeypatch):
    datagram = (socket.SOCK_DGRAM, socket.IPPROTO_UDP, "")

    def resolve_both_families(host, port, **_):
        return [
            (socket.AF_INET6, *datagram, ("::1", port, 0, 0)),
            (socket.AF_INET, *datagram, ("127.0.0.1", port)),
        ]

    with open_receiver(0) as receiver:
        monkeypatch.setattr(socket, "getaddrinfo", resolve_both_families)
        send_datagrams(random_object_list(1), "localhost", receiver.getsockname()[1])
        assert receive_datagrams(receiver, idle_s=0.1).sizes["object"] == 1


def make_losses(datagrams: list[bytes]) -> dict[str, tuple[list[bytes], str, list[int]]]:
    """Return losses of five datagrams: arrivals, warning, frames received."""
    changed = SensorData.FromString(datagrams[3])
    changed.timestamp.nanos += 1
    invalid = SensorData.FromString(datagrams[3])
    if invalid.moving_object:
        invalid.moving_object[0].base.dimension.length = -1.0
    return {
        "middle list": (datagrams[:1] + datagrams[2:], "1 missing; 4 lists", [0, 2, 3, 4]),
        "two lists": ([*datagrams[:2], datagrams[4]], "2 missing; 3 lists", [0, 1, 4]),
        "reordered": ([datagrams[i] for i in (1, 0, 2, 4, 3)], "2 late; 5 lists", [0, 1, 2, 3, 4]),
        "duplicate": ([*datagrams, datagrams[1]], "1 duplicate; 5 lists", [0, 1, 2, 3, 4]),
        "foreign": ([b"hello", *datagrams], "1 damaged or foreign; 5 lists", [0, 1, 2, 3, 4]),
        "empty": ([b"", *datagrams], "1 damaged or foreign; 5 lists", [0, 1, 2, 3, 4]),
        "truncated": (
            [*datagrams[:3], datagrams[3][:-1], datagrams[4]],
            "1 damaged or foreign, 1 missing; 4 lists",
            [0, 1, 2, 4],
        ),
        "impossible value": (
            [*datagrams[:3], invalid.SerializeToString(), datagrams[4]],
            "1 damaged or foreign, 1 missing; 4 lists",
            [0, 1, 2, 4],
        ),
    }


@pytest.mark.parametrize("loss", make_losses([b""] * 5))
def test_lost_or_late_datagrams_are_reported_and_no_list_is_partial(loss):
    objects = random_tracks(60, 5, 10, 30, 2)
    arrivals, message, frames = make_losses(encode_datagrams(objects))[loss]

    with pytest.warns(dc.PhysicsWarning, match=message):
        result = object_list_from_datagrams(arrivals)

    assert result.cycle_frame.values.tolist() == frames
    check_object_lists_agree(result, objects.isel(object=np.isin(objects.frame, frames)), {})


@nightly
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_bytes_never_stop_reception():
    objects = random_object_list(4, 4)
    datagrams = encode_datagrams(objects)
    x = set(objects.x.values[~np.isnan(objects.x.values)])
    rng = np.random.default_rng(3)
    for _ in range(200):
        damaged = bytearray(datagrams[1])
        for position in rng.integers(len(damaged), size=rng.integers(1, 5)):
            damaged[position] = rng.integers(256)
        result = object_list_from_datagrams([datagrams[0], bytes(damaged), *datagrams])
        assert x <= set(result.x.values)


def two_sensors() -> tuple[list[bytes], list[bytes]]:
    """Return datagrams of two sensors, of equal times and frames."""
    sensors = (random_object_list(3, 3, seed=1), random_object_list(2, 2, seed=2))
    return encode_datagrams(sensors[0], 7), encode_datagrams(sensors[1], 3)


def test_second_sensor_at_a_port_is_named_and_can_be_chosen():
    first, second = two_sensors()
    received = [first[0], second[0], second[1], first[1]]

    with pytest.warns(dc.PhysicsWarning, match=r"2 of sensor 3; 2 lists of sensor 7.*sensor_id="):
        of_first = object_list_from_datagrams(received)
    of_second = object_list_from_datagrams(received, sensor_id=3)

    check_object_lists_agree(of_first, object_list_from_datagrams(first), {})
    check_object_lists_agree(of_second, object_list_from_datagrams(second), {})


def test_chosen_sensor_that_sends_nothing_is_reported_with_the_others():
    with pytest.warns(dc.PhysicsWarning, match="2 of sensor 7; 0 lists of sensor 5"):
        assert not object_list_from_datagrams(two_sensors()[0], sensor_id=5).sizes["cycle"]


def test_sensors_without_lists_are_not_offered_for_a_chosen_one():
    lidar = lidar_message()
    datagrams = [lidar.SerializeToString()]
    lidar.timestamp.seconds = 2
    with pytest.warns(dc.PhysicsWarning, match="2 without moving .*; 0 lists received") as warned:
        object_list_from_datagrams([*datagrams, lidar.SerializeToString()], sensor_id=7)
    assert len(warned) == 1


def test_sensor_is_chosen_over_loopback():
    objects = random_tracks(2)
    with open_receiver(0) as receiver:
        port = receiver.getsockname()[1]
        send_datagrams(random_tracks(1), "127.0.0.1", port)
        send_datagrams(objects, "127.0.0.1", port, sensor_id=2**63 - 1)
        result = receive_datagrams(receiver, sensor_id=2**63 - 1, idle_s=0.1)

    check_object_lists_agree(result, objects, {})


def lidar_message() -> SensorData:
    message = SensorData()
    message.timestamp.seconds = 1
    message.sensor_id.value = 1
    message.feature_data.lidar_sensor.add().detection.add().position.distance = 3.0
    return message


def camera_message() -> SensorData:
    message = SensorData()
    message.timestamp.seconds = 1
    message.sensor_id.value = 1
    message.lane_boundary.add().header.tracking_id.value = 5
    return message


@pytest.mark.parametrize("message", [lidar_message(), camera_message()])
def test_messages_of_other_sensors_are_no_empty_lists(message, tmp_path):
    datagrams = encode_datagrams(random_tracks(2))
    arrivals = [message.SerializeToString(), *datagrams]
    with pytest.warns(dc.PhysicsWarning, match="1 without moving objects or radar detections"):
        received = object_list_from_datagrams(arrivals)
    assert received.sizes == {"object": 2, "cycle": 1}

    messages = [SensorData.FromString(datagram) for datagram in arrivals]
    with pytest.warns(dc.PhysicsWarning, match="1 without moving objects .*; 1 list read"):
        read = read_objects(write_trace(tmp_path / "x.osi", messages))
    assert read.sizes == {"object": 2, "cycle": 1}


def test_sensors_without_lists_are_refused_in_traces_and_counted_at_ports(tmp_path):
    messages = [lidar_message(), camera_message()]
    messages[1].sensor_id.value = 2
    with pytest.raises(RecordingError, match="2 messages without moving objects .* sensors 1, 2"):
        read_objects(write_trace(tmp_path / "x.osi", messages))
    datagrams = [message.SerializeToString() for message in messages]
    with pytest.warns(dc.PhysicsWarning, match="2 without moving objects .*; 0 lists"):
        assert not object_list_from_datagrams(datagrams).sizes["cycle"]
    with pytest.warns(dc.PhysicsWarning, match="1 without moving objects .*; 1 list received"):
        chosen = object_list_from_datagrams(datagrams, sensor_id=2)
    assert chosen.sizes == {"object": 0, "cycle": 1}


CONTENTS = ("stationary object", "no features", "no sensor", "header")


def make_free_road(content: str) -> SensorData:
    """Return a message of a sensor without object list, such as one of a free road."""
    message = SensorData()
    message.timestamp.nanos = 50_000_000
    if content != "no sensor":
        message.sensor_id.value = 0
    if content == "stationary object":
        message.stationary_object.add().header.tracking_id.value = 5
    if content == "no features":
        message.feature_data.version.version_major = 3
    return message


@pytest.mark.parametrize("message", [lidar_message(), *map(make_free_road, CONTENTS)])
def test_only_sensor_without_lists_has_empty_lists_and_a_warning(message, tmp_path):
    path = write_trace(tmp_path / "x.osi", [message])
    datagrams = [message.SerializeToString()]
    for read in (lambda: read_objects(path), lambda: object_list_from_datagrams(datagrams)):
        with pytest.warns(dc.PhysicsWarning, match="1 without moving objects .*; 1 list "):
            assert read().sizes == {"object": 0, "cycle": 1}


@pytest.mark.parametrize("content", CONTENTS)
def test_free_road_is_an_empty_cycle_of_its_sensor(content, tmp_path):
    messages = [SensorData.FromString(one) for one in encode_datagrams(random_tracks(1, 1, 1))]
    messages[1] = make_free_road(content)

    of_trace = read_objects(write_trace(tmp_path / "x.osi", messages))
    received = object_list_from_datagrams([message.SerializeToString() for message in messages])

    for objects in (of_trace, received):
        assert objects.frame.values.tolist() == [0, 2]
        np.testing.assert_allclose(objects.cycle_time, [0.0, 0.05, 0.1])


def make_cycle_messages(counter: str, n_cycles: int = 6) -> tuple[list[bytes], list[bytes]]:
    """Return the lists of a sensor, and messages of its lane boundaries at the same times."""
    lists, lanes = [], []
    for datagram in encode_datagrams(random_tracks(*[1] * n_cycles)):
        message = SensorData.FromString(datagram)
        message.ClearField("sensor_id")
        lane = camera_message()
        lane.ClearField("sensor_id")
        lane.timestamp.CopyFrom(message.timestamp)
        if counter in ("lanes", "none"):
            message.moving_object_header.ClearField("cycle_counter")
        if counter in ("both", "lanes"):
            lane.moving_object_header.cycle_counter = round(message.timestamp.nanos / 50e6)
        lists.append(message.SerializeToString())
        lanes.append(lane.SerializeToString())
    return lists, lanes


ORDERS = {
    "list first": (0, 6, 1, 7, 2, 8, 3, 9, 4, 10, 5, 11),
    "lanes first": (6, 0, 7, 1, 8, 2, 9, 3, 10, 4, 11, 5),
    "all lanes late": range(12),
    "mixed": (0, 1, 7, 6, 8, 9, 2, 3, 5, 11, 10, 4),
}


@pytest.mark.parametrize("counter", ["lists", "both", "lanes", "none"])
@pytest.mark.parametrize("order", ORDERS)
def test_messages_without_objects_at_the_time_of_a_list_belong_to_its_cycle(order, counter):
    lists, lanes = make_cycle_messages(counter)
    arrivals = [[*lists, *lanes][index] for index in ORDERS[order]]
    with pytest.warns(dc.PhysicsWarning, match="6 without objects at the time of .*; 6 lists"):
        received = object_list_from_datagrams(arrivals)

    assert received.frame.values.tolist() == list(range(6))
    np.testing.assert_allclose(received.cycle_time, 0.05 * np.arange(6), atol=1e-9)


@pytest.mark.parametrize("counter", ["lists", "both", "lanes", "none"])
@pytest.mark.parametrize("order", ["list first", "lanes first"])
def test_traces_with_several_messages_in_a_cycle_are_read(order, counter, tmp_path):
    lists, lanes = make_cycle_messages(counter)
    messages = [SensorData.FromString([*lists, *lanes][index]) for index in ORDERS[order]]
    path = write_trace(tmp_path / "x.osi", messages)
    with pytest.warns(dc.PhysicsWarning, match="6 without objects at the time of .*; 6 lists read"):
        objects = read_objects(path)

    assert objects.frame.values.tolist() == list(range(6))
    np.testing.assert_allclose(objects.cycle_time, 0.05 * np.arange(6), atol=1e-9)


def test_empty_lists_of_equal_time_and_other_frames_are_kept():
    first, second = encode_datagrams(random_tracks(1, 0))
    changed = SensorData.FromString(second)
    changed.timestamp.CopyFrom(SensorData.FromString(first).timestamp)
    with pytest.warns(dc.PhysicsWarning, match="1 of equal times"):
        received = object_list_from_datagrams([first, changed.SerializeToString()])
    assert received.cycle_frame.values.tolist() == [0, 1]


def test_messages_of_an_old_run_are_no_part_of_cycles_of_a_later_one():
    lists, lanes = make_cycle_messages("lists", 30)
    with pytest.warns(dc.PhysicsWarning, match="1 restart of the sender.*from frame 30 on"):
        received = object_list_from_datagrams([*lanes, *lists])
    assert received.sizes == {"object": 30, "cycle": 60}


@pytest.mark.parametrize("time_after_s", [0.0, 0.3])
@pytest.mark.parametrize("order", ["list first", "lanes first"])
def test_restarts_of_senders_with_several_messages_in_a_cycle_are_one_run_each(order, time_after_s):
    arrivals = []
    for run, time_s in enumerate((0.0, time_after_s)):
        lists, lanes = make_cycle_messages("lists")
        messages = [SensorData.FromString(datagram) for datagram in (*lists, *lanes)]
        for message in messages:
            message.timestamp.nanos += round(time_s * 1e9)
            message.mounting_position.position.x = float(run)  # no byte-identical datagrams
        arrivals += [messages[index].SerializeToString() for index in ORDERS[order]]

    with pytest.warns(dc.PhysicsWarning) as warned:
        received = object_list_from_datagrams(arrivals)

    restart, merged = [str(warning.message) for warning in warned]
    assert "1 restart of the sender" in restart and "from frame 6 on" in restart
    assert "12 without objects at the time of another message" in merged
    assert received.frame.values.tolist() == list(range(12))
    np.testing.assert_allclose(received.cycle_time, 0.05 * np.arange(12), atol=1e-9)


def test_frames_are_in_order_across_lists_without_counter():
    messages = [SensorData.FromString(one) for one in encode_datagrams(random_tracks(1, 1, 1))]
    messages[0].moving_object_header.cycle_counter = 9
    messages[1].moving_object_header.ClearField("cycle_counter")
    with pytest.warns(dc.PhysicsWarning, match="1 restart of the sender.*from frame 2 on"):
        received = object_list_from_datagrams([one.SerializeToString() for one in messages])
    np.testing.assert_allclose(received.cycle_time, [0.0, 0.05, 0.1])


def with_counter(datagram: bytes, counter: int) -> bytes:
    message = SensorData.FromString(datagram)
    message.moving_object_header.cycle_counter = counter
    return message.SerializeToString()


@pytest.mark.parametrize("counter", [0, 7])
def test_constant_counters_are_no_restarts(counter, tmp_path):
    objects = random_tracks(*[1] * 6)
    datagrams = [with_counter(datagram, counter) for datagram in encode_datagrams(objects)]
    path = write_trace(tmp_path / "x.osi", map(SensorData.FromString, datagrams))

    for result in (object_list_from_datagrams(datagrams), read_objects(path)):
        check_object_lists_agree(result, objects, {})

    datagrams[2:4] = datagrams[3], datagrams[2]
    with pytest.warns(dc.PhysicsWarning, match="objects: 1 late; 6 lists"):
        check_object_lists_agree(object_list_from_datagrams(datagrams), objects, {})


def test_messages_of_other_types_are_no_empty_lists(tmp_path):
    view = SensorView()
    view.version.version_major = 3
    view.timestamp.seconds = 1
    view.sensor_id.value = 1
    truth = view.global_ground_truth
    truth.timestamp.seconds = 1
    truth.version.version_major = 3
    for number in range(3):
        truth.moving_object.add().id.value = number
        truth.moving_object[number].base.position.x = 20.0
    for message in (view, truth):
        with pytest.warns(dc.PhysicsWarning, match="1 damaged or foreign; 0 lists"):
            assert not object_list_from_datagrams([message.SerializeToString()]).sizes["cycle"]
        with pytest.raises(RecordingError, match="of another type"):
            read_objects(write_trace(tmp_path / "x.osi", [message]))


def test_trace_of_two_sensors_is_refused_by_their_numbers(tmp_path):
    messages = [SensorData.FromString(sensor[0]) for sensor in two_sensors()]
    with pytest.raises(RecordingError, match="sensors 3, 7"):
        read_objects(write_trace(tmp_path / "x.osi", messages))


def write_trace(path, messages):
    contents = [message.SerializeToString() for message in messages]
    path.write_bytes(b"".join(len(content).to_bytes(4, "little") + content for content in contents))
    return path


def shift_lists(objects, time_s: float, frame: int):
    """Return an object list with other times and frames."""
    return objects.assign(
        time=objects.time + time_s,
        frame=objects.frame + frame,
        cycle_time=objects.cycle_time + time_s,
        cycle_frame=objects.cycle_frame + frame,
    )


RESTARTS = {
    "both zero, with other objects": (0.0, 0, 0.0, 0),
    "clock continues": (0.0, 0, 100.0, 0),
    "time and frame of the middle": (0.0, 0, 0.01, 0),
    "time back, frame continues": (50.0, 0, 0.0, 20),
    "receiver came late": (50.0, 1000, 0.0, 0),
}


@pytest.mark.parametrize("n_before", [2, 5, 12])
@pytest.mark.parametrize("restart", RESTARTS.values(), ids=RESTARTS)
def test_lists_before_and_after_a_restart_of_the_sender_are_kept(restart, n_before):
    time_before, frame_before, time_after, frame_after = restart
    n_after = 12
    before = shift_lists(random_object_list(*[2] * n_before, seed=1), time_before, frame_before)
    after = shift_lists(random_object_list(*[3] * n_after, seed=2), time_after, frame_after)

    with pytest.warns(dc.PhysicsWarning, match="1 restart of the sender.* from frame") as warned:
        result = object_list_from_datagrams([*encode_datagrams(before), *encode_datagrams(after)])

    (warning,) = warned
    n_lists = n_before + n_after
    assert result.cycle_frame.values.tolist() == list(range(n_lists))
    expected_time = after.cycle_time.values
    overlaps = expected_time[0] < before.cycle_time.values[-1]
    if overlaps:
        expected_time = before.cycle_time.values[-1] + 0.05 * np.arange(1, n_after + 1)
    assert ("increased" in str(warning.message)) == overlaps
    assert f"from frame {n_before} on" in str(warning.message)
    np.testing.assert_allclose(result.cycle_time, [*before.cycle_time.values, *expected_time])
    assert np.bincount(result.frame).tolist() == [2] * n_before + [3] * n_after


@pytest.mark.parametrize("index", [5, 9])
@pytest.mark.parametrize("is_duplicate", [False, True])
@pytest.mark.parametrize("time_after_s", [0.0, 50.5])  # clock of the restart: zero, or continues
def test_late_list_of_the_run_before_a_restart_belongs_to_it(index, is_duplicate, time_after_s):
    before = shift_lists(random_tracks(*[1] * 10), 50.0, 1000)
    after = shift_lists(random_tracks(*[2] * 10), time_after_s, 0)
    old, new = encode_datagrams(before), encode_datagrams(after)
    on_time = old if is_duplicate else [*old[:index], *old[index + 1 :]]

    with pytest.warns(dc.PhysicsWarning) as warned:
        result = object_list_from_datagrams([*on_time, *new[:3], old[index], *new[3:]])

    assert np.bincount(result.frame).tolist() == [1] * 10 + [2] * 10
    np.testing.assert_allclose(result.cycle_time, 50.0 + 0.05 * np.arange(20), atol=1e-9)
    restart, *others = [str(warning.message) for warning in warned]
    assert "1 restart" in restart
    assert ("from frame 10 on times increased by 50.5 s" in restart) == (time_after_s == 0.0)
    kind = "1 duplicate" if is_duplicate else "1 late"
    assert [kind in other for other in others] == [True] * (is_duplicate or index < 9)
    assert "missing" not in "".join(others)


def test_list_that_arrives_within_a_second_is_sorted_to_its_place():
    objects = random_tracks(*[1] * 30)
    datagrams = encode_datagrams(objects)
    datagrams.insert(25, datagrams.pop(5))  # 20 lists of 50 ms: exactly one second

    with pytest.warns(dc.PhysicsWarning, match="objects: 1 late; 30 lists"):
        result = object_list_from_datagrams(datagrams)

    check_object_lists_agree(result, objects, {})
    np.testing.assert_allclose(result.cycle_time, objects.cycle_time, atol=1e-9)


def test_lists_of_equal_time_are_kept_in_order_of_their_frames():
    messages = [SensorData.FromString(one) for one in encode_datagrams(random_tracks(*[1] * 6))]
    for message, tenths in zip(messages, (0, 0, 0, 1, 1, 2), strict=True):
        message.timestamp.nanos = tenths * 100_000_000
    datagrams = [messages[i].SerializeToString() for i in (0, 2, 1, 3, 4, 5)]

    with pytest.warns(dc.PhysicsWarning, match="1 late, 3 of equal times.*; 6 lists"):
        result = object_list_from_datagrams(datagrams)

    assert result.frame.values.tolist() == list(range(6))
    np.testing.assert_allclose(result.cycle_time, [0.0, 1e-5, 2e-5, 0.1, 0.10001, 0.2], atol=1e-9)


def test_warnings_are_attributed_to_the_line_of_the_user(tmp_path):
    datagrams = encode_datagrams(random_tracks(1, 1))
    trace = [lidar_message(), *map(SensorData.FromString, datagrams)]
    path = write_trace(tmp_path / "x.osi", trace)
    with open_receiver(0) as receiver, pytest.warns(dc.PhysicsWarning) as warned:
        for datagram in [
            b"foreign",
            *datagrams,
            *two_sensors()[0],
            *encode_datagrams(random_tracks(3)),
        ]:
            receiver.sendto(datagram, receiver.getsockname())
        receive_datagrams(receiver, idle_s=0.1)
        read_objects(path)

    assert [warning.filename for warning in warned] == [__file__] * 4


def test_sender_that_restarts_for_each_list_keeps_them_all():
    lists = [encode_datagrams(random_object_list(1, seed=seed))[0] for seed in range(6)]
    with pytest.warns(dc.PhysicsWarning, match="5 restarts of the sender.* and 2 more"):
        assert object_list_from_datagrams(lists).sizes == {"object": 6, "cycle": 6}


def test_messages_of_other_senders_without_counter_are_read_in_order():
    messages = [
        SensorData.FromString(datagram) for datagram in encode_datagrams(random_tracks(1, 1))
    ]
    for message in messages:
        message.moving_object_header.ClearField("cycle_counter")

    result = object_list_from_datagrams([message.SerializeToString() for message in messages])

    assert result.cycle_frame.values.tolist() == [0, 1]


def test_no_datagrams_give_empty_list():
    assert object_list_from_datagrams([]).sizes == {"object": 0, "cycle": 0}
    assert object_list_from_datagrams(encode_datagrams(random_object_list(0))).sizes == {
        "object": 0,
        "cycle": 1,
    }


def test_missing_osi_library_is_reported_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "osi3.osi_sensordata_pb2", None)
    monkeypatch.setitem(sys.modules, "osi3.osi_version_pb2", None)
    with open_receiver(0) as receiver:
        port = receiver.getsockname()[1]
        for call in (
            lambda: send_datagrams(single_object_list(), "127.0.0.1", port),
            lambda: receive_datagrams(receiver, idle_s=0.1),
        ):
            with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
                call()


INVALID_CALLS = {
    "port zero": lambda: send_datagrams(random_object_list(1), "127.0.0.1", 0),
    "port above 65535": lambda: send_datagrams(random_object_list(1), "127.0.0.1", 65536),
    "port of wrong type": lambda: send_datagrams(random_object_list(1), "127.0.0.1", "http"),
    "unknown host": lambda: send_datagrams(random_object_list(1), "no such host", 5000),
    "host of wrong type": lambda: send_datagrams(random_object_list(1), 17, 5000),
    "list of wrong type": lambda: send_datagrams("objects", "127.0.0.1", 5000),
    "foreign address": lambda: open_receiver(0, "192.0.2.1"),
    "negative port": lambda: open_receiver(-1),
    "negative sensor": lambda: send_datagrams(random_object_list(1), "::1", 5000, sensor_id=-1),
    "receiver of wrong type": lambda: receive_datagrams(5000),
}


@pytest.mark.parametrize("call", INVALID_CALLS.values(), ids=INVALID_CALLS)
def test_rejects_invalid_calls(call):
    with pytest.raises(InvalidSetting):
        call()


def test_rejects_closed_and_stream_sockets():
    with open_receiver(0) as closed:
        pass
    with socket.socket() as stream:
        for receiver in (closed, stream):
            with pytest.raises(InvalidSetting, match="open UDP socket"):
                receive_datagrams(receiver, idle_s=0.1)


def test_rejects_zero_idle_time():
    with open_receiver(0) as receiver, pytest.raises(InvalidSetting, match="idle_s"):
        receive_datagrams(receiver, idle_s=0.0)
