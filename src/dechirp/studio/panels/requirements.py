"""Panel of requirements, with the designed radar and its findings."""

import math
from collections.abc import Callable
from dataclasses import replace
from html import escape
from typing import get_args

from bokeh.models import Button, Column, Div, Select, UIElement

from dechirp.config.dumping import dump_yaml
from dechirp.config.fields import list_settings
from dechirp.config.loading import parse_settings
from dechirp.core.errors import DechirpError, InvalidFile
from dechirp.core.findings import Finding
from dechirp.core.text import format_number, format_with_si_prefix
from dechirp.experiments.scenario import Scenario
from dechirp.radar.design.derived import DerivedValue
from dechirp.radar.design.design import (
    DEFAULT_RULE,
    EXAMPLE_REQUIREMENTS,
    TYPICAL_HARDWARE,
    Design,
    Rule,
    design,
)
from dechirp.radar.design.requirements import Requirements as DesignRequirements
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.studio.panels.arrays import replace_radar_and_adapt_processing
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.knob_widgets import KnobForm
from dechirp.studio.panels.knobs import overrides_for_knob_text
from dechirp.studio.scenario_edits import check_scenario_within_limits
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_DIGITS = 6


def apply_design(scenario: Scenario, design: Design) -> Scenario:
    """Return the scenario with the waveform of a design and its own receivers.

    Only one transmitter is used: TDM would divide the unambiguous velocity. The frame period is
    kept if there is time.
    """
    radar, frame = scenario.radar, round_frame_to_six_digits(design.radar.frame)
    if radar is None:
        return replace_radar_and_adapt_processing(scenario, replace(design.radar, frame=frame))
    period_s = radar.frame.period_s
    if period_s is not None and period_s >= frame.duration_s:
        frame = replace(frame, period_s=period_s)
    array = replace(radar.array, tx_m=radar.array.tx_m[:1])
    chain = replace(scenario.chain, n_range_bins=None, n_velocity_bins=None)
    new_radar = replace(design.radar, frame=frame, array=array)
    return replace_radar_and_adapt_processing(replace(scenario, chain=chain), new_radar)


def round_frame_to_six_digits(frame: Frame) -> Frame:
    """Round the frame of a design to six digits; a crystal is stable to five.

    Numbers are rounded so that range cells do not become wider and the unambiguous velocity does
    not decrease. Velocity cells become wider by at most 2e-5 and the unambiguous range decreases
    by as much; a design has a margin of 10 %.
    """
    chirp = frame.chirp
    margin_s = max(0.0, chirp.ramp_duration_s - chirp.adc_start_s - chirp.sampled_duration_s)
    # 1e-6 shorter: a steeper ramp has a shorter wavelength in its middle.
    adc_start_s, ramp_s, interval_s = (
        _round_to_six_digits(chirp.adc_start_s, math.ceil),
        _round_to_six_digits(chirp.ramp_duration_s * (1 - 1e-6), math.floor),
        _round_to_six_digits(frame.single_interval_s * (1 - 1e-6), math.floor),
    )
    rate_hz = _round_to_six_digits(chirp.n_samples / (ramp_s - adc_start_s - margin_s), math.ceil)
    slope_hz_per_s = _round_to_six_digits(
        chirp.sampled_bandwidth_hz * rate_hz / chirp.n_samples, math.ceil
    )
    rounded_chirp = replace(
        chirp,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=rate_hz,
        slope_hz_per_s=slope_hz_per_s,
    )
    return replace(frame, chirp=rounded_chirp, interval_s=interval_s)


def _round_to_six_digits(number: float, rounding: Callable[[float], int]) -> float:
    """Round to six digits, up or down; numbers with fewer digits stay unchanged."""
    if not number:
        return number
    unit = 10.0 ** (math.floor(math.log10(number)) + 1 - _DIGITS)
    nearest = round(number / unit)
    digits = (
        nearest if math.isclose(nearest, number / unit, rel_tol=1e-12) else rounding(number / unit)
    )
    return float(f"{digits * unit:.{_DIGITS}g}")


_OUT_OF_DATE = "Out of date: a requirement above is wrong"


class Requirements(Panel):
    """Knobs of requirements, the designed radar, and a button that applies it."""

    name = "requirements"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._requirements = EXAMPLE_REQUIREMENTS
        self._hardware = _scenario_or_typical_hardware(session.scenario)
        self._design: Design | None = None
        """None if the rule has no solution."""
        self._title = self._body = ""
        self._used_design: Design | None = None
        """Design of the radar in use, until its waveform is changed."""
        self._rule = Select(
            title="Rule",
            options=list(get_args(Rule)),
            value=DEFAULT_RULE,
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
            html_attributes={
                "title": "Chirps of 5.5 round trips, or the limits of timing, hardware and"
                " regulation."
            },
        )
        self._form = KnobForm(
            EXAMPLE_REQUIREMENTS,
            lambda _: list_settings(DesignRequirements),
            self._change_requirement_and_redesign,
        )
        self._use_button = Button(
            label="Use this radar", button_type="primary", margin=(6, 0, 6, 0)
        )
        self._use_button.sizing_mode = "stretch_width"
        self._answer = Div(sizing_mode="stretch_width", disable_math=True)
        self._root = Column(
            name=self.name,
            children=[self._form.root_element, self._rule, self._use_button, self._answer],
            sizing_mode="stretch_width",
            spacing=0,
        )
        self._rule.on_change(
            "value", lambda attr, old, new: self._design_and_show(self._requirements)
        )
        self._use_button.on_click(self._apply_design_to_scenario)
        self._form.on_marks.append(self._show_design)
        session.on_settings.append(self._redesign_if_hardware_changed)
        session.setting_findings.append(self._findings_on_used_design)
        self._design_and_show(EXAMPLE_REQUIREMENTS)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _change_requirement_and_redesign(self, path: str, text: str) -> None:
        try:
            requirements = change_requirement(self._requirements, path, text)
        except DechirpError as error:
            self._form.show_mistakes(error.mistakes)
        else:
            self._design_and_show(requirements)

    def _design_and_show(self, requirements: DesignRequirements) -> None:
        """Design a radar; without a solution, show the reason and keep the last requirements."""
        try:
            new_design = design(requirements, rule=self._rule.value, hardware=self._hardware)
        except DechirpError as error:
            self._form.show_mistakes(error.mistakes)
            if requirements == self._requirements:  # the changed rule has no solution
                self._design, self._title = None, "No radar"
                self._body = "<br>".join(escape(str(mistake)) for mistake in error.mistakes)
        else:
            self._requirements, self._design, self._body = (
                requirements,
                new_design,
                _design_html(new_design),
            )
            self._title = "Met" if new_design.is_met else "Cannot be met: the nearest radar"
            self._form.show_settings_of(requirements)
        self._show_design()

    def _show_design(self) -> None:
        """Show the answer, greyed out while a knob is invalid."""
        is_old = self._form.has_wrong_text
        self._answer.text = f"<h2>{_OUT_OF_DATE if is_old else self._title}</h2>{self._body}"
        self._answer.styles = {"opacity": "0.5" if is_old else "1"}
        self._use_button.disabled = is_old or self._design is None

    def _redesign_if_hardware_changed(self, scenario: Scenario) -> None:
        """Design again if the hardware of the scenario has changed."""
        hardware = _scenario_or_typical_hardware(scenario)
        if hardware != self._hardware:
            self._hardware = hardware
            self._design_and_show(self._requirements)

    def _apply_design_to_scenario(self) -> None:
        chosen_design = self._design
        if chosen_design is not None:
            self._used_design = chosen_design
            self.session.queue_edit(
                "radar",
                lambda scenario: check_scenario_within_limits(
                    apply_design(scenario, chosen_design), self.session.limits
                ),
            )

    def _findings_on_used_design(self, scenario: Scenario) -> tuple[Finding, ...]:
        """Return the requirements that the radar in use misses, if it was designed here."""
        used = self._used_design
        if used is None or scenario.radar is None:
            return ()
        waveform = round_frame_to_six_digits(used.radar.frame).chirp
        return tuple(used.findings) if scenario.radar.frame.chirp == waveform else ()


def _scenario_or_typical_hardware(scenario: Scenario) -> Hardware:
    radar = scenario.radar
    return (None if radar is None else radar.hardware) or TYPICAL_HARDWARE


def change_requirement(
    requirements: DesignRequirements, path: str, text: str
) -> DesignRequirements:
    """Return the requirements with one of them changed to a text.

    Raises
    ------
    DechirpError
        As `dechirp design` refuses its options, or if the text of a needed one is empty.
    """
    try:
        return parse_settings(
            dump_yaml(requirements),
            DesignRequirements,
            file="",
            overrides=overrides_for_knob_text(requirements, path, text),
        )
    except InvalidFile as error:
        mistakes = (
            replace(mistake, file=None, line=None, column=None) for mistake in error.mistakes
        )
        raise InvalidFile(*mistakes) from None


def _design_html(result: Design) -> str:
    """Return the findings and derived values of a design as HTML."""
    findings = "".join(
        f"<p class='finding'>{escape(str(derived))}</p>" for derived in result.findings
    )
    rows = "".join(
        f"<tr title='{escape(derived.symbols)}'><td>{escape(derived.name.replace('_', ' '))}</td>"
        f"<td>{escape(_format_derived_value(derived))}</td><td>{escape(derived.formula)}</td></tr>"
        for derived in result.derived
    )
    return f"{findings}<table class='follows' aria-label='Design'>{rows}</table>"


def _format_derived_value(derived: DerivedValue) -> str:
    if derived.unit == "1":
        return format_number(derived.value)
    if derived.unit == "Hz/s":
        return f"{format_number(derived.value / 1e12)} MHz/µs"
    return (
        f"{format_number(derived.value)} m/s"
        if derived.unit == "m/s"
        else format_with_si_prefix(derived.value, derived.unit)
    )
