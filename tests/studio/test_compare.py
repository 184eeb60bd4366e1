"""A/B: the same chance in both, counted beside theory."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from bokeh.models import Button, Div

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.simulation.impairments.noise import WhiteNoise
from dechirp.studio.compare import Comparison, ComparisonRow, changed_settings
from dechirp.studio.panels.compare import Compare
from dechirp.studio.scenario_edits import PageLimits, apply_options
from dechirp.studio.session import Session
from trial_cases import make_target, small_radar

# Of each interval: all of them together fail by chance in one of a hundred thousand seeds.
CONFIDENCE = 1 - 1e-7


def scenario(**settings) -> Scenario:
    """A steady target that is found in most frames of 64 x 32 samples."""
    scene = dc.Scene(targets=[replace(make_target(21.0, 5.0), name="car", fluctuation="steady")])
    noise = WhiteNoise(snr=10 ** (settings.pop("snr_db", -20.0) / 10))
    return Scenario(radar=small_radar(2), scene=scene, impairments=(noise,), seed=3, **settings)


def turned(one: Scenario, *options: str) -> Scenario:
    return apply_options(one, options, PageLimits())


def counted(a: Scenario, b: Scenario, n_trials: int) -> dict[str, ComparisonRow]:
    """Rows by their score, after so many trials of each."""
    comparison = Comparison(a, b, confidence=CONFIDENCE)
    while comparison.n_trials < n_trials:
        comparison.run_for(0.0)
    return {row.score.label(): row for row in comparison.rows()}


def test_theory_stands_within_the_intervals_of_both():
    often, always = scenario(), scenario(snr_db=0.0)
    rows = counted(often, always, 400)
    errors = [rows[f"{axis}_rmse"].b for axis in ("range", "velocity", "azimuth")]
    shares = [rows["detection_probability"].a, rows["frame_false_alarm_probability"].b]
    assert 0.3 < rows["detection_probability"].a.theory < 0.9
    for told in (*errors, *shares):
        assert told.low < told.theory < told.high


def test_equal_settings_differ_in_nothing():
    rows = counted(scenario(), scenario(), 40)
    assert rows["detection_probability"].a.value < 1
    assert all(row.a == row.b and row.change.value == 0 for row in rows.values())
    assert rows["range_rmse"].change.high == rows["range_rmse"].change.low == 0


def test_the_same_noise_shows_a_difference_that_two_draws_would_hide():
    # 0.25 dB: where the probability is a half, steps of 0.02.
    rows = counted(scenario(), scenario(snr_db=-19.75), 400)
    row = rows["detection_probability"]
    assert row.a.high > row.b.value and row.b.low < row.a.value
    assert row.change.value > 0 and row.change.certainty > 0.999


def test_a_thousand_times_the_false_alarm_probability_gives_a_thousand_times_the_alarms():
    base = scenario(snr_db=0.0)
    rows = counted(
        turned(base, "chain.cfar.false_alarm_probability=1e-3"),
        turned(base, "chain.cfar.false_alarm_probability=1e-6"),
        200,
    )
    cell = rows["false_alarm_probability"]
    assert cell.a.low < cell.a.theory == 1e-3 < cell.a.high < 1.5e-3
    assert cell.b.low <= cell.b.theory == 1e-6 < cell.b.high < 1e-4
    assert cell.change.low < 1e-6 - 1e-3 < cell.change.high < 0
    assert cell.change.certainty > CONFIDENCE
    frame = rows["frame_false_alarm_probability"]
    assert frame.change.high < 0 and frame.change.certainty > CONFIDENCE


def test_certainty_is_that_of_the_sign_it_is_told_with():
    forth, back = (
        counted(*pair, 100)["detection_probability"].change
        for pair in ((scenario(), scenario(snr_db=-18.0)), (scenario(snr_db=-18.0), scenario()))
    )
    assert forth.value == -back.value > 0
    assert forth.certainty == back.certainty > 0.99


def test_a_step_is_one_trial_or_one_law():
    comparison = Comparison(scenario(), scenario())
    n_laws = 6 + 6
    for n_steps in range(1, n_laws + 7):
        comparison.run_for(0.0)
        done = max(n_steps - n_laws, 0)
        # That both have a trial is counted when the next one begins.
        assert comparison.n_trials == max(done - 1, 0) // 2


def test_what_one_of_them_cannot_tell_is_told_of_the_other_alone():
    rows = counted(scenario(), turned(scenario(), "chain.angle=null"), 10)
    assert rows["azimuth_rmse"].a is not None
    assert rows["azimuth_rmse"].b is None and rows["azimuth_rmse"].change is None


def test_of_many_frames_the_first_is_tried_and_of_tracks_none():
    once = counted(scenario(), scenario(), 10)
    many = turned(scenario(), "n_frames=50", "tracker={}")
    assert counted(many, many, 10) == once


def test_a_recording_has_no_truth_to_be_compared_with():
    recording = Scenario(recording=RecordingSource(path="walk.bin"))
    with pytest.raises(InvalidSetting, match="a scene that can be simulated again"):
        Comparison(recording, scenario())


def test_differences_are_the_settings_that_were_turned_and_no_others():
    found = changed_settings(
        scenario(),
        turned(scenario(), "scene.targets.car.rcs=10 dBsm", "chain.range_window=rectangular"),
    )
    assert [(one.path, one.b) for one in found] == [
        ("scene.targets.car.rcs", "10 dBsm"),
        ("chain.range_window", "rectangular"),
    ]


def test_the_page_counts_by_itself_until_it_is_closed_and_shows_names_as_text():
    named = replace(scenario().scene.targets[0], name="<img src=x>")
    one = replace(scenario(), scene=dc.Scene(targets=[named]))

    async def counted_on_page() -> str:
        document, before = Document(), asyncio.all_tasks()
        panel = Compare(Session(document, worker, one, PageLimits()))
        for button in panel.root.select({"type": Button}):
            if button.label.startswith("Keep"):
                button._trigger_event(ButtonClick(button))
        (said,) = panel.root.select({"type": Div})
        while "no difference" not in said.text:
            await asyncio.sleep(0.01)
            for waiting in document.session_callbacks:
                document.remove_next_tick_callback(waiting)
                waiting.callback()
        (counting,) = asyncio.all_tasks() - before
        for closed in document.session_destroyed_callbacks:
            closed(None)
        await asyncio.wait([counting])
        return said.text

    with ThreadPoolExecutor(1) as worker:
        text = asyncio.run(asyncio.wait_for(counted_on_page(), 60))
    assert "A and B are the same settings." in text
    assert "&lt;img src=x&gt;" in text and "<img" not in text
