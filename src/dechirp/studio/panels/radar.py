"""The waveform and the array, and what follows from them."""

from functools import partial
from html import escape

from bokeh.models import Column, Div, Select, UIElement

from dechirp.core.errors import Mistake
from dechirp.core.words import number, quantity, ratio_db
from dechirp.experiment.scenario import Scenario
from dechirp.process.sources import tells_directions
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar as Settings
from dechirp.studio.panels.arrays import in_a_row, with_array, with_elements
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.entries import written
from dechirp.studio.panels.fields import Form, changer
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_CHIRP = "start_frequency slope adc_start ramp_duration sample_rate n_samples sampling"
_FRAME = "n_chirps interval period multiplexing modulation"
_ARRAY = ("radar.array.tx", "radar.array.rx")
_ROWS = ((1, 1), (1, 4), (1, 8), (2, 4), (3, 4), (4, 4), (2, 8))
"""Transmitters and receivers of arrays in a row, to choose from."""


class Radar(Panel):
    """Waveform, array, and the numbers that follow."""

    name = "radar"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._follows = Div(sizing_mode="stretch_width", disable_math=True)
        self._rows = Select(
            title="Array in a row",
            options=[("", "as below"), *((_text(*row), _shown(*row)) for row in _ROWS)],
            value="",
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
            html_attributes={
                "title": "Elements half a wavelength apart, whose transmitters take turns."
            },
        )
        waveform = [f"radar.frame.chirp.{key}" for key in _CHIRP.split()]
        waveform += [f"radar.frame.{key}" for key in _FRAME.split()]
        self._forms = [
            Form(session.scenario, lambda _: waveform, changer(session)),
            Form(session.scenario, lambda _: _ARRAY, self._place),
        ]
        self._root = Column(
            name=self.name,
            children=[self._follows, self._forms[0].root, self._rows, self._forms[1].root],
            sizing_mode="stretch_width",
            spacing=0,
        )
        self._rows.on_change("value", lambda attr, old, new: self._take(str(new)))
        session.on_settings.append(self._show)
        session.on_trouble += [*(form.tell for form in self._forms), self._put_back]
        self._show(session.scenario)

    @property
    def root(self) -> UIElement:
        """The knobs, with the numbers above."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _show(self, scenario: Scenario) -> None:
        for form in self._forms:
            form.show(scenario)
        self._follows.text = _table(scenario.radar)
        self._rows.visible = scenario.radar is not None
        self._rows.value = _row_of(scenario.radar)

    def _put_back(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show the array that holds, where another was refused."""
        if mistakes:
            self._rows.value = _row_of(self.session.scenario.radar)

    def _take(self, text: str) -> None:
        radar = self.session.scenario.radar
        is_listed = text in (_text(*row) for row in _ROWS)  # a browser may say anything
        if not is_listed or radar is None or text == _row_of(radar):
            return
        n_tx, n_rx = map(int, text.split())
        options, limits = in_a_row(radar, n_tx, n_rx), self.session.limits
        self.session.edit("radar.array", partial(with_array, options=options, limits=limits))

    def _place(self, path: str, text: str) -> None:
        limits = self.session.limits
        self.session.edit(path, partial(with_elements, path=path, text=text, limits=limits))


def _row_of(radar: Settings | None) -> str:
    """Text of the choice that an array is; empty where it is none of them."""
    if radar is None:
        return ""
    n_tx, n_rx = len(radar.array.tx_m), radar.array.n_rx
    if (n_tx, n_rx) not in _ROWS:
        return ""
    made = in_a_row(radar, n_tx, n_rx)[0].partition("=")[2]
    return _text(n_tx, n_rx) if made == written(radar.array) else ""


def _text(n_tx: int, n_rx: int) -> str:
    return f"{n_tx} {n_rx}"


def _shown(n_tx: int, n_rx: int) -> str:
    return f"{n_tx} transmitter{'s' * (n_tx > 1)}, {n_rx} receiver{'s' * (n_rx > 1)}"


def _table(radar: Settings | None) -> str:
    """What follows from a radar, as a table."""
    if radar is None:
        return "The recording says what its radar is."
    frame = radar.at(0).frame
    chirp = frame.chirp
    rows = [
        ("Range resolution", quantity(chirp.range_resolution_m, "m")),
        ("Largest range", f"{number(chirp.max_range_m)} m"),
        ("Velocity resolution", f"{number(frame.velocity_resolution_m_per_s)} m/s"),
        ("Largest velocity", f"± {number(frame.max_velocity_m_per_s)} m/s"),
        ("Wavelength", quantity(chirp.wavelength_m, "m")),
        ("Sampled bandwidth", quantity(chirp.sampled_bandwidth_hz, "Hz")),
    ]
    if not tells_directions(radar):
        rows.append(("Directions", "none, so no tracks"))
    if radar.hardware is not None:
        noise_dbm = ratio_db(noise_power_w(radar)) + 30
        rows.append(("Noise in a sample", f"{number(noise_dbm)} dBm"))
    cells = "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in rows)
    return f'<table class="follows" aria-label="What follows">{cells}</table>'
