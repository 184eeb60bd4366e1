"""Points from a TI radar's serial port: what they mean, and what is lost on the way."""

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

MAGIC = b"\x02\x01\x04\x03\x06\x05\x08\x07"
SDK_4, SDK_2, SDK_1_0 = 0x04070001, 0x02010004, 0x01000005


def item(kind, content):
    return struct.pack("<II", kind, len(content)) + content


def packet(number, n_objects, *items, version=SDK_4, platform=0x2944, subframe=(0,)):
    body = b"".join(items)
    n_bytes = 36 + 4 * len(subframe) + len(body)
    padding = -n_bytes % 32
    words = (version, n_bytes + padding, platform, number, 12345, n_objects, len(items), *subframe)
    return MAGIC + struct.pack(f"<{len(words)}I", *words) + body + b"\x0f" * padding


def points_item(points):
    return item(1, b"".join(struct.pack("<4f", *point) for point in points))


def side_item(ratios_db):
    return item(7, b"".join(struct.pack("<2h", round(10 * db), 300) for db in ratios_db))


STATISTICS = item(6, bytes(24))


def scene(number):
    """Three points whose numbers tell the packet they are from."""
    points = [(0.1 * k, 1.0 + number, 0.5, -0.25 * k) for k in range(3)]
    return packet(number, 3, points_item(points), side_item([10, 20, 30]), STATISTICS)


def read(tmp_path, content, told=None):
    (tmp_path / "stream.dat").write_bytes(content)
    return TiUart().read(tmp_path / "stream.dat", told or RecordingHints())


def lost(contents):
    return [finding.value for finding in contents.findings if finding.level == "warning"]


def told(n_chirps=16, period_s=0.1):
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


def test_a_point_in_front_to_the_left_and_above_is_there(tmp_path):
    # In TI's axes x points right, y forward, z up.
    content = packet(7, 1, points_item([(-1.0, 2.0, 0.5, -0.75)]), side_item([23.4]))

    contents = read(tmp_path, content)

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


def test_packets_without_points_count_and_ratios_that_were_not_sent_are_unknown(tmp_path):
    content = (
        packet(1, 0, STATISTICS)
        + packet(2, 2, points_item([(0, 1, 0, 0), (0, 2, 0, 0)]))
        + packet(3, 0, points_item([]), side_item([]))
    )

    contents = read(tmp_path, content)

    assert contents.n_frames == 3
    assert contents.points.frame.values.tolist() == [1, 1]
    assert np.isnan(contents.points.snr).all()
    assert lost(contents) == []


def test_other_items_are_counted_by_kind(tmp_path):
    profile = item(2, bytes(512))

    contents = read(tmp_path, scene(1) + packet(2, 0, profile, STATISTICS, item(301, b"abc")))

    (note,) = [finding.value for finding in contents.findings]
    assert "range profile (2) in 1, statistics (6) in 2, unknown (301) in 1" in note


def test_the_radar_gives_the_points_their_times(tmp_path):
    contents = read(tmp_path, scene(20) + scene(21) + scene(24), told())

    mid_frame_s = contents.radar.frame.mid_frame_s
    times = np.repeat([0.0, 0.1, 0.4], 3) + mid_frame_s
    assert contents.points.time.values == pytest.approx(times)


# Header, points, side information, statistics, the next magic word: from each some bytes.
@pytest.mark.parametrize("place", [0, 5, 9, 14, 30, 38, 41, 45, 52, 80, 97, 101, 115, 130, 155])
@pytest.mark.parametrize("n_bytes", [1, 7, 40, 200])
def test_bytes_lost_from_a_packet_cost_no_packet_behind_it(tmp_path, place, n_bytes):
    sent = [scene(number) for number in range(10, 16)]
    start = len(sent[0]) + len(sent[1])
    content = b"".join(sent)
    content = content[: start + place] + content[start + place + n_bytes :]

    contents = read(tmp_path, content)

    n_packets_hit = 1 + (place + n_bytes - 1) // len(sent[2])
    hit = set(range(12, 12 + n_packets_hit))
    if place >= 124 and n_packets_hit > 1:
        hit.remove(12)  # lost: its statistics, which are behind its points
    whole = np.unique(contents.points.frame_number).tolist()
    assert whole == sorted({10, 11, 12, 13, 14, 15} - hit)
    # And each point is one that was sent.
    forward = np.sqrt(contents.points.range**2 - 0.25) * np.cos(contents.points.azimuth)
    assert forward.values == pytest.approx(1.0 + contents.points.frame_number.values, rel=1e-5)
    (warning,) = lost(contents)
    assert f"{len(hit)} frames missing between frame 10 and 15" in warning


def test_a_packet_that_begins_inside_a_damaged_one_is_found(tmp_path):
    longer = bytearray(scene(2))
    struct.pack_into("<I", longer, 12, 4 * len(longer))  # says that it is four times as long

    contents = read(tmp_path, scene(1) + bytes(longer) + scene(3) + scene(4) + scene(5))

    assert np.unique(contents.points.frame_number).tolist() == [1, 3, 4, 5]
    assert f"1 damaged ones, {len(longer)} bytes in 1 places" in lost(contents)[0]


def test_a_stream_joined_late_and_stopped_early_gives_its_whole_packets(tmp_path):
    content = scene(5)[50:] + scene(6) + scene(7) + scene(8)[:-10]

    contents = read(tmp_path, content)

    assert np.unique(contents.points.frame_number).tolist() == [6, 7]
    assert "in 2 places left out, 0 frames missing between frame 6 and 7" in lost(contents)[0]


def test_points_that_cannot_be_true_make_a_packet_damaged(tmp_path):
    for wrong in (np.nan, np.inf, 1e30):
        bad = packet(2, 1, points_item([(0.0, wrong, 0.0, 0.0)]), STATISTICS)
        contents = read(tmp_path, scene(1) + bad + scene(3))
        assert np.unique(contents.points.frame_number).tolist() == [1, 3]


def test_frame_numbers_that_start_again_are_no_loss_and_subframes_share_one(tmp_path):
    shared = [packet(9, 1, points_item([(0, 1, 0, 0)]), subframe=(n,)) for n in range(2)]

    contents = read(tmp_path, scene(8) + b"".join(shared) + scene(1))

    assert contents.n_frames == 4
    assert (
        "0 bytes in 0 places left out, 0 frames missing between frame 8 and 1, 1 jumps"
        in lost(contents)[0]
    )


# --- Before SDK 3: 16-bit numbers ------------------------------------------------------


def old_item(points, q_format=8):
    """Range bin, Doppler bin, peak, x, y, z; of 16 bits, coordinates times 2^q."""
    content = struct.pack("<HH", len(points), q_format)
    for doppler, x, y, z in points:
        xyz = (round(metres * 2**q_format) for metres in (x, y, z))
        content += struct.pack("<HhH3h", 10, doppler, 500, *xyz)
    return item(1, content)


@pytest.mark.parametrize(("platform", "subframe"), [(0xA1443, ()), (0xA1642, (0,))])
def test_points_of_16_bits_are_read_whichever_header_the_chip_has(tmp_path, platform, subframe):
    content = b"".join(
        packet(
            number,
            2,
            old_item([(-3, 1.5, 2.0, 0.0), (2, 0.0, 4.0, -0.5)]),
            STATISTICS,
            version=SDK_2,
            platform=platform,
            subframe=subframe,
        )
        for number in (1, 2)
    )

    contents = read(tmp_path, content, told())

    bin_m_per_s = contents.radar.frame.velocity_resolution_m_per_s
    assert contents.points.range.values == pytest.approx([2.5, np.sqrt(16.25)] * 2)
    assert contents.points.azimuth.values == pytest.approx([-np.arctan2(1.5, 2), 0] * 2)
    assert contents.points.velocity.values == pytest.approx(
        [-3 * bin_m_per_s, 2 * bin_m_per_s] * 2, rel=1e-6
    )


def test_doppler_bins_are_no_velocities_without_the_radar(tmp_path):
    content = packet(1, 1, old_item([(-3, 0, 2, 0)]), STATISTICS, version=SDK_2)

    contents = read(tmp_path, content)

    assert np.isnan(contents.points.velocity.values).all()
    assert "Doppler bins" in lost(contents)[0]


def test_the_first_sdk_counts_doppler_bins_from_zero(tmp_path):
    points = old_item([(13, 0, 2, 0), (2, 0, 2, 0)])
    content = packet(1, 2, points, STATISTICS, version=SDK_1_0, platform=0xA1443, subframe=())

    contents = read(tmp_path, content, told(n_chirps=16))

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
        scene(1)[:-1],
        packet(1, 4, points_item([(0, 1, 0, 0)])),  # says four points
        packet(1, 0, item(6, b"") * 2)[:-32],
        packet(1, 1, points_item([(0, 1, 0, 0)]) * 2),
        packet(1, 2, old_item([(0, 0, 1, 0)]), version=SDK_2),
    ],
)
def test_a_file_without_a_whole_packet_is_refused(tmp_path, content):
    with pytest.raises(RecordingError, match="no complete packet"):
        read(tmp_path, content)


def test_a_file_is_known_by_a_magic_word_near_its_start(tmp_path):
    file = tmp_path / "anything.bin"
    for content, fit in (
        (scene(1), MatchQuality.SELF_DESCRIBING),
        (b"\x55" * 3000 + scene(1), MatchQuality.SELF_DESCRIBING),
        (MAGIC + scene(1), MatchQuality.SELF_DESCRIBING),
        (MAGIC + b"\xff" * 100, MatchQuality.NO),
        (MAGIC, MatchQuality.NO),
        (b"", MatchQuality.NO),
    ):
        file.write_bytes(content)
        assert TiUart().recognise(file) == fit
    assert TiUart().recognise(tmp_path) == MatchQuality.NO


STREAM = b"".join(scene(number) for number in range(5)) + packet(
    5, 1, old_item([(-3, 0, 2, 0)]), version=SDK_2, platform=0xA1443, subframe=()
)


@settings(max_examples=200)
@given(st.data())
def test_losing_bytes_never_makes_points_up(tmp_path_factory, data):
    content = bytearray(STREAM)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        del content[at : at + data.draw(st.integers(1, 200))]
    try:
        contents = read(tmp_path_factory.mktemp("fuzz"), bytes(content))
    except RecordingError:
        return
    new = contents.points.isel(detection=contents.points.frame_number.values < 5)
    forward = np.sqrt(new.range**2 - 0.25) * np.cos(new.azimuth)
    assert forward.values == pytest.approx(1.0 + new.frame_number.values, rel=1e-5)


@settings(max_examples=200)
@given(st.data())
def test_no_bytes_do_anything_but_decode_or_be_refused(tmp_path_factory, data):
    content = bytearray(STREAM)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(content)))
        gone = data.draw(st.integers(0, 100))
        content[at : at + gone] = data.draw(st.binary(max_size=40) | st.just(MAGIC))
    try:
        contents = read(tmp_path_factory.mktemp("fuzz"), bytes(content), told())
    except RecordingError:
        return
    points = contents.points
    assert np.isfinite(points.range.values).all()
    assert np.isfinite(points.velocity.values).all()
    assert points.frame.size == 0 or points.frame.max() < contents.n_frames
