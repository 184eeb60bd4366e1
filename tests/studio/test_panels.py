"""Knobs: what they show is what holds, what is typed into them is what comes to hold."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from bokeh.models import Button, Checkbox, Div, Select, TextAreaInput, TextInput

import dechirp as dc
from dechirp.core.errors import DechirpError
from dechirp.experiments.run import run
from dechirp.experiments.scenario import Scenario, load
from dechirp.radar.budget import noise_power_w
from dechirp.studio.panels.arrays import linear_array_options
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.hardware import Hardware
from dechirp.studio.panels.knobs import Knob, override_options, setting_knobs
from dechirp.studio.panels.processing import Processing
from dechirp.studio.panels.radar import Radar
from dechirp.studio.panels.requirements import Requirements, apply_design, round_frame
from dechirp.studio.panels.settings_file import SettingsFile
from dechirp.studio.panels.targets import Targets, replace_noise
from dechirp.studio.scenario_edits import PageLimits, apply_options, parse_scenario
from dechirp.studio.session import Session

TEXT = """
name: street
seed: 3
n_frames: 6
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 3 us, ramp_duration: 29 us,
            sample_rate: 10 MHz, n_samples: 128, sampling: complex}
    n_chirps: 32
    interval: 35 us
    period: 50 ms
    multiplexing: {kind: tdm, order: [0, 1]}
  array:
    tx: [[0, 0, 0], [0, 7.776 mm, 0]]
    rx: [[0, 0, 0], [0, 1.944 mm, 0], [0, 3.888 mm, 0], [0, 5.832 mm, 0]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB, loss: 1 dB}
scene:
  targets:
    - {name: car, position: [30 m, 3 m, 0], velocity: [8 m/s, 0, 0], rcs: 10 dBsm}
    - {name: a.b, position: [40 m, 0, 0], body: {kind: pedestrian, speed: 1.5 m/s}}
    - {position: [20 m, -4 m, 0], fluctuation: swerling-1}
impairments:
  - {kind: thermal-noise}
  - {kind: leakage, isolation: 40 dB}
  - {kind: wall-multipath, start: [0, 6 m], end: [50 m, 6 m]}
  - {kind: wall-multipath, start: [0, -6 m], end: [50 m, -6 m]}
chain: {angle: {kind: capon}, cluster: {}, mitigation: [{kind: mean-subtraction}]}
tracker: {}
"""
PANELS = (Radar, Targets, Hardware, Processing, Requirements, SettingsFile)
WHOLE = ("name", "seed", "n_frames", "radar", "scene", "engine", "impairments", "chain")
LIMITS = PageLimits()


class Page:
    """A session whose edits are made at once, in the place of its worker."""

    def __init__(self, kind: type[Panel], text: str = TEXT) -> None:
        self.session = Session(
            Document(), ThreadPoolExecutor(1), parse_scenario(text, LIMITS), LIMITS
        )
        self.panel = kind(self.session)
        self.session.document.add_root(self.panel.root)

    @property
    def scenario(self) -> Scenario:
        return self.session.scenario

    def knob(self, path: str) -> Any:
        found = [
            one
            for one in self.widgets(Checkbox, Select, TextInput)
            if one.html_attributes.get("data-setting") == path
        ]
        assert len(found) == 1, path
        return found[0]

    def widgets(self, *kinds: type) -> list[Any]:
        return [one for one in self.panel.root.references() if isinstance(one, kinds)]

    def press(self, label: str, title: str = "") -> None:
        (button,) = (
            one
            for one in self.widgets(Button)
            if one.label == label and one.html_attributes.get("title", "") == title
        )
        button._trigger_event(ButtonClick(button))
        self.apply()

    def type(self, path: str, text: str) -> None:
        self.knob(path).value = text
        self.apply()

    def apply(self) -> None:
        edits = list(self.session._edits.values())
        self.session._edits.clear()
        try:
            for edit in edits:
                self.session.scenario = edit(self.session.scenario)
        except DechirpError as error:
            for tell in self.session.on_mistakes:
                tell(error.mistakes)
            return
        if edits:
            for show in self.session.on_settings:
                show(self.session.scenario)

    @property
    def words(self) -> list[str]:
        return [one.text for one in self.widgets(Div) if one.visible and "wrong" in one.css_classes]


def knobs() -> list[Knob]:
    scenario = parse_scenario(TEXT, LIMITS)
    return [entry for path in (*WHOLE, "tracker") for entry in setting_knobs(scenario, path)]


def test_what_every_knob_shows_is_what_holds_when_it_is_typed() -> None:
    scenario = parse_scenario(TEXT, LIMITS)
    for entry in knobs():
        if not entry.text.startswith("{"):  # a member, or what is on, is taken with defaults
            again = apply_options(
                scenario, override_options(scenario, entry.path, entry.text), LIMITS
            )
            assert again == scenario, entry


def test_every_choice_of_a_family_is_taken_or_asks_for_what_it_cannot_do_without() -> None:
    page = Page(Processing)
    for kind in (text for text, _ in page.knob("chain.cfar.estimator").options):
        page.type("chain.cfar.estimator", kind)
        assert f"{{kind: {page.scenario.chain.cfar.estimator.kind()}}}" == kind
    page = Page(Hardware)
    before = page.scenario
    page.knob("impairments.bumper").active = True
    page.apply()
    assert page.scenario == before  # nothing is known of it yet
    page.type("impairments.bumper.distance", "5 cm")
    assert page.scenario == before
    page.type("impairments.bumper.reflectivity", "-10 dB")
    assert page.scenario.impairments[-1].kind() == "bumper"
    page.knob("impairments.bumper").active = False
    page.apply()
    assert page.scenario == before


def test_a_wrong_value_is_told_below_its_knob_and_escape_puts_back_what_holds() -> None:
    page = Page(Radar)
    before = page.scenario
    knob = page.knob("radar.frame.chirp.slope")
    for text in ("20", "20 MHz", "nan", "1e30 MHz/us", "import os", "&a 1", "!!float 1"):
        page.type("radar.frame.chirp.slope", text)
        assert page.scenario == before
        assert "wrong" in knob.css_classes and knob.value == text
        (words,) = page.words
        assert "expected" in words
    knob.value = knob.tags[0]  # as page.js does
    assert not page.words and "wrong" not in knob.css_classes


def test_a_value_that_does_not_fit_another_setting_is_told_where_it_was_typed() -> None:
    page = Page(Radar)
    page.type("radar.frame.chirp.n_samples", "4096")
    assert "wrong" in page.knob("radar.frame.chirp.n_samples").css_classes
    assert any("radar.frame.chirp.ramp_duration: " in words for words in page.words)
    page.type("radar.frame.chirp.slope", "12 MHz/us")
    assert not page.words
    assert page.knob("radar.frame.chirp.n_samples").value == "128"


def test_what_is_typed_is_shown_as_settings_files_write_it() -> None:
    page = Page(Radar)
    page.type("radar.frame.chirp.start_frequency", "77000 MHz")
    assert page.knob("radar.frame.chirp.start_frequency").value == "77 GHz"


@pytest.mark.parametrize(("n_tx", "n_rx"), [(1, 4), (2, 4), (3, 4)])
def test_an_array_in_a_row_has_its_virtual_elements_half_a_wavelength_apart(
    n_tx: int, n_rx: int
) -> None:
    scenario = parse_scenario(TEXT, LIMITS)
    assert scenario.radar is not None
    made = apply_options(scenario, linear_array_options(scenario.radar, n_tx, n_rx), LIMITS).radar
    assert made is not None
    across_m = sorted(made.array.virtual_positions_m[:, 1])
    half_m = made.frame.chirp.wavelength_m / 2
    assert np.diff(across_m) == pytest.approx([half_m] * (n_tx * n_rx - 1), abs=1e-6)
    assert made.frame.n_slots == n_tx


def one_element(page: Page) -> None:
    radar, scenario = page.scenario.radar, page.scenario
    assert radar is not None and len(radar.element_positions_m) == 1
    assert scenario.tracker is None and scenario.ego_motion is None
    assert not page.words


@pytest.mark.parametrize("angle", ["capon", "fft"])
def test_an_array_of_one_element_is_chosen_at_once_and_ends_what_needs_directions(
    angle: str,
) -> None:
    page = Page(Radar, TEXT.replace("capon", angle))
    (rows,) = (one for one in page.widgets(Select) if one.title == "Array in a row")
    rows.value = "1 1"
    page.apply()
    one_element(page)
    assert any("Directions" in one.text for one in page.widgets(Div))
    rows.value = "1 4"
    page.apply()
    assert page.scenario.chain.fit_to_radar(page.scenario.radar).angle is not None


def test_elements_can_be_typed_one_setting_after_the_other() -> None:
    page = Page(Radar)
    page.type("radar.array.rx", "[[0, 0, 0]]")
    assert page.scenario.tracker is not None  # two transmitters still tell directions
    page.type("radar.array.tx", "[[0, 0, 0]]")
    one_element(page)
    page.type("radar.array.tx", "[[0, 0, 0], [0, 2 mm, 0], [0, 4 mm, 0]]")
    assert page.scenario.radar.frame.n_slots == 3  # type: ignore[union-attr]
    page.type("radar.array.tx", "[[0, 0, 0], 2 mm]")
    assert page.words and page.scenario.radar.frame.n_slots == 3  # type: ignore[union-attr]


def test_an_array_that_is_refused_is_not_shown_as_if_it_were_there() -> None:
    page = Page(Radar, TEXT.replace("n_chirps: 32", "n_chirps: 600"))
    (rows,) = (one for one in page.widgets(Select) if one.title == "Array in a row")
    before, shown = page.scenario, rows.value
    rows.value = "4 4"  # 84 ms, in a period of 50 ms
    page.apply()
    assert page.scenario == before and rows.value == shown


def test_a_detector_has_a_false_alarm_probability_or_an_offset() -> None:
    page = Page(Processing)
    page.type("chain.cfar.offset", "15 dB")
    assert page.scenario.chain.cfar.false_alarm_probability is None
    page.type("chain.cfar.false_alarm_probability", "1e-4")
    assert page.scenario.chain.cfar.offset is None


def test_noise_told_by_the_snr_of_a_target_is_as_strong_as_that_of_the_receiver() -> None:
    scenario = parse_scenario(TEXT, LIMITS)
    told = replace_noise(scenario, "white")
    assert scenario.scene is not None and scenario.radar is not None
    noise_w = told.impairments[0].noise_power_w(scenario.scene, scenario.radar)
    assert noise_w == pytest.approx(noise_power_w(scenario.radar), rel=0.012)  # 0.05 dB
    assert replace_noise(told, "thermal") == scenario


def test_targets_come_and_go_and_their_knobs_with_them() -> None:
    page = Page(Targets)
    assert page.scenario.scene is not None
    names = page.scenario.scene.names
    page.press("Add a target")
    assert page.scenario.scene.names == (*names, "target-1")
    page.type("scene.targets.target-1.rcs", "3 dBsm")
    page.type("scene.targets.target-1.body", "{kind: car}")  # has cross sections of its own
    assert page.scenario.scene.targets[-1].body is not None
    page.press("Remove", "Remove target 1")
    assert page.scenario.scene.names == (*names[1:], "target-1")
    page.type("scene.targets.0.position", "[50 m, 0, 0]")  # a.b: a path takes it for two names
    assert page.scenario.scene.targets[0].position_m == (50.0, 0.0, 0.0)


def test_the_design_is_taken_with_the_receivers_and_the_hardware_of_the_radar() -> None:
    page = Page(Requirements)
    before = page.scenario.radar
    assert before is not None
    page.type("max_range", "100 m")
    page.type("max_velocity", "30 m/s")
    page.press("Use this radar")
    radar = page.scenario.radar
    assert radar is not None
    asked = {"max_range_m": 100, "range_resolution_m": 1, "max_velocity_m_per_s": 30}
    wanted = dc.design(**asked, rule="constraints").radar.frame
    assert radar.frame == replace(round_frame(wanted), period_s=before.frame.period_s)
    assert radar.array.rx_m == before.array.rx_m and radar.hardware == before.hardware


@pytest.mark.parametrize("rule", ["constraints", "round-trips"])
def test_what_is_taken_has_numbers_of_six_digits_and_still_does_what_is_asked(rule: Any) -> None:
    rng = np.random.default_rng(10)
    for _ in range(50):
        farthest_m, cell_m, fastest_m_per_s = rng.uniform((20, 0.3, 1), (200, 2, 15))
        asked = {"max_range_m": farthest_m, "range_resolution_m": cell_m}
        made = dc.design(**asked, max_velocity_m_per_s=fastest_m_per_s, rule=rule)
        assert made.is_met
        frame = round_frame(made.radar.frame)
        assert frame.chirp.range_resolution_m <= cell_m * (1 + 1e-12)
        assert frame.chirp.max_range_m >= farthest_m
        assert frame.max_velocity_m_per_s >= fastest_m_per_s
        taken = apply_design(parse_scenario(TEXT, LIMITS), made)
        texts = [one.text for one in setting_knobs(taken, "radar.frame")]
        assert max(sum(map(str.isdigit, text)) for text in texts) <= 7, texts  # or a 0 before six


def test_what_no_radar_can_do_is_told_with_the_nearest_one() -> None:
    page = Page(Requirements)
    page.type("max_velocity", "3000 m/s")
    answer = "".join(one.text for one in page.widgets(Div))
    assert "nearest" in answer and "expected" in answer
    page.type("max_range", "100")
    assert any("a length" in words for words in page.words)


def take_and_answer(page: Page) -> tuple[Button, Div]:
    (take,) = (one for one in page.widgets(Button) if one.label == "Use this radar")
    (answer,) = (one for one in page.widgets(Div) if "aria-label='Design'" in one.text)
    return take, answer


def test_while_a_requirement_is_wrong_the_answer_is_out_of_date_and_not_taken() -> None:
    page = Page(Requirements)
    take, answer = take_and_answer(page)
    held = answer.text
    assert "<h3>Met" in held and not take.disabled
    for path, text in (("max_range", "150"), ("max_velocity", "-1 m/s"), ("rcs", "1 m")):
        page.type(path, text)
        assert page.words and take.disabled and "<h3>Out of date" in answer.text, text
        page.knob(path).value = page.knob(path).tags[0]  # as page.js does on Escape
        assert not page.words and not take.disabled and answer.text == held, text
    page.type("max_range", "150")
    page.type("max_range", "120 m")
    assert not take.disabled and "Out of date" not in answer.text and answer.text != held


def test_a_design_has_the_hardware_that_the_radar_has_when_it_is_taken() -> None:
    page = Page(Requirements)
    page.session.change_setting("radar.hardware.noise_factor", "9 dB")
    page.apply()
    page.press("Use this radar")
    radar = page.scenario.radar
    assert radar is not None and radar.hardware is not None
    assert radar.hardware.noise_factor == pytest.approx(10**0.9)


@pytest.mark.parametrize("wrong", ["1e-300 m/s", "1e300 m/s", "0 m/s", "-1 m/s", "nan", ".inf m/s"])
def test_requirements_that_are_absurd_are_told_at_their_knob(wrong: str) -> None:
    page = Page(Requirements)
    for path in ("max_range", "range_resolution", "max_velocity", "velocity_resolution", "carrier"):
        unit = {"max_range": "m", "range_resolution": "m", "carrier": "Hz"}.get(path, "m/s")
        page.type(path, wrong.replace("m/s", unit))
        assert "wrong" in page.knob(path).css_classes and "expected" in page.words[0]
        page.knob(path).value = page.knob(path).tags[0]


def test_requirements_that_no_chirp_can_have_are_told_at_their_knob_and_not_kept() -> None:
    page = Page(Requirements)
    page.type("max_velocity", "1e-9 m/s")
    assert any("Chirp.sample_rate" in words for words in page.words)
    page.type("max_range", "140 m")  # of the others one may still be changed
    page.press("Use this radar")
    radar = page.scenario.radar
    assert radar is not None
    assert radar.frame.max_velocity_m_per_s == pytest.approx(50.0, rel=1e-4)


def test_a_rule_that_has_no_chirp_for_the_requirements_says_so_until_another_has() -> None:
    page = Page(Requirements)
    page.type("range_resolution", "1e9 m")
    (take,) = (one for one in page.widgets(Button) if one.label == "Use this radar")
    (rule,) = (one for one in page.widgets(Select) if one.title == "Rule")
    rule.value = next(one for one in rule.options if one != "constraints")
    assert take.disabled and any("Chirp.slope" in one.text for one in page.widgets(Div))
    rule.value = "constraints"
    assert not take.disabled


def test_the_text_that_is_downloaded_runs_to_the_same_result(tmp_path: Path) -> None:
    page = Page(SettingsFile)
    (area,) = page.widgets(TextAreaInput)
    file = tmp_path / "scenario.yaml"
    file.write_text(area.tags[0])
    read = load(file)
    assert read == page.scenario
    assert run(read).detections.equals(run(page.scenario).detections)


def test_a_text_with_mistakes_is_kept_and_what_holds_is_downloaded() -> None:
    page = Page(SettingsFile)
    (area,) = page.widgets(TextAreaInput)
    held, before = area.tags[0], page.scenario
    area.value = held.replace("77 GHz", "77")
    page.press("Apply")
    assert page.scenario == before and area.tags[0] == held
    assert "radar.frame.chirp.start_frequency" in page.words[0] and ":6:" in page.words[0]
    area.value = held.replace("seed: 3", "seed: 4")
    page.press("Apply")
    assert page.scenario.seed == 4


@pytest.mark.parametrize("kind", PANELS)
def test_every_widget_has_words_of_its_own(kind: type[Panel]) -> None:
    page = Page(kind)
    for one in page.widgets(TextInput, TextAreaInput, Select):
        assert one.title
    for one in page.widgets(Button, Checkbox):
        assert one.label
    for one in page.widgets(TextInput):
        assert "Needs" in one.html_attributes["aria-description"]


@pytest.mark.parametrize("kind", PANELS)
def test_a_recording_without_a_scene_has_fewer_knobs(kind: type[Panel], tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"")
    limits = PageLimits(folders=(tmp_path,))
    scenario = parse_scenario("recording: {path: a.bin}", limits)
    panel = kind(Session(Document(), ThreadPoolExecutor(1), scenario, limits))
    shown = [
        one.html_attributes.get("data-setting", "")
        for one in panel.root.references()
        if isinstance(one, TextInput | Select)
    ]
    assert not any(path.startswith(("scene", "radar")) for path in shown)
