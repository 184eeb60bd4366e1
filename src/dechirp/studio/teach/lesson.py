"""Base class of lessons: animated figures, formulas, knobs and experiments."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from bokeh.models import Select, Slider, UIElement

from dechirp.studio.theme import Theme

STACK_WHEN_NARROW_CSS = (
    "@media (max-width: 1099.98px) { :host { flex-direction: column !important; } }"
)
"""Style of a row of figures: below each other on a narrow screen."""

S = TypeVar("S")
T = TypeVar("T")
Setting = float | str


@dataclass(frozen=True)
class Dial:
    """Numeric knob within bounds."""

    title: str
    """Title with unit."""
    start: float
    end: float
    step: float
    first: float

    def create_widget(self) -> Slider:
        """Create the slider."""
        decimals = max(0, int(np.ceil(-np.log10(self.step) - 1e-9)))
        return Slider(
            title=self.title,
            start=self.start,
            end=self.end,
            step=self.step,
            value=self.first,
            format="0." + "0" * decimals if decimals else "0",
            sizing_mode="stretch_width",
        )

    def parse_browser_value(self, value: Any) -> float:
        """Parse a value from the browser to a number within bounds."""
        is_number = isinstance(value, int | float) and np.isfinite(value)
        return float(np.clip(value, self.start, self.end)) if is_number else self.first


@dataclass(frozen=True)
class Choice:
    """Knob with a list of options."""

    title: str
    options: tuple[str, ...]
    first: str

    def create_widget(self) -> Select:
        """Create the selection widget."""
        return Select(
            title=self.title,
            options=list(self.options),
            value=self.first,
            sizing_mode="stretch_width",
        )

    def parse_browser_value(self, value: Any) -> str:
        """Parse a value from the browser to one of the options."""
        return str(value) if value in self.options else self.first


@dataclass(frozen=True)
class Experiment:
    """Experiment of a lesson: instruction, knob values and explanation."""

    question: str
    knob_values: Mapping[str, Setting]
    """Knob values by name; other knobs return to their initial values."""
    answer: str


class Lesson(ABC, Generic[S, T]):
    """One lesson on one page.

    `compute_frame` computes the results from the settings on the worker;
    `draw_frame_and_format_numbers` draws them on the event loop.

    Parameters
    ----------
    settings : callable
        Creates settings from knob values by name.
    """

    title: ClassVar[str]
    introduction: ClassVar[str]
    """Introduction in one or two sentences."""
    formulas: ClassVar[tuple[tuple[str, str], ...]]
    """Formulas for `report.equations.equation_svg`, each with a description."""
    knobs: ClassVar[Mapping[str, Dial | Choice]]
    animated_dial: ClassVar[tuple[str, float]]
    """Dial animated by play, with its step per frame; it wraps around at the end."""
    experiments: ClassVar[tuple[Experiment, ...]]

    def __init__(self, settings: Callable[..., S]) -> None:
        self._settings = settings

    def build_settings(self, knob_values: Mapping[str, Any]) -> S:
        """Build settings from the knob values of the browser."""
        return self._settings(
            **{
                name: knob.parse_browser_value(knob_values[name])
                for name, knob in self.knobs.items()
            }
        )

    def next_animated_knob_values(self, knob_values: Mapping[str, Any]) -> Mapping[str, float]:
        """Return the knob values that play changes for the next frame."""
        name, step = self.animated_dial
        dial = self.knobs[name]
        assert isinstance(dial, Dial)
        value = round((dial.parse_browser_value(knob_values[name]) + step) / dial.step) * dial.step
        if not dial.start - dial.step / 2 <= value <= dial.end + dial.step / 2:
            value = dial.start if step > 0 else dial.end
        return {name: value}

    @property
    @abstractmethod
    def root_element(self) -> UIElement:
        """Root element of the figures."""

    @abstractmethod
    def compute_frame(self, settings: S, frame_number: int) -> T:
        """Compute a frame; its number, counted during playback, determines the noise."""

    @abstractmethod
    def draw_frame_and_format_numbers(self, frame: T) -> Mapping[str, str]:
        """Draw a frame and return the numbers to show beside the figures, by label."""

    @abstractmethod
    def apply_theme(self, theme: Theme) -> None:
        """Apply the colours of a theme."""
