"""A lesson: figures that move, a formula, knobs to turn and things to try."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from bokeh.models import Select, Slider, UIElement

from dechirp.studio.theme import Theme

S = TypeVar("S")
T = TypeVar("T")
Setting = float | str


@dataclass(frozen=True)
class Dial:
    """A number that is turned within bounds."""

    title: str
    """With its unit."""
    start: float
    end: float
    step: float
    first: float

    def widget(self) -> Slider:
        """What it is turned by."""
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

    def taken(self, given: Any) -> float:
        """What a browser sent, as a number within bounds."""
        known = isinstance(given, int | float) and np.isfinite(given)
        return float(np.clip(given, self.start, self.end)) if known else self.first


@dataclass(frozen=True)
class Choice:
    """One of a few."""

    title: str
    options: tuple[str, ...]
    first: str

    def widget(self) -> Select:
        """What it is chosen by."""
        return Select(
            title=self.title,
            options=list(self.options),
            value=self.first,
            sizing_mode="stretch_width",
        )

    def taken(self, given: Any) -> str:
        """What a browser sent, as one of the options."""
        return str(given) if given in self.options else self.first


@dataclass(frozen=True)
class Try:
    """Something to try: what to do, which knobs that takes, and what is then seen and why."""

    ask: str
    sets: Mapping[str, Setting]
    """Knobs by name; the others go back to where they began."""
    answer: str


class Lesson(ABC, Generic[S, T]):
    """One lesson on one page.

    `look` computes what is seen, from settings alone, on the worker; `show` puts it into the
    figures, on the loop.

    Parameters
    ----------
    settings : callable
        Makes settings of the values of the knobs, given by name.
    """

    title: ClassVar[str]
    says: ClassVar[str]
    """What it is about, in a sentence or two."""
    formulas: ClassVar[tuple[tuple[str, str], ...]]
    """Mathematics as `report.equations.svg` sets it, each with its words."""
    knobs: ClassVar[Mapping[str, Dial | Choice]]
    moves: ClassVar[tuple[str, float]]
    """The dial that play turns, and by how much a frame; at its end it begins again."""
    tries: ClassVar[tuple[Try, ...]]

    def __init__(self, settings: Callable[..., S]) -> None:
        self._settings = settings

    def settings(self, values: Mapping[str, Any]) -> S:
        """Settings from what the browser sent for each knob."""
        return self._settings(
            **{name: knob.taken(values[name]) for name, knob in self.knobs.items()}
        )

    def onward(self, values: Mapping[str, Any]) -> Mapping[str, float]:
        """What play makes of the values of the knobs for the next frame: those that change."""
        name, by = self.moves
        dial = self.knobs[name]
        assert isinstance(dial, Dial)
        next_ = round((dial.taken(values[name]) + by) / dial.step) * dial.step
        if not dial.start - dial.step / 2 <= next_ <= dial.end + dial.step / 2:
            next_ = dial.start if by > 0 else dial.end
        return {name: next_}

    @property
    @abstractmethod
    def root(self) -> UIElement:
        """Its figures."""

    @abstractmethod
    def look(self, at: S, number: int) -> T:
        """What is seen; `number` counts frames while it plays, for noise that is new in each."""

    @abstractmethod
    def show(self, seen: T) -> Mapping[str, str]:
        """Draw it; gives numbers to read beside the figures, by what they are."""

    @abstractmethod
    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
