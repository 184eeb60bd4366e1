"""`dechirp fixed-point`: from the call to vectors on disk."""

import json

import pytest

from dechirp.cli.main import main
from dechirp.results.hex_vectors import read_vectors

SMALL = ["--set", "radar.frame.n_chirps=32", "--set", "chain.n_range_bins=4096"]


def call(capsys, *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["fixed-point", *words])
    printed = capsys.readouterr()
    return int(ended.value.code or 0), printed.out, printed.err


def test_a_frame_gives_vectors_and_finds_what_floating_point_finds(tmp_path, capsys):
    out = tmp_path / "vectors"
    status, printed, _ = call(capsys, "--out", str(out), "--json", *SMALL)
    told = json.loads(printed)

    assert status == 0
    assert told["n_fixed"] == told["n_float"] > 0 and told["n_only_one"] == 0
    assert told["words"]["range_bits"] == 16 and not any(told["overflows"].values())
    vectors = read_vectors(out)
    assert int(vectors["detected"].sum()) == told["n_fixed"]
    assert set(told["files"]) == {path.name for path in out.iterdir()}


def test_word_lengths_come_from_a_file_and_overflows_are_told(tmp_path, capsys):
    words = tmp_path / "words.yaml"
    words.write_text("range_bits: 12\ndoppler_bits: 12\nscaling: none\n")
    status, printed, _ = call(capsys, "--words", str(words), "--out", str(tmp_path / "v"), *SMALL)
    assert status == 0 and "words saturated" in printed


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--frame", "3"], "--frame: 3; expected a frame from 0 to 0"),
        (["--frame", "3"], "n_frames says how many"),
        (["--set", "chain.cfar.estimator.kind=ordered-statistic"], "chain.cfar.estimator"),
        (["--set", "chain.n_range_bins=3000"], "set n_range_bins to 4096"),
        (["--words", "nowhere.yaml"], "nowhere.yaml: the file: not found"),
    ],
)
def test_what_cannot_be_is_said_and_nothing_is_written(tmp_path, capsys, words, says):
    status, _, told = call(capsys, "--out", str(tmp_path / "v"), *words)
    assert status == 2 and says in told and "Traceback" not in told
    assert not (tmp_path / "v").exists()
