"""Object lists in the CAN messages of vendors' radars, through their DBCs and mappings."""

import math
import os
import re
import warnings
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.results.object_lists.can_bus import CanFd
from dechirp.results.object_lists.can_frames import CanFrame
from dechirp.results.object_lists.can_logs import SUFFIXES, read_can_log, write_can_log
from dechirp.results.object_lists.can_mapping import CanMapping, MappedSignal, read_vendor_layout
from dechirp.results.object_lists.list_columns import MEASURED, build_object_list
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list, encode_vendor_frames
from nightly import nightly
from sample_vendor_dbc import (
    ESR,
    LISTED_MAPPING,
    LISTS,
    TOYOTA,
    dbc_text,
    numbered_messages,
)

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")


@pytest.fixture
def files(tmp_path):
    paths = {}
    for name, text in {
        "toyota.dbc": TOYOTA,
        "esr.dbc": ESR,
        "lists.dbc": LISTS,
        "lists.yaml": LISTED_MAPPING,
    }.items():
        paths[name] = tmp_path / name
        paths[name].write_text(text)
    return paths


def radial_object_list(n_cycles: int, n_objects: int, seed: int = 7):
    """Return objects with velocities along the line of sight, as radars measure them."""
    rng = np.random.default_rng(seed)
    n = n_cycles * n_objects
    azimuth, range_m = rng.uniform(-0.5, 0.5, n), rng.uniform(5, 90, n)
    rate = rng.uniform(-40, 40, n)
    columns = dict.fromkeys(MEASURED, np.full(n, np.nan)) | {
        "frame": np.repeat(np.arange(n_cycles), n_objects),
        "time": np.repeat(np.arange(n_cycles) * 0.05, n_objects),
        "number": np.tile(np.arange(1, n_objects + 1), n_cycles),
        "status": np.full(n, "confirmed"),
        "x": range_m * np.cos(azimuth),
        "y": range_m * np.sin(azimuth),
        "vx": rate * np.cos(azimuth),
        "vy": rate * np.sin(azimuth),
        "snr": rng.uniform(1, 100, n),
        "width": rng.uniform(0, 7, n),
    }
    return build_object_list(columns, np.arange(n_cycles), np.arange(n_cycles) * 0.05)


def sorted_columns(objects, *names):
    order = np.lexsort((objects["number"].values, objects["frame"].values))
    return [objects[name].values[order] for name in names]


def range_azimuth_rate(objects):
    x, y, vx, vy = sorted_columns(objects, "x", "y", "vx", "vy")
    range_m = np.hypot(x, y)
    return range_m, np.arctan2(y, x), (vx * x + vy * y) / range_m


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_toyota_list_returns_within_half_a_step(suffix, files, tmp_path):
    objects = radial_object_list(5, 10)
    log = tmp_path / f"log{suffix}"
    options = {"dbc": files["toyota.dbc"], "mapping": "toyota-adas"}
    write_can_log(objects, log, **options)
    result = read_can_log(log, **options)
    assert dict(result.sizes) == dict(objects.sizes)
    np.testing.assert_allclose(result["cycle_time"], objects["cycle_time"], atol=1e-6)
    for name in ("number", "frame", "status"):
        np.testing.assert_array_equal(
            sorted_columns(result, name)[0], sorted_columns(objects, name)[0]
        )
    for name, step in (("x", 0.04), ("y", 0.04)):
        received, expected = sorted_columns(result, name)[0], sorted_columns(objects, name)[0]
        np.testing.assert_allclose(received, expected, atol=step / 2 + 1e-9)
    # Half a step of 0.025 m/s; the direction changes by half a step of the position at 5 m.
    rate, expected_rate = range_azimuth_rate(result)[2], range_azimuth_rate(objects)[2]
    np.testing.assert_allclose(rate, expected_rate, atol=0.0125 + 1e-9)


def test_esr_list_returns_range_angle_and_rate_within_half_a_step(files, tmp_path):
    objects = radial_object_list(4, 8)
    status = np.array(["confirmed", "tentative"] * 16)
    objects = objects.assign(status=("object", status))
    log = tmp_path / "log.asc"
    options = {"dbc": files["esr.dbc"], "mapping": "delphi-esr"}
    write_can_log(objects, log, **options)
    result = read_can_log(log, **options)
    for received, expected, step in zip(
        range_azimuth_rate(result),
        range_azimuth_rate(objects),
        (0.1, math.radians(0.1), 0.01),
        strict=True,
    ):
        np.testing.assert_allclose(received, expected, atol=step / 2 + 1e-9)
    width, expected_width = sorted_columns(result, "width")[0], sorted_columns(objects, "width")[0]
    np.testing.assert_allclose(width, expected_width, atol=0.25 + 1e-9)
    np.testing.assert_array_equal(
        sorted_columns(result, "status")[0], sorted_columns(objects, "status")[0]
    )


@pytest.mark.parametrize(
    ("dbc", "mapping"), [("toyota.dbc", "toyota-adas"), ("esr.dbc", "delphi-esr")]
)
def test_mapped_signals_of_any_bytes_are_those_of_cantools(files, dbc, mapping):
    layout = read_vendor_layout(files[dbc], mapping)
    rng = np.random.default_rng(1)
    for identifier, decoder in layout.decoders.items():
        for n_excess in (0, 2):
            data = rng.bytes(decoder.length + n_excess)
            codes = layout.messages[identifier].decode(
                data, decode_choices=False, scaling=False, allow_excess=True
            )
            expected = {name: code for name, code in codes.items() if name in layout.codes}
            assert decoder.decode_codes(data) == expected


def test_signs_and_bits_agree_with_hand_made_messages(files):
    """A target 10 deg to the right at 50 m that approaches: bits placed by hand."""
    layout = read_vendor_layout(files["esr.dbc"], "delphi-esr")
    # Motorola bit 12 and ten bits down: five of byte 1, five of byte 2; range three and eight.
    angle, range_code, rate, status = 100, 500, -1234 & 0x3FFF, 3
    word = (status << 53) | (angle << 43) | (range_code << 32) | rate
    objects = assemble_vendor_list([CanFrame(1.0, 1282, False, word.to_bytes(8, "big"))], layout)
    assert objects["number"].item() == 3
    assert objects["x"].item() == pytest.approx(50 * math.cos(math.radians(10)))
    assert objects["y"].item() == pytest.approx(-50 * math.sin(math.radians(10)))
    assert objects["vx"].item() == pytest.approx(-12.34 * math.cos(math.radians(10)))
    toyota = read_vendor_layout(files["toyota.dbc"], "toyota-adas")
    data = bytearray(8)
    data[0] = 9
    data[1:3] = (1796 << 3).to_bytes(2, "big")  # 71.84 m, bits 15 down to 3 of byte 2
    data[3:5] = (69 << 5).to_bytes(2, "big")  # 2.76 m to the right
    data[5:7] = (144 << 4 | 1).to_bytes(2, "big")  # 3.6 m/s, and VALID
    objects = assemble_vendor_list([CanFrame(0.0, 528, False, bytes(data))], toyota)
    assert objects["x"].item() == pytest.approx(71.84)
    assert objects["y"].item() == pytest.approx(-2.76)
    radial = objects["vx"].item() * 71.84 - objects["vy"].item() * 2.76
    assert radial / math.hypot(71.84, 2.76) == pytest.approx(3.6)


def test_objects_of_several_messages_with_number_signal(files):
    layout = read_vendor_layout(files["lists.dbc"], files["lists.yaml"])
    objects = radial_object_list(3, 4)
    sent = encode_vendor_frames(objects, layout, CanFd())
    assert not any(frame.fd for frame in sent)
    assert len(sent) == 3 * (1 + 4 * 2)
    result = assemble_vendor_list(sent, layout)
    for name, step in (("x", 0.2), ("y", 0.2), ("vx", 0.25 / 3.6)):
        received, expected = sorted_columns(result, name)[0], sorted_columns(objects, name)[0]
        np.testing.assert_allclose(received, expected, atol=step / 2 + 1e-9)
    snr, expected_snr = sorted_columns(result, "snr")[0], sorted_columns(objects, "snr")[0]
    np.testing.assert_allclose(10 * np.log10(snr / expected_snr), 0, atol=0.25 + 1e-9)


def test_value_without_object_marks_empty_messages(files):
    """As Honda and Mazda send the largest distance in messages without an object."""
    mapping = CanMapping(
        messages=("TRACK_A_#",),
        x=MappedSignal(signal="LONG_DIST", empty=255.0),
        y=MappedSignal(signal="LAT_DIST", factor=-1.0),
    )
    layout = read_vendor_layout(files["toyota.dbc"], mapping)
    objects = radial_object_list(2, 3)
    at_empty_value = objects["x"].values.copy()
    at_empty_value[0] = 255.0  # an object there is moved by one step of 0.04 m
    objects = objects.assign(x=("object", at_empty_value))
    frames = encode_vendor_frames(objects, layout, CanFd())
    dbc = cantools.database.load_file(files["toyota.dbc"])
    distances = [dbc.decode_message(f.identifier, f.data)["LONG_DIST"] for f in frames]
    assert distances.count(255.0) == len(frames) - 6
    result = assemble_vendor_list(frames, layout)
    x, expected = sorted_columns(result, "x")[0], sorted_columns(objects, "x")[0]
    np.testing.assert_allclose(x, expected, atol=0.04 + 1e-9)
    assert read_vendor_layout(files["toyota.dbc"], "toyota-adas").empty_codes == {"VALID": 0}


def test_lists_end_where_counter_changes_or_an_object_repeats(files):
    layout = read_vendor_layout(files["toyota.dbc"], "toyota-adas")
    objects = radial_object_list(6, 3)
    sent = encode_vendor_frames(objects, layout, CanFd())
    # Without the first messages of a list, its number still follows from the counter.
    lost = [frame for index, frame in enumerate(sent) if not 16 <= index < 20]
    result = assemble_vendor_list(lost, layout)
    assert result.sizes["cycle"] == 6
    same_counter = CanMapping(
        messages=("TRACK_A_#",),
        x=MappedSignal(signal="LONG_DIST"),
        y=MappedSignal(signal="LAT_DIST"),
    )
    result = assemble_vendor_list(sent, read_vendor_layout(files["toyota.dbc"], same_counter))
    assert result.sizes["cycle"] == 6
    assert result.sizes["object"] == 6 * 16  # without a status, all messages have objects


def test_too_many_objects_and_clipped_values_are_reported(files, tmp_path):
    objects = radial_object_list(1, 20)
    objects["x"][0] = 1000.0
    options = {"dbc": files["toyota.dbc"], "mapping": "toyota-adas"}
    with pytest.warns(dc.PhysicsWarning) as caught:
        write_can_log(objects, tmp_path / "log.asc", **options)
    texts = " ".join(str(warning.message) for warning in caught)
    assert "4 objects left out" in texts
    assert read_can_log(tmp_path / "log.asc", **options).sizes["object"] == 16
    objects = radial_object_list(1, 2)
    objects["x"][0], objects["vy"][1] = 1000.0, np.nan
    with pytest.warns(dc.PhysicsWarning) as caught:
        write_can_log(objects, tmp_path / "log.asc", **options)
    texts = " ".join(str(warning.message) for warning in caught)
    assert "1 of LONG_DIST (0 to 300)" in texts
    assert "1 of range_rate" in texts


def test_messages_agree_with_cantools_and_classical_frames(files, tmp_path):
    """A vendor's controller receives plain CAN frames that its own DBC decodes."""
    objects = radial_object_list(1, 2)
    log = tmp_path / "log.blf"
    write_can_log(objects, log, dbc=files["toyota.dbc"], mapping="toyota-adas")
    database = cantools.database.load_file(files["toyota.dbc"])
    with can.BLFReader(log) as reader:
        messages = list(reader)
    assert len(messages) == 16
    assert not any(message.is_fd for message in messages)
    tracks = [database.decode_message(m.arbitration_id, m.data) for m in messages]
    assert [track["VALID"] for track in tracks] == [0, 1, 1] + [0] * 13
    assert tracks[1]["LAT_DIST"] == pytest.approx(-objects["y"].values[0], abs=0.02)


def test_short_messages_are_left_out_and_reported(files):
    layout = read_vendor_layout(files["toyota.dbc"], "toyota-adas")
    sent = encode_vendor_frames(radial_object_list(1, 3), layout, CanFd())
    sent[1] = sent[1]._replace(data=sent[1].data[:5])
    with pytest.warns(dc.PhysicsWarning, match="1 messages shorter"):
        assert assemble_vendor_list(sent, layout).sizes["object"] == 2


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ("messages: [TRACK_A_##]\nx: {signal: LONG_DIST}\ny: {signal: LAT_DIST}", "one #"),
        ("messages: [TRACK_A_0]\nx: {signal: LONG_DIST}\ny: {signal: LAT_DIST}", "one #"),
        ("messages: [TRACK_A_#]\nx: {signal: LONG_DIST}", "x and y"),
        ("messages: [TRACK_B_#]\nx: {signal: LONG_DIST}\ny: {signal: LAT_DIST}", "TRACK_B"),
        ("messages: [TRACK_A_#]\nx: {signal: LONG}\ny: {signal: LAT_DIST}", "LONG"),
        ("messages: [TRACK_A_#]\nx: {signal: LONG_DIST, factor: 0}", "factor"),
        ("messages: [TRACK_A_#]\nspeed: {signal: REL_SPEED}", "speed"),
    ],
)
def test_wrong_mapping_is_one_clear_error(mapping, message, files, tmp_path):
    file = tmp_path / "wrong.yaml"
    file.write_text(mapping)
    with pytest.raises(DechirpError, match=message):
        read_vendor_layout(files["toyota.dbc"], file)


def test_empty_value_outside_of_its_signal_is_refused(files):
    mapping = CanMapping(
        messages=("TRACK_A_#",),
        x=MappedSignal(signal="LONG_DIST", empty=400.0),
        y=MappedSignal(signal="LAT_DIST"),
    )
    with pytest.raises(InvalidSetting, match="LONG_DIST from 0 to 300; expected .* value 400"):
        read_vendor_layout(files["toyota.dbc"], mapping)
    with pytest.raises(InvalidSetting, match=r"MappedSignal\.empty"):
        MappedSignal(signal="LONG_DIST", empty=math.nan)


def test_mapping_without_dbc_or_file_is_refused(files, tmp_path):
    with pytest.raises(InvalidSetting, match="which the package does not contain"):
        read_can_log(tmp_path / "log.asc", mapping="toyota-adas")
    with pytest.raises(InvalidSetting, match="toyota-adas"):
        read_vendor_layout(files["toyota.dbc"], "toyota")
    objects = radial_object_list(1, 2)
    write_can_log(objects, tmp_path / "log.asc", dbc=files["esr.dbc"], mapping="delphi-esr")
    with pytest.raises(RecordingError, match="none with the identifier 0x210"):
        read_can_log(tmp_path / "log.asc", dbc=files["toyota.dbc"], mapping="toyota-adas")


def test_objects_give_the_own_speed_without_a_radar():
    """Standing objects of a radar at (12, 1.5) m/s; a third of the objects moves."""
    rng = np.random.default_rng(8)
    n = 30
    azimuth, range_m = rng.uniform(-0.7, 0.7, n), rng.uniform(10, 80, n)
    rate = -(12 * np.cos(azimuth) + 1.5 * np.sin(azimuth)) + rng.normal(0, 0.05, n)
    rate[:10] += rng.uniform(3, 20, 10)
    objects = radial_object_list(1, n).assign(
        x=("object", range_m * np.cos(azimuth)),
        y=("object", range_m * np.sin(azimuth)),
        vx=("object", rate * np.cos(azimuth)),
        vy=("object", rate * np.sin(azimuth)),
    )
    detections = dc.object_lists.objects_to_detections(
        objects, range_std_m=0.1, velocity_std_m_per_s=0.05, lateral_std_m=0.01
    )
    motion = dc.ego_motion(detections, None)
    assert motion["n_static"].item() == 20
    for name, expected in (("vx", 12.0), ("vy", 1.5)):
        error = motion[name].item() - expected
        assert abs(error) < 6 * motion[f"{name}_std"].item()  # by chance less than 1e-8
        assert motion[f"{name}_std"].item() < 0.1
    with pytest.raises(InvalidSetting, match="lateral_std_m"):
        dc.object_lists.objects_to_detections(
            objects, range_std_m=0.1, velocity_std_m_per_s=0.05, lateral_std_m=0.0
        )


@pytest.mark.filterwarnings("default::dechirp.PhysicsWarning")
@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_cut_log_is_reported_with_the_place(suffix, files, tmp_path):
    log = tmp_path / f"log{suffix}"
    options = {"dbc": files["toyota.dbc"], "mapping": "toyota-adas"}
    write_can_log(radial_object_list(4, 10), log, **options)
    content = log.read_bytes()
    cut = len(content) // 2
    while content[cut - 1 : cut] in b"\r\n":  # within a line
        cut += 1
    log.write_bytes(content[:cut])
    errors = []
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        try:
            read_can_log(log, **options)
        except RecordingError as error:  # what remains of a line may be none
            errors = [error]
    texts = [str(item) for item in (*messages, *errors)]
    assert any("cut off" in text and f"at byte {cut}" in text for text in texts)


@pytest.mark.filterwarnings("default::dechirp.PhysicsWarning")
def test_asc_without_the_end_of_its_block_is_reported(files, tmp_path):
    log = tmp_path / "log.asc"
    options = {"dbc": files["toyota.dbc"], "mapping": "toyota-adas"}
    write_can_log(radial_object_list(4, 10), log, **options)
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(lines[: len(lines) // 2]))
    with pytest.warns(dc.PhysicsWarning, match="before the end of its trigger block"):
        read_can_log(log, **options)


@pytest.mark.filterwarnings("default::dechirp.PhysicsWarning")
@pytest.mark.parametrize(
    ("dbc", "mapping", "n_messages"), [("toyota.dbc", "toyota-adas", 16), ("lists.dbc", None, 9)]
)
def test_log_cut_between_two_lines_is_reported(dbc, mapping, n_messages, files, tmp_path):
    log = tmp_path / "log.log"
    options = {"dbc": files[dbc], "mapping": mapping or files["lists.yaml"]}
    write_can_log(radial_object_list(3, 4), log, **options)
    lines = log.read_bytes().splitlines(keepends=True)
    assert len(lines) == 3 * n_messages
    log.write_bytes(b"".join(lines[:-3]))
    n_missing = 3 if mapping else 1  # of numbered objects: the second message of the third
    with pytest.warns(dc.PhysicsWarning, match=f"list 2, the last, lacks {n_missing} messages"):
        objects = read_can_log(log, **options)
    assert objects.sizes["cycle"] == 3

    log.write_bytes(b"".join(lines[:-n_messages]))
    with warnings.catch_warnings():
        warnings.simplefilter("error", dc.PhysicsWarning)
        assert read_can_log(log, **options).sizes["cycle"] == 2


def test_cut_dbc_is_refused_with_the_line(tmp_path):
    cut = ESR.rindex("|", 0, ESR.rindex("SG_") + 60) + 1
    path = tmp_path / "cut.dbc"
    path.write_text(ESR[:cut])
    line = ESR[:cut].count("\n") + 1
    with pytest.raises(InvalidSetting, match=f"incomplete statement at its end, line {line}"):
        read_vendor_layout(path, "delphi-esr")


def test_signal_before_its_message_is_refused_by_name(tmp_path):
    path = tmp_path / "negative.dbc"
    path.write_text(re.sub(r"(SG_ CAN_TX_TRACK_RANGE :) *\d+", r"\1 -1", ESR))
    with pytest.raises(InvalidSetting, match=r"negative\.dbc with .*CAN_TX_TRACK_RANGE at bit -1"):
        read_vendor_layout(path, "delphi-esr")


FD_TEMPLATE = """\
BO_ {id} OBJECT_{n}: 16 XXX
 SG_ COUNTER : 0|8@1+ (1,0) [0|255] "" XXX
 SG_ STATE : 8|2@1+ (1,0) [0|3] "" XXX
 SG_ X : 16|16@1- (0.01,0) [-327.68|327.67] "m" XXX
 SG_ Y : 32|16@1- (0.01,0) [-327.68|327.67] "m" XXX
 SG_ VX : 64|16@1- (0.01,0) [-327.68|327.67] "m/s" XXX
 SG_ VY : 80|16@1- (0.01,0) [-327.68|327.67] "m/s" XXX
"""
FD_MAPPING = """\
messages: [OBJECT_#]
counter: COUNTER
status: {signal: STATE, confirmed: [2], tentative: [1], empty: 0}
x: {signal: X}
y: {signal: Y}
vx: {signal: VX}
vy: {signal: VY}
"""


@pytest.fixture
def fd_files(tmp_path):
    (tmp_path / "fd.dbc").write_text(dbc_text(numbered_messages(FD_TEMPLATE, 768, range(12))))
    (tmp_path / "fd.yaml").write_text(FD_MAPPING)
    return {"dbc": tmp_path / "fd.dbc", "mapping": tmp_path / "fd.yaml"}


def decode_with_cantools(dbc, frames):
    database = cantools.database.load_file(dbc)
    return [database.decode_message(frame.arbitration_id, frame.data) for frame in frames]


def decode_with_opendbc(dbc, frames):
    """Decode each frame with the parser of commaai/opendbc."""
    parsers = pytest.importorskip("opendbc.can.parser", reason="needs opendbc: pip install opendbc")
    identifiers = {frame.arbitration_id for frame in frames}
    parser = parsers.CANParser(str(dbc), [(identifier, 0) for identifier in identifiers], 0)
    rows = []
    for frame in frames:
        nanoseconds = round(frame.timestamp * 1e9)
        updated = parser.update([(nanoseconds, [(frame.arbitration_id, bytes(frame.data), 0)])])
        assert updated == {frame.arbitration_id}
        rows.append(dict(parser.vl[frame.arbitration_id]))
    return rows


@pytest.mark.parametrize("decode", [decode_with_cantools, decode_with_opendbc])
def test_strangers_decode_every_frame_of_tracks_within_half_a_step(decode, fd_files, tmp_path):
    # Of 11 objects in 12 messages of 16 bytes: CAN FD, each list within its cycle.
    objects = radial_object_list(6, 11)
    log = tmp_path / "log.blf"
    write_can_log(objects, log, **fd_files)
    with can.BLFReader(log) as reader:
        frames = list(reader)
    assert len(frames) == 6 * 12
    assert all(frame.is_fd and frame.dlc == 16 for frame in frames)
    times_s = np.array([frame.timestamp for frame in frames])
    assert np.all(np.diff(times_s) > 0)
    np.testing.assert_allclose(times_s[::12] - times_s[0], np.arange(6) * 0.05, atol=1e-6)
    decoded = decode(fd_files["dbc"], frames)
    filled = [row for row in decoded if row["STATE"]]
    assert len(filled) == objects.sizes["object"]
    for signal, name in (("X", "x"), ("Y", "y"), ("VX", "vx"), ("VY", "vy")):
        (expected,) = sorted_columns(objects, name)
        received = [row[signal] for row in filled]
        np.testing.assert_allclose(received, expected, atol=0.005 + 1e-9)


@pytest.mark.parametrize("decode", [decode_with_cantools, decode_with_opendbc])
def test_strangers_decode_a_published_dbc(decode, tmp_path):
    # ESR.dbc of commaai/opendbc: angles clockwise, so their sign is the opposite one.
    folder = os.environ.get("DECHIRP_WITNESS_DATA")
    dbc = Path(folder or "", "car_dbc", "ESR.dbc")
    if not folder or not dbc.is_file():
        pytest.skip("needs car_dbc of DECHIRP_WITNESS_DATA")
    objects = radial_object_list(4, 20)
    write_can_log(objects, tmp_path / "log.blf", dbc=dbc, mapping="delphi-esr")
    with can.BLFReader(tmp_path / "log.blf") as reader:
        frames = list(reader)
    assert len(frames) == 4 * 64
    decoded = decode(dbc, frames)
    range_m, azimuth, rate = range_azimuth_rate(objects)
    filled = [row for row in decoded if row["CAN_TX_TRACK_RANGE"]]
    assert len(filled) == 80
    for signal, expected, step in (
        ("CAN_TX_TRACK_RANGE", range_m, 0.1),
        ("CAN_TX_TRACK_ANGLE", -np.degrees(azimuth), 0.1),
        ("CAN_TX_TRACK_RANGE_RATE", rate, 0.01),
    ):
        received = [row[signal] for row in filled]
        np.testing.assert_allclose(received, expected, atol=step / 2 + 1e-9)


@pytest.fixture
def toyota_frames(files, tmp_path):
    dbc = files["toyota.dbc"].rename(tmp_path / "toyota_adas.dbc")  # opendbc checks by this name
    write_can_log(radial_object_list(4, 10), tmp_path / "log.blf", dbc=dbc, mapping="toyota-adas")
    with can.BLFReader(tmp_path / "log.blf") as reader:
        return dbc, list(reader)


def test_checksums_are_sums_as_in_frames_of_a_car(toyota_frames):
    """Bytes of the identifier, length and other bytes: in all of 19,200 frames of comma2k19."""
    _, frames = toyota_frames
    assert len(frames) == 4 * 16
    for frame in frames:
        high, low = divmod(frame.arbitration_id, 256)
        assert frame.data[7] == (high + low + 8 + sum(frame.data[:7])) % 256
    assert len({frame.data[7] for frame in frames}) > 16


def test_parser_of_opendbc_accepts_each_checksum(toyota_frames):
    assert len(decode_with_opendbc(*toyota_frames)) == 4 * 16


def test_lists_longer_than_their_cycle_are_reported(fd_files):
    layout = read_vendor_layout(fd_files["dbc"], fd_files["mapping"])
    objects = radial_object_list(3, 11)
    # At 10 kbit/s a frame of 16 bytes takes some 20 ms, the list 240 ms of a cycle of 50.
    bus = CanFd(arbitration_bit_rate_hz=1e4, data_bit_rate_hz=1e4)
    with pytest.warns(dc.PhysicsWarning, match="lists of 12 messages take longer than their cycle"):
        encode_vendor_frames(objects, layout, bus)
    with warnings.catch_warnings():
        warnings.simplefilter("error", dc.PhysicsWarning)
        encode_vendor_frames(objects, layout, CanFd())


@nightly
def test_run_writes_its_tracks_by_the_dbc_of_a_vendor(fd_files, tmp_path, capsys):
    settings = ["n_frames=5", "radar.frame.n_chirps=64", "tracker={}", "chain.angle.kind=fft"]
    words = ["run", str(EXAMPLES / "mimo.yaml"), "--out", str(tmp_path / "run"), "--quiet"]
    words += [word for setting in settings for word in ("--set", setting)]
    coding = ["--dbc", str(fd_files["dbc"]), "--mapping", str(fd_files["mapping"])]
    log = tmp_path / "tracks.asc"
    with pytest.raises(SystemExit) as done:
        main([*words, "--objects", str(log), *coding])
    assert not done.value.code
    received = read_can_log(log, **fd_files)
    assert received.sizes["cycle"] == 5
    assert received.sizes["object"] > 5
    for extra, message in (
        (["--objects", str(tmp_path / "tracks.csv"), *coding], "--dbc: given without a CAN log"),
        (["--objects", str(log), "--mapping", "toyota-adas"], "--dbc"),
        (["--objects", str(log), "--dbc", str(fd_files["dbc"]), "--mapping", "x"], "--mapping"),
    ):
        with pytest.raises(SystemExit) as done:
            main([*words, *extra])
        assert done.value.code == 2
        assert message in capsys.readouterr().err
