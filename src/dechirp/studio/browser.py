"""What page and browser tell each other beside what is drawn; page.js is the other end."""

from importlib.resources import files

from bokeh.core.properties import Bool, Int, String
from bokeh.model import DataModel


class Browser(DataModel):
    """Counters and a switch that both sides hold."""

    shown = Int(0)
    """Moments sent. The browser answers every second one when it has drawn it."""
    place = String("")
    """Which frame it was and whether one is computed, as the page says it.

    A widget would be laid out anew each time.
    """
    drawn = Int(0)
    """The last of them that was drawn."""
    play_keys = Int(0)
    """How often the key for play and pause was struck."""
    step_keys = Int(0)
    """How often the key for the next frame was struck."""
    free_keys = Int(0)
    """How often the key was struck that lets the cursor go."""
    dark = Bool(False)
    """Whether dark colours are worn."""


def text_of(*path: str) -> str:
    """Text of a file of the studio."""
    return files("dechirp.studio").joinpath(*path).read_text("utf-8")


def script() -> str:
    """What runs in the browser beside Bokeh."""
    return text_of("page.js") + text_of("lighter.js")
