"""What a worker does is the same whoever else works beside it, and whatever it did before."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numba
import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError
from dechirp.core.threads import single_threaded
from dechirp.evaluation.score.detection_probability import DetectionProbability
from dechirp.evaluation.score.errors import RangeRmse, VelocityRmse
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study import trial
from dechirp.experiments.study.executors import _thread_findings
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.run import replay_trial
from dechirp.experiments.study.study import Study, SweptSetting, TrialBudget
from dechirp.experiments.study.trial import prepare_trial, run_block
from dechirp.simulation.impairments.bumper import Bumper
from dechirp.simulation.impairments.thermal_noise import ThermalNoise
from trial_cases import small, target

SCENE = dc.Scene(targets=(target(name="car"), target(41.3, -5.0, name="van", rcs_m2=3.0)))
SCORES = (DetectionProbability(), RangeRmse())


def study(**changed) -> Study:
    """40 trials of two targets in blocks of 10."""
    scenario = Scenario(scene=SCENE, radar=small(2), impairments=(ThermalNoise(),))
    settings = {"scenario": scenario, "trials": TrialBudget(at_most=40, block=10), "scores": SCORES}
    return Study(**{**settings, **changed})


def kept(block):
    """What the ledger has of a block, but for the time it took."""
    return block.sums.tobytes(), block.failures, block.findings


@pytest.fixture
def often():
    """Threads that take turns a thousand times as often, so that they do meet."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(before)


def test_blocks_of_a_point_may_run_in_threads_of_one_process(often):
    numbers = [*range(4)] * 3
    alone_plan, plan = Plan.from_study(study()), Plan.from_study(study())
    expected = [kept(run_block(alone_plan, 0, number)) for number in numbers]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda number: kept(run_block(plan, 0, number)), numbers))
    assert found == expected


def test_who_works_alone_has_one_thread_and_gives_the_others_back():
    before = numba.get_num_threads()
    with pytest.raises(ZeroDivisionError), single_threaded():
        assert numba.get_num_threads() == 1
        raise ZeroDivisionError
    assert numba.get_num_threads() == before


def test_a_trial_replayed_is_that_of_the_study_to_the_bit():
    body = dc.Scene(targets=(target(name="car"),) * 1)
    one = study(
        scenario=Scenario(scene=body, radar=small(4), impairments=(ThermalNoise(),)), seed=4
    )
    block = run_block(Plan.from_study(one), 0, 2)
    again = replay_trial(one, 23)
    assert again.sums.tobytes() == block.sums[3].tobytes()


def test_what_was_warned_of_does_not_depend_on_which_block_came_first():
    impairments = (ThermalNoise(), Bumper(distance_m=0.05, reflectivity=0.1))
    scenario = Scenario(scene=SCENE, radar=small(2), impairments=impairments)
    drawn = study(scenario=scenario, sensor="statistical")
    first, late = Plan.from_study(drawn), Plan.from_study(drawn)
    found = run_block(first, 0, 0).findings
    run_block(late, 0, 1)
    assert any("bumper" in one.value for one in found)
    assert run_block(late, 0, 0).findings == found


def test_short_memory_is_not_a_trials_failure(monkeypatch):
    def run(self, number):
        raise MemoryError("no 3 GiB")

    monkeypatch.setattr(trial.TrialRunner, "run", run)
    with pytest.raises(DechirpError, match="too little memory for trial 10 of point 0"):
        run_block(Plan.from_study(study()), 0, 1)


def test_theory_that_raises_loses_no_trials(monkeypatch):
    plan, undisturbed = Plan.from_study(study()), run_block(Plan.from_study(study()), 0, 0)

    def theory(self, case):
        raise ArithmeticError("no law")

    monkeypatch.setattr(DetectionProbability, "theory", theory)
    block = run_block(plan, 0, 0)
    assert block.sums.tobytes() == undisturbed.sums.tobytes()
    assert np.isnan(block.theory[:2]).all()
    assert block.theory[2:] == pytest.approx(undisturbed.theory[2:])
    assert ["no law" in one.value for one in block.findings] == [True]


def test_a_point_that_cannot_be_prepared_fails_in_each_trial_and_has_no_theory():
    lists = (SweptSetting(path="radar.frame.n_chirps", texts=("32", "1")),)
    plan = Plan.from_study(study(vary=lists, scores=(DetectionProbability(), VelocityRmse())))
    assert not run_block(plan, 0, 0).failures
    block = run_block(plan, 1, 0)
    assert [one.trial for one in block.failures] == list(range(10))
    assert np.isnan(block.sums).all() and np.isnan(block.theory).all()


def test_targets_of_a_point_must_be_those_of_the_study(monkeypatch):
    plan = Plan.from_study(study())
    car, van = SCENE.targets
    other = dc.Scene(targets=(car, replace(van, name="tram")))
    made = prepare_trial(
        Plan.from_study(study(scenario=replace(plan.study.scenario, scene=other))), 0, 0
    )
    monkeypatch.setattr(trial, "prepare_trial", lambda *asked: made)
    failed = run_block(plan, 0, 0).failures
    assert len(failed) == 10
    assert "targets car, tram" in failed[0].message


@pytest.mark.parametrize(("threads", "n_told"), [({"a": 1, "b": 1}, 0), ({"a": 1, "b": 8}, 1)])
def test_workers_whose_threads_would_wait_for_each_other_are_told_of(threads, n_told):
    found = _thread_findings(SimpleNamespace(nthreads=lambda: threads))
    assert ["b of 8" in one.value for one in found] == [True] * n_told
