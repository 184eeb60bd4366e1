"""Object lists on CAN FD: frame duration, signal codes, DBC files, lost frames, logs, buses."""

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
    encode_can_frames,
    largest_bus_load,
    max_objects_per_list,
    object_list_duration_s,
)
from dechirp.results.object_lists.can_layout import (
    OBJECT_SIGNALS,
    read_dbc_layout,
    shipped_dbc_path,
)
from dechirp.results.object_lists.can_lists import assemble_object_list
from dechirp.results.object_lists.can_logs import (
    SUFFIXES,
    read_can_log,
    receive_can,
    send_can,
    write_can_log,
)
from dechirp.results.object_lists.list_columns import build_object_list
from nightly import nightly, nightly_except
from sample_object_lists import (
    DBC_STEPS,
    check_object_lists_agree,
    random_object_list,
    single_object_list,
)

SHIPPED = shipped_dbc_path().read_text()
LAYOUT = read_dbc_layout()
BUS = CanFd()


def count_bits_on_bus(data: bytes, identifier: int) -> tuple[int, int]:
    """Count bits of a frame by stuffing it: those before the stuff count, and all after them."""
    code = FRAME_LENGTHS.index(len(data))
    header_bits = [0, *(identifier >> n & 1 for n in range(10, -1, -1)), 0, 0, 1, 0, 1, 0]
    plain_bits = header_bits + [code >> n & 1 for n in range(3, -1, -1)]
    plain_bits += [byte >> n & 1 for byte in data for n in range(7, -1, -1)]
    stuffed_bits: list[int] = []
    run_length = 0
    for bit in plain_bits:
        run_length = run_length + 1 if stuffed_bits and stuffed_bits[-1] == bit else 1
        stuffed_bits.append(bit)
        if run_length == 5:
            stuffed_bits.append(1 - bit)
            run_length = 1
    crc = 17 if len(data) <= 16 else 21
    fixed = 1 + (4 + crc) // 4  # before the stuff count, and after each fourth bit
    return len(stuffed_bits), 4 + crc + fixed + 1 + 1 + 1 + 7 + 3


@nightly
@given(st.sampled_from(FRAME_LENGTHS), st.integers(0, 2**11 - 1), st.integers(0), st.booleans())
def test_frame_length_stays_below_worst_case(n_bytes, identifier, seed, is_constant):
    rng = np.random.default_rng(seed)
    data = (
        bytes([0x00, 0xFF][seed % 2] for _ in range(n_bytes)) if is_constant else rng.bytes(n_bytes)
    )

    assert sum(count_bits_on_bus(data, identifier)) <= sum(worst_case_frame_bits(n_bytes))


def test_worst_case_length_is_nearly_reached_by_runs_of_four_and_five():
    # Five equal bits, then runs of four: each stuff bit begins a new run. Length code 15 is 1111.
    pattern = "0" + "0000" + "11110000" * 64
    data = int(pattern[:512], 2).to_bytes(64, "big")

    # The header bits are fixed, so 4 of 133 stuff bits are missing.
    assert sum(worst_case_frame_bits(64)) - sum(count_bits_on_bus(data, 0)) <= 4


def test_frame_lengths_match_linux_kernel():
    # linux/can/length.h: 579 and 598 bits without stuff bits, 712 and 736 with, intermission too.
    for extended, bare, stuffed in ((False, 579, 712), (True, 598, 736)):
        dynamic = (41 if extended else 22) + 512
        assert sum(worst_case_frame_bits(64, extended=extended)) == stuffed
        assert sum(worst_case_frame_bits(64, extended=extended)) - (dynamic - 1) // 4 == bare


def test_frame_duration_follows_bits_at_both_rates():
    slow = CanFd(arbitration_bit_rate_hz=500e3, data_bit_rate_hz=500e3)

    assert slow.frame_duration_s(64) == pytest.approx(712 / 500e3)
    assert BUS.frame_duration_s(64) == pytest.approx(34 / 500e3 + 678 / 2e6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_logs_read_back_within_half_step(tmp_path, suffix):
    objects = random_object_list(5, 0, 12, 1)
    path = tmp_path / f"objects{suffix}"

    write_can_log(objects, path)
    result = read_can_log(path)

    check_object_lists_agree(result, objects, DBC_STEPS)
    assert result.cycle_frame.values.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(result.cycle_time, objects.cycle_time, atol=5e-7)


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
    st.fixed_dictionaries({name: values | st.just(np.nan) for name, values in _FINITE.items()}),
    st.integers(0, 65535),
    st.integers(0, 2**32 - 1),
    st.floats(0, 1e9),
    st.sampled_from(("detection", "tentative", "confirmed")),
)
def test_values_in_range_are_encoded_within_half_step(row, number, frame, time, status):
    objects = single_object_list(**row, number=number, frame=frame, time=time, status=status)

    result = assemble_object_list(encode_can_frames(objects, LAYOUT, BUS), LAYOUT)

    check_object_lists_agree(result, objects, {**DBC_STEPS, "time": 1e-6})


@given(st.sampled_from(sorted(_FINITE)), st.floats(2e3, 1e200), st.booleans())
def test_values_beyond_range_are_clipped_without_wrapping(name, size, is_negative):
    positive = name in ("x_std", "y_std", "vx_std", "vy_std", "snr", "length", "width")
    value = size * 1e30 if name == "snr" else -size if is_negative and not positive else size
    signal = next(
        signal for signal, definition in OBJECT_SIGNALS.items() if definition.column == name
    )

    with pytest.warns(dc.PhysicsWarning, match=f"1 values clipped to the range.*1 of {signal} "):
        frames = encode_can_frames(single_object_list(**{name: value}), LAYOUT, BUS)

    column_value = assemble_object_list(frames, LAYOUT)[name].item()
    signal_value = 10 * np.log10(column_value) if name == "snr" else column_value
    codes = LAYOUT.codes[signal]
    assert signal_value == pytest.approx(codes.min_value if value < 0 else codes.max_value)


def test_empty_list_is_header_only():
    frames = encode_can_frames(random_object_list(0, 0), LAYOUT, BUS)

    assert [frame.identifier for frame in frames] == [0x300, 0x300]
    assert assemble_object_list(frames, LAYOUT).sizes == {"object": 0, "cycle": 2}
    no_objects = build_object_list({name: [] for name in random_object_list(1)}, [], [])
    assert encode_can_frames(no_objects, LAYOUT, BUS) == []


def test_dbc_alone_decodes_frames():
    objects = single_object_list(
        x=123.456, vy=-7.0, y=np.nan, number=42, time=1.25, frame=17, snr=1000.0
    )
    database = cantools.database.load_file(shipped_dbc_path())

    header, part = encode_can_frames(objects, LAYOUT, BUS)

    object_signals = database.decode_message(part.identifier, part.data)
    assert object_signals["X_0"] == pytest.approx(123.46)
    assert object_signals["VY_0"] == pytest.approx(-7.0)
    assert str(object_signals["Y_0"]) == "NotAvailable"
    assert (object_signals["Number_0"], str(object_signals["Status_0"])) == (42, "Confirmed")
    assert object_signals["Snr_0"] == pytest.approx(30.0)
    list_signals = database.decode_message(header.identifier, header.data)
    assert (list_signals["NumberOfObjects"], list_signals["Frame"]) == (1, 17)
    assert list_signals["Time"] == pytest.approx(1.25)
    header_data = header.data[:-4] + bytes(4)  # the checksum is the last signal
    assert list_signals["Checksum"] == zlib.crc32(header_data + part.data)


def test_frames_are_sent_back_to_back_from_cycle_time():
    frames = encode_can_frames(random_object_list(7, 2), LAYOUT, BUS)

    times_s = np.array([frame.time_s for frame in frames])
    assert times_s[[0, 4]].tolist() == [0.0, 0.05]
    assert np.diff(times_s[:4]).tolist() == pytest.approx(
        [BUS.frame_duration_s(20), *[BUS.frame_duration_s(64)] * 2]
    )


def test_list_longer_than_cycle_is_truncated():
    objects = random_object_list(30, 4, period_s=5e-3)
    allowed_s = 5e-3 * BUS.largest_load

    with pytest.warns(dc.PhysicsWarning, match="15 objects left out of 1 list") as warnings:
        frames = encode_can_frames(objects, LAYOUT, BUS)

    n_kept = max_objects_per_list(5e-3, LAYOUT, BUS)
    assert n_kept == 15
    assert (
        object_list_duration_s(n_kept, LAYOUT, BUS)
        <= allowed_s
        < object_list_duration_s(n_kept + 1, LAYOUT, BUS)
    )
    load = largest_bus_load(objects, LAYOUT, BUS)
    assert load == pytest.approx((BUS.frame_duration_s(20) + 10 * BUS.frame_duration_s(64)) / 5e-3)
    assert f"the longest takes {load:.0%} of the bus" in str(warnings[0].message)
    header = LAYOUT.header.decode(frames[0].data)
    assert (header["NumberOfObjects"], header["LeftOut"]) == (15, 15)
    last_s = frames[5].time_s + BUS.frame_duration_s(64)
    assert last_s - frames[0].time_s <= allowed_s
    assert assemble_object_list(frames, LAYOUT).sizes["object"] == 19


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("ObjectListPart: 64", "ObjectListPart: 640000000"),
        ("48|2@", "48|200000000@"),
        ("48|2@", "480000000|2@"),
        ("(0.01,0)", "(0.01,1E999999)"),
        ("-1310.71|", f"-{'9' * 5000}|"),
        ("BU_: Radar Receiver", "BU_: Radar Receiver\nSG_MUL_VAL_ 769 X_0 Status_0 0-400000000;"),
    ],
    ids=["message", "signal", "start", "exponent", "digits", "multiplexer"],
)
def test_numbers_that_would_exhaust_the_parser_are_refused(tmp_path, monkeypatch, old, new):
    # The parser takes up to 60 s and 6 GB for each.
    dbc = tmp_path / "huge.dbc"
    dbc.write_text(SHIPPED.replace(old, new))
    monkeypatch.setattr(cantools.database, "load_string", lambda *_, **__: pytest.fail("parsed"))

    with pytest.raises(InvalidSetting, match="at most"):
        read_dbc_layout(dbc)


def test_limits_of_floats_are_accepted(tmp_path):
    dbc = tmp_path / "floats.dbc"
    dbc.write_text(SHIPPED.replace("[0|255]", "[-3.4E+038|1.7E+308]", 1))

    assert read_dbc_layout(dbc).codes == LAYOUT.codes


def test_list_longer_than_dbc_counter_is_truncated(tmp_path):
    dbc = tmp_path / "short.dbc"
    dbc.write_text(SHIPPED.replace("16|8@1+ (1,0) [0|255]", "16|8@1+ (1,0) [0|20]"))

    with pytest.warns(dc.PhysicsWarning, match=r"280 objects left out.*at most 255 in a list"):
        assert len(encode_can_frames(random_object_list(535), LAYOUT, BUS)) == 1 + 85
    with pytest.warns(dc.PhysicsWarning, match=r"5 objects left out.*at most 20 in a list"):
        assert len(encode_can_frames(random_object_list(25), read_dbc_layout(dbc), BUS)) == 1 + 7


def test_single_list_has_bus_load_only_with_cycle():
    assert np.isnan(largest_bus_load(random_object_list(3), LAYOUT, BUS))
    every_10_ms = CanFd(cycle_s=10e-3)
    assert largest_bus_load(random_object_list(3), LAYOUT, every_10_ms) == pytest.approx(
        (BUS.frame_duration_s(20) + BUS.frame_duration_s(64)) / 10e-3
    )


def convert_to_big_endian(text: str) -> str:
    """Make every signal big-endian, at the same distance from the first bit of the message."""

    def move_signal(match: re.Match[str]) -> str:
        bit = int(match[2])
        return f" SG_ {match[1]} : {8 * (bit // 8) + 7 - bit % 8}|{match[3]}@0"

    return re.sub(r" SG_ (\w+) : (\d+)\|(\d+)@1", move_signal, text)


VALID_DBCS = {
    "big-endian": convert_to_big_endian(SHIPPED),
    "extended identifiers": SHIPPED.replace(" 768", f" {0x98FF0300}").replace(
        " 769", f" {0x98FF0301}"
    ),
    "two objects in a frame": re.sub(r" SG_ \w+_2 .*\n|VAL_ 769 \w+_2 .*\n", "", SHIPPED),
    "additional signal": re.sub(r" SG_ \w+_2 .*\n|VAL_ 769 \w+_2 .*\n", "", SHIPPED).replace(
        "BO_ 769 ObjectListPart: 64 Radar\n",
        'BO_ 769 ObjectListPart: 64 Radar\n SG_ Own : 360|8@1+ (1,0) [0|255] "" Receiver\n',
    ),
    "no limits": re.sub(r"\[[-.\d]+\|[-.\d]+\]", "[0|0]", SHIPPED),
}


@pytest.mark.parametrize("text", VALID_DBCS.values(), ids=VALID_DBCS)
def test_equivalent_dbcs_encode_same_objects(tmp_path, text):
    dbc, log = tmp_path / "own.dbc", tmp_path / "objects.log"
    dbc.write_text(text)
    objects = random_object_list(4, 1)

    write_can_log(objects, log, dbc=dbc)

    check_object_lists_agree(read_can_log(log, dbc=dbc), objects, DBC_STEPS)


UNFIT_DBCS = {
    "no dbc": ("nothing of the kind", "not a DBC"),
    "empty": ("", "not a DBC"),
    "no message": ('VERSION "1"\n', "no message"),
    "no header": (SHIPPED.replace("ObjectListHeader", "Header"), "ObjectListHeader"),
    "no width": (SHIPPED.replace("SG_ Width_1 ", "SG_ Breadth_1 "), "Width_1"),
    "too few bits": (SHIPPED.replace("X_0 : 50|18@", "X_0 : 50|9@"), "X_0 of 9 bits"),
    "too coarse": (SHIPPED.replace("(0.01,0) [-163.83", "(1,0) [-163.83"), "VX_0.* steps of 1"),
    "short checksum": (SHIPPED.replace("128|32@1+", "128|16@1+"), "Checksum of 16 bits"),
    "zero scale": (SHIPPED.replace("(0.1,0) [-102.3", "(0,0) [-102.3"), "scale 0"),
    "scaled counter": (SHIPPED.replace("0|16@1+ (1,0)", "0|16@1+ (0.5,0)"), "scale 0.5"),
    "floats": (SHIPPED + "SIG_VALTYPE_ 768 Checksum : 1;\n", "floats"),
    "different object layouts": (SHIPPED.replace("Z_2 : 406|11@", "Z_2 : 406|10@"), "Z_2"),
    "invalid frame length": (SHIPPED.replace("Header: 20", "Header: 22"), "22 bytes"),
    "duplicate identifier": (SHIPPED.replace("BO_ 769 Obj", "BO_ 768 Obj"), "identifier|DBC"),
    "overlapping signals": (SHIPPED.replace("SG_ Y_0 : 68|", "SG_ Y_0 : 60|"), "not a DBC"),
    "value table inside range": (SHIPPED.replace("X_0 -131072 ", "X_0 5 "), "code 5"),
    "different counters": (
        SHIPPED.replace("SG_ Counter : 0|16@1+ (1,0) [0|65535] \"\" Receiver\n SG_ Part",
                        "SG_ Counter : 0|8@1+ (1,0) [0|255] \"\" Receiver\n SG_ Part"), "Counter"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), UNFIT_DBCS.values(), ids=UNFIT_DBCS)
def test_rejects_unfit_dbc_with_reason(tmp_path, text, message):
    dbc, log = tmp_path / "own.dbc", tmp_path / "objects.blf"
    dbc.write_text(text)

    with pytest.raises(InvalidSetting, match=rf"own\.dbc with .*{message}") as error:
        write_can_log(random_object_list(2), log, dbc=dbc)

    assert all(vars(error.value.mistakes[0])[part] for part in ("value", "expected", "fix"))
    assert not log.exists()


def test_repeated_message_of_dbc_prints_nothing_of_the_parser(tmp_path, capfd, caplog):
    dbc = tmp_path / "twice.dbc"
    part = SHIPPED[SHIPPED.index("BO_ 769") :]
    part = part[: part.index("\n\n")]
    dbc.write_text(SHIPPED.replace(part, f"{part}\n\n{part.replace('BO_ 769', 'BO_ 770')}"))

    with pytest.raises(InvalidSetting, match="2 messages of the name ObjectListPart"):
        read_dbc_layout(dbc)

    assert capfd.readouterr() == ("", "")
    assert not caplog.records


def test_rejects_unknown_values_when_dbc_has_no_code_for_them(tmp_path):
    dbc = tmp_path / "own.dbc"
    dbc.write_text(re.sub(r"VAL_ 769 Z_\d .*\n", "", SHIPPED))

    with pytest.raises(InvalidSetting, match="no code in Z for unknown values"):
        encode_can_frames(single_object_list(z=np.nan), read_dbc_layout(dbc), BUS)
    result = assemble_object_list(
        encode_can_frames(single_object_list(z=1.0), read_dbc_layout(dbc), BUS),
        read_dbc_layout(dbc),
    )
    assert result.z.item() == pytest.approx(1.0)


def test_list_with_flipped_bit_is_dropped():
    frames = encode_can_frames(random_object_list(4, 4), LAYOUT, BUS)
    rng = np.random.default_rng(3)
    for index in range(3):  # header and two parts of the first list
        for bit in rng.choice(8 * len(frames[index].data), 30, replace=False).tolist():
            data = bytearray(frames[index].data)
            data[bit // 8] ^= 1 << bit % 8
            damaged_frames = [*frames]
            damaged_frames[index] = frames[index]._replace(data=bytes(data))

            with pytest.warns(dc.PhysicsWarning, match="1 lists are complete"):
                result = assemble_object_list(damaged_frames, LAYOUT)

            assert result.frame.values.tolist() == [1] * 4


LOSSES = {
    "part": (slice(1, 2), "1 incomplete lists", {1, 2}),
    "header": (slice(0, 1), "2 parts without a header", {1, 2}),
    "complete list": (slice(3, 6), "1 lists missing", {0, 2}),
    "last part": (slice(-1, None), "1 incomplete lists", {0, 1}),
}


@pytest.mark.parametrize(
    ("lost_frames", "message", "remaining_frames"), LOSSES.values(), ids=LOSSES
)
def test_lost_frames_are_reported_and_their_lists_dropped(lost_frames, message, remaining_frames):
    # The counter wraps.
    frames = encode_can_frames(random_object_list(4, 4, 4), LAYOUT, BUS, first=65535)
    del frames[lost_frames]

    with pytest.warns(dc.PhysicsWarning, match=message):
        result = assemble_object_list(frames, LAYOUT)

    assert set(result.frame.values.tolist()) == remaining_frames


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_foreign_frames_in_log_are_ignored(tmp_path, suffix):
    path, mixed_log = tmp_path / f"own{suffix}", tmp_path / f"mixed{suffix}"
    objects = random_object_list(3, 3)
    write_can_log(objects, path)
    with can.LogReader(str(path)) as reader, can.Logger(str(mixed_log)) as logger:
        for message in reader:
            logger.on_message_received(message)
            logger.on_message_received(
                can.Message(timestamp=message.timestamp, arbitration_id=0x123, data=b"\1\2")
            )

    check_object_lists_agree(read_can_log(mixed_log), objects, DBC_STEPS)


def test_rejects_log_with_foreign_frames_only(tmp_path):
    path = tmp_path / "other.log"
    path.write_text("(0.000000) can0 123#0102 R\n")
    with pytest.raises(RecordingError, match="1 frames, none with the identifier 0x300"):
        read_can_log(path)


@nightly
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_logs_give_complete_lists_or_error(tmp_path, suffix):
    path = tmp_path / f"objects{suffix}"
    objects = random_object_list(6, 6, 6)
    write_can_log(objects, path)
    content = path.read_bytes()
    rng = np.random.default_rng(4)
    for number in range(60):
        damaged_content = bytearray(
            content[: rng.integers(len(content))] if number % 2 else content
        )
        for position in rng.integers(len(content), size=5 * (number % 3)):
            if position < len(damaged_content):
                damaged_content[position] = rng.integers(256)
        path.write_bytes(damaged_content)
        try:
            result = read_can_log(path)
        except DechirpError:
            continue
        complete_lists = objects.isel(object=np.isin(objects.frame, result.cycle_frame))
        check_object_lists_agree(result, complete_lists, DBC_STEPS)


def test_virtual_bus_transmits_lists():
    objects = random_object_list(5, 0, 7)
    with (
        can.Bus("lists", interface="virtual") as sender,
        can.Bus("lists", interface="virtual") as receiver,
    ):
        next_counter = send_can(objects, sender, first=65534)
        result = receive_can(receiver, idle_s=0.05)

    assert next_counter == 1
    check_object_lists_agree(result, objects, DBC_STEPS)


def test_bus_failure_while_receiving_is_reported(monkeypatch):
    def fail(*_):
        raise can.CanOperationError("bus off")

    with can.Bus("lists", interface="virtual") as receiver:
        monkeypatch.setattr(receiver, "recv", fail)
        with pytest.raises(InvalidSetting, match="bus off"):
            receive_can(receiver)


INVALID_BUS_SETTINGS = {
    "zero rate": {"data_bit_rate_hz": 0.0},
    "nan rate": {"arbitration_bit_rate_hz": np.nan},
    "data rate below arbitration rate": {"data_bit_rate_hz": 250e3},
    "arbitration rate above 1 Mbit/s": {"arbitration_bit_rate_hz": 2e6},
    "load above one": {"largest_load": 1.5},
    "zero cycle": {"cycle_s": 0.0},
}


@pytest.mark.parametrize("settings", INVALID_BUS_SETTINGS.values(), ids=INVALID_BUS_SETTINGS)
def test_rejects_invalid_bus_settings(settings):
    with pytest.raises(InvalidSetting, match=r"CanFd\.\w+: .*; expected"):
        CanFd(**settings)


def test_rejects_invalid_frame_length():
    with pytest.raises(InvalidSetting, match="n_bytes: 63"):
        worst_case_frame_bits(63)


@pytest.mark.parametrize("suffix", nightly_except(1, SUFFIXES))
@pytest.mark.parametrize("time", [-5.0, 1.7e9, 1e15])
def test_any_time_is_logged(tmp_path, suffix, time):
    path = tmp_path / f"objects{suffix}"
    if time in (-5.0, 1e15):
        with pytest.warns(dc.PhysicsWarning, match="1 of Time"):
            write_can_log(single_object_list(time=time), path)
    else:
        write_can_log(single_object_list(time=time), path)

    assert read_can_log(path).time.item() == pytest.approx(np.clip(time, 0, 2**32 - 1), abs=1e-6)


INVALID_CALLS = {
    "bus of wrong type": lambda: send_can(random_object_list(1), "can0"),
    "no receiver": lambda: receive_can(None),
    "negative counter": lambda: send_can(random_object_list(1), None, first=-1),
    "bus settings of wrong type": lambda: encode_can_frames(random_object_list(1), LAYOUT, 500e3),
    "dbc of wrong type": lambda: read_dbc_layout(7),
    "missing dbc": lambda: read_dbc_layout("nowhere.dbc"),
    "dbc folder": lambda: read_dbc_layout("."),
}


@pytest.mark.parametrize("call", INVALID_CALLS.values(), ids=INVALID_CALLS)
def test_rejects_invalid_calls(call):
    with pytest.raises(InvalidSetting):
        call()


def test_rejects_closed_bus():
    bus = can.Bus("shut", interface="virtual")
    bus.shutdown()
    with pytest.raises(InvalidSetting, match="closed bus"):
        send_can(random_object_list(1), bus)
