"""Tuning: search, gain in confirmation trials, continuation, refusals and report."""

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
from dechirp.experiments.tune.document import tune_result_as_dict
from dechirp.experiments.tune.parsing import load_tune
from dechirp.experiments.tune.run import TuneResult, run_search
from dechirp.report.tune import describe_improvement_and_limits, format_headline, render_tune_page
from nightly import NIGHTLY, nightly, nightly_except
from page_checks import check_captions, check_pdf_contains_page_text

RADAR = """\
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 30 us,
            sample_rate: 10 MHz, n_samples: 64, sampling: complex}
    n_chirps: 32
    interval: 35 us
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
"""

# Two training cells, where the map has space for hundreds, cost 9 dB at 1e-3.
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


class ImmediateExecutor(Executor):
    """Executor that runs tasks immediately and interrupts the search after `at_most` blocks."""

    def __init__(self, at_most: int | None = None) -> None:
        self.done, self.at_most = 0, at_most

    def submit(self, fn, /, *args, **kwargs):
        if self.done == self.at_most:
            raise KeyboardInterrupt
        self.done += 1
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def immediate_workers(at_most: int | None = None) -> Workers:
    return Workers(ImmediateExecutor(at_most), lambda: 1)


def write_tune_file(folder: Path, text: str = TUNE, scenario: str = SCENARIO) -> Path:
    (folder / "weak.yaml").write_text(scenario)
    (folder / "tune.yaml").write_text(text)
    return folder / "tune.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("tune")


@pytest.fixture(scope="module")
def reference_result(folder) -> TuneResult:
    return run_search(
        load_tune(write_tune_file(folder)), folder / "out", workers=immediate_workers()
    )


@nightly
def test_search_adds_missing_training_cells(reference_result):
    best = dict(reference_result.candidates[reference_result.best.number].settings)
    context = build_trial_context(reference_result.scenarios[0])

    assert (
        len(
            context.chain.cfar.training_window.training_cell_offsets(
                context.chain.cfar.training_window.half_range
            )
        )
        > 12
    )
    assert float(best["chain.cfar.false_alarm_probability"]) <= 2e-3
    assert reference_result.gain.certainty > 1 - 1e-6


def is_near_theory(
    reference_result: TuneResult, default_scenario: dc.Scenario, best_scenario: dc.Scenario
) -> bool:
    """Compare the gain with theory within five standard errors (the interval has 1.96 per side)."""
    score = reference_result.tune.objective.score
    gain = (
        score.theoretical_values(build_trial_context(best_scenario)).item()
        - score.theoretical_values(build_trial_context(default_scenario)).item()
    )
    return (
        abs(gain - reference_result.gain.value)
        < 2.5 * (reference_result.gain.high - reference_result.gain.low) / 2 + 0.02
    )


@nightly
def test_gain_in_confirmation_trials_matches_theory(reference_result):
    assert is_near_theory(
        reference_result, reference_result.tune.scenarios[0], reference_result.scenarios[0]
    )
    default_score, best_score = (
        candidate.scores["detection_probability"].value
        for candidate in (reference_result.default, reference_result.best)
    )
    assert reference_result.gain.value == pytest.approx(best_score - default_score)


@nightly
def test_settings_beyond_limit_are_not_chosen(reference_result):
    rejected_candidates = [
        candidate for candidate in reference_result.candidates if not candidate.is_admitted
    ]

    assert rejected_candidates
    for candidate in rejected_candidates:
        assert candidate.scores["false_alarm_probability"].low > 1e-3
    assert reference_result.best.decisions != ("not met",)
    assert reference_result.best.scores["false_alarm_probability"].low <= 1e-3


@nightly
def test_stopped_search_continues_to_same_result(folder, reference_result, tmp_path):
    short_tune = load_tune(
        write_tune_file(tmp_path, TUNE.replace("candidates: 12", "candidates: 5"))
    )
    for blocks in (1, 3):
        with pytest.raises(KeyboardInterrupt):
            run_search(short_tune, tmp_path / "out", workers=immediate_workers(at_most=blocks))
    run_search(short_tune, tmp_path / "out", workers=immediate_workers())
    tune = load_tune(folder / "tune.yaml")
    with pytest.raises(KeyboardInterrupt):
        # 11 of 12, the earlier candidates restored.
        run_search(tune, tmp_path / "out", workers=immediate_workers(at_most=6))
    continued_result = run_search(tune, tmp_path / "out", workers=immediate_workers())

    assert tune_result_as_dict(continued_result) == tune_result_as_dict(reference_result)
    repeated_result = run_search(tune, tmp_path / "out", workers=immediate_workers(at_most=0))
    assert tune_result_as_dict(repeated_result) == tune_result_as_dict(reference_result)


@nightly
def test_candidate_whose_workers_died_does_not_change_other_trials(
    folder, reference_result, tmp_path
):
    tune = load_tune(folder / "tune.yaml")

    class DyingExecutor(ImmediateExecutor):
        def submit(self, fn, /, *args, **kwargs):
            if args[0].chain == reference_result.scenarios[0].chain:
                raise BrokenExecutor
            return super().submit(fn, *args, **kwargs)

    partial_result = run_search(tune, tmp_path / "out", workers=Workers(DyingExecutor(), lambda: 1))
    (failed_candidate,) = [
        candidate for candidate in partial_result.candidates if candidate.failure
    ]
    assert (
        failed_candidate.number == reference_result.best.number
        and "dead, 1 time" in failed_candidate.failure
    )
    # The last candidate depends on the scores of the others, so it differs; the record has both.
    assert partial_result.candidates[-1].scores != reference_result.candidates[-1].scores
    assert tune_result_as_dict(
        run_search(tune, tmp_path / "out", workers=immediate_workers())
    ) == tune_result_as_dict(reference_result)


@nightly
def test_settings_that_fail_in_confirmation_trials_are_not_chosen(tmp_path):
    text = TUNE.replace("candidates: 12", "candidates: 4").replace("confirmation_trials: 80", "")
    tune = load_tune(write_tune_file(tmp_path, text + "confirmation_trials: 4\n"))

    class LateFailingExecutor(ImmediateExecutor):
        def submit(self, fn, /, *args, **kwargs):
            future = super().submit(fn, *args, **kwargs)
            if kwargs["trials"].start < tune.trials or args[0] == tune.scenarios[0]:
                return future
            failure = Failure(kwargs["trials"].start, "ValueError: singular")
            failing: Future = Future()
            failing.set_result(replace(future.result(), failures=(failure,)))
            return failing

    tune_result = run_search(
        tune, tmp_path / "out", workers=Workers(LateFailingExecutor(), lambda: 1)
    )

    assert tune_result.best.number == 0  # the unchanged settings alone are within the limit
    assert not any(entry.failure for entry in tune_result.candidates)
    (finding,) = [entry for entry in tune_result.findings if entry.setting.startswith("candidate")]
    assert "ValueError: singular" in finding.value
    assert tune_result_as_dict(
        run_search(tune, tmp_path / "out", workers=immediate_workers(at_most=0))
    ) == tune_result_as_dict(tune_result)


def test_different_search_in_same_folder_is_refused(folder, reference_result, tmp_path):
    for old, new in (("trials: 40", "trials: 41"), ("to: 9", "to: 8"), ("1e-3}}", "2e-3}}")):
        tune = load_tune(write_tune_file(tmp_path, TUNE.replace(old, new)))
        with pytest.raises(dc.DechirpError, match=r"as in the existing results.*--out"):
            run_search(tune, folder / "out", workers=immediate_workers())
    changed = load_tune(write_tune_file(tmp_path), ["scene.targets.car.rcs=2 dBsm"])
    with pytest.raises(dc.DechirpError, match="source weak"):
        run_search(changed, folder / "out", workers=immediate_workers())


def test_page_shows_gain_and_is_self_contained(reference_result):
    document = {"version": "1", **tune_result_as_dict(reference_result)}
    page = render_tune_page(document, yaml="name: weak")

    assert format_headline(document).startswith("Detection probability: 0.")
    assert (
        "certainty" in describe_improvement_and_limits(document)
        and describe_improvement_and_limits(document) in page
    )
    assert page.count("<svg") == 1 and "chain.cfar.n_training.range=" in page
    assert not any(word in page for word in ("http://", "https://", "src=", "@import"))
    check_captions(page)
    if NIGHTLY:
        check_pdf_contains_page_text(page)


@contextmanager
def _immediate_local_workers(n_workers: int | None = None):
    yield immediate_workers()


def test_command_writes_best_settings_and_scenario(folder, reference_result, monkeypatch, capsys):
    monkeypatch.setattr(executors, "local_workers", _immediate_local_workers)
    status = command.tune(folder / "tune.yaml", out=folder / "out", as_json=True, quiet=True)
    document = json.loads(capsys.readouterr().out)

    assert status == 0
    assert document["best"]["settings"] == dict(
        reference_result.candidates[reference_result.best.number].settings
    )
    assert len(document["candidates"]) == 13 and document["candidates"][0]["settings"] == {}
    assert document["gain"]["low"] > 0
    assert all((folder / "out" / name).is_file() for name in document["files"])
    best = dc.load(folder / "out" / "best.yaml")
    assert best == reference_result.scenarios[0]
    overrides = [f"{path}={text}" for path, text in document["best"]["settings"].items()]
    assert dc.load(folder / "weak.yaml", overrides).chain == best.chain


@nightly
def test_search_without_admitted_candidate_exits_with_status_1(tmp_path, monkeypatch, capsys):
    text = TUNE.replace(
        "at_most: {false", "at_least: {detection_probability: 0.9999}, at_most: {false"
    )
    text = text.replace("candidates: 12", "candidates: 3")
    monkeypatch.setattr(executors, "local_workers", _immediate_local_workers)
    status = command.tune(write_tune_file(tmp_path, text), out=tmp_path / "out")
    output = capsys.readouterr().out

    assert status == 1
    assert "violate a limit" in output and "--set" not in output
    document = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert document["best"] is None and document["gain"] is None
    assert not (tmp_path / "out" / "best.yaml").exists()
    assert "No settings meet the limits" in (tmp_path / "out" / "report.html").read_text()


def test_incompatible_settings_are_reported_and_skipped(tmp_path):
    text = """\
scenarios: [weak.yaml]
search:
  chain.cfar.n_training.range: [2, 28]
  chain.cfar.n_guard.range: [1, 25]
objective: {maximise: detection_probability}
trials: 4
confirmation_trials: 4
"""
    tune_result = run_search(
        load_tune(write_tune_file(tmp_path, text)), tmp_path / "out", workers=immediate_workers()
    )
    failed_candidates = [candidate for candidate in tune_result.candidates if candidate.failure]

    assert len(tune_result.candidates) == 5  # all four combinations and the unchanged settings
    assert [
        dict(candidate.settings)["chain.cfar.n_guard.range"] for candidate in failed_candidates
    ] == ["25"]
    assert "chain.cfar" in failed_candidates[0].failure
    assert "Traceback" not in render_tune_page(
        {"version": "1", **tune_result_as_dict(tune_result)}, yaml=""
    )


@nightly
def test_limit_below_trial_resolution_gives_warning(tmp_path):
    text = TUNE.replace("probability: 1e-3}", "probability: 1e-6}").replace("es: 12", "es: 1")
    scenario = SCENARIO.replace("false_alarm_probability: 1e-3", "false_alarm_probability: 1e-6")
    tune_result = run_search(
        load_tune(write_tune_file(tmp_path, text, scenario)),
        tmp_path / "out",
        workers=immediate_workers(),
    )

    [finding] = tune_result.findings
    assert finding.level == "warning" and finding.setting == "trials"
    # 40 maps of 2,048 cells give 0.08 expected false alarms at 1e-6.
    assert "give trials" in str(finding) and "1e-06" in finding.expected


def write_recorded_tune_file(folder: Path) -> Path:
    """Write a recording of the scene and a tune file with its true targets."""
    scenario = dc.load(write_tune_file(folder).parent / "weak.yaml")
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


@nightly
def test_recording_is_searched_on_one_half_and_confirmed_on_other(tmp_path):
    tune_result = run_search(
        load_tune(write_recorded_tune_file(tmp_path)), tmp_path / "out", workers=immediate_workers()
    )

    assert tune_result.n_trials == (30, 30)
    default_scenario = dc.load(tmp_path / "weak.yaml")
    assert is_near_theory(
        tune_result,
        default_scenario,
        replace(default_scenario, chain=tune_result.scenarios[0].chain),
    )
    assert tune_result.gain.certainty > 0.9
    # Cells away from the car, 30 frames of 32 velocities: the false-alarm rate matches the design.
    rate = tune_result.default.scores["false_alarm_probability"]
    assert 0 < rate.value < 3e-3


def test_recording_without_empty_range_is_refused_for_false_alarms(tmp_path):
    path = write_recorded_tune_file(tmp_path)
    path.write_text(path.read_text().replace("    empty_range: [40 m, 70 m]", ""))
    with pytest.raises(dc.DechirpError, match=r"empty_range.*give empty_range"):
        run_search(load_tune(path), tmp_path / "out", workers=immediate_workers())


@pytest.mark.parametrize(
    ("score", "message"), [("roc", "a map of noise"), ("track_completeness", "tracks")]
)
def test_rejects_scores_that_need_a_simulation(tmp_path, score, message):
    path = write_recorded_tune_file(tmp_path)
    path.write_text(
        path.read_text().replace("maximise: detection_probability", f"maximise: {score}")
    )
    with pytest.raises(dc.DechirpError, match=rf"objective: {score}, .*{message}.*or scenarios"):
        run_search(load_tune(path), tmp_path / "out", workers=immediate_workers())


INVALID_CHANGES = {
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
    ("objective: {", "# {"): ("objective", "missing"),
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


@pytest.mark.parametrize(("old", "new"), nightly_except(8, INVALID_CHANGES))
def test_invalid_file_is_refused_with_setting_and_fix(tmp_path, old, new):
    path = write_tune_file(tmp_path, TUNE.replace(old, new, 1))
    setting, expected = INVALID_CHANGES[old, new]
    with pytest.raises(dc.InvalidFile) as error:
        load_tune(path)
    text = str(error.value)

    assert setting in text and expected in text and ".yaml" in text


def test_missing_optuna_names_tune_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    with pytest.raises(dc.DechirpError, match=r"pip install 'dechirp\[tune\]'"):
        run_search(
            load_tune(write_tune_file(tmp_path)), tmp_path / "out", workers=immediate_workers()
        )
    assert not (tmp_path / "out").exists()


def test_folder_with_foreign_files_is_refused_and_left_unchanged(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("do not lose")
    with pytest.raises(dc.DechirpError, match=r"--out: .*mine, a folder with thesis.txt; expected"):
        command.tune(write_tune_file(tmp_path), out=tmp_path / "mine")
