"""Object lists as UDP datagrams: messages of ASAM OSI, lost and damaged datagrams, loopback."""

import socket
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from osi3.osi_sensordata_pb2 import SensorData

import dechirp as dc
from dechirp.core.errors import InvalidSetting
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


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_bytes_never_stop_reception():
    datagrams = encode_datagrams(random_object_list(4, 4))
    rng = np.random.default_rng(3)
    for _ in range(200):
        damaged = bytearray(datagrams[1])
        for position in rng.integers(len(damaged), size=rng.integers(1, 5)):
            damaged[position] = rng.integers(256)
        result = object_list_from_datagrams([datagrams[0], bytes(damaged)])
        assert 0 in result.cycle_frame.values or result.sizes["cycle"]


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
