"""Main settings of the studio: sliders, presets, undo and edits in any order."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from bokeh.document import Document

from dechirp.config.dumping import dump_yaml
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.studio.panels.main_settings import (
    MAIN_SETTINGS,
    MainSettings,
    change_main_setting,
)
from dechirp.studio.panels.presets import PRESETS, preset_scenario
from dechirp.studio.scenario_edits import PageLimits, check_scenario_within_limits, parse_scenario
from dechirp.studio.session import Session

LIMITS = PageLimits()
START = preset_scenario("crossroads", LIMITS)


@pytest.mark.parametrize("name", MAIN_SETTINGS)
@pytest.mark.parametrize("share", [0.15, 0.6])
def test_slider_shows_what_it_set(name, share):
    main = MAIN_SETTINGS[name]
    n_steps = round(share * (main.end - main.start) / main.step)
    value = main.start + n_steps * main.step
    if name == "interval":
        value = max(value, 31)  # longer than the ramp
    changed = change_main_setting(START, name, value, LIMITS)
    assert main.read(changed) == pytest.approx(value, rel=1e-6)
    unchanged = [other for other in MAIN_SETTINGS if other not in (name, "receivers")]
    for other in unchanged:
        assert MAIN_SETTINGS[other].read(changed) == pytest.approx(MAIN_SETTINGS[other].read(START))


def test_bandwidth_determines_range_cell_and_samples_the_largest_range():
    wide = change_main_setting(START, "bandwidth", 600, LIMITS).radar.frame.chirp
    assert wide.range_resolution_m == pytest.approx(SPEED_OF_LIGHT / 2 / 600e6)
    many = change_main_setting(START, "samples", 512, LIMITS).radar.frame.chirp
    assert many.max_range_m == pytest.approx(2 * START.radar.frame.chirp.max_range_m)


@pytest.mark.parametrize("name", PRESETS)
def test_preset_is_a_settings_file_within_the_limits(name):
    scenario = preset_scenario(name, LIMITS)
    check_scenario_within_limits(scenario, LIMITS)
    assert parse_scenario(dump_yaml(scenario), LIMITS) == scenario


def test_choice_of_scenes_shows_the_one_in_effect():
    session = Session(Document(), ThreadPoolExecutor(1), START, LIMITS)
    panel = MainSettings(session)

    def take(scenario) -> str:
        session.scenario = scenario
        for listen in session.on_settings:
            listen(scenario)
        return dict(panel._preset.options)[panel._preset.value]

    assert take(START) == PRESETS["crossroads"][0]
    other = preset_scenario("two-cells", LIMITS)
    assert take(other) == PRESETS["two-cells"][0]
    assert not session.has_queued_edit("")  # showing it opens nothing
    changed = change_main_setting(other, "bandwidth", 300, LIMITS)
    assert take(changed) == f"{PRESETS['two-cells'][0]}, changed"
    panel._preset.value = "two-cells"  # undoes the changes
    assert session.has_queued_edit("")
    assert take(replace(START, name="mine")) == "mine"
