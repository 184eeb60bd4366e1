"""Object lists on CAN FD: time on the bus, codes, whole lists or none, logs and a bus."""

import re
import zlib

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.results.object_lists.can_bus import FRAME_LENGTHS, CanFd, worst_case_frame_bits
from dechirp.results.object_lists.can_frames import (
    bus_load,
    encode_frames,
    list_duration_s,
    max_fitting_objects,
)
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, read_layout, shipped_dbc
from dechirp.results.object_lists.can_lists import assemble_lists
from dechirp.results.object_lists.can_logs import (
    SUFFIXES,
    read_can_log,
    receive_can,
    send_can,
    write_can_log,
)
from dechirp.results.object_lists.list_columns import build_object_list
from objects_made import STEPS, must_be_equal, objects_at, one

SHIPPED = shipped_dbc().read_text()
LAYOUT = read_layout()
BUS = CanFd()


def bits_on_the_bus(data: bytes, identifier: int) -> tuple[int, int]:
    """Count bits of a frame by stuffing it: those before the stuff count, and all after them."""
    code = FRAME_LENGTHS.index(len(data))
    head = [0, *(identifier >> n & 1 for n in range(10, -1, -1)), 0, 0, 1, 0, 1, 0]
    plain = head + [code >> n & 1 for n in range(3, -1, -1)]
    plain += [byte >> n & 1 for byte in data for n in range(7, -1, -1)]
    sent: list[int] = []
    alike = 0
    for bit in plain:
        alike = alike + 1 if sent and sent[-1] == bit else 1
        sent.append(bit)
        if alike == 5:
            sent.append(1 - bit)
            alike = 1
    crc = 17 if len(data) <= 16 else 21
    fixed = 1 + (4 + crc) // 4  # before the stuff count, and after each fourth bit
    return len(sent), 4 + crc + fixed + 1 + 1 + 1 + 7 + 3


@given(st.sampled_from(FRAME_LENGTHS), st.integers(0, 2**11 - 1), st.integers(0), st.booleans())
def test_no_frame_is_longer_than_its_bound(n_bytes, identifier, seed, is_all_alike):
    rng = np.random.default_rng(seed)
    data = (
        bytes([0x00, 0xFF][seed % 2] for _ in range(n_bytes))
        if is_all_alike
        else rng.bytes(n_bytes)
    )

    assert sum(bits_on_the_bus(data, identifier)) <= sum(worst_case_frame_bits(n_bytes))


def test_the_bound_is_nearly_met_by_runs_of_four_and_five():
    # Five bits alike, then fours: each stuff bit begins the next run. Length code 15 is 1111.
    pattern = "0" + "0000" + "11110000" * 64
    data = int(pattern[:512], 2).to_bytes(64, "big")

    # The head cannot be all runs, as its bits are given: 4 of 133 stuff bits are missing.
    assert sum(worst_case_frame_bits(64)) - sum(bits_on_the_bus(data, 0)) <= 4


def test_lengths_are_those_that_linux_has():
    # linux/can/length.h: 579 and 598 bits without stuff bits, 712 and 736 with, intermission too.
    for extended, bare, stuffed in ((False, 579, 712), (True, 598, 736)):
        dynamic = (41 if extended else 22) + 512
        assert sum(worst_case_frame_bits(64, extended=extended)) == stuffed
        assert sum(worst_case_frame_bits(64, extended=extended)) - (dynamic - 1) // 4 == bare


def test_a_frame_takes_the_time_of_its_bits_at_both_rates():
    slow = CanFd(arbitration_bit_rate_hz=500e3, data_bit_rate_hz=500e3)

    assert slow.frame_duration_s(64) == pytest.approx(712 / 500e3)
    assert BUS.frame_duration_s(64) == pytest.approx(34 / 500e3 + 678 / 2e6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_logs_read_back_to_half_a_step(tmp_path, suffix):
    found = objects_at(5, 0, 12, 1)
    path = tmp_path / f"objects{suffix}"

    write_can_log(found, path)
    read = read_can_log(path)

    must_be_equal(read, found, STEPS)
    assert read.cycle_frame.values.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(read.cycle_time, found.cycle_time, atol=5e-7)


_FINITE = {
    "x": st.floats(-1310.7, 1310.7),
    "y": st.floats(-1310.7, 1310.7),
    "z": st.floats(-102.3, 102.3),
    "vx": st.floats(-163.8, 163.8),
    "vy": st.floats(-163.8, 163.8),
    **dict.fromkeys(("x_std", "y_std"), st.floats(0, 10.2)),
    **dict.fromkeys(("vx_std", "vy_std"), st.floats(0, 51.1)),
    "snr": st.floats(1e-5, 1e15),
    "length": st.floats(0, 51),
    "width": st.floats(0, 25.4),
}


@given(
    st.fixed_dictionaries({name: own | st.just(np.nan) for name, own in _FINITE.items()}),
    st.integers(0, 65535),
    st.integers(0, 2**32 - 1),
    st.floats(0, 1e9),
    st.sampled_from(("detection", "tentative", "confirmed")),
)
def test_every_value_in_range_is_told_to_half_a_step(row, number, frame, time, status):
    found = one(**row, number=number, frame=frame, time=time, status=status)

    read = assemble_lists(encode_frames(found, LAYOUT, BUS), LAYOUT)

    must_be_equal(read, found, {**STEPS, "time": 1e-6})


@given(st.sampled_from(sorted(_FINITE)), st.floats(2e3, 1e200), st.booleans())
def test_values_beyond_the_range_are_told_as_its_end_and_never_wrap(name, size, is_negative):
    positive = name in ("x_std", "y_std", "vx_std", "vy_std", "snr", "length", "width")
    value = size * 1e30 if name == "snr" else -size if is_negative and not positive else size
    signal = next(signal for signal, one in OBJECT_SIGNALS.items() if one.column == name)

    with pytest.warns(dc.PhysicsWarning, match=f"1 values clipped to the range.*1 of {signal} "):
        sent = encode_frames(one(**{name: value}), LAYOUT, BUS)

    read = assemble_lists(sent, LAYOUT)[name].item()
    told = 10 * np.log10(read) if name == "snr" else read
    codes = LAYOUT.codes[signal]
    assert told == pytest.approx(codes.min_value if value < 0 else codes.max_value)


def test_a_list_of_nothing_is_a_header_alone():
    sent = encode_frames(objects_at(0, 0), LAYOUT, BUS)

    assert [frame.identifier for frame in sent] == [0x300, 0x300]
    assert assemble_lists(sent, LAYOUT).sizes == {"object": 0, "cycle": 2}
    nothing = build_object_list({name: [] for name in objects_at(1)}, [], [])
    assert encode_frames(nothing, LAYOUT, BUS) == []


def test_others_read_the_same_by_the_dbc_alone():
    found = one(x=123.456, vy=-7.0, y=np.nan, number=42, time=1.25, frame=17, snr=1000.0)
    database = cantools.database.load_file(shipped_dbc())

    header, part = encode_frames(found, LAYOUT, BUS)

    said = database.decode_message(part.identifier, part.data)
    assert said["X_0"] == pytest.approx(123.46)
    assert said["VY_0"] == pytest.approx(-7.0)
    assert str(said["Y_0"]) == "NotTold"
    assert (said["Number_0"], str(said["Status_0"])) == (42, "Confirmed")
    assert said["Snr_0"] == pytest.approx(30.0)
    of_list = database.decode_message(header.identifier, header.data)
    assert (of_list["NumberOfObjects"], of_list["Frame"]) == (1, 17)
    assert of_list["Time"] == pytest.approx(1.25)
    bare = header.data[:-4] + bytes(4)  # the checksum is the last signal
    assert of_list["Checksum"] == zlib.crc32(bare + part.data)


def test_frames_follow_each_other_from_the_time_of_their_cycle():
    sent = encode_frames(objects_at(7, 2), LAYOUT, BUS)

    times_s = np.array([frame.time_s for frame in sent])
    assert times_s[[0, 4]].tolist() == [0.0, 0.05]
    assert np.diff(times_s[:4]).tolist() == pytest.approx(
        [BUS.frame_duration_s(20), *[BUS.frame_duration_s(64)] * 2]
    )


def test_a_list_longer_than_the_cycle_is_cut_to_what_fits():
    found = objects_at(30, 4, period_s=5e-3)
    allowed_s = 5e-3 * BUS.largest_load

    with pytest.warns(dc.PhysicsWarning, match="15 objects left out of 1 lists") as said:
        sent = encode_frames(found, LAYOUT, BUS)

    n_kept = max_fitting_objects(5e-3, LAYOUT, BUS)
    assert n_kept == 15
    assert (
        list_duration_s(n_kept, LAYOUT, BUS) <= allowed_s < list_duration_s(n_kept + 1, LAYOUT, BUS)
    )
    load = bus_load(found, LAYOUT, BUS)
    assert load == pytest.approx((BUS.frame_duration_s(20) + 10 * BUS.frame_duration_s(64)) / 5e-3)
    assert f"the longest takes {load:.0%} of the bus" in str(said[0].message)
    header = LAYOUT.header.decode(sent[0].data)
    assert (header["NumberOfObjects"], header["LeftOut"]) == (15, 15)
    last_s = sent[5].time_s + BUS.frame_duration_s(64)
    assert last_s - sent[0].time_s <= allowed_s
    assert assemble_lists(sent, LAYOUT).sizes["object"] == 19


def test_a_list_longer_than_the_dbc_counts_is_cut_too(tmp_path):
    dbc = tmp_path / "short.dbc"
    dbc.write_text(SHIPPED.replace("16|8@1+ (1,0) [0|255]", "16|8@1+ (1,0) [0|20]"))

    with pytest.warns(dc.PhysicsWarning, match=r"280 objects left out.*at most 255 in a list"):
        assert len(encode_frames(objects_at(535), LAYOUT, BUS)) == 1 + 85
    with pytest.warns(dc.PhysicsWarning, match=r"5 objects left out.*at most 20 in a list"):
        assert len(encode_frames(objects_at(25), read_layout(dbc), BUS)) == 1 + 7


def test_one_list_alone_has_no_load_unless_the_cycle_is_given():
    assert np.isnan(bus_load(objects_at(3), LAYOUT, BUS))
    every_10_ms = CanFd(cycle_s=10e-3)
    assert bus_load(objects_at(3), LAYOUT, every_10_ms) == pytest.approx(
        (BUS.frame_duration_s(20) + BUS.frame_duration_s(64)) / 10e-3
    )


def big_endian(text: str) -> str:
    """Make every signal big-endian, at the same distance from the first bit of the message."""

    def turned(match: re.Match[str]) -> str:
        at = int(match[2])
        return f" SG_ {match[1]} : {8 * (at // 8) + 7 - at % 8}|{match[3]}@0"

    return re.sub(r" SG_ (\w+) : (\d+)\|(\d+)@1", turned, text)


DBCS = {
    "big-endian": big_endian(SHIPPED),
    "extended identifiers": SHIPPED.replace(" 768", f" {0x98FF0300}").replace(
        " 769", f" {0x98FF0301}"
    ),
    "two objects in a frame": re.sub(r" SG_ \w+_2 .*\n|VAL_ 769 \w+_2 .*\n", "", SHIPPED),
    "a signal of its own": re.sub(r" SG_ \w+_2 .*\n|VAL_ 769 \w+_2 .*\n", "", SHIPPED).replace(
        "BO_ 769 ObjectListPart: 64 Radar\n",
        'BO_ 769 ObjectListPart: 64 Radar\n SG_ Own : 360|8@1+ (1,0) [0|255] "" Receiver\n',
    ),
    "no limits": re.sub(r"\[[-.\d]+\|[-.\d]+\]", "[0|0]", SHIPPED),
}


@pytest.mark.parametrize("text", DBCS.values(), ids=DBCS)
def test_another_dbc_tells_the_same(tmp_path, text):
    dbc, log = tmp_path / "own.dbc", tmp_path / "objects.log"
    dbc.write_text(text)
    found = objects_at(4, 1)

    write_can_log(found, log, dbc=dbc)

    must_be_equal(read_can_log(log, dbc=dbc), found, STEPS)


UNFIT = {
    "no dbc": ("nothing of the kind", "not a DBC"),
    "empty": ("", "not a DBC"),
    "no message": ('VERSION "1"\n', "no message"),
    "no header": (SHIPPED.replace("ObjectListHeader", "Header"), "ObjectListHeader"),
    "no width": (SHIPPED.replace("SG_ Width_1 ", "SG_ Breadth_1 "), "Width_1"),
    "too few bits": (SHIPPED.replace("X_0 : 50|18@", "X_0 : 50|9@"), "X_0 of 9 bits"),
    "too coarse": (SHIPPED.replace("(0.01,0) [-163.83", "(1,0) [-163.83"), "VX_0.* steps of 1"),
    "a short checksum": (SHIPPED.replace("128|32@1+", "128|16@1+"), "Checksum of 16 bits"),
    "a scale of nothing": (SHIPPED.replace("(0.1,0) [-102.3", "(0,0) [-102.3"), "scale 0"),
    "a scaled counter": (SHIPPED.replace("0|16@1+ (1,0)", "0|16@1+ (0.5,0)"), "scale 0.5"),
    "floats": (SHIPPED + "SIG_VALTYPE_ 768 Checksum : 1;\n", "floats"),
    "objects that differ": (SHIPPED.replace("Z_2 : 406|11@", "Z_2 : 406|10@"), "Z_2"),
    "a length no frame has": (SHIPPED.replace("Header: 20", "Header: 22"), "22 bytes"),
    "one identifier": (SHIPPED.replace("BO_ 769 Obj", "BO_ 768 Obj"), "identifier|DBC"),
    "overlapping signals": (SHIPPED.replace("SG_ Y_0 : 68|", "SG_ Y_0 : 60|"), "not a DBC"),
    "a hole in the range": (SHIPPED.replace("X_0 -131072 ", "X_0 5 "), "code 5"),
    "counters that differ": (
        SHIPPED.replace("SG_ Counter : 0|16@1+ (1,0) [0|65535] \"\" Receiver\n SG_ Part",
                        "SG_ Counter : 0|8@1+ (1,0) [0|255] \"\" Receiver\n SG_ Part"), "Counter"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "named"), UNFIT.values(), ids=UNFIT)
def test_a_dbc_that_does_not_fit_is_refused_by_name(tmp_path, text, named):
    dbc, log = tmp_path / "own.dbc", tmp_path / "objects.blf"
    dbc.write_text(text)

    with pytest.raises(InvalidSetting, match=rf"own\.dbc with .*{named}") as error:
        write_can_log(objects_at(2), log, dbc=dbc)

    assert all(vars(error.value.mistakes[0])[part] for part in ("value", "expected", "fix"))
    assert not log.exists()


def test_a_dbc_that_cannot_say_what_is_not_told_is_refused_where_it_must(tmp_path):
    dbc = tmp_path / "own.dbc"
    dbc.write_text(re.sub(r"VAL_ 769 Z_\d .*\n", "", SHIPPED))

    with pytest.raises(InvalidSetting, match="no code in Z for unknown values"):
        encode_frames(one(z=np.nan), read_layout(dbc), BUS)
    read = assemble_lists(encode_frames(one(z=1.0), read_layout(dbc), BUS), read_layout(dbc))
    assert read.z.item() == pytest.approx(1.0)


def test_any_flipped_bit_leaves_its_list_out():
    sent = encode_frames(objects_at(4, 4), LAYOUT, BUS)
    rng = np.random.default_rng(3)
    for place in range(3):  # header and two parts of the first list
        for bit in rng.choice(8 * len(sent[place].data), 30, replace=False).tolist():
            data = bytearray(sent[place].data)
            data[bit // 8] ^= 1 << bit % 8
            damaged = [*sent]
            damaged[place] = sent[place]._replace(data=bytes(data))

            with pytest.warns(dc.PhysicsWarning, match="1 lists are complete"):
                read = assemble_lists(damaged, LAYOUT)

            assert read.frame.values.tolist() == [1] * 4


LOST = {
    "a part": (slice(1, 2), "1 incomplete lists", {1, 2}),
    "a header": (slice(0, 1), "2 parts without a header", {1, 2}),
    "a list": (slice(3, 6), "1 lists missing", {0, 2}),
    "the last part": (slice(-1, None), "1 incomplete lists", {0, 1}),
}


@pytest.mark.parametrize(("gone", "said", "left"), LOST.values(), ids=LOST)
def test_what_is_lost_is_told_and_its_list_left_out(gone, said, left):
    sent = encode_frames(objects_at(4, 4, 4), LAYOUT, BUS, first=65535)  # the counter goes round
    del sent[gone]

    with pytest.warns(dc.PhysicsWarning, match=said):
        read = assemble_lists(sent, LAYOUT)

    assert set(read.frame.values.tolist()) == left


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_other_traffic_in_a_log_is_passed_over(tmp_path, suffix):
    path, mixed = tmp_path / f"own{suffix}", tmp_path / f"mixed{suffix}"
    found = objects_at(3, 3)
    write_can_log(found, path)
    with can.LogReader(str(path)) as own, can.Logger(str(mixed)) as log:
        for message in own:
            log.on_message_received(message)
            log.on_message_received(
                can.Message(timestamp=message.timestamp, arbitration_id=0x123, data=b"\1\2")
            )

    must_be_equal(read_can_log(mixed), found, STEPS)


def test_a_log_of_other_traffic_alone_is_refused(tmp_path):
    path = tmp_path / "other.log"
    path.write_text("(0.000000) can0 123#0102 R\n")
    with pytest.raises(RecordingError, match="1 frames, none with the identifier 0x300"):
        read_can_log(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_logs_give_whole_lists_or_an_error(tmp_path, suffix):
    path = tmp_path / f"objects{suffix}"
    found = objects_at(6, 6, 6)
    write_can_log(found, path)
    content = path.read_bytes()
    rng = np.random.default_rng(4)
    for number in range(60):
        damaged = bytearray(content[: rng.integers(len(content))] if number % 2 else content)
        for at in rng.integers(len(content), size=5 * (number % 3)):
            if at < len(damaged):
                damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read = read_can_log(path)
        except DechirpError:
            continue
        whole = found.isel(object=np.isin(found.frame, read.cycle_frame))
        must_be_equal(read, whole, STEPS)


def test_a_bus_carries_lists_from_one_to_another():
    found = objects_at(5, 0, 7)
    with (
        can.Bus("lists", interface="virtual") as sender,
        can.Bus("lists", interface="virtual") as receiver,
    ):
        following = send_can(found, sender, first=65534)
        read = receive_can(receiver, idle_s=0.05)

    assert following == 1
    must_be_equal(read, found, STEPS)


def test_a_bus_that_fails_while_it_is_heard_is_told(monkeypatch):
    def fails(*_):
        raise can.CanOperationError("bus off")

    with can.Bus("lists", interface="virtual") as receiver:
        monkeypatch.setattr(receiver, "recv", fails)
        with pytest.raises(InvalidSetting, match="bus off"):
            receive_can(receiver)


WRONG_BUS = {
    "no rate": {"data_bit_rate_hz": 0.0},
    "a rate that is none": {"arbitration_bit_rate_hz": np.nan},
    "data slower": {"data_bit_rate_hz": 250e3},
    "classic rates and more": {"arbitration_bit_rate_hz": 2e6},
    "more than all": {"largest_load": 1.5},
    "no time": {"cycle_s": 0.0},
}


@pytest.mark.parametrize("settings", WRONG_BUS.values(), ids=WRONG_BUS)
def test_a_bus_that_cannot_be_is_refused(settings):
    with pytest.raises(InvalidSetting, match=r"CanFd\.\w+: .*; expected"):
        CanFd(**settings)


def test_a_length_that_no_frame_has_is_refused():
    with pytest.raises(InvalidSetting, match="n_bytes: 63"):
        worst_case_frame_bits(63)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("time", [-5.0, 1.7e9, 1e15])
def test_any_time_can_be_logged(tmp_path, suffix, time):
    path = tmp_path / f"objects{suffix}"
    if time in (-5.0, 1e15):
        with pytest.warns(dc.PhysicsWarning, match="1 of Time"):
            write_can_log(one(time=time), path)
    else:
        write_can_log(one(time=time), path)

    assert read_can_log(path).time.item() == pytest.approx(np.clip(time, 0, 2**32 - 1), abs=1e-6)


WRONG_CALLS = {
    "a bus that is none": lambda: send_can(objects_at(1), "can0"),
    "nothing to hear": lambda: receive_can(None),
    "a counter below": lambda: send_can(objects_at(1), None, first=-1),
    "rates that are none": lambda: encode_frames(objects_at(1), LAYOUT, 500e3),
    "a dbc that is none": lambda: read_layout(7),
    "a dbc that is not there": lambda: read_layout("nowhere.dbc"),
    "a dbc that is a folder": lambda: read_layout("."),
}


@pytest.mark.parametrize("call", WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_wrong_calls_are_refused(call):
    with pytest.raises(InvalidSetting):
        call()


def test_a_bus_that_takes_nothing_is_an_error():
    bus = can.Bus("shut", interface="virtual")
    bus.shutdown()
    with pytest.raises(InvalidSetting, match="closed bus"):
        send_can(objects_at(1), bus)
