"""What a radar should do: the design answers with one, and with what it cannot do."""

from dataclasses import replace
from html import escape
from typing import get_args, get_type_hints

from bokeh.models import Button, Column, Div, Select, UIElement

from dechirp.config.fields import settings
from dechirp.config.files import parse
from dechirp.config.texts import dump
from dechirp.core.errors import DechirpError, InvalidFile
from dechirp.experiment.scenario import Scenario
from dechirp.radar.derived import Derived
from dechirp.radar.design import TYPICAL_HARDWARE, Design, design
from dechirp.radar.requirements import Requirements as Asked
from dechirp.report.words import number, quantity
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.fields import Form
from dechirp.studio.session import Session
from dechirp.studio.settings import checked
from dechirp.studio.theme import Theme

_START = Asked(max_range_m=150.0, range_resolution_m=1.0, max_velocity_m_per_s=50.0)
_RULES = get_args(get_type_hints(design)["rule"])


class Requirements(Panel):
    """Knobs of requirements, the radar that meets them, and a button that takes it."""

    name = "requirements"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._asked = _START
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
        radar = self.session.scenario.radar
        hardware = None if radar is None else radar.hardware
        try:
            made = design(asked, rule=self._rule.value, hardware=hardware or TYPICAL_HARDWARE)
        except DechirpError as error:
            self._form.tell(error.mistakes)
            if asked == self._asked:  # it is the rule that was changed, and has no such chirp
                self._answer.text = "<br>".join(escape(str(one)) for one in error.mistakes)
                self._take.disabled = True
            return
        self._asked, self._design = asked, made
        self._form.show(asked)
        self._answer.text, self._take.disabled = _answer(made), False

    def _taken(self) -> None:
        made = self._design
        self.session.edit(
            "radar", lambda scenario: checked(with_design(scenario, made), self.session.limits)
        )


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


def with_design(scenario: Scenario, made: Design) -> Scenario:
    """A scenario with the waveform of a design, and the receivers that it had.

    One transmitter sends, for several that take turns would divide the largest velocity. Frames
    come as often as before where there is time.
    """
    radar = scenario.radar
    if radar is None:
        return replace(scenario, radar=made.radar)
    frame, period_s = made.radar.frame, radar.frame.period_s
    if period_s is not None and period_s >= frame.duration_s:
        frame = replace(frame, period_s=period_s)
    array = replace(radar.array, tx_m=radar.array.tx_m[:1])
    chain = replace(scenario.chain, n_range_bins=None, n_velocity_bins=None)
    taken = replace(made.radar, frame=frame, array=array)
    return replace(scenario, radar=taken, chain=chain)


def _answer(made: Design) -> str:
    """The numbers of a design with their formulas, after what it cannot do."""
    title = "Met" if made.met else "Cannot be met: the nearest radar"
    findings = "".join(f"<p class='finding'>{escape(str(one))}</p>" for one in made.findings)
    rows = "".join(
        f"<tr title='{escape(one.uses)}'><td>{escape(one.name.replace('_', ' '))}</td>"
        f"<td>{escape(_with_unit(one))}</td><td>{escape(one.formula)}</td></tr>"
        for one in made.derived
    )
    return f"<h3>{title}</h3>{findings}<table class='follows' aria-label='Design'>{rows}</table>"


def _with_unit(one: Derived) -> str:
    if one.unit == "1":
        return number(one.value)
    if one.unit == "Hz/s":
        return f"{number(one.value / 1e12)} MHz/µs"
    return f"{number(one.value)} m/s" if one.unit == "m/s" else quantity(one.value, one.unit)
