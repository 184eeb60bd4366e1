"""Points from the serial port of TI radars: coordinates, times, lost and damaged packets."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import MatchQuality, RecordingHints
from dechirp.recordings.readers.ti_uart import TiUart
from dechirp.recordings.settings.base import RecordingSettings
from nightly import n_examples

MAGIC = b"\x02\x01\x04\x03\x06\x05\x08\x07"
SDK_4, SDK_2, SDK_1_0 = 0x04070001, 0x02010004, 0x01000005


def encode_item(kind, content):
    return struct.pack("<II", kind, len(content)) + content


def encode_packet(number, n_objects, *items, version=SDK_4, platform=0x2944, subframe=(0,)):
    body = b"".join(items)
    n_bytes = 36 + 4 * len(subframe) + len(body)
    padding = -n_bytes % 32
    words = (version, n_bytes + padding, platform, number, 12345, n_objects, len(items), *subframe)
    return MAGIC + struct.pack(f"<{len(words)}I", *words) + body + b"\x0f" * padding


def encode_points(points):
    return encode_item(1, b"".join(struct.pack("<4f", *point) for point in points))


def encode_side_info(ratios_db):
    return encode_item(7, b"".join(struct.pack("<2h", round(10 * db), 300) for db in ratios_db))


STATISTICS = encode_item(6, bytes(24))


def encode_scene(number):
    """Encode a packet with three points whose range depends on the packet number."""
    points = [(0.1 * k, 1.0 + number, 0.5, -0.25 * k) for k in range(3)]
    return encode_packet(
        number, 3, encode_points(points), encode_side_info([10, 20, 30]), STATISTICS
    )


def read_contents(tmp_path, content, hints=None):
    (tmp_path / "stream.dat").write_bytes(content)
    return TiUart().read(tmp_path / "stream.dat", hints or RecordingHints())


def list_warnings(contents):
    return [finding.value for finding in contents.findings if finding.level == "warning"]


def make_hints(n_chirps=16, period_s=0.1):
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=60e-6,
        sample_rate_hz=5e6,
        n_samples=256,
        sampling="complex",
    )
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=70e-6, period_s=period_s)
    return RecordingHints(settings=RecordingSettings(radar=Radar(frame=frame)))


def test_point_coordinates_follow_ti_axes(tmp_path):
    # In TI's axes x points right, y forward, z up.
    content = encode_packet(
        7, 1, encode_points([(-1.0, 2.0, 0.5, -0.75)]), encode_side_info([23.4])
    )

    contents = read_contents(tmp_path, content)

    (point,) = contents.points.to_dataframe().to_dict("records")
    assert contents.radar is None
    assert contents.decode is None
    assert contents.n_frames == 1
    assert point["frame"] == 0
    assert point["frame_number"] == 7
    assert point["range"] == pytest.approx(np.sqrt(5.25))
    assert point["velocity"] == -0.75
    assert point["azimuth"] == pytest.approx(np.arctan2(1, 2))
    assert point["elevation"] == pytest.approx(np.arcsin(0.5 / np.sqrt(5.25)))
    assert point["snr"] == pytest.approx(10**2.34, rel=1e-6)
    assert "time" not in contents.points


def test_empty_packets_are_frames_and_missing_snr_is_nan(tmp_path):
    content = (
        encode_packet(1, 0, STATISTICS)
        + encode_packet(2, 2, encode_points([(0, 1, 0, 0), (0, 2, 0, 0)]))
        + encode_packet(3, 0, encode_points([]), encode_side_info([]))
    )

    contents = read_contents(tmp_path, content)

    assert contents.n_frames == 3
    assert contents.points.frame.values.tolist() == [1, 1]
    assert np.isnan(contents.points.snr).all()
    assert list_warnings(contents) == []


def test_unused_items_are_counted_by_kind(tmp_path):
    profile = encode_item(2, bytes(512))

    contents = read_contents(
        tmp_path,
        encode_scene(1) + encode_packet(2, 0, profile, STATISTICS, encode_item(301, b"abc")),
    )

    (note,) = [finding.value for finding in contents.findings]
    assert "range profile (2) in 1, statistics (6) in 2, unknown (301) in 1" in note


CFG = """\
channelCfg 15 1 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 10 6 60 0 0 30 1 256 5000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 16 0 100 1 0
sensorStart
"""


def test_only_settings_file_of_folder_gives_radar(tmp_path):
    content = encode_scene(20) + encode_scene(21)
    (tmp_path / "sent.cfg").write_text(CFG)

    contents = read_contents(tmp_path, content)

    frame = contents.radar.frame
    assert (frame.n_chirps, frame.period_s) == (16, 0.1)
    times = np.unique(contents.points.time) - frame.mid_frame_s
    assert times == pytest.approx([0.0, 0.1], abs=1e-9)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ([CFG, CFG.replace("256", "128")], "a.cfg, b.cfg not used (no settings in the recording"),
        ([CFG.replace("profileCfg 0 77", "profileCfg 0")], "a.cfg not used (13 numbers)"),
    ],
)
def test_points_need_no_readable_settings(tmp_path, texts, message):
    for name, text in zip("ab", texts, strict=False):
        (tmp_path / f"{name}.cfg").write_text(text)

    contents = read_contents(tmp_path, encode_scene(20))

    assert contents.radar is None
    assert message in contents.findings[0].value


def test_radar_gives_point_times(tmp_path):
    contents = read_contents(
        tmp_path, encode_scene(20) + encode_scene(21) + encode_scene(24), make_hints()
    )

    mid_frame_s = contents.radar.frame.mid_frame_s
    times = np.repeat([0.0, 0.1, 0.4], 3) + mid_frame_s
    assert contents.points.time.values == pytest.approx(times)


# Offsets in the header, the points, the side information, the statistics and the next header.
@pytest.mark.parametrize("offset", [0, 5, 9, 14, 30, 38, 41, 45, 52, 80, 97, 101, 115, 130, 155])
@pytest.mark.parametrize("n_bytes", [1, 7, 40, 200])
def test_lost_bytes_damage_no_later_packet(tmp_path, offset, n_bytes):
    packets = [encode_scene(number) for number in range(10, 16)]
    start = len(packets[0]) + len(packets[1])
    content = b"".join(packets)
    content = content[: start + offset] + content[start + offset + n_bytes :]

    contents = read_contents(tmp_path, content)

    n_packets_hit = 1 + (offset + n_bytes - 1) // len(packets[2])
    damaged_numbers = set(range(12, 12 + n_packets_hit))
    if offset >= 124 and n_packets_hit > 1:
        damaged_numbers.remove(12)  # only its statistics are lost, after its points
    frame_numbers = np.unique(contents.points.frame_number).tolist()
    assert frame_numbers == sorted({10, 11, 12, 13, 14, 15} - damaged_numbers)
    # Every point equals an encoded one.
    forward = np.sqrt(contents.points.range**2 - 0.25) * np.cos(contents.points.azimuth)
    assert forward.values == pytest.approx(1.0 + contents.points.frame_number.values, rel=1e-5)
    (warning,) = list_warnings(contents)
    assert f"{len(damaged_numbers)} frames missing between frame 10 and 15" in warning


def test_finds_packet_within_damaged_packet(tmp_path):
    damaged_packet = bytearray(encode_scene(2))
    # Declared length: four times the true one.
    struct.pack_into("<I", damaged_packet, 12, 4 * len(damaged_packet))

    contents = read_contents(
        tmp_path,
        encode_scene(1)
        + bytes(damaged_packet)
        + encode_scene(3)
        + encode_scene(4)
        + encode_scene(5),
    )

    assert np.unique(contents.points.frame_number).tolist() == [1, 3, 4, 5]
    assert f"1 damaged ones, {len(damaged_packet)} bytes in 1 places" in list_warnings(contents)[0]


def test_partial_stream_gives_complete_packets(tmp_path):
    content = encode_scene(5)[50:] + encode_scene(6) + encode_scene(7) + encode_scene(8)[:-10]

    contents = read_contents(tmp_path, content)

    assert np.unique(contents.points.frame_number).tolist() == [6, 7]
    assert (
        "in 2 places left out, 0 frames missing between frame 6 and 7" in list_warnings(contents)[0]
    )


def test_packet_with_impossible_points_is_damaged(tmp_path):
    for coordinate in (np.nan, np.inf, 1e30):
        invalid_packet = encode_packet(
            2, 1, encode_points([(0.0, coordinate, 0.0, 0.0)]), STATISTICS
        )
        contents = read_contents(tmp_path, encode_scene(1) + invalid_packet + encode_scene(3))
        assert np.unique(contents.points.frame_number).tolist() == [1, 3]


def test_restarted_and_shared_frame_numbers_are_no_loss(tmp_path):
    subframes = [
        encode_packet(9, 1, encode_points([(0, 1, 0, 0)]), subframe=(n,)) for n in range(2)
    ]

    contents = read_contents(tmp_path, encode_scene(8) + b"".join(subframes) + encode_scene(1))

    assert contents.n_frames == 4
    assert (
        "0 bytes in 0 places left out, 0 frames missing between frame 8 and 1, 1 jumps"
        in list_warnings(contents)[0]
    )


# --- Before SDK 3: 16-bit numbers ------------------------------------------------------


def encode_16_bit_points(points, q_format=8):
    """Encode range bin, Doppler bin, peak, x, y, z in 16 bits; coordinates are scaled by 2^q."""
    content = struct.pack("<HH", len(points), q_format)
    for doppler, x, y, z in points:
        xyz = (round(metres * 2**q_format) for metres in (x, y, z))
        content += struct.pack("<HhH3h", 10, doppler, 500, *xyz)
    return encode_item(1, content)


@pytest.mark.parametrize(("platform", "subframe"), [(0xA1443, ()), (0xA1642, (0,))])
def test_16_bit_points_are_read_with_both_headers(tmp_path, platform, subframe):
    content = b"".join(
        encode_packet(
            number,
            2,
            encode_16_bit_points([(-3, 1.5, 2.0, 0.0), (2, 0.0, 4.0, -0.5)]),
            STATISTICS,
            version=SDK_2,
            platform=platform,
            subframe=subframe,
        )
        for number in (1, 2)
    )

    contents = read_contents(tmp_path, content, make_hints())

    bin_m_per_s = contents.radar.frame.velocity_resolution_m_per_s
    assert contents.points.range.values == pytest.approx([2.5, np.sqrt(16.25)] * 2)
    assert contents.points.azimuth.values == pytest.approx([-np.arctan2(1.5, 2), 0] * 2)
    assert contents.points.velocity.values == pytest.approx(
        [-3 * bin_m_per_s, 2 * bin_m_per_s] * 2, rel=1e-6
    )


def test_doppler_bins_without_radar_give_nan_velocity(tmp_path):
    content = encode_packet(1, 1, encode_16_bit_points([(-3, 0, 2, 0)]), STATISTICS, version=SDK_2)

    contents = read_contents(tmp_path, content)

    assert np.isnan(contents.points.velocity.values).all()
    assert "Doppler bins" in list_warnings(contents)[0]


def test_first_sdk_counts_doppler_bins_from_zero(tmp_path):
    points = encode_16_bit_points([(13, 0, 2, 0), (2, 0, 2, 0)])
    content = encode_packet(
        1, 2, points, STATISTICS, version=SDK_1_0, platform=0xA1443, subframe=()
    )

    contents = read_contents(tmp_path, content, make_hints(n_chirps=16))

    bin_m_per_s = contents.radar.frame.velocity_resolution_m_per_s
    expected = np.array([-3, 2]) * bin_m_per_s
    assert contents.points.velocity.values == pytest.approx(expected, rel=1e-6)


# --- Wrong input ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"sensorStart\nDone\n",
        MAGIC,
        MAGIC * 1000,
        encode_scene(1)[:-1],
        encode_packet(1, 4, encode_points([(0, 1, 0, 0)])),  # declares four points
        encode_packet(1, 0, encode_item(6, b"") * 2)[:-32],
        encode_packet(1, 1, encode_points([(0, 1, 0, 0)]) * 2),
        encode_packet(1, 2, encode_16_bit_points([(0, 0, 1, 0)]), version=SDK_2),
    ],
)
def test_rejects_file_without_complete_packet(tmp_path, content):
    with pytest.raises(RecordingError, match="no complete packet"):
        read_contents(tmp_path, content)


def test_recognises_file_by_magic_word_near_start(tmp_path):
    file = tmp_path / "anything.bin"
    for content, quality in (
        (encode_scene(1), MatchQuality.SELF_DESCRIBING),
        (b"\x55" * 3000 + encode_scene(1), MatchQuality.SELF_DESCRIBING),
        (MAGIC + encode_scene(1), MatchQuality.SELF_DESCRIBING),
        (MAGIC + b"\xff" * 100, MatchQuality.NO),
        (MAGIC, MatchQuality.NO),
        (b"", MatchQuality.NO),
    ):
        file.write_bytes(content)
        assert TiUart().recognise(file) == quality
    assert TiUart().recognise(tmp_path) == MatchQuality.NO


STREAM = b"".join(encode_scene(number) for number in range(5)) + encode_packet(
    5, 1, encode_16_bit_points([(-3, 0, 2, 0)]), version=SDK_2, platform=0xA1443, subframe=()
)


@settings(max_examples=n_examples(200))
@given(st.data())
def test_lost_bytes_never_create_points(tmp_path_factory, data):
    content = bytearray(STREAM)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content)))
        del content[start : start + data.draw(st.integers(1, 200))]
    try:
        contents = read_contents(tmp_path_factory.mktemp("fuzz"), bytes(content))
    except RecordingError:
        return
    points = contents.points.isel(detection=contents.points.frame_number.values < 5)
    forward = np.sqrt(points.range**2 - 0.25) * np.cos(points.azimuth)
    assert forward.values == pytest.approx(1.0 + points.frame_number.values, rel=1e-5)


@settings(max_examples=n_examples(200))
@given(st.data())
def test_fuzzed_bytes_decode_or_raise_recording_error(tmp_path_factory, data):
    content = bytearray(STREAM)
    for _ in range(data.draw(st.integers(1, 6))):
        start = data.draw(st.integers(0, len(content)))
        n_removed = data.draw(st.integers(0, 100))
        content[start : start + n_removed] = data.draw(st.binary(max_size=40) | st.just(MAGIC))
    try:
        contents = read_contents(tmp_path_factory.mktemp("fuzz"), bytes(content), make_hints())
    except RecordingError:
        return
    points = contents.points
    assert np.isfinite(points.range.values).all()
    assert np.isfinite(points.velocity.values).all()
    assert points.frame.size == 0 or points.frame.max() < contents.n_frames


def encode_viewer_frame(number, points=(), n_targets=0):
    items = []
    if points:
        items.append(encode_item(6, b"".join(struct.pack("<4f", *point) for point in points)))
    if n_targets:
        items.append(encode_item(7, bytes(28 * n_targets)))
        items.append(encode_item(8, bytes(len(points))))
    return struct.pack("<II", number, len(items)) + b"".join(items)


def test_file_of_people_counting_viewer_gives_points(tmp_path):
    content = b"".join(
        [
            encode_viewer_frame(1),
            encode_viewer_frame(2, [(5.0, -0.25, -0.5, 12.6)]),
            encode_viewer_frame(4, [(5.5, 0.25, 0.5, 20.0), (6.0, 0.0, 0.0, 30.0)], n_targets=1),
        ]
    )
    cut = encode_viewer_frame(5, [(1.0, 0.0, 0.0, 20.0)])[:-4]

    contents = read_contents(tmp_path, content + cut)

    points = contents.points
    assert TiUart().recognise(tmp_path / "stream.dat") == MatchQuality.SELF_DESCRIBING
    assert contents.n_frames == 3
    assert points.frame.values.tolist() == [1, 2, 2]
    assert points.frame_number.values.tolist() == [2, 4, 4]
    assert points.range.values.tolist() == [5.0, 5.5, 6.0]
    assert points.velocity.values.tolist() == [-0.5, 0.5, 0.0]
    # To the right in the file, to the left in the package.
    assert points.azimuth.values.tolist() == [0.25, -0.25, 0.0]
    assert points.snr.values == pytest.approx([12.6, 20, 30])
    assert list_warnings(contents) == [f"3 complete frames; {len(cut)} bytes after them left out"]


@pytest.mark.parametrize("kind", ["noise", "counter", "zeros"])
def test_raw_samples_are_not_taken_for_frames_of_viewer(tmp_path, kind):
    words = {
        "noise": np.random.default_rng(1).integers(-2000, 2000, 4096, np.int16),
        "counter": np.arange(4096, dtype=np.int16),
        "zeros": np.zeros(4096, np.int16),
    }[kind]
    (tmp_path / "capture.bin").write_bytes(words.tobytes())

    assert TiUart().recognise(tmp_path / "capture.bin") == MatchQuality.NO
