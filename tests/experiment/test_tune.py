"""A search finds what is better, says by how much and how surely, and goes on where it stopped."""

import json
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.commands import tune as command
from dechirp.experiments.study import executors
from dechirp.experiments.study.block import Failure
from dechirp.experiments.study.executors import Workers
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.experiments.tune.document import tune_document
from dechirp.experiments.tune.parsing import load_tune
from dechirp.experiments.tune.run import TuneResult, run_search
from dechirp.report.tune import format_headline, format_verdict, render_tune_page
from printed import check_captions, check_pdf

RADAR = """\
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 30 us,
            sample_rate: 10 MHz, n_samples: 64, sampling: complex}
    n_chirps: 32
    interval: 35 us
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
"""

# Two training cells, where the map has room for hundreds: 9 dB are lost at 1e-3.
CHAIN = """\
chain:
  range_window: rectangular
  doppler_window: rectangular
  cfar: {estimator: {kind: cell-averaging}, n_training: {range: 0, velocity: 1},
         n_guard: {range: 1, velocity: 1}, false_alarm_probability: 1e-3}
"""

SCENARIO = f"""\
name: weak
radar:
{RADAR}
scene:
  targets:
    - {{name: car, position: [30 m, 0 m, 0 m], velocity: [5 m/s, 0 m/s, 0 m/s], rcs: 1 dBsm}}
impairments: [{{kind: white-noise, snr: -21 dB, target: car}}]
{CHAIN}"""

TUNE = """\
scenarios: [weak.yaml]
seed: 3
search:
  chain.cfar.n_training.range: {from: 0, to: 9, step: 1}
  chain.cfar.n_training.velocity: {from: 1, to: 6, step: 1}
  chain.cfar.false_alarm_probability: {from: 1e-4, to: 1e-2, n: 5, spacing: log}
objective: {maximise: detection_probability, at_most: {false_alarm_probability: 1e-3}}
trials: 40
confirmation_trials: 80
candidates: 12
"""


class Here(Executor):
    """Does what it is given at once; stops the whole search after so many blocks."""

    def __init__(self, at_most: int | None = None) -> None:
        self.done, self.at_most = 0, at_most

    def submit(self, fn, /, *args, **kwargs):
        if self.done == self.at_most:
            raise KeyboardInterrupt
        self.done += 1
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def here(at_most: int | None = None) -> Workers:
    return Workers(Here(at_most), lambda: 1)


def written(folder: Path, text: str = TUNE, scenario: str = SCENARIO) -> Path:
    (folder / "weak.yaml").write_text(scenario)
    (folder / "tune.yaml").write_text(text)
    return folder / "tune.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("tune")


@pytest.fixture(scope="module")
def tuned(folder) -> TuneResult:
    return run_search(load_tune(written(folder)), folder / "out", workers=here())


def test_the_search_finds_the_training_cells_that_were_left_out(tuned):
    best = dict(tuned.candidates[tuned.best.number].settings)
    case = build_trial_context(tuned.scenarios[0])

    assert (
        len(case.chain.cfar.training_window.offsets(case.chain.cfar.training_window.half_range))
        > 12
    )
    assert float(best["chain.cfar.false_alarm_probability"]) <= 2e-3
    assert tuned.gain.certainty > 1 - 1e-6


def is_near_theory(tuned: TuneResult, before: dc.Scenario, after: dc.Scenario) -> bool:
    """Five standard errors: the interval has at least 1.96 of them on each side."""
    score = tuned.tune.objective.score
    gain = (
        score.theory(build_trial_context(after)).item()
        - score.theory(build_trial_context(before)).item()
    )
    return abs(gain - tuned.gain.value) < 2.5 * (tuned.gain.high - tuned.gain.low) / 2 + 0.02


def test_the_gain_in_fresh_trials_is_what_theory_says(tuned):
    assert is_near_theory(tuned, tuned.tune.scenarios[0], tuned.scenarios[0])
    before, after = (
        one.scores["detection_probability"].value for one in (tuned.default, tuned.best)
    )
    assert tuned.gain.value == pytest.approx(after - before)


def test_settings_beyond_the_limit_are_not_taken_however_much_they_detect(tuned):
    beyond = [one for one in tuned.candidates if not one.is_admitted]

    assert beyond
    for one in beyond:
        assert one.scores["false_alarm_probability"].low > 1e-3
    assert tuned.best.decisions != ("not met",)
    assert tuned.best.scores["false_alarm_probability"].low <= 1e-3


def test_a_search_that_was_stopped_goes_on_to_the_same_result(folder, tuned, tmp_path):
    fewer = load_tune(written(tmp_path, TUNE.replace("candidates: 12", "candidates: 5")))
    for blocks in (1, 3):
        with pytest.raises(KeyboardInterrupt):
            run_search(fewer, tmp_path / "out", workers=here(at_most=blocks))
    run_search(fewer, tmp_path / "out", workers=here())
    asked = load_tune(folder / "tune.yaml")
    with pytest.raises(KeyboardInterrupt):
        run_search(
            asked, tmp_path / "out", workers=here(at_most=6)
        )  # 11 of 12, learnt from the past
    again = run_search(asked, tmp_path / "out", workers=here())

    assert tune_document(again) == tune_document(tuned)
    nothing_left = run_search(asked, tmp_path / "out", workers=here(at_most=0))
    assert tune_document(nothing_left) == tune_document(tuned)


def test_settings_whose_workers_died_leave_the_trials_of_others_theirs(folder, tuned, tmp_path):
    asked = load_tune(folder / "tune.yaml")

    class Dies(Here):
        def submit(self, fn, /, *args, **kwargs):
            if args[0].chain == tuned.scenarios[0].chain:
                raise BrokenExecutor
            return super().submit(fn, *args, **kwargs)

    without = run_search(asked, tmp_path / "out", workers=Workers(Dies(), lambda: 1))
    (failed,) = [one for one in without.candidates if one.failure]
    assert failed.number == tuned.best.number and "dead, 1 time" in failed.failure
    # The last is chosen by what the others came to: another one, in a record that has both.
    assert without.candidates[-1].scores != tuned.candidates[-1].scores
    assert tune_document(run_search(asked, tmp_path / "out", workers=here())) == tune_document(
        tuned
    )


def test_settings_that_fail_in_fresh_trials_are_not_taken(tmp_path):
    text = TUNE.replace("candidates: 12", "candidates: 4").replace("confirmation_trials: 80", "")
    asked = load_tune(written(tmp_path, text + "confirmation_trials: 4\n"))

    class FailsLater(Here):
        def submit(self, fn, /, *args, **kwargs):
            future = super().submit(fn, *args, **kwargs)
            if kwargs["trials"].start < asked.trials or args[0] == asked.scenarios[0]:
                return future
            failure = Failure(kwargs["trials"].start, "ValueError: singular")
            failing: Future = Future()
            failing.set_result(replace(future.result(), failures=(failure,)))
            return failing

    found = run_search(asked, tmp_path / "out", workers=Workers(FailsLater(), lambda: 1))

    assert found.best.number == 0  # as they are: all that is left within the limit
    assert not any(one.failure for one in found.candidates)
    (told,) = [one for one in found.findings if one.setting.startswith("candidate")]
    assert "ValueError: singular" in told.value
    assert tune_document(
        run_search(asked, tmp_path / "out", workers=here(at_most=0))
    ) == tune_document(found)


def test_another_search_in_the_same_folder_is_refused(folder, tuned, tmp_path):
    for old, new in (("trials: 40", "trials: 41"), ("to: 9", "to: 8"), ("1e-3}}", "2e-3}}")):
        asked = load_tune(written(tmp_path, TUNE.replace(old, new)))
        with pytest.raises(dc.DechirpError, match=r"as in the existing results.*--out"):
            run_search(asked, folder / "out", workers=here())
    changed = load_tune(written(tmp_path), ["scene.targets.car.rcs=2 dBsm"])
    with pytest.raises(dc.DechirpError, match="source weak"):
        run_search(changed, folder / "out", workers=here())


def test_the_page_shows_the_gain_and_asks_for_nothing_else(tuned):
    found = {"version": "1", **tune_document(tuned)}
    page = render_tune_page(found, yaml="name: weak")

    assert format_headline(found).startswith("Detection probability: 0.")
    assert "certainty" in format_verdict(found) and format_verdict(found) in page
    assert page.count("<svg") == 1 and "chain.cfar.n_training.range=" in page
    assert not any(word in page for word in ("http://", "https://", "src=", "@import"))
    check_captions(page)
    check_pdf(page)


@contextmanager
def _here(n_workers: int | None = None):
    yield here()


def test_the_command_writes_what_can_be_taken_over(folder, tuned, monkeypatch, capsys):
    monkeypatch.setattr(executors, "local_workers", _here)
    status = command.tune(folder / "tune.yaml", out=folder / "out", as_json=True, quiet=True)
    told = json.loads(capsys.readouterr().out)

    assert status == 0
    assert told["best"]["settings"] == dict(tuned.candidates[tuned.best.number].settings)
    assert len(told["candidates"]) == 13 and told["candidates"][0]["settings"] == {}
    assert told["gain"]["low"] > 0
    assert all((folder / "out" / name).is_file() for name in told["files"])
    best = dc.load(folder / "out" / "best.yaml")
    assert best == tuned.scenarios[0]
    overrides = [f"{path}={text}" for path, text in told["best"]["settings"].items()]
    assert dc.load(folder / "weak.yaml", overrides).chain == best.chain


def test_the_answer_is_no_where_nothing_keeps_the_limits(tmp_path, monkeypatch, capsys):
    text = TUNE.replace(
        "at_most: {false", "at_least: {detection_probability: 0.9999}, at_most: {false"
    )
    text = text.replace("candidates: 12", "candidates: 3")
    monkeypatch.setattr(executors, "local_workers", _here)
    status = command.tune(written(tmp_path, text), out=tmp_path / "out")
    said = capsys.readouterr().out

    assert status == 1
    assert "violate a limit" in said and "--set" not in said
    told = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert told["best"] is None and told["gain"] is None
    assert not (tmp_path / "out" / "best.yaml").exists()
    assert "No settings meet the limits" in (tmp_path / "out" / "report.html").read_text()


def test_settings_that_cannot_be_together_are_told_and_left(tmp_path):
    text = """\
scenarios: [weak.yaml]
search:
  chain.cfar.n_training.range: [2, 28]
  chain.cfar.n_guard.range: [1, 25]
objective: {maximise: detection_probability}
trials: 4
confirmation_trials: 4
"""
    found = run_search(load_tune(written(tmp_path, text)), tmp_path / "out", workers=here())
    wrong = [one for one in found.candidates if one.failure]

    assert len(found.candidates) == 5  # all four, and the settings as they are
    assert [dict(one.settings)["chain.cfar.n_guard.range"] for one in wrong] == ["25"]
    assert "chain.cfar" in wrong[0].failure
    assert "Traceback" not in render_tune_page({"version": "1", **tune_document(found)}, yaml="")


def test_a_limit_finer_than_the_trials_can_tell_is_warned_of(tmp_path):
    text = TUNE.replace("probability: 1e-3}", "probability: 1e-6}").replace("es: 12", "es: 1")
    scenario = SCENARIO.replace("false_alarm_probability: 1e-3", "false_alarm_probability: 1e-6")
    found = run_search(
        load_tune(written(tmp_path, text, scenario)), tmp_path / "out", workers=here()
    )

    [finding] = found.findings
    assert finding.level == "warning" and finding.setting == "trials"
    # 40 maps of 2,048 cells: 0.08 false alarms are expected at 1e-6.
    assert "give trials" in str(finding) and "1e-06" in finding.expected


def recorded(folder: Path) -> Path:
    """A recording of the scene, and what was there."""
    scenario = dc.load(written(folder).parent / "weak.yaml")
    cube = dc.simulate(
        scenario.scene, scenario.radar, impairments=scenario.impairments, n_frames=60, seed=4
    )
    largest = float(abs(cube.values).max())
    np.save(folder / "capture.npy", (cube.values / largest).astype(np.complex64))
    (folder / "recorded.yaml").write_text(
        "name: car-park\n"
        "recording: {path: capture.npy, axes: [frame, chirp, rx, sample], encoding: full-scale}\n"
        f"radar:\n{RADAR}\n{CHAIN}"
    )
    text = TUNE.replace("candidates: 12", "candidates: 4").replace(
        "scenarios: [weak.yaml]",
        "recordings:\n"
        "  - scenario: recorded.yaml\n"
        "    truth: {targets: [{name: car, position: [30 m, 0 m, 0 m], velocity: [5 m/s, 0, 0],"
        " rcs: 0 dBsm}]}\n"
        "    empty_range: [40 m, 70 m]",
    )
    (folder / "tune.yaml").write_text(text)
    return folder / "tune.yaml"


def test_a_recording_is_searched_on_one_half_and_confirmed_on_the_other(tmp_path):
    found = run_search(load_tune(recorded(tmp_path)), tmp_path / "out", workers=here())

    assert found.n_trials == (30, 30)
    before = dc.load(tmp_path / "weak.yaml")
    assert is_near_theory(found, before, replace(before, chain=found.scenarios[0].chain))
    assert found.gain.certainty > 0.9
    # Beside the car, of 30 frames of 32 velocities: as many alarms as the design says.
    rate = found.default.scores["false_alarm_probability"]
    assert 0 < rate.value < 3e-3


def test_a_recording_without_an_empty_part_tells_no_false_alarms(tmp_path):
    path = recorded(tmp_path)
    path.write_text(path.read_text().replace("    empty_range: [40 m, 70 m]", ""))
    with pytest.raises(dc.DechirpError, match=r"empty_range.*give empty_range"):
        run_search(load_tune(path), tmp_path / "out", workers=here())


@pytest.mark.parametrize(
    ("score", "said"), [("roc", "a map of noise"), ("track_completeness", "tracks")]
)
def test_scores_that_a_recording_cannot_tell_are_refused(tmp_path, score, said):
    path = recorded(tmp_path)
    path.write_text(
        path.read_text().replace("maximise: detection_probability", f"maximise: {score}")
    )
    with pytest.raises(dc.DechirpError, match=rf"objective: {score}, .*{said}.*or scenarios"):
        run_search(load_tune(path), tmp_path / "out", workers=here())


WRONG = {
    ("n_training.range:", "n_trainig.range:"): ("search.chain.cfar.n_trainig", "n_training?"),
    ("from: 0, to: 9", "from: 9, to: 0"): ("search.chain.cfar.n_training.range", "below to"),
    (
        "step: 1}\n  chain.cfar.n_training.v",
        "step: 1}\n  radar.frame.n_chirps: [16, 32]\n  chain.cfar.n_training.v",
    ): (
        "search.radar.frame.n_chirps",
        "in one of chain, ego_motion, tracker",
    ),
    ("{from: 0, to: 9, step: 1}", "{uniform: [0, 9]}"): ("n_training.range", "a list or a range"),
    ("{from: 0, to: 9, step: 1}", "{from: 0, to: 40, step: 1}"): (
        "n_training.range: 31, with chain.cfar.n_training 65 range cells",
        "the range cells of the map",
    ),
    ("maximise: detection_p", "maximise: detecton_p"): (
        "objective.maximise",
        "detection_probability?",
    ),
    ("maximise: detection_probability,", ""): ("objective", "one of them"),
    ("{false_alarm_probability: 1e-3}", "{false_alarm_probability: 3 m}"): (
        "objective.at_most.false_alarm_probability",
        "bare number",
    ),
    ("[weak.yaml]", "[strong.yaml]"): ("strong.yaml", "not found"),
    ("[weak.yaml]", "weak.yaml"): ("scenarios", "in brackets"),
    ("[weak.yaml]", "[{recording: {path: a.npy}}]"): ("scenarios", "under recordings"),
    ("_probability: 1e-3}", "_probability: 3}"): (
        "objective.at_most.false_alarm",
        "between 0 and 1",
    ),
    ("trials: 40", "trials: 1"): ("trials", "from 2"),
    ("candidates: 12", "candidate: 12"): ("candidate", "candidates?"),
    ("objective: {", "# {"): ("objective", "absent"),
    ("maximise: detection_probability", "maximise: processing_time"): (
        "objective.maximise",
        "the same trial",
    ),
    ("maximise: detection_probability", "maximise: range_rmse"): (
        "objective.maximise",
        "minimise: range_rmse",
    ),
    ("maximise: detection_probability", "minimise: range_bias"): (
        "objective.minimise",
        "set limits to it",
    ),
}


@pytest.mark.parametrize(("old", "new"), WRONG)
def test_a_wrong_file_is_refused_with_the_place_and_the_cure(tmp_path, old, new):
    path = written(tmp_path, TUNE.replace(old, new, 1))
    where, cure = WRONG[old, new]
    with pytest.raises(dc.InvalidFile) as error:
        load_tune(path)
    text = str(error.value)

    assert where in text and cure in text and ".yaml" in text


def test_without_optuna_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    with pytest.raises(dc.DechirpError, match=r"pip install 'dechirp\[tune\]'"):
        run_search(load_tune(written(tmp_path)), tmp_path / "out", workers=here())
    assert not (tmp_path / "out").exists()


def test_a_folder_of_somebody_else_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("do not lose")
    with pytest.raises(dc.DechirpError, match=r"--out: .*mine, a folder with thesis.txt; expected"):
        command.tune(written(tmp_path), out=tmp_path / "mine")
