"""`dechirp fixed-point`: vectors on disk, word lengths from a file, and errors."""

import json

import pytest

from dechirp.cli.main import main
from dechirp.results.hex_vectors import read_vectors
from nightly import nightly

SMALL_SETTINGS = ["--set", "radar.frame.n_chirps=32", "--set", "chain.n_range_bins=4096"]


def run_cli(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_info:
        main(["fixed-point", *arguments])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


@nightly
def test_fixed_point_frame_gives_vectors_and_floating_point_detections(tmp_path, capsys):
    out = tmp_path / "vectors"
    status, output, _ = run_cli(capsys, "--out", str(out), "--json", *SMALL_SETTINGS)
    document = json.loads(output)

    assert status == 0
    assert document["n_fixed"] == document["n_float"] > 0 and document["n_only_one"] == 0
    assert document["words"]["range_bits"] == 16 and not any(document["overflows"].values())
    vectors = read_vectors(out)
    assert int(vectors["detected"].sum()) == document["n_fixed"]
    assert set(document["files"]) == {path.name for path in out.iterdir()}


def test_words_option_reads_file_and_overflows_are_reported(tmp_path, capsys):
    words_file = tmp_path / "words.yaml"
    words_file.write_text("range_bits: 12\ndoppler_bits: 12\nscaling: none\n")
    status, output, _ = run_cli(
        capsys, "--words", str(words_file), "--out", str(tmp_path / "v"), *SMALL_SETTINGS
    )
    assert status == 0 and "words saturated" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frame", "3"], "--frame: 3; expected a frame from 0 to 0"),
        (["--frame", "3"], "n_frames is the number"),
        (["--set", "chain.cfar.estimator.kind=ordered-statistic"], "chain.cfar.estimator"),
        (["--set", "chain.n_range_bins=3000"], "set n_range_bins to 4096"),
        (["--words", "nowhere.yaml"], "nowhere.yaml: the file: not found"),
    ],
)
def test_rejects_invalid_options_and_writes_nothing(tmp_path, capsys, arguments, message):
    status, _, err = run_cli(capsys, "--out", str(tmp_path / "v"), *arguments)
    assert status == 2 and message in err and "Traceback" not in err
    assert not (tmp_path / "v").exists()
