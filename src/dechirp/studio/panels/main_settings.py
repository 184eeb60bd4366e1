"""Panel of the main settings: scenes to begin with, and sliders of eight settings."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from bokeh.models import Column, Div, Select, Slider, UIElement

from dechirp.core.units import to_decibels
from dechirp.experiments.scenario import Scenario
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.studio.browser_events import is_bounded_number
from dechirp.studio.panels.arrays import apply_array_overrides, linear_array_tdm_overrides
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.knobs import NONE
from dechirp.studio.panels.presets import PRESETS, preset_scenario
from dechirp.studio.scenario_edits import PageLimits, apply_overrides
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


@dataclass(frozen=True)
class MainSetting:
    """Slider of one quantity, which may follow from several settings."""

    title: str
    """Quantity with its unit."""
    effect: str
    """Property of the results that it determines."""
    start: float
    end: float
    step: float
    read: Callable[[Scenario], float | None]
    """Function that returns the current value; None where the scenario has none."""
    overrides: Callable[[Scenario, float], Iterable[str]]
    """Function that returns the PATH=VALUE options for a value."""


def _radar_value(read: Callable[[Radar], float]) -> Callable[[Scenario], float | None]:
    return lambda scenario: None if scenario.radar is None else read(scenario.radar)


def _hardware_value(name: str, *, offset_db: float = 0.0) -> Callable[[Scenario], float | None]:
    def read(scenario: Scenario) -> float | None:
        hardware = None if scenario.radar is None else scenario.radar.hardware
        return None if hardware is None else float(to_decibels(getattr(hardware, name))) + offset_db

    return read


def _chirp(scenario: Scenario) -> Chirp:
    assert scenario.radar is not None  # the slider is hidden without a radar
    return scenario.radar.frame.chirp


def _bandwidth_overrides(scenario: Scenario, bandwidth_mhz: float) -> tuple[str]:
    slope_hz_per_s = bandwidth_mhz * 1e6 / _chirp(scenario).sampled_duration_s
    return (f"radar.frame.chirp.slope={slope_hz_per_s / 1e12:.9g} MHz/us",)


def _sample_count_overrides(scenario: Scenario, n_samples: float) -> tuple[str, str]:
    """Return the options for another number of samples in the same part of the ramp."""
    rate_hz = n_samples / _chirp(scenario).sampled_duration_s
    return (
        f"radar.frame.chirp.n_samples={n_samples:.0f}",
        f"radar.frame.chirp.sample_rate={rate_hz / 1e6:.9g} MHz",
    )


def _receiver_overrides(scenario: Scenario, n_rx: float) -> tuple[str, ...]:
    assert scenario.radar is not None
    return linear_array_tdm_overrides(scenario.radar, len(scenario.radar.array.tx_m), int(n_rx))


def _false_alarm_exponent(scenario: Scenario) -> float | None:
    probability = scenario.chain.cfar.false_alarm_probability
    return None if probability is None else math.log10(probability)


MAIN_SETTINGS = {
    "bandwidth": MainSetting(
        "Bandwidth (MHz)",
        "Width of a range cell, c / 2B.",
        20,
        1000,
        5,
        _radar_value(lambda radar: radar.frame.chirp.sampled_bandwidth_hz / 1e6),
        _bandwidth_overrides,
    ),
    "samples": MainSetting(
        "Samples per chirp",
        "Largest range, in range cells.",
        32,
        1024,
        16,
        _radar_value(lambda radar: radar.frame.chirp.n_samples),
        _sample_count_overrides,
    ),
    "chirps": MainSetting(
        "Chirps per frame",
        "Width of a velocity cell, and 10 lg of it as gain over the noise.",
        8,
        512,
        8,
        _radar_value(lambda radar: radar.frame.n_chirps),
        lambda _, n_chirps: (f"radar.frame.n_chirps={n_chirps:.0f}",),
    ),
    "interval": MainSetting(
        "Chirp interval (µs)",
        "Largest unambiguous velocity, λ / 4T for one transmitter.",
        10,
        200,
        1,
        _radar_value(lambda radar: radar.for_frame(0).frame.single_interval_s * 1e6),
        lambda _, interval_us: (f"radar.frame.interval={interval_us:.9g} us",),
    ),
    "receivers": MainSetting(
        "Receivers, half a wavelength apart",
        "Width of the beam, about 102° over the number of elements.",
        1,
        16,
        1,
        _radar_value(lambda radar: radar.array.n_rx),
        _receiver_overrides,
    ),
    "power": MainSetting(
        "Transmit power (dBm)",
        "Level of the echoes.",
        -20,
        30,
        1,
        _hardware_value("transmit_power_w", offset_db=30.0),
        lambda _, power_dbm: (f"radar.hardware.transmit_power={power_dbm:.9g} dBm",),
    ),
    "noise": MainSetting(
        "Noise figure (dB)",
        "Level of the noise.",
        0,
        40,
        1,
        _hardware_value("noise_factor"),
        lambda _, noise_db: (f"radar.hardware.noise_factor={noise_db:.9g} dB",),
    ),
    "false-alarms": MainSetting(
        "False alarms per cell, as a power of ten",
        "Height of the threshold over the noise.",
        -9,
        -1,
        0.5,
        _false_alarm_exponent,
        lambda _, exponent: (
            f"chain.cfar.false_alarm_probability={10**exponent:.6g}",
            f"chain.cfar.offset={NONE}",
        ),
    ),
}


def change_main_setting(
    scenario: Scenario, name: str, value: float, limits: PageLimits
) -> Scenario:
    """Return the scenario with another value of a main setting.

    Raises
    ------
    DechirpError
        As `scenario_edits.apply_overrides`.
    """
    options = MAIN_SETTINGS[name].overrides(scenario, value)
    if name == "receivers":
        return apply_array_overrides(scenario, options, limits)
    return apply_overrides(scenario, options, limits)


class MainSettings(Panel):
    """Choice of a scene, and a slider for each main setting."""

    name = "main_settings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._presets: dict[str, Scenario] = {}
        """Presets that were compared with the settings, by name."""
        self._preset = Select(
            title="Scene",
            value="",
            sizing_mode="stretch_width",
        )
        self._preset.on_change("value", lambda attr, old, new: self._open_preset(str(new)))
        self._sliders = {name: _create_slider(main) for name, main in MAIN_SETTINGS.items()}
        for name, slider in self._sliders.items():
            slider.on_change("value", partial(self._change_setting, name))
        self._note = Div(
            text="Further settings are on the other tabs. Undo takes a change back.",
            sizing_mode="stretch_width",
        )
        self._root = Column(
            name=self.name,
            children=[self._preset, *self._sliders.values(), self._note],
            sizing_mode="stretch_width",
            spacing=6,
        )
        session.on_settings.append(self._show_settings_of)
        session.on_mistakes.append(lambda _: self._show_settings_of(session.scenario))
        self._show_settings_of(session.scenario)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _open_preset(self, name: str) -> None:
        # Also called when the page selects the preset in effect.
        if name in PRESETS and not self._is_preset(name, self.session.scenario):
            self.session.go_to_step(0)
            self.session.queue_edit("", lambda _: preset_scenario(name, self.session.limits))

    def _change_setting(self, name: str, attr: str, old: object, new: object) -> None:
        current = MAIN_SETTINGS[name].read(self.session.scenario)
        if not is_bounded_number(new) or current is None:
            return
        value = float(new)  # type: ignore[arg-type]  # checked above
        if math.isclose(value, current, rel_tol=1e-6, abs_tol=1e-6):
            return
        self.session.queue_edit(
            f"main setting {name}",
            partial(change_main_setting, name=name, value=value, limits=self.session.limits),
        )

    def _show_scene_of(self, scenario: Scenario) -> None:
        """Select the preset in effect; changed ones and other scenes have an entry of their own."""
        name, is_unchanged = scenario.name, self._is_preset(scenario.name, scenario)
        is_changed = name in PRESETS and scenario.scene is not None
        own_entry = f"{PRESETS[name][0]}, changed" if is_changed else name
        presets = [(preset, title) for preset, (title, _) in PRESETS.items()]
        self._preset.update(
            options=presets if is_unchanged else [("", own_entry), *presets],
            value=name if is_unchanged else "",
        )

    def _is_preset(self, name: str, scenario: Scenario) -> bool:
        """Return True if a scenario is the preset of a name."""
        if name not in PRESETS or scenario.name != name:
            return False
        if name not in self._presets:
            self._presets[name] = preset_scenario(name, self.session.limits)
        return scenario == self._presets[name]

    def _show_settings_of(self, scenario: Scenario) -> None:
        self._show_scene_of(scenario)
        for name, main in MAIN_SETTINGS.items():
            slider, value = self._sliders[name], main.read(scenario)
            if slider.visible != (value is not None):
                slider.visible = value is not None
            if value is None or self.session.has_queued_edit(f"main setting {name}"):
                continue  # the slider is ahead of the settings while it is dragged
            start, end = min(main.start, value), max(main.end, value)
            if (slider.start, slider.end, slider.value) != (start, end, value):
                slider.update(start=start, end=end, value=value)


def _create_slider(main: MainSetting) -> Slider:
    decimals = max(0, math.ceil(-math.log10(main.step)))
    return Slider(
        title=main.title,
        start=main.start,
        end=main.end,
        step=main.step,
        value=main.start,
        format="0." + "0" * decimals if decimals else "0",
        margin=(2, 12, 2, 8),
        sizing_mode="stretch_width",
        html_attributes={"title": main.effect},
    )
