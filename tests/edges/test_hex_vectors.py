"""Hexadecimal test vectors of the fixed-point chain: round trip, format, damaged folders."""

import json
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.processing.fixed_point.chain import fixed_point_map, stage_outputs
from dechirp.processing.fixed_point.lookup_tables import make_lookup_tables
from dechirp.processing.fixed_point.samples import to_integer_samples_and_step
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.results.hex_vectors import (
    FILES,
    check_vector_folder_replaceable,
    read_vectors,
    read_words,
    write_vectors,
)
from nightly import nightly_except

OVERFLOWING_WORDS = WordLengths(range_bits=18, doppler_bits=14, twiddle_bits=17, scaling="none")


def shrink_radar(radar: dc.Radar, sampling: str) -> dc.Radar:
    chirp = replace(radar.frame.chirp, n_samples=48, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=16))


CHAIN = dc.Chain(n_range_bins=64)
SCENE = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(5, 0, 0))])


def simulate_frame(radar: dc.Radar):
    return dc.simulate(SCENE, radar, seed=1).isel(frame=0)


@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
@pytest.mark.parametrize(
    "words", [OVERFLOWING_WORDS, WordLengths()], ids=["overflowing", "default"]
)
def test_all_stages_and_tables_read_back_equal(tmp_path, radar, sampling, words):
    radar = shrink_radar(radar, sampling)
    frame = simulate_frame(radar)

    names = write_vectors(tmp_path / "v", frame, radar, CHAIN, words)
    vectors = read_vectors(tmp_path / "v")

    plan = make_lookup_tables(radar, CHAIN.fit_to_radar(radar), words)
    for block in stage_outputs(to_integer_samples_and_step(frame, radar, words)[0], radar, plan):
        assert np.array_equal(vectors.pop(block.name), block.integers), block.name
    for name, table in (
        ("range_weights", plan.range_window),
        ("doppler_weights", plan.doppler_window),
        ("range_twiddles", plan.range_twiddles),
        ("doppler_twiddles", plan.doppler_twiddles),
        ("logarithms", plan.logarithms),
        ("factors", plan.factors),
    ):
        assert np.array_equal(vectors.pop(name), table), name
    assert not vectors
    assert {path.name for path in (tmp_path / "v").iterdir()} == set(names) <= set(FILES)


def test_last_stages_equal_fixed_point_map(tmp_path, radar):
    radar = shrink_radar(radar, "complex")
    write_vectors(tmp_path / "v", simulate_frame(radar), radar, CHAIN)
    vectors, expected = (
        read_vectors(tmp_path / "v"),
        fixed_point_map(simulate_frame(radar), radar, CHAIN),
    )

    for name in ("power", "log_power", "threshold", "detected"):
        assert np.array_equal(vectors[name], expected[name].values)


def test_words_are_twos_complement_with_digits_for_their_bits(tmp_path, radar):
    radar = shrink_radar(radar, "complex")
    write_vectors(tmp_path / "v", simulate_frame(radar), radar, CHAIN, OVERFLOWING_WORDS)
    document = json.loads((tmp_path / "v" / "vectors.json").read_text())

    range_spectrum = read_vectors(tmp_path / "v")["range_fft"][0, 0, :, 1]
    lines = (tmp_path / "v" / "range_fft_q.hex").read_text().splitlines()
    assert range_spectrum.min() < 0
    assert lines[:64] == [f"{int(x) & 0x3FFFF:05x}" for x in range_spectrum]
    entry = next(vector for vector in document["vectors"] if vector["name"] == "range_fft")
    assert (entry["bits"], entry["shape"]) == (18, [16, 2, 64])
    assert sum(entry["overflows"]) > 0


def test_rejects_changed_or_missing_vectors(tmp_path, radar):
    radar = shrink_radar(radar, "complex")
    folder = tmp_path / "v"
    write_vectors(folder, simulate_frame(radar), radar, CHAIN)
    lines = (folder / "power.hex").read_text().splitlines(keepends=True)

    (folder / "power.hex").write_text("".join(["0" * 11 + "7\n", *lines[1:]]))
    with pytest.raises(RecordingError, match="SHA-256"):
        read_vectors(folder)
    (folder / "power.hex").write_text("xxxxxxxxxxxx\n" + "".join(lines[1:]))
    with pytest.raises(RecordingError, match=r"power.hex.*never written"):
        read_vectors(folder)
    (folder / "power.hex").unlink()
    with pytest.raises(RecordingError, match="No such file"):
        read_vectors(folder)
    entry = {"name": "power", "files": ["power.hex"], "sha256": [], "bits": 48, "signed": False}
    for entries in ([1], [{}], [entry], None):
        text = json.dumps({"format_version": 1, "vectors": entries})
        (folder / "vectors.json").write_text(text)
        with pytest.raises(RecordingError, match="folder of vectors"):
            read_vectors(folder)
    (folder / "vectors.json").write_text("[]")
    with pytest.raises(RecordingError, match="folder of vectors"):
        read_vectors(folder)
    (folder / "vectors.json").write_text('{"format_version": 9, "vectors": []}')
    with pytest.raises(RecordingError, match="version 9"):
        read_vectors(folder)


def test_reads_simulator_words_and_rejects_words_that_are_too_long(tmp_path):
    path = tmp_path / "out.hex"
    path.write_text("// 0x00000000\n7f\n80\nff\n")

    assert read_words(path, bits=8, signed=True).tolist() == [127, -128, -1]
    assert read_words(path, bits=8, signed=False).tolist() == [127, 128, 255]
    with pytest.raises(RecordingError, match="a word of 8 bits"):
        read_words(path, bits=7, signed=False)


def test_foreign_folder_is_not_overwritten(tmp_path, radar):
    radar = shrink_radar(radar, "complex")
    (tmp_path / "own.txt").write_text("mine")
    with pytest.raises(DechirpError, match=r"own\.txt"):
        write_vectors(tmp_path, simulate_frame(radar), radar, CHAIN)
    assert [path.name for path in tmp_path.iterdir()] == ["own.txt"]

    write_vectors(tmp_path / "v", simulate_frame(radar), radar, CHAIN)
    check_vector_folder_replaceable(tmp_path / "v")
    write_vectors(tmp_path / "v", simulate_frame(radar), radar, CHAIN)


def test_rejected_frame_leaves_no_folder(tmp_path, radar):
    with pytest.raises(dc.InvalidSetting, match="set n_range_bins to 64"):
        write_vectors(
            tmp_path / "v",
            simulate_frame(shrink_radar(radar, "complex")),
            shrink_radar(radar, "complex"),
        )
    assert not (tmp_path / "v").exists()
