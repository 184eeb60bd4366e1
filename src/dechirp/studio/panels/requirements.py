"""What a radar should do: the design answers with one, and with what it cannot do."""

from dataclasses import replace
from html import escape
from typing import get_args, get_type_hints

from bokeh.models import Button, Column, Div, Select, UIElement

from dechirp.config.fields import settings
from dechirp.config.files import parse
from dechirp.config.texts import dump
from dechirp.core.errors import DechirpError, InvalidFile
from dechirp.core.words import number, quantity
from dechirp.experiment.scenario import Scenario
from dechirp.radar.derived import Derived
from dechirp.radar.design import TYPICAL_HARDWARE, Design, design
from dechirp.radar.hardware import Hardware
from dechirp.radar.requirements import Requirements as Asked
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.fields import Form
from dechirp.studio.panels.taken import with_design
from dechirp.studio.session import Session
from dechirp.studio.settings import checked
from dechirp.studio.theme import Theme

_START = Asked(max_range_m=150.0, range_resolution_m=1.0, max_velocity_m_per_s=50.0)
_OLD = "Out of date: a requirement above is wrong"
_RULES = get_args(get_type_hints(design)["rule"])


class Requirements(Panel):
    """Knobs of requirements, the radar that meets them, and a button that takes it."""

    name = "requirements"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._asked = _START
        self._hardware = _hardware(session.scenario)
        self._design: Design | None = None
        """None where the rule has none for what is asked."""
        self._title = self._said = ""
        self._rule = Select(
            title="Rule",
            options=list(_RULES),
            value="constraints",  # what parts can do; 5.5 round trips to 90 m take 600 MHz
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
            html_attributes={
                "title": "Chirps of 5.5 round trips, or what timeline, parts and regulator allow."
            },
        )
        self._form = Form(_START, lambda _: settings(Asked), self._change)
        self._take = Button(label="Take this radar", button_type="primary", margin=(6, 0, 6, 0))
        self._take.sizing_mode = "stretch_width"
        self._answer = Div(sizing_mode="stretch_width", disable_math=True)
        self._root = Column(
            name=self.name,
            children=[self._form.root, self._rule, self._take, self._answer],
            sizing_mode="stretch_width",
            spacing=0,
        )
        self._rule.on_change("value", lambda attr, old, new: self._ask(self._asked))
        self._take.on_click(self._taken)
        self._form.on_marks.append(self._show)
        session.on_settings.append(self._settle)
        self._ask(_START)

    @property
    def root(self) -> UIElement:
        """The knobs, and the answer below them."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _change(self, path: str, text: str) -> None:
        try:
            asked = asked_with(self._asked, path, text)
        except DechirpError as error:
            self._form.tell(error.mistakes)
        else:
            self._ask(asked)

    def _ask(self, asked: Asked) -> None:
        """Answer requirements; where no chirp can be made, say why and keep the last ones."""
        try:
            made = design(asked, rule=self._rule.value, hardware=self._hardware)
        except DechirpError as error:
            self._form.tell(error.mistakes)
            if asked == self._asked:  # it is the rule that was changed, and has no such chirp
                self._design, self._title = None, "No radar"
                self._said = "<br>".join(escape(str(one)) for one in error.mistakes)
        else:
            self._asked, self._design, self._said = asked, made, _answer(made)
            self._title = "Met" if made.met else "Cannot be met: the nearest radar"
            self._form.show(asked)
        self._show()

    def _show(self) -> None:
        """Show the answer; while a knob is wrong it is that of other requirements."""
        is_old = self._form.is_wrong
        self._answer.text = f"<h3>{_OLD if is_old else self._title}</h3>{self._said}"
        self._answer.styles = {"opacity": "0.5" if is_old else "1"}
        self._take.disabled = is_old or self._design is None

    def _settle(self, scenario: Scenario) -> None:
        """Answer anew where the hardware has changed, which is taken with the radar."""
        hardware = _hardware(scenario)
        if hardware != self._hardware:
            self._hardware = hardware
            self._ask(self._asked)

    def _taken(self) -> None:
        made = self._design
        if made is not None:
            self.session.edit(
                "radar",
                lambda scenario: checked(with_design(scenario, made), self.session.limits),
            )


def _hardware(scenario: Scenario) -> Hardware:
    radar = scenario.radar
    return (None if radar is None else radar.hardware) or TYPICAL_HARDWARE


def asked_with(asked: Asked, path: str, text: str) -> Asked:
    """Requirements with one of them as a text says.

    Raises
    ------
    InvalidFile
        As `dechirp design` refuses its options.
    """
    try:
        return parse(dump(asked), Asked, file="", overrides=[f"{path}={text}"])
    except InvalidFile as error:
        nowhere = (replace(one, file=None, line=None, column=None) for one in error.mistakes)
        raise InvalidFile(*nowhere) from None


def _answer(made: Design) -> str:
    """The numbers of a design with their formulas, after what it cannot do."""
    findings = "".join(f"<p class='finding'>{escape(str(one))}</p>" for one in made.findings)
    rows = "".join(
        f"<tr title='{escape(one.uses)}'><td>{escape(one.name.replace('_', ' '))}</td>"
        f"<td>{escape(_with_unit(one))}</td><td>{escape(one.formula)}</td></tr>"
        for one in made.derived
    )
    return f"{findings}<table class='follows' aria-label='Design'>{rows}</table>"


def _with_unit(one: Derived) -> str:
    if one.unit == "1":
        return number(one.value)
    if one.unit == "Hz/s":
        return f"{number(one.value / 1e12)} MHz/µs"
    return f"{number(one.value)} m/s" if one.unit == "m/s" else quantity(one.value, one.unit)
