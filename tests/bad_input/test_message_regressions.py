"""Regression tests of error messages and findings that were wrong or unclear."""

import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numpy.typing import ArrayLike

import dechirp as dc
from bad_input.entries import check_error_is_complete, run_command
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix
from dechirp.experiments.run import fitted_chain_findings
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.results.hex_vectors import read_vectors
from dechirp.results.object_lists.files import read_objects, write_objects
from sample_object_lists import random_object_list


def test_fix_for_required_argument_does_not_suggest_omission(capsys, tmp_path):
    with pytest.raises(SystemExit) as system_exit:
        main(["completion", "perl"])
    message = capsys.readouterr().err
    assert system_exit.value.code == 2
    assert "one of bash, zsh, fish" in message and "leave it out" not in message
    assert did_you_mean_fix("perl", ["bash"], CHOOSE_OR_OMIT) == "use one of these, or omit it"
    assert did_you_mean_fix("perl", []) == "omit it"


@pytest.mark.parametrize(
    ("call", "wrong", "suggested"),
    [
        (lambda: dc.theory.detection_probability(10.0, pfa=1e-6), "pfa", "false_alarm_probability"),
        (
            lambda: dc.theory.required_snr(pd=0.9, false_alarm_probability=1e-6),
            "pd",
            "detection_probability",
        ),
        (lambda: dc.theory.cell_averaging_factor(pfa=1e-6), "pfa", "false_alarm_probability"),
        (
            lambda: dc.link_budget.unambiguous_range(sr=1e6, slope_hz_per_s=1e13),
            "sr",
            "sample_rate_hz",
        ),
        (
            lambda: dc.cfar.cfar_threshold([[1.0]], false_alarm_probability=1e-6),
            "false_alarm_probability",
            "pfa",
        ),
    ],
)
def test_abbreviation_of_an_argument_suggests_its_name(call, wrong, suggested):
    with pytest.raises(dc.InvalidSetting, match=rf"\.{wrong}: .* did you mean {suggested}\?"):
        call()


def test_class_in_place_of_its_instance_is_named():
    with pytest.raises(dc.InvalidSetting) as error:
        dc.cfar.cfar_threshold([[1.0]], 1, 0, 1e-3, dc.cfar.OrderedStatistic)
    message = "kind: the class OrderedStatistic; expected str or NoiseEstimator; write"
    assert str(error.value).replace("\n", " ").startswith(message + " OrderedStatistic(...)")


def test_misspelt_criterion_for_the_number_of_sources_is_answered_with_its_names():
    with pytest.raises(dc.InvalidSetting, match=r"n_sources: 'mdll'; expected .* mdl or aic"):
        dc.angle.music([[1.0, 1.0, 1.0]], [0.0, 0.5, 1.0], "mdll")


def test_rate_of_a_single_count_asks_for_blocks():
    with pytest.raises(dc.InvalidSetting, match="counts: .* two or more blocks of equal exposure"):
        dc.theory.rate_interval(3, 1e6, confidence=0.9)


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        ("theory.binomial_interval", ("hits", "trials", "confidence")),
        ("theory.cell_averaging_factor", ("false_alarm_probability", "n_training", "n_summed")),
        ("theory.gate_threshold", ("gate_probability", "n_dimensions")),
        ("link_budget.ula_beamwidth", ("n_elements", "spacing", "angle_rad")),
    ],
)
def test_signatures_show_that_arrays_are_accepted(function, arguments):
    namespace, name = function.split(".")
    parameters = inspect.signature(getattr(getattr(dc, namespace), name)).parameters

    for argument in arguments:
        assert parameters[argument].annotation in ("ArrayLike", ArrayLike)


def test_integral_floats_are_accepted_as_integers():
    assert dc.reference(["seed=7.0"]).seed == 7
    assert dc.reference(["radar.frame.n_chirps=64.0"]).radar.frame.n_chirps == 64
    for text in ("7.5", "1e300", "'7'", "true"):
        with pytest.raises(DechirpError, match="expected a whole number"):
            dc.reference([f"seed={text}"])


def test_omitted_angle_estimator_gives_finding():
    scenario = dc.reference(["chain.angle={kind: fft}"])
    (angle_finding,) = (
        finding
        for finding in fitted_chain_findings(scenario.chain, scenario.radar)
        if finding.setting == "chain.angle"
    )
    assert angle_finding.value == "fft, left out: this array resolves no directions"
    default_scenario = dc.reference()
    assert not [
        finding
        for finding in fitted_chain_findings(default_scenario.chain, default_scenario.radar)
        if "angle" in finding.setting
    ]


def test_empty_object_list_differs_from_invalid_log(tmp_path):
    for suffix in (".asc", ".blf", ".log"):
        file = tmp_path / f"nothing{suffix}"
        write_objects(random_object_list(0, 0), file)
        assert read_objects(file).sizes == {"object": 0, "cycle": 2}
    (tmp_path / "junk.asc").write_bytes(bytes(range(256)))
    with pytest.raises(dc.RecordingError, match="it has no readable frame"):
        read_objects(tmp_path / "junk.asc")


def test_missing_columns_are_named_in_error(tmp_path):
    file = tmp_path / "objects.csv"
    write_objects(random_object_list(1), file)
    file.write_text(file.read_text().replace("x_m,", "x,", 1))
    with pytest.raises(dc.RecordingError, match="without columns x_m; expected"):
        read_objects(file)


def test_rejects_vector_files_outside_folder(tmp_path):
    secret = tmp_path / "secret.hex"
    secret.write_text("0001\n")
    folder = tmp_path / "vectors"
    folder.mkdir()
    entry = {"name": "a", "bits": 16, "signed": True, "shape": [1], "sha256": ["0"]}
    for name in ("../secret.hex", str(secret), "/dev/zero"):
        description = {"format_version": 1, "vectors": [{**entry, "files": [name]}]}
        (folder / "vectors.json").write_text(json.dumps(description))
        with pytest.raises(dc.RecordingError, match="names of files in the same folder"):
            read_vectors(folder)


def test_infeasible_tune_candidate_is_named_in_error(tmp_path):
    text = (Path(__file__).with_name("corpus") / "tune" / "good.yaml").read_text()
    infeasible_text = text.replace(
        "chain.cfar.false_alarm_probability: {from: 1e-5, to: 1e-3, step: 1e-5}",
        "chain.cfar.n_training.range: [4, 6]",
    )
    (tmp_path / "tune.yaml").write_text(infeasible_text)
    with pytest.raises(
        DechirpError,
        match=r"n_training.range: 4, with chain.cfar.n_training 25"
        r" velocity cells",
    ):
        dc.load_tune(tmp_path / "tune.yaml")


@pytest.mark.parametrize("host", ["a\x85b", "a" * 300, "\udcff"])
def test_rejects_invalid_host_name(host, tmp_path):
    assert run_command(["studio", "--host", host], tmp_path) == 2
    with pytest.raises(DechirpError) as caught:
        dc.listen(f"{host}:4098", radar=dc.reference().radar)
    check_error_is_complete(caught.value)


PLUGIN_SOURCE = """
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


def test_plugin_with_kind_of_member_is_reported_and_ignored(tmp_path):
    (tmp_path / "intruder.py").write_text(PLUGIN_SOURCE)
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
    process = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(src)])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout.startswith("dechirp.processing.cfar.ordered_statistic\n")
    assert process.stdout.endswith("dechirp.processing.cfar.cell_averaging\n")
    assert (
        "intruder:Other has the kind ordered-statistic of dechirp.processing.cfar" in process.stdout
    )


def test_misspelt_calibration_key_gets_suggestion(tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text('{"elements": [[0, 0]], "gian": [[1, 0]]}')
    with pytest.raises(DechirpError, match="gian: an unknown key.*did you mean gain"):
        read_calibration(file)


@pytest.mark.parametrize(
    ("window", "fix"),
    [
        ("boxcar", "write rectangular, which has the same weights"),
        ("blackmanharris", "write blackman-harris, which has the same weights"),
        ("hanning", r"did you mean hann\?"),
        (("kaiser", 14.0), r"did you mean kaiser-6\?"),
        ("flattop", "choose one of them; only functions on plain arrays accept this window"),
        (None, "choose one of them"),
    ],
)
def test_window_of_scipy_in_settings_is_answered_with_the_name_of_its_weights(window, fix):
    with pytest.raises(dc.InvalidSetting, match=rf"^Chain\.range_window: .*; {fix}$"):
        dc.Chain(range_window=window)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("radar", r"settings of a radar: frame; .* radar: radar\.yaml$"),
        ("crossing-tracks", r"a trial of the tracker .*; run it: python benchmarks/tracks\.py"),
        ("tune", r"a search for settings; expected a scenario; run it: dechirp tune .*\.yaml$"),
        ("studies/data-set", r"a study; expected a scenario; run it: dechirp study .*\.yaml$"),
    ],
)
def test_file_of_another_kind_in_place_of_scenario_is_explained(name, message):
    file = Path(dc.__file__).parents[2] / "examples" / f"{name}.yaml"
    with pytest.raises(dc.InvalidFile, match=message) as caught:
        dc.load(file)
    assert len(caught.value.mistakes) == 1
