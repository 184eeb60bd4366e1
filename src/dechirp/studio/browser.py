"""What page and browser tell each other beside what is drawn; page.js is the other end."""

from collections.abc import Callable
from importlib.resources import files

from bokeh.core.properties import Bool, Int, String
from bokeh.events import PointEvent
from bokeh.model import DataModel
from bokeh.plotting import figure

_LARGEST = 1e15  # beyond it a float has no step of 0.1 left


class Browser(DataModel):
    """Counters and a switch that both sides hold."""

    shown = Int(0)
    """Moments sent. The browser answers every second one when it has drawn it."""
    place = String("")
    """Which frame it was and whether one is computed, as the page says it.

    A widget would be laid out anew each time.
    """
    drawn = Int(0)
    """The last of them that it answered."""
    play_keys = Int(0)
    """How often the key for play and pause was struck."""
    step_keys = Int(0)
    """How often the key for the next frame was struck."""
    free_keys = Int(0)
    """How often the key was struck that lets the cursor go."""
    dark = Bool(False)
    """Whether dark colours are worn."""


def is_number(told: object) -> bool:
    """Whether it can be reckoned with: a browser may tell anything."""
    return isinstance(told, int | float) and abs(told) <= _LARGEST


def on_place(of: figure, event: type[PointEvent], hear: Callable[[float, float], None]) -> None:
    """Call with the x and y of such events in a figure, where they are numbers."""

    def heard(told: PointEvent) -> None:
        if is_number(told.x) and is_number(told.y):
            hear(float(told.x), float(told.y))

    of.on_event(event, heard)


def text_of(*path: str) -> str:
    """Text of a file of the studio."""
    return files("dechirp.studio").joinpath(*path).read_text("utf-8")


def script() -> str:
    """What runs in the browser beside Bokeh."""
    return text_of("page.js") + text_of("lighter.js")
