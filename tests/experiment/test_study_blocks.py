"""Blocks of trials: independence of threads and order, replay, failures and findings."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError
from dechirp.core.threads import exclusive_single_thread, thread_count
from dechirp.evaluation.score.errors import RangeRmse, VelocityRmse
from dechirp.evaluation.score.probabilities import DetectionProbability
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study import trial
from dechirp.experiments.study.executors import _multithreaded_worker_findings
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.run import replay_trial
from dechirp.experiments.study.study import Study, SweptSetting, TrialBudget
from dechirp.experiments.study.trial import create_trial_runner, run_trial_block
from dechirp.simulation.impairments.bumper import Bumper
from dechirp.simulation.impairments.noise import ThermalNoise
from nightly import nightly
from trial_cases import make_target, small_radar

SCENE = dc.Scene(targets=(make_target(name="car"), make_target(41.3, -5.0, name="van", rcs_m2=3.0)))
SCORES = (DetectionProbability(), RangeRmse())


def make_study(**changed) -> Study:
    """Make a study of 40 trials of two targets in blocks of 10."""
    scenario = Scenario(scene=SCENE, radar=small_radar(2), impairments=(ThermalNoise(),))
    settings = {"scenario": scenario, "trials": TrialBudget(at_most=40, block=10), "scores": SCORES}
    return Study(**{**settings, **changed})


def ledger_content(block):
    """Return the content of a block that the ledger stores, except its run time."""
    return block.sums.tobytes(), block.failures, block.findings


@pytest.fixture
def frequent_switches():
    """Switch between threads a thousand times as often, so that races are likely."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(interval_s)


@nightly
def test_blocks_of_a_point_can_run_in_threads(frequent_switches):
    numbers = [*range(4)] * 3
    serial_plan, plan = Plan.from_study(make_study()), Plan.from_study(make_study())
    expected = [ledger_content(run_trial_block(serial_plan, 0, number)) for number in numbers]
    with ThreadPoolExecutor(4) as pool:
        contents = list(
            pool.map(lambda number: ledger_content(run_trial_block(plan, 0, number)), numbers)
        )
    assert contents == expected


def test_single_threaded_restores_thread_count():
    n_threads = thread_count()
    with pytest.raises(ZeroDivisionError), exclusive_single_thread():
        assert thread_count() == 1
        raise ZeroDivisionError
    assert thread_count() == n_threads


def test_replayed_trial_equals_trial_of_study():
    scene = dc.Scene(targets=(make_target(name="car"),) * 1)
    seeded_study = make_study(
        scenario=Scenario(scene=scene, radar=small_radar(4), impairments=(ThermalNoise(),)), seed=4
    )
    block = run_trial_block(Plan.from_study(seeded_study), 0, 2)
    replayed_trial = replay_trial(seeded_study, 23)
    assert replayed_trial.sums.tobytes() == block.sums[3].tobytes()


def test_findings_do_not_depend_on_block_order():
    impairments = (ThermalNoise(), Bumper(distance_m=0.05, reflectivity=0.1))
    scenario = Scenario(scene=SCENE, radar=small_radar(2), impairments=impairments)
    statistical_study = make_study(scenario=scenario, sensor="statistical")
    first, late = Plan.from_study(statistical_study), Plan.from_study(statistical_study)
    findings = run_trial_block(first, 0, 0).findings
    run_trial_block(late, 0, 1)
    assert any("bumper" in finding.value for finding in findings)
    assert run_trial_block(late, 0, 0).findings == findings


def test_memory_error_is_not_counted_as_failed_trial(monkeypatch):
    def run(self, number):
        raise MemoryError("no 3 GiB")

    monkeypatch.setattr(trial.TrialRunner, "run_trial", run)
    with pytest.raises(DechirpError, match="too little memory for trial 10 of point 0"):
        run_trial_block(Plan.from_study(make_study()), 0, 1)


def test_error_in_theory_loses_no_trials(monkeypatch):
    plan, reference_block = (
        Plan.from_study(make_study()),
        run_trial_block(Plan.from_study(make_study()), 0, 0),
    )

    def theory(self, case):
        raise ArithmeticError("no law")

    monkeypatch.setattr(DetectionProbability, "theoretical_values", theory)
    block = run_trial_block(plan, 0, 0)
    assert block.sums.tobytes() == reference_block.sums.tobytes()
    assert np.isnan(block.theory[:2]).all()
    assert block.theory[2:] == pytest.approx(reference_block.theory[2:])
    assert ["no law" in finding.value for finding in block.findings] == [True]


def test_point_with_invalid_scores_fails_every_trial_and_has_no_theory():
    lists = (SweptSetting(path="radar.frame.n_chirps", texts=("32", "1")),)
    plan = Plan.from_study(make_study(vary=lists, scores=(DetectionProbability(), VelocityRmse())))
    assert not run_trial_block(plan, 0, 0).failures
    block = run_trial_block(plan, 1, 0)
    assert [failure.trial for failure in block.failures] == list(range(10))
    assert np.isnan(block.sums).all() and np.isnan(block.theory).all()


def test_targets_of_point_must_match_study(monkeypatch):
    plan = Plan.from_study(make_study())
    car, van = SCENE.targets
    other_scene = dc.Scene(targets=(car, replace(van, name="tram")))
    prepared_trial = create_trial_runner(
        Plan.from_study(make_study(scenario=replace(plan.study.scenario, scene=other_scene))), 0, 0
    )
    monkeypatch.setattr(trial, "create_trial_runner", lambda *arguments: prepared_trial)
    failures = run_trial_block(plan, 0, 0).failures
    assert len(failures) == 10
    assert "targets car, tram" in failures[0].message


@pytest.mark.parametrize(("threads", "n_findings"), [({"a": 1, "b": 1}, 0), ({"a": 1, "b": 8}, 1)])
def test_workers_with_several_threads_give_a_finding(threads, n_findings):
    findings = _multithreaded_worker_findings(SimpleNamespace(nthreads=lambda: threads))
    assert ["b of 8" in finding.value for finding in findings] == [True] * n_findings
