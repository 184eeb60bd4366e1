"""Main settings of the studio: sliders, presets, undo and edits in any order."""

import pytest

from dechirp.config.dumping import dump_yaml
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.studio.panels.main_settings import MAIN_SETTINGS, change_main_setting
from dechirp.studio.panels.presets import PRESETS, preset_scenario
from dechirp.studio.scenario_edits import PageLimits, check_scenario_within_limits, parse_scenario

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
