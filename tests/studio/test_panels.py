"""Panels of the studio: knobs, arrays, designs, targets and settings files."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from bokeh.models import Button, Checkbox, Div, Select, TextAreaInput, TextInput

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiments.run import run
from dechirp.experiments.scenario import Scenario, load
from dechirp.radar.budget import noise_power_w
from dechirp.radar.design.design import EXAMPLE_REQUIREMENTS
from dechirp.studio.panels.arrays import linear_array_tdm_overrides
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.hardware import Hardware
from dechirp.studio.panels.knobs import Knob, overrides_for_knob_text, setting_knobs
from dechirp.studio.panels.processing import Processing
from dechirp.studio.panels.radar import Radar
from dechirp.studio.panels.requirements import Requirements, apply_design, round_frame_to_six_digits
from dechirp.studio.panels.settings_file import SettingsFile
from dechirp.studio.panels.targets import Targets, replace_noise_model
from dechirp.studio.scenario_edits import PageLimits, apply_overrides, parse_scenario
from dechirp.studio.session import Session
from nightly import n_examples, nightly, nightly_except

SETTINGS = """
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
TOP_LEVEL_SETTINGS = (
    "name",
    "seed",
    "n_frames",
    "radar",
    "scene",
    "engine",
    "impairments",
    "chain",
)
LIMITS = PageLimits()


class Page:
    """Session that applies edits immediately instead of in its worker."""

    def __init__(self, kind: type[Panel], text: str = SETTINGS) -> None:
        self.session = Session(
            Document(), ThreadPoolExecutor(1), parse_scenario(text, LIMITS), LIMITS
        )
        self.panel = kind(self.session)
        self.session.document.add_root(self.panel.root_element)

    @property
    def scenario(self) -> Scenario:
        return self.session.scenario

    def find_knob(self, path: str) -> Any:
        matches = [
            widget
            for widget in self.find_widgets(Checkbox, Select, TextInput)
            if widget.html_attributes.get("data-setting") == path
        ]
        assert len(matches) == 1, path
        return matches[0]

    def find_widgets(self, *kinds: type) -> list[Any]:
        return [
            widget for widget in self.panel.root_element.references() if isinstance(widget, kinds)
        ]

    def press_button(self, label: str, title: str = "") -> None:
        (button,) = (
            widget
            for widget in self.find_widgets(Button)
            if widget.label == label and widget.html_attributes.get("title", "") == title
        )
        button._trigger_event(ButtonClick(button))
        self.apply_edits()

    def type_setting(self, path: str, text: str) -> None:
        self.find_knob(path).value = text
        self.apply_edits()

    def apply_edits(self) -> None:
        edits = list(self.session._edits.values())
        self.session._edits.clear()
        try:
            for edit in edits:
                self.session.scenario = edit(self.session.scenario)
        except DechirpError as error:
            for report in self.session.on_mistakes:
                report(error.mistakes)
            return
        if edits:
            for update in self.session.on_settings:
                update(self.session.scenario)

    @property
    def messages(self) -> list[str]:
        return [
            widget.text
            for widget in self.find_widgets(Div)
            if widget.visible and "wrong" in widget.css_classes
        ]


def list_knobs() -> list[Knob]:
    scenario = parse_scenario(SETTINGS, LIMITS)
    return [
        entry
        for path in (*TOP_LEVEL_SETTINGS, "tracker")
        for entry in setting_knobs(scenario, path)
    ]


@nightly
def test_typing_shown_knob_text_leaves_scenario_unchanged() -> None:
    scenario = parse_scenario(SETTINGS, LIMITS)
    for entry in list_knobs():
        if not entry.text.startswith("{"):  # members and enabled sections start with defaults
            edited_scenario = apply_overrides(
                scenario, overrides_for_knob_text(scenario, entry.path, entry.text), LIMITS
            )
            assert edited_scenario == scenario, entry


@nightly
def test_family_choices_apply_or_wait_for_required_settings() -> None:
    page = Page(Processing)
    for kind in (text for text, _ in page.find_knob("chain.cfar.estimator").options):
        page.type_setting("chain.cfar.estimator", kind)
        assert f"{{kind: {page.scenario.chain.cfar.estimator.kind()}}}" == kind
    page = Page(Hardware)
    initial_scenario = page.scenario
    page.find_knob("impairments.bumper").active = True
    page.apply_edits()
    assert page.scenario == initial_scenario  # required settings are missing
    page.type_setting("impairments.bumper.distance", "5 cm")
    assert page.scenario == initial_scenario
    page.type_setting("impairments.bumper.reflectivity", "-10 dB")
    assert page.scenario.impairments[-1].kind() == "bumper"
    page.find_knob("impairments.bumper").active = False
    page.apply_edits()
    assert page.scenario == initial_scenario


@nightly
def test_invalid_value_is_reported_at_knob_and_escape_restores_it() -> None:
    page = Page(Radar)
    initial_scenario = page.scenario
    knob = page.find_knob("radar.frame.chirp.slope")
    for text in ("20", "20 MHz", "nan", "1e30 MHz/us", "import os", "&a 1", "!!float 1"):
        page.type_setting("radar.frame.chirp.slope", text)
        assert page.scenario == initial_scenario
        assert "wrong" in knob.css_classes and knob.value == text
        (message,) = page.messages
        assert "expected" in message
    knob.value = knob.tags[0]  # like page.js
    assert not page.messages and "wrong" not in knob.css_classes


def test_conflicting_value_is_reported_at_edited_knob() -> None:
    page = Page(Radar)
    page.type_setting("radar.frame.chirp.n_samples", "4096")
    assert "wrong" in page.find_knob("radar.frame.chirp.n_samples").css_classes
    assert any("radar.frame.chirp.ramp_duration: " in message for message in page.messages)
    page.type_setting("radar.frame.chirp.slope", "12 MHz/us")
    assert page.messages  # the text is kept, to be tried again
    page.type_setting("radar.frame.chirp.n_samples", "128")
    assert not page.messages
    assert page.find_knob("radar.frame.chirp.n_samples").value == "128"


@pytest.mark.parametrize(
    ("path", "typed", "shown", "value"),
    nightly_except(
        1,
        [
            ("radar.hardware.noise_factor", "18", "18 dB", 10**1.8),
            ("radar.hardware.transmit_power", "-3", "-3 dBm", 1e-3 * 10**-0.3),
            ("radar.hardware.noise_factor", "12", "12 dB", 10**1.2),
        ],
    ),
)
def test_bare_number_in_field_of_decibels_has_its_unit(
    path: str, typed: str, shown: str, value: float
) -> None:
    page = Page(Hardware)
    page.type_setting(path, typed)
    assert page.find_knob(path).value == shown
    hardware = page.scenario.radar.hardware
    setting = {
        "noise_factor": hardware.noise_factor,
        "transmit_power": hardware.transmit_power_w,
    }[path.rpartition(".")[2]]
    assert setting == pytest.approx(value)


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (
            "",
            "empty; expected a number or a ratio, such as 4 or 6 dB; type one, or press Escape for"
            " the value before",
        ),
        (
            "-5",
            "-5 dB; expected at least 0 dB; give a noise factor without a minus sign, such as 3 dB",
        ),
    ],
)
def test_refused_field_of_decibels_states_what_is_expected(typed: str, message: str) -> None:
    page = Page(Hardware)
    mistakes: list[Mistake] = []
    page.session.on_mistakes.append(mistakes.extend)
    page.type_setting("radar.hardware.noise_factor", typed)
    assert page.messages == [message]
    assert {mistake.setting for mistake in mistakes} == {"radar.hardware.noise_factor"}


def test_typed_value_is_shown_in_settings_file_format() -> None:
    page = Page(Radar)
    page.type_setting("radar.frame.chirp.start_frequency", "77000 MHz")
    assert page.find_knob("radar.frame.chirp.start_frequency").value == "77 GHz"


@pytest.mark.parametrize(("n_tx", "n_rx"), [(1, 4), (2, 4), (3, 4)])
def test_linear_array_has_half_wavelength_virtual_spacing(n_tx: int, n_rx: int) -> None:
    scenario = parse_scenario(SETTINGS, LIMITS)
    assert scenario.radar is not None
    radar = apply_overrides(
        scenario, linear_array_tdm_overrides(scenario.radar, n_tx, n_rx), LIMITS
    ).radar
    assert radar is not None
    positions_m = sorted(radar.array.virtual_positions_m[:, 1])
    half_m = radar.frame.chirp.wavelength_m / 2
    assert np.diff(positions_m) == pytest.approx([half_m] * (n_tx * n_rx - 1), abs=1e-6)
    assert radar.frame.n_slots == n_tx


def check_single_element(page: Page) -> None:
    radar, scenario = page.scenario.radar, page.scenario
    assert radar is not None and len(radar.element_positions_m) == 1
    assert scenario.tracker is None and scenario.ego_motion is None
    assert not page.messages


@pytest.mark.parametrize("angle", ["capon", "fft"])
def test_choosing_single_element_disables_direction_processing(
    angle: str,
) -> None:
    page = Page(Radar, SETTINGS.replace("capon", angle))
    (rows,) = (widget for widget in page.find_widgets(Select) if widget.title == "Array in a row")
    rows.value = "1 1"
    page.apply_edits()
    check_single_element(page)
    assert any("Directions" in widget.text for widget in page.find_widgets(Div))
    rows.value = "1 4"
    page.apply_edits()
    assert page.scenario.chain.fit_to_radar(page.scenario.radar).angle is not None


def test_element_positions_can_be_edited_one_setting_at_a_time() -> None:
    page = Page(Radar)
    page.type_setting("radar.array.rx", "[[0, 0, 0]]")
    assert page.scenario.tracker is not None  # two transmitters still resolve directions
    page.type_setting("radar.array.tx", "[[0, 0, 0]]")
    check_single_element(page)
    page.type_setting("radar.array.tx", "[[0, 0, 0], [0, 2 mm, 0], [0, 4 mm, 0]]")
    assert page.scenario.radar.frame.n_slots == 3  # type: ignore[union-attr]
    page.type_setting("radar.array.tx", "[[0, 0, 0], 2 mm]")
    assert page.messages and page.scenario.radar.frame.n_slots == 3  # type: ignore[union-attr]


def test_refused_array_choice_is_reset() -> None:
    page = Page(Radar, SETTINGS.replace("n_chirps: 32", "n_chirps: 600"))
    (rows,) = (widget for widget in page.find_widgets(Select) if widget.title == "Array in a row")
    initial_scenario, initial_choice = page.scenario, rows.value
    rows.value = "4 4"  # 84 ms exceed the period of 50 ms
    page.apply_edits()
    assert page.scenario == initial_scenario and rows.value == initial_choice


def test_detector_has_false_alarm_probability_or_offset() -> None:
    page = Page(Processing)
    page.type_setting("chain.cfar.offset", "15 dB")
    assert page.scenario.chain.cfar.false_alarm_probability is None
    page.type_setting("chain.cfar.false_alarm_probability", "1e-4")
    assert page.scenario.chain.cfar.offset is None


def test_noise_set_by_target_snr_equals_receiver_noise() -> None:
    scenario = parse_scenario(SETTINGS, LIMITS)
    white_noise_scenario = replace_noise_model(scenario, "white")
    assert scenario.scene is not None and scenario.radar is not None
    noise_w = white_noise_scenario.impairments[0].noise_power_w(scenario.scene, scenario.radar)
    assert noise_w == pytest.approx(noise_power_w(scenario.radar), rel=0.012)  # 0.05 dB
    assert replace_noise_model(white_noise_scenario, "thermal") == scenario


def test_targets_and_their_knobs_can_be_added_and_removed() -> None:
    page = Page(Targets)
    assert page.scenario.scene is not None
    names = page.scenario.scene.names
    page.press_button("Add a target")
    assert page.scenario.scene.names == (*names, "target-1")
    page.type_setting("scene.targets.target-1.rcs", "3 dBsm")
    # Defines its own cross sections.
    page.type_setting("scene.targets.target-1.body", "{kind: car}")
    assert page.scenario.scene.targets[-1].body is not None
    page.press_button("Remove", "Remove target 1")
    assert page.scenario.scene.names == (*names[1:], "target-1")
    page.type_setting("scene.targets.0.position", "[50 m, 0, 0]")  # a.b cannot be a path component
    assert page.scenario.scene.targets[0].position_m == (50.0, 0.0, 0.0)


def select_rule(page: Page, value: str) -> Select:
    """Select a rule of the design page, and return its widget."""
    (rule,) = (widget for widget in page.find_widgets(Select) if widget.title == "Rule")
    rule.value = value
    return rule


def test_design_keeps_receivers_and_hardware_of_radar() -> None:
    page = Page(Requirements)
    initial_radar = page.scenario.radar
    assert initial_radar is not None
    page.type_setting("max_range", "100 m")
    page.type_setting("max_velocity", "30 m/s")
    page.press_button("Use this radar")
    radar = page.scenario.radar
    assert radar is not None
    requirements = {"max_range_m": 100, "range_resolution_m": 1, "max_velocity_m_per_s": 30}
    designed_frame = dc.design(**requirements).radar.frame
    assert radar.frame == replace(
        round_frame_to_six_digits(designed_frame), period_s=initial_radar.frame.period_s
    )
    assert radar.array.rx_m == initial_radar.array.rx_m and radar.hardware == initial_radar.hardware


@pytest.mark.parametrize("rule", ["constraints", "round-trips"])
def test_design_rounded_to_six_digits_meets_requirements(rule: Any) -> None:
    rng = np.random.default_rng(10)
    for _ in range(n_examples(50)):
        max_range_m, range_resolution_m, max_velocity_m_per_s = rng.uniform(
            (20, 0.3, 1), (200, 2, 15)
        )
        requirements = {"max_range_m": max_range_m, "range_resolution_m": range_resolution_m}
        design = dc.design(**requirements, max_velocity_m_per_s=max_velocity_m_per_s, rule=rule)
        assert design.is_met
        frame = round_frame_to_six_digits(design.radar.frame)
        assert frame.chirp.range_resolution_m <= range_resolution_m * (1 + 1e-12)
        assert frame.chirp.max_range_m >= max_range_m
        assert frame.max_velocity_m_per_s >= max_velocity_m_per_s
        scenario = apply_design(parse_scenario(SETTINGS, LIMITS), design)
        texts = [knob.text for knob in setting_knobs(scenario, "radar.frame")]
        # A leading zero and six digits.
        assert max(sum(map(str.isdigit, text)) for text in texts) <= 7, texts


def test_infeasible_requirements_give_nearest_design() -> None:
    page = Page(Requirements)
    page.type_setting("max_velocity", "3000 m/s")
    answer = "".join(widget.text for widget in page.find_widgets(Div))
    assert "nearest" in answer and "expected" in answer
    page.type_setting("max_range", "100")
    assert any("a length" in message for message in page.messages)


def test_used_design_that_cannot_be_met_leaves_its_findings() -> None:
    page = Page(Requirements)
    select_rule(page, "constraints")
    page.type_setting("range_resolution", "0.1 m")
    page.type_setting("max_velocity", "90 m/s")
    (find_findings,) = page.session.setting_findings
    assert find_findings(page.scenario) == ()
    page.press_button("Use this radar")
    findings = find_findings(page.scenario)
    assert any(finding.level == "error" for finding in findings)
    assert any("max_velocity" in finding.setting for finding in findings)
    chirp = replace(page.scenario.radar.frame.chirp, n_samples=32)
    frame = replace(page.scenario.radar.frame, chirp=chirp)
    changed = replace(page.scenario, radar=replace(page.scenario.radar, frame=frame))
    assert find_findings(changed) == ()  # of another waveform


def find_design_button_and_answer(page: Page) -> tuple[Button, Div]:
    (button,) = (widget for widget in page.find_widgets(Button) if widget.label == "Use this radar")
    (answer,) = (
        widget for widget in page.find_widgets(Div) if "aria-label='Design'" in widget.text
    )
    return button, answer


def test_invalid_requirement_marks_design_out_of_date() -> None:
    page = Page(Requirements)
    button, answer = find_design_button_and_answer(page)
    valid_answer = answer.text
    assert "<h2>Met" in valid_answer and not button.disabled
    for path, text in (("max_range", "150"), ("max_velocity", "-1 m/s"), ("rcs", "1 m")):
        page.type_setting(path, text)
        assert page.messages and button.disabled and "<h2>Out of date" in answer.text, text
        page.find_knob(path).value = page.find_knob(path).tags[0]  # like page.js on Escape
        assert not page.messages and not button.disabled and answer.text == valid_answer, text
    page.type_setting("max_range", "150")
    page.type_setting("max_range", "120 m")
    assert not button.disabled and "Out of date" not in answer.text and answer.text != valid_answer


def test_design_uses_current_hardware_of_radar() -> None:
    page = Page(Requirements)
    page.session.change_setting("radar.hardware.noise_factor", "9 dB")
    page.apply_edits()
    page.press_button("Use this radar")
    radar = page.scenario.radar
    assert radar is not None and radar.hardware is not None
    assert radar.hardware.noise_factor == pytest.approx(10**0.9)


@pytest.mark.parametrize(
    "value", nightly_except(2, ["1e-300 m/s", "1e300 m/s", "0 m/s", "-1 m/s", "nan", ".inf m/s"])
)
def test_absurd_requirements_are_reported_at_their_knob(value: str) -> None:
    page = Page(Requirements)
    for path in ("max_range", "range_resolution", "max_velocity", "velocity_resolution", "carrier"):
        unit = {"max_range": "m", "range_resolution": "m", "carrier": "Hz"}.get(path, "m/s")
        page.type_setting(path, value.replace("m/s", unit))
        assert "wrong" in page.find_knob(path).css_classes and "expected" in page.messages[0]
        page.find_knob(path).value = page.find_knob(path).tags[0]


def test_requirements_beyond_any_chirp_are_reported_and_not_kept() -> None:
    page = Page(Requirements)
    select_rule(page, "constraints")
    page.type_setting("max_velocity", "1e-9 m/s")
    assert any("Chirp.sample_rate" in message for message in page.messages)
    page.type_setting("max_range", "140 m")  # the other requirements can still be changed
    page.press_button("Use this radar")
    radar = page.scenario.radar
    assert radar is not None
    assert radar.frame.max_velocity_m_per_s == pytest.approx(100.0, rel=1e-4)


def test_design_page_opens_with_defaults_of_command_line_and_library(
    capsys: pytest.CaptureFixture[str],
) -> None:
    requirements = ("--max-range", "200m", "--range-resolution", "1m", "--max-velocity", "100m/s")
    with pytest.raises(SystemExit):
        main(["design", *requirements, "--json"])
    derived = json.loads(capsys.readouterr().out)["derived"]
    (answer,) = (div for div in Page(Requirements).find_widgets(Div) if "<table" in div.text)

    assert list(derived) == [value.name for value in dc.design(EXAMPLE_REQUIREMENTS).derived]
    for name, value in derived.items():
        assert f"<td>{name.replace('_', ' ')}</td>" in answer.text
        assert escape(value["formula"]) in answer.text
    assert dc.design(EXAMPLE_REQUIREMENTS).radar.frame.chirp.n_samples == 2200  # of the reference


def test_rule_without_feasible_chirp_is_reported_until_changed() -> None:
    page = Page(Requirements)
    (button,) = (widget for widget in page.find_widgets(Button) if widget.label == "Use this radar")
    rule = select_rule(page, "constraints")
    page.type_setting("range_resolution", "1e9 m")
    rule.value = next(widget for widget in rule.options if widget != "constraints")
    assert button.disabled and any(
        "Chirp.slope" in widget.text for widget in page.find_widgets(Div)
    )
    rule.value = "constraints"
    assert not button.disabled


@nightly
def test_downloaded_settings_reproduce_result(tmp_path: Path) -> None:
    page = Page(SettingsFile)
    (area,) = page.find_widgets(TextAreaInput)
    file = tmp_path / "scenario.yaml"
    file.write_text(area.tags[0])
    loaded_scenario = load(file)
    assert loaded_scenario == page.scenario
    assert run(loaded_scenario).detections.equals(run(page.scenario).detections)


def test_invalid_text_is_kept_and_valid_settings_are_downloaded() -> None:
    page = Page(SettingsFile)
    (area,) = page.find_widgets(TextAreaInput)
    valid_text, initial_scenario = area.tags[0], page.scenario
    area.value = valid_text.replace("77 GHz", "77")
    page.press_button("Apply")
    assert page.scenario == initial_scenario and area.tags[0] == valid_text
    assert "radar.frame.chirp.start_frequency" in page.messages[0] and ":6:" in page.messages[0]
    area.value = valid_text.replace("seed: 3", "seed: 4")
    page.press_button("Apply")
    assert page.scenario.seed == 4


@pytest.mark.parametrize("kind", PANELS)
def test_every_widget_has_label(kind: type[Panel]) -> None:
    page = Page(kind)
    for widget in page.find_widgets(TextInput, TextAreaInput, Select):
        assert widget.title
    for widget in page.find_widgets(Button, Checkbox):
        assert widget.label
    for widget in page.find_widgets(TextInput):
        assert "Needs" in widget.html_attributes["aria-description"]


@pytest.mark.parametrize("kind", PANELS)
def test_recording_has_no_knobs_for_scene_and_radar(kind: type[Panel], tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"")
    limits = PageLimits(folders=(tmp_path,))
    scenario = parse_scenario("recording: {path: a.bin}", limits)
    panel = kind(Session(Document(), ThreadPoolExecutor(1), scenario, limits))
    setting_paths = [
        widget.html_attributes.get("data-setting", "")
        for widget in panel.root_element.references()
        if isinstance(widget, TextInput | Select)
    ]
    assert not any(path.startswith(("scene", "radar")) for path in setting_paths)
