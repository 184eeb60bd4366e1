"""Object lists as UDP datagrams: layout, lost and damaged datagrams, and loopback."""

import math
import socket
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.results.object_lists.datagrams import (
    MAX_OBJECTS_PER_DATAGRAM,
    encode_datagrams,
    object_list_from_datagrams,
)
from dechirp.results.object_lists.ethernet import open_receiver, receive_datagrams, send_datagrams
from dechirp.results.object_lists.list_columns import MEASURED
from sample_object_lists import check_object_lists_agree, random_object_list, single_object_list

SINGLE_PRECISION = {"relative": 2.0**-24, "snr": 1e-6}
"""Tolerances of single precision."""


def test_datagram_has_documented_layout():
    objects = single_object_list(x=1.5, width=0.25, number=7, frame=3, time=0.5, snr=8.0)

    (datagram,) = encode_datagrams(objects, sequence=11)

    assert struct.unpack(">4sHHHHIqIIII", datagram[:36] + bytes(4)) == (
        *(b"DCOL", 1, 1, 0, 1, 11, 500_000_000, 3, 1, 0, 0),
    )
    assert struct.unpack_from(">I", datagram, 36)[0] == zlib.crc32(
        datagram[:36] + bytes(4) + datagram[40:]
    )
    number, status, *values = struct.unpack(">IB3x12f", datagram[40:])
    assert (number, status) == (7, 2)
    columns = dict(zip(MEASURED, values, strict=True))
    assert (columns["x"], columns["width"], columns["snr"], columns["vx"]) == (1.5, 0.25, 8.0, -5.0)
    assert math.isnan(columns["z"])


def test_datagrams_fit_in_one_ethernet_frame():
    datagrams = encode_datagrams(random_object_list(3 * MAX_OBJECTS_PER_DATAGRAM + 1))

    # 1500 bytes less 20 of IP and 8 of UDP.
    assert [len(datagram) for datagram in datagrams] == [1440] * 3 + [96]
    assert 1440 + 56 > 1472


@given(
    st.lists(st.floats(-(2.0**127), 2.0**127, width=32), min_size=5, max_size=5),
    st.integers(0, 2**32 - 1),
    st.floats(-1e9, 1e9),
)
def test_single_precision_values_read_back_exactly(values, number, time):
    objects = single_object_list(
        **dict(zip(MEASURED, values, strict=False)), number=number, time=time
    )

    result = object_list_from_datagrams(encode_datagrams(objects))

    check_object_lists_agree(result, objects, SINGLE_PRECISION | {"time": 1e-6})
    np.testing.assert_array_equal([result[name].item() for name in MEASURED[:5]], values)


def test_lists_survive_udp_loopback():
    objects = random_object_list(60, 0, 3)
    with open_receiver(0) as receiver:
        port = receiver.getsockname()[1]
        next_sequence = send_datagrams(
            objects.isel(cycle=[0, 1], object=slice(60)), "127.0.0.1", port
        )
        assert (
            send_datagrams(
                objects.isel(cycle=[2], object=slice(60, None)), "localhost", port, sequence=4
            )
            == 5
        )
        result = receive_datagrams(receiver, idle_s=0.1)

    assert next_sequence == 4
    check_object_lists_agree(result, objects, SINGLE_PRECISION)
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


def flip_bit(datagram: bytes, bit: int) -> bytes:
    content = bytearray(datagram)
    content[bit // 8] ^= 1 << bit % 8
    return bytes(content)


def test_checksum_detects_any_flipped_bit():
    datagrams = encode_datagrams(random_object_list(2, 2))
    for bit in range(0, 8 * len(datagrams[0]), 7):
        with pytest.warns(dc.PhysicsWarning, match="1 damaged or foreign"):
            result = object_list_from_datagrams([flip_bit(datagrams[0], bit), datagrams[1]])
        assert result.frame.values.tolist() == [1, 1]


def make_losses(datagrams: list[bytes]) -> dict[str, tuple[list[bytes], str, list[int]]]:
    """Return losses of seven datagrams of four lists: arrivals, warning, complete frames."""
    return {
        "middle datagram": (datagrams[:1] + datagrams[2:], "1 missing", [1, 2, 3]),
        "complete list": (datagrams[:3] + datagrams[4:], "1 missing", [0, 2, 3]),
        "last datagram": (datagrams[:-1], "1 missing", [0, 1, 2]),
        "first datagram": (datagrams[1:], "1 missing", [1, 2, 3]),
        "reordered": (
            [datagrams[1], datagrams[0], *datagrams[2:]],
            "1 late; 4 of 4",
            [0, 1, 2, 3],
        ),
        "duplicate": (
            [*datagrams[:3], datagrams[1], *datagrams[3:]],
            "1 duplicate; 4 of 4",
            [0, 1, 2, 3],
        ),
        "foreign": ([b"hello", *datagrams], "1 damaged or foreign; 4 of 4", [0, 1, 2, 3]),
        "truncated": ([*datagrams[:3], datagrams[3][:-1], *datagrams[4:]], "1 damaged", [0, 2, 3]),
    }


@pytest.mark.parametrize("loss", make_losses([b""] * 7))
@pytest.mark.parametrize("first", [0, 2**32 - 3])
def test_lost_or_late_datagrams_are_reported_and_no_list_is_partial(loss, first):
    objects = random_object_list(60, 5, 10, 30)
    arrivals, message, remaining_frames = make_losses(encode_datagrams(objects, sequence=first))[
        loss
    ]

    with pytest.warns(dc.PhysicsWarning, match=message):
        result = object_list_from_datagrams(arrivals)

    assert result.cycle_frame.values.tolist() == remaining_frames
    check_object_lists_agree(
        result, objects.isel(object=np.isin(objects.frame, remaining_frames)), SINGLE_PRECISION
    )


def test_datagrams_with_inconsistent_count_give_no_list():
    (datagram,) = encode_datagrams(random_object_list(2))
    second, third = (
        _set_checksum(datagram[:6] + struct.pack(">HHHI", n, place, 2, place) + datagram[16:])
        for n, place in ((2, 1), (3, 2))
    )

    with pytest.warns(dc.PhysicsWarning, match="0 of 2 lists are complete"):
        assert object_list_from_datagrams([second, third]).sizes["cycle"] == 0


def _set_checksum(datagram: bytes) -> bytes:
    """Return the datagram with its CRC-32 at byte 36, as documented."""
    crc = zlib.crc32(datagram[:36] + bytes(4) + datagram[40:])
    return datagram[:36] + struct.pack(">I", crc) + datagram[40:]


def test_no_datagrams_give_empty_list():
    assert object_list_from_datagrams([]).sizes == {"object": 0, "cycle": 0}
    assert object_list_from_datagrams(encode_datagrams(random_object_list(0))).sizes == {
        "object": 0,
        "cycle": 1,
    }


@pytest.mark.parametrize("columns", [{"number": 2**32}, {"x": 1e39}, {"time": 1e10}], ids=str)
def test_values_beyond_field_range_are_clipped(columns):
    with pytest.warns(dc.PhysicsWarning, match="1 values clipped to the range"):
        result = object_list_from_datagrams(encode_datagrams(single_object_list(**columns)))

    limits = {"number": 2**32 - 1, "x": float(np.finfo(np.float32).max), "time": 9.2e9}
    (name,) = columns
    assert result[name].item() == limits[name]


INVALID_CALLS = {
    "port zero": lambda: send_datagrams(random_object_list(1), "127.0.0.1", 0),
    "port above 65535": lambda: send_datagrams(random_object_list(1), "127.0.0.1", 65536),
    "port of wrong type": lambda: send_datagrams(random_object_list(1), "127.0.0.1", "http"),
    "unknown host": lambda: send_datagrams(random_object_list(1), "no such host", 5000),
    "host of wrong type": lambda: send_datagrams(random_object_list(1), 17, 5000),
    "list of wrong type": lambda: send_datagrams("objects", "127.0.0.1", 5000),
    "sequence above 32 bits": lambda: send_datagrams(
        random_object_list(1), "127.0.0.1", 5000, sequence=2**32
    ),
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
