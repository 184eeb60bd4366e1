"""Panel of the waveform and the array, with derived values."""

from functools import partial
from html import escape

from bokeh.models import Column, Div, Select, UIElement

from dechirp.core.errors import Mistake
from dechirp.core.text import format_number, format_with_si_prefix, ratio_db
from dechirp.experiments.scenario import Scenario
from dechirp.processing.direction_finding import can_resolve_directions
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar as RadarSettings
from dechirp.studio.panels.arrays import (
    apply_array_overrides,
    linear_array_tdm_overrides,
    replace_array_elements,
)
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.fold import Fold
from dechirp.studio.panels.knob_widgets import KnobForm, make_setting_changer
from dechirp.studio.panels.knobs import format_setting_inline
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_CHIRP = "start_frequency slope adc_start ramp_duration sample_rate n_samples sampling"
_FRAME = "n_chirps interval period multiplexing modulation"
_ARRAY = ("radar.array.tx", "radar.array.rx")
_ROWS = ((1, 1), (1, 4), (1, 8), (2, 4), (3, 4), (4, 4), (2, 8))
"""Offered numbers of transmitters and receivers of uniform linear arrays."""


class Radar(Panel):
    """Waveform, array and derived values."""

    name = "radar"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._derived_values = Div(sizing_mode="stretch_width", disable_math=True)
        self._rows = Select(
            title="Array in a row",
            options=[
                ("", "as below"),
                *((_element_counts_as_text(*row), _array_choice_label(*row)) for row in _ROWS),
            ],
            value="",
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
            html_attributes={"title": "Elements half a wavelength apart, with TDM transmitters."},
        )
        waveform = [f"radar.frame.chirp.{key}" for key in _CHIRP.split()]
        waveform += [f"radar.frame.{key}" for key in _FRAME.split()]
        self._forms = [
            KnobForm(
                session.scenario,
                lambda _: waveform,
                make_setting_changer(session),
                group=lambda path: "Chirp" if path.startswith("radar.frame.chirp.") else "Frame",
                open_groups=("Chirp", "Frame"),
            ),
            KnobForm(session.scenario, lambda _: _ARRAY, self._change_array_elements),
        ]
        array = Fold("Array")
        array.set_children([self._rows, self._forms[1].root_element])
        self._root = Column(
            name=self.name,
            children=[
                self._derived_values,
                self._forms[0].root_element,
                array.root_element,
            ],
            sizing_mode="stretch_width",
            spacing=0,
        )
        self._rows.on_change("value", lambda attr, old, new: self._apply_array_choice(str(new)))
        session.on_settings.append(self._show_radar_of_scenario)
        session.on_mistakes += [
            *(form.show_mistakes for form in self._forms),
            self._restore_array_choice,
        ]
        self._show_radar_of_scenario(session.scenario)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _show_radar_of_scenario(self, scenario: Scenario) -> None:
        for form in self._forms:
            form.show_settings_of(scenario)
        self._derived_values.text = _derived_values_html(scenario.radar)
        self._rows.visible = scenario.radar is not None
        self._rows.value = _choice_matching_array(scenario.radar)

    def _restore_array_choice(self, mistakes: tuple[Mistake, ...]) -> None:
        """Restore the choice of the current array after a refused one."""
        if mistakes:
            self._rows.value = _choice_matching_array(self.session.scenario.radar)

    def _apply_array_choice(self, text: str) -> None:
        radar = self.session.scenario.radar
        # A browser may send anything.
        is_listed = text in (_element_counts_as_text(*row) for row in _ROWS)
        if not is_listed or radar is None or text == _choice_matching_array(radar):
            return
        n_tx, n_rx = map(int, text.split())
        options, limits = linear_array_tdm_overrides(radar, n_tx, n_rx), self.session.limits
        self.session.queue_edit(
            "radar.array", partial(apply_array_overrides, overrides=options, limits=limits)
        )

    def _change_array_elements(self, path: str, text: str) -> None:
        limits = self.session.limits
        self.session.queue_edit(
            path, partial(replace_array_elements, path=path, text=text, limits=limits)
        )


def _choice_matching_array(radar: RadarSettings | None) -> str:
    """Return the choice that equals the array; empty if none does."""
    if radar is None:
        return ""
    n_tx, n_rx = len(radar.array.tx_m), radar.array.n_rx
    if (n_tx, n_rx) not in _ROWS:
        return ""
    array_text = linear_array_tdm_overrides(radar, n_tx, n_rx)[0].partition("=")[2]
    return (
        _element_counts_as_text(n_tx, n_rx)
        if array_text == format_setting_inline(radar.array)
        else ""
    )


def _element_counts_as_text(n_tx: int, n_rx: int) -> str:
    return f"{n_tx} {n_rx}"


def _array_choice_label(n_tx: int, n_rx: int) -> str:
    return f"{n_tx} transmitter{'s' * (n_tx > 1)}, {n_rx} receiver{'s' * (n_rx > 1)}"


def _derived_values_html(radar: RadarSettings | None) -> str:
    """Return the derived values of a radar as an HTML table."""
    if radar is None:
        return "The radar is defined by the recording."
    frame = radar.for_frame(0).frame
    chirp = frame.chirp
    rows = [
        ("Range resolution", format_with_si_prefix(chirp.range_resolution_m, "m")),
        ("Largest range", f"{format_number(chirp.max_range_m)} m"),
        ("Velocity resolution", f"{format_number(frame.velocity_resolution_m_per_s)} m/s"),
        ("Largest velocity", f"± {format_number(frame.max_velocity_m_per_s)} m/s"),
        ("Wavelength", format_with_si_prefix(chirp.wavelength_m, "m")),
        ("Sampled bandwidth", format_with_si_prefix(chirp.sampled_bandwidth_hz, "Hz")),
    ]
    if not can_resolve_directions(radar):
        rows.append(("Directions", "none, so no tracks"))
    if radar.hardware is not None:
        noise_dbm = ratio_db(noise_power_w(radar)) + 30
        rows.append(("Noise in a sample", f"{format_number(noise_dbm)} dBm"))
    cells = "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in rows)
    return f'<table class="follows" aria-label="What follows">{cells}</table>'
