"""A/B comparison: scores of two scenarios with common random numbers, next to theory."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from bokeh.models import Button, Div

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.score.probabilities import DetectionProbability
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.simulation.impairments.noise import WhiteNoise
from dechirp.studio.compare import (
    Comparison,
    ComparisonRow,
    changed_settings,
    reason_of_missing_theory,
)
from dechirp.studio.panels.compare import Compare
from dechirp.studio.scenario_edits import PageLimits, apply_overrides
from dechirp.studio.session import Session
from nightly import nightly
from trial_cases import make_target, small_radar

# Confidence of each interval: together they fail by chance for one seed in 100,000.
CONFIDENCE = 1 - 1e-7


def build_scenario(**settings) -> Scenario:
    """Build a scene with a steady target that most frames of 64 x 32 samples detect."""
    scene = dc.Scene(targets=[replace(make_target(21.0, 5.0), name="car", fluctuation="steady")])
    noise = WhiteNoise(snr=10 ** (settings.pop("snr_db", -20.0) / 10))
    return Scenario(radar=small_radar(2), scene=scene, impairments=(noise,), seed=3, **settings)


def change_settings(original: Scenario, *options: str) -> Scenario:
    return apply_overrides(original, options, PageLimits())


def count_trials(a: Scenario, b: Scenario, n_trials: int) -> dict[str, ComparisonRow]:
    """Run trials of both scenarios; return comparison rows by score label."""
    comparison = Comparison(a, b, confidence=CONFIDENCE)
    while comparison.n_trials < n_trials:
        comparison.run_trials_for(0.0)
    return {row.score.kind(): row for row in comparison.comparison_rows_so_far()}


@nightly
def test_theory_lies_within_confidence_intervals():
    weak, strong = build_scenario(), build_scenario(snr_db=0.0)
    rows = count_trials(weak, strong, 400)
    errors = [rows[f"{axis}_rmse"].b for axis in ("range", "velocity", "azimuth")]
    shares = [rows["detection_probability"].a, rows["frame_false_alarm_probability"].b]
    assert 0.3 < rows["detection_probability"].a.theory < 0.9
    for estimate in (*errors, *shares):
        assert estimate.low < estimate.theory < estimate.high


def test_equal_settings_give_zero_change():
    rows = count_trials(build_scenario(), build_scenario(), 40)
    assert rows["detection_probability"].a.value < 1
    assert all(row.a == row.b and row.change.value == 0 for row in rows.values())
    assert rows["range_rmse"].change.high == rows["range_rmse"].change.low == 0


@nightly
def test_common_noise_resolves_small_difference():
    # 0.25 dB changes the detection probability by 0.02 where it is 0.5.
    rows = count_trials(build_scenario(), build_scenario(snr_db=-19.75), 400)
    row = rows["detection_probability"]
    assert row.a.high > row.b.value and row.b.low < row.a.value
    assert row.change.value > 0 and row.change.certainty > 0.999


@nightly
def test_false_alarm_rate_follows_setting_over_three_decades():
    base = build_scenario(snr_db=0.0)
    rows = count_trials(
        change_settings(base, "chain.cfar.false_alarm_probability=1e-3"),
        change_settings(base, "chain.cfar.false_alarm_probability=1e-6"),
        200,
    )
    cell = rows["false_alarm_probability"]
    assert cell.a.low < cell.a.theory == 1e-3 < cell.a.high < 1.5e-3
    assert cell.b.low <= cell.b.theory == 1e-6 < cell.b.high < 1e-4
    assert cell.change.low < 1e-6 - 1e-3 < cell.change.high < 0
    assert cell.change.certainty > CONFIDENCE
    frame = rows["frame_false_alarm_probability"]
    assert frame.change.high < 0 and frame.change.certainty > CONFIDENCE


@nightly
def test_certainty_refers_to_sign_of_change():
    increase, decrease = (
        count_trials(*pair, 100)["detection_probability"].change
        for pair in (
            (build_scenario(), build_scenario(snr_db=-18.0)),
            (build_scenario(snr_db=-18.0), build_scenario()),
        )
    )
    assert increase.value == -decrease.value > 0
    assert increase.certainty == decrease.certainty > 0.99


def test_each_step_computes_one_trial_or_one_theory():
    comparison = Comparison(build_scenario(), build_scenario())
    n_theories = 6 + 6
    for n_steps in range(1, n_theories + 7):
        comparison.run_trials_for(0.0)
        n_trial_steps = max(n_steps - n_theories, 0)
        # A pair of trials is counted when the next one starts.
        assert comparison.n_trials == max(n_trial_steps - 1, 0) // 2


def test_score_missing_in_one_scenario_is_shown_for_other_only():
    rows = count_trials(build_scenario(), change_settings(build_scenario(), "chain.angle=null"), 10)
    assert rows["azimuth_rmse"].a is not None
    assert rows["azimuth_rmse"].b is None and rows["azimuth_rmse"].change is None


@nightly
def test_only_first_frame_is_compared_and_tracks_are_not():
    single_frame_rows = count_trials(build_scenario(), build_scenario(), 10)
    many_frames = change_settings(build_scenario(), "n_frames=50", "tracker={}")
    assert count_trials(many_frames, many_frames, 10) == single_frame_rows


def test_rejects_recording_without_truth():
    recording = Scenario(recording=RecordingSource(path="walk.bin"))
    with pytest.raises(InvalidSetting, match="a scene that can be simulated again"):
        Comparison(recording, build_scenario())


def test_changed_settings_lists_only_changed_paths():
    changes = changed_settings(
        build_scenario(),
        change_settings(
            build_scenario(), "scene.targets.car.rcs=10 dBsm", "chain.range_window=rectangular"
        ),
    )
    assert [(change.path, change.b) for change in changes] == [
        ("scene.targets.car.rcs", "10 dBsm"),
        ("chain.range_window", "rectangular"),
    ]


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ("chain.mitigation=[{kind: mean-subtraction}]", "mitigation"),
        ("scene.targets.car.body={kind: pedestrian, speed: 1 m/s}", "body"),
        ("chain.cfar.estimator={kind: trimmed-mean}", "closed law"),
        ("impairments=[]", "noise"),
    ],
)
def test_missing_theory_has_reason(option, reason):
    changed = change_settings(build_scenario(), option)
    score, name = DetectionProbability(), changed.scene.names[0]
    context = build_trial_context(changed)
    assert np.isnan(score.theoretical_values(context)).all()
    assert reason in reason_of_missing_theory(score, name, context)


def test_page_runs_trials_until_closed_and_escapes_names():
    target = replace(build_scenario().scene.targets[0], name="<img src=x>")
    named_scenario = replace(build_scenario(), scene=dc.Scene(targets=[target]))

    async def read_page_text() -> str:
        document, tasks_before = Document(), asyncio.all_tasks()
        panel = Compare(Session(document, worker, named_scenario, PageLimits()))
        for button in panel.root_element.select({"type": Button}):
            if button.label.startswith("Keep"):
                button._trigger_event(ButtonClick(button))
        (summary,) = panel.root_element.select({"type": Div})
        while "no difference" not in summary.text:
            await asyncio.sleep(0.01)
            for tick in document.session_callbacks:
                document.remove_next_tick_callback(tick)
                tick.callback()
        (trial_task,) = asyncio.all_tasks() - tasks_before
        for callback in document.session_destroyed_callbacks:
            callback(None)
        await asyncio.wait([trial_task])
        return summary.text

    with ThreadPoolExecutor(1) as worker:
        text = asyncio.run(asyncio.wait_for(read_page_text(), 60))
    assert "A and B are the same settings." in text
    assert "&lt;img src=x&gt;" in text and "<img" not in text
