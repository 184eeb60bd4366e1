"""Faults of messages that were found by reading them all, each with what it says now."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dechirp as dc
from bad_input.entries import called, must_say_all
from dechirp.cli.main import main
from dechirp.config.suggestions import CHOOSE_OR_OMIT, did_you_mean
from dechirp.core.errors import DechirpError
from dechirp.experiments.run import run_chain_findings
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.results.hex_vectors import read_vectors
from dechirp.results.object_lists.files import read_objects, write_objects
from sample_object_lists import random_object_list


def test_a_word_that_must_be_given_is_not_to_be_left_out(capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main(["completion", "perl"])
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert "one of bash, zsh, fish" in said and "leave it out" not in said
    assert did_you_mean("perl", ["bash"], CHOOSE_OR_OMIT) == "use one of these, or omit it"
    assert did_you_mean("perl", []) == "omit it"


def test_whole_numbers_with_a_point_are_whole_numbers_as_in_json():
    assert dc.reference(["seed=7.0"]).seed == 7
    assert dc.reference(["radar.frame.n_chirps=64.0"]).radar.frame.n_chirps == 64
    for text in ("7.5", "1e300", "'7'", "true"):
        with pytest.raises(DechirpError, match="expected a whole number"):
            dc.reference([f"seed={text}"])


def test_an_estimator_that_was_asked_for_is_not_left_out_in_silence():
    asked = dc.reference(["chain.angle={kind: fft}"])
    (told,) = (
        one for one in run_chain_findings(asked.chain, asked.radar) if one.setting == "chain.angle"
    )
    assert told.value == "fft, left out: this array resolves no directions"
    usual = dc.reference()
    assert not [
        one for one in run_chain_findings(usual.chain, usual.radar) if "angle" in one.setting
    ]


def test_a_list_of_nothing_is_told_from_a_file_of_no_log(tmp_path):
    for suffix in (".asc", ".blf", ".log"):
        file = tmp_path / f"nothing{suffix}"
        write_objects(random_object_list(0, 0), file)
        assert read_objects(file).sizes == {"object": 0, "cycle": 2}
    (tmp_path / "junk.asc").write_bytes(bytes(range(256)))
    with pytest.raises(dc.RecordingError, match="it has no readable frame"):
        read_objects(tmp_path / "junk.asc")


def test_a_table_without_its_columns_names_them(tmp_path):
    file = tmp_path / "objects.csv"
    write_objects(random_object_list(1), file)
    file.write_text(file.read_text().replace("x_m,", "x,", 1))
    with pytest.raises(dc.RecordingError, match="without columns x_m; expected"):
        read_objects(file)


def test_vectors_of_elsewhere_are_not_read(tmp_path):
    secret = tmp_path / "secret.hex"
    secret.write_text("0001\n")
    folder = tmp_path / "vectors"
    folder.mkdir()
    entry = {"name": "a", "bits": 16, "signed": True, "shape": [1], "sha256": ["0"]}
    for name in ("../secret.hex", str(secret), "/dev/zero"):
        about = {"format_version": 1, "vectors": [{**entry, "files": [name]}]}
        (folder / "vectors.json").write_text(json.dumps(about))
        with pytest.raises(dc.RecordingError, match="names of files beside it"):
            read_vectors(folder)


def test_a_search_tells_whose_setting_a_candidate_spoils(tmp_path):
    text = (Path(__file__).with_name("corpus") / "tune" / "good.yaml").read_text()
    wrong = text.replace(
        "chain.cfar.false_alarm_probability: {from: 1e-5, to: 1e-3, step: 1e-5}",
        "chain.cfar.n_training.range: [4, 6]",
    )
    (tmp_path / "tune.yaml").write_text(wrong)
    with pytest.raises(
        DechirpError,
        match=r"n_training.range: 4, with chain.cfar.n_training 25"
        r" velocity cells",
    ):
        dc.load_tune(tmp_path / "tune.yaml")


@pytest.mark.parametrize("host", ["a\x85b", "a" * 300, "\udcff"])
def test_a_host_that_is_no_name_is_refused(host, tmp_path):
    assert called(["studio", "--host", host], tmp_path) == 2
    with pytest.raises(DechirpError) as caught:
        dc.listen(f"{host}:4098", radar=dc.reference().radar)
    must_say_all(caught.value)


GUEST = """
from dechirp.processing.cfar.cell_averaging import CellAveraging as Own
from dechirp.processing.cfar.base import NoiseEstimator


class Heir(Own):
    pass


class Other(NoiseEstimator):
    @classmethod
    def kind(cls):
        return "ordered-statistic"


for name in NoiseEstimator.__abstractmethods__:
    setattr(Other, name, getattr(Own, name))
Other.__abstractmethods__ = frozenset()
"""


def test_a_guest_that_goes_by_the_kind_of_a_member_is_told_of_and_takes_no_place(tmp_path):
    (tmp_path / "intruder.py").write_text(GUEST)
    folder = tmp_path / "intruder-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: intruder\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[dechirp.cfar]\nsecond = intruder:Other\n")
    src = Path(dc.__file__).parent.parent
    code = (
        "from dechirp.processing.cfar.base import NoiseEstimator as F\n"
        "print(F.members()['ordered-statistic'].__module__)\n"
        "print(F.failed_plugins(), F.members()['cell-averaging'].__module__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(src)])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("dechirp.processing.cfar.ordered_statistic\n")
    assert done.stdout.endswith("dechirp.processing.cfar.cell_averaging\n")
    assert "intruder:Other has the kind ordered-statistic of dechirp.processing.cfar" in done.stdout


def test_a_calibration_names_the_key_that_was_meant(tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text('{"elements": [[0, 0]], "gian": [[1, 0]]}')
    with pytest.raises(DechirpError, match="gian: an unknown key.*did you mean gain"):
        read_calibration(file)
