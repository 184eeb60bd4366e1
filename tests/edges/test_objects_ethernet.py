"""Object lists as UDP datagrams: the layout, what is lost on the way, and a loopback."""

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
    assemble_datagrams,
    encode_datagrams,
)
from dechirp.results.object_lists.ethernet import open_receiver, receive_datagrams, send_datagrams
from dechirp.results.object_lists.list_columns import MEASURED
from objects_made import must_be_equal, objects_at, one

SINGLE = {"relative": 2.0**-24, "snr": 1e-6}
"""What single precision leaves."""


def test_a_datagram_is_laid_out_as_its_page_says():
    found = one(x=1.5, width=0.25, number=7, frame=3, time=0.5, snr=8.0)

    (datagram,) = encode_datagrams(found, sequence=11)

    assert struct.unpack(">4sHHHHIqIIII", datagram[:36] + bytes(4)) == (
        *(b"DCOL", 1, 1, 0, 1, 11, 500_000_000, 3, 1, 0, 0),
    )
    assert struct.unpack_from(">I", datagram, 36)[0] == zlib.crc32(
        datagram[:36] + bytes(4) + datagram[40:]
    )
    number, status, *values = struct.unpack(">IB3x12f", datagram[40:])
    assert (number, status) == (7, 2)
    told = dict(zip(MEASURED, values, strict=True))
    assert (told["x"], told["width"], told["snr"], told["vx"]) == (1.5, 0.25, 8.0, -5.0)
    assert math.isnan(told["z"])


def test_no_datagram_is_longer_than_ethernet_carries_in_one_piece():
    sent = encode_datagrams(objects_at(3 * MAX_OBJECTS_PER_DATAGRAM + 1))

    # 1500 bytes less 20 of IP and 8 of UDP.
    assert [len(datagram) for datagram in sent] == [1440] * 3 + [96]
    assert 1440 + 56 > 1472


@given(
    st.lists(st.floats(-(2.0**127), 2.0**127, width=32), min_size=5, max_size=5),
    st.integers(0, 2**32 - 1),
    st.floats(-1e9, 1e9),
)
def test_what_single_precision_holds_is_read_back(values, number, time):
    found = one(**dict(zip(MEASURED, values, strict=False)), number=number, time=time)

    read = assemble_datagrams(encode_datagrams(found))

    must_be_equal(read, found, SINGLE | {"time": 1e-6})
    np.testing.assert_array_equal([read[name].item() for name in MEASURED[:5]], values)


def test_lists_go_over_the_network_and_come_back():
    found = objects_at(60, 0, 3)
    with open_receiver(0) as line:
        port = line.getsockname()[1]
        following = send_datagrams(found.isel(cycle=[0, 1], object=slice(60)), "127.0.0.1", port)
        assert (
            send_datagrams(
                found.isel(cycle=[2], object=slice(60, None)), "localhost", port, sequence=4
            )
            == 5
        )
        read = receive_datagrams(line, idle_s=0.1)

    assert following == 4
    must_be_equal(read, found, SINGLE)
    assert read.cycle_frame.values.tolist() == [0, 1, 2]


def test_a_name_of_both_kinds_of_addresses_is_that_of_the_listener(monkeypatch):
    datagram = (socket.SOCK_DGRAM, socket.IPPROTO_UDP, "")

    def both(host, port, **_):
        return [
            (socket.AF_INET6, *datagram, ("::1", port, 0, 0)),
            (socket.AF_INET, *datagram, ("127.0.0.1", port)),
        ]

    with open_receiver(0) as line:
        monkeypatch.setattr(socket, "getaddrinfo", both)
        send_datagrams(objects_at(1), "localhost", line.getsockname()[1])
        assert receive_datagrams(line, idle_s=0.1).sizes["object"] == 1


def flipped(datagram: bytes, bit: int) -> bytes:
    changed = bytearray(datagram)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_any_flipped_bit_is_found_by_the_checksum():
    sent = encode_datagrams(objects_at(2, 2))
    for bit in range(0, 8 * len(sent[0]), 7):
        with pytest.warns(dc.PhysicsWarning, match="1 damaged or foreign"):
            read = assemble_datagrams([flipped(sent[0], bit), sent[1]])
        assert read.frame.values.tolist() == [1, 1]


def lost(sent: list[bytes]) -> dict[str, tuple[list[bytes], str, list[int]]]:
    """Ways in which the seven datagrams of four lists can arrive, what is said, what is left."""
    return {
        "one in the middle": (sent[:1] + sent[2:], "1 missing", [1, 2, 3]),
        "a whole list": (sent[:3] + sent[4:], "1 missing", [0, 2, 3]),
        "the last one": (sent[:-1], "1 missing", [0, 1, 2]),
        "the first one": (sent[1:], "1 missing", [1, 2, 3]),
        "another order": ([sent[1], sent[0], *sent[2:]], "1 late; 4 of 4", [0, 1, 2, 3]),
        "twice": ([*sent[:3], sent[1], *sent[3:]], "1 duplicate; 4 of 4", [0, 1, 2, 3]),
        "a stranger's": ([b"hello", *sent], "1 damaged or foreign; 4 of 4", [0, 1, 2, 3]),
        "cut short": ([*sent[:3], sent[3][:-1], *sent[4:]], "1 damaged", [0, 2, 3]),
    }


@pytest.mark.parametrize("way", lost([b""] * 7))
@pytest.mark.parametrize("first", [0, 2**32 - 3])
def test_what_is_lost_or_late_is_told_and_no_list_is_half(way, first):
    found = objects_at(60, 5, 10, 30)
    arrived, said, left = lost(encode_datagrams(found, sequence=first))[way]

    with pytest.warns(dc.PhysicsWarning, match=said):
        read = assemble_datagrams(arrived)

    assert read.cycle_frame.values.tolist() == left
    must_be_equal(read, found.isel(object=np.isin(found.frame, left)), SINGLE)


def test_datagrams_that_do_not_agree_on_their_number_are_no_list():
    (sent,) = encode_datagrams(objects_at(2))
    second, third = (
        _checked(sent[:6] + struct.pack(">HHHI", n, place, 2, place) + sent[16:])
        for n, place in ((2, 1), (3, 2))
    )

    with pytest.warns(dc.PhysicsWarning, match="0 of 2 lists are complete"):
        assert assemble_datagrams([second, third]).sizes["cycle"] == 0


def _checked(datagram: bytes) -> bytes:
    """The same with the CRC-32 that its page says, at byte 36."""
    crc = zlib.crc32(datagram[:36] + bytes(4) + datagram[40:])
    return datagram[:36] + struct.pack(">I", crc) + datagram[40:]


def test_nothing_at_all_is_an_empty_list():
    assert assemble_datagrams([]).sizes == {"object": 0, "cycle": 0}
    assert assemble_datagrams(encode_datagrams(objects_at(0))).sizes == {"object": 0, "cycle": 1}


@pytest.mark.parametrize("columns", [{"number": 2**32}, {"x": 1e39}, {"time": 1e10}], ids=str)
def test_what_no_field_can_tell_is_told_as_its_end(columns):
    with pytest.warns(dc.PhysicsWarning, match="1 values clipped to the range"):
        read = assemble_datagrams(encode_datagrams(one(**columns)))

    ends = {"number": 2**32 - 1, "x": float(np.finfo(np.float32).max), "time": 9.2e9}
    (name,) = columns
    assert read[name].item() == ends[name]


WRONG = {
    "a port below": lambda: send_datagrams(objects_at(1), "127.0.0.1", 0),
    "a port above": lambda: send_datagrams(objects_at(1), "127.0.0.1", 65536),
    "a port that is none": lambda: send_datagrams(objects_at(1), "127.0.0.1", "http"),
    "no such host": lambda: send_datagrams(objects_at(1), "no such host", 5000),
    "a host that is none": lambda: send_datagrams(objects_at(1), 17, 5000),
    "no list": lambda: send_datagrams("objects", "127.0.0.1", 5000),
    "a sequence beyond": lambda: send_datagrams(objects_at(1), "127.0.0.1", 5000, sequence=2**32),
    "a network of others": lambda: open_receiver(0, "192.0.2.1"),
    "no port": lambda: open_receiver(-1),
    "no line": lambda: receive_datagrams(5000),
}


@pytest.mark.parametrize("call", WRONG.values(), ids=WRONG)
def test_wrong_calls_are_refused(call):
    with pytest.raises(InvalidSetting):
        call()


def test_a_line_that_is_closed_or_none_of_datagrams_is_refused():
    with open_receiver(0) as closed:
        pass
    with socket.socket() as stream:
        for line in (closed, stream):
            with pytest.raises(InvalidSetting, match="open UDP socket"):
                receive_datagrams(line, idle_s=0.1)


def test_a_wait_that_is_none_is_refused():
    with open_receiver(0) as line, pytest.raises(InvalidSetting, match="idle_s"):
        receive_datagrams(line, idle_s=0.0)
