"""State and events shared with the browser; page.js is the other side."""

from collections.abc import Callable
from importlib.resources import files

from bokeh.core.properties import Bool, Int, String
from bokeh.events import PointEvent
from bokeh.model import DataModel
from bokeh.plotting import figure

_SCRIPTS = ("page.js", "tiles.js", "connection.js", "dragging.js")
_MAX_NUMBER = 1e15  # above it the spacing of floats exceeds 0.1

DRAW_TIMEOUT_S = 2.0
"""Time after which the next frame is sent without a confirmation."""
FRAMES_PER_CONFIRMATION = 2
"""The browser confirms every second frame: a confirmation takes the server 1 ms."""
MAX_UNDRAWN_FRAMES = FRAMES_PER_CONFIRMATION + 1
"""Frames in flight per browser: one more than it draws between two confirmations."""


class BrowserState(DataModel):
    """Counters and a switch, synchronised between server and browser."""

    n_frames_sent = Int(0)
    """Frames sent."""
    frames_per_confirmation = Int(FRAMES_PER_CONFIRMATION)
    """The browser confirms frames whose number is a multiple of this when it has drawn them."""
    frame_status = String("")
    """Text with the number of the frame, and whether another one is being computed.

    A widget would trigger a new layout at each change.
    """
    is_outdated = Bool(False)
    """True while the tiles show a frame of other settings, as the present ones failed."""
    n_frames_drawn = Int(0)
    """Last frame that the browser confirmed."""
    play_keys = Int(0)
    """Number of presses of the key for play and pause."""
    step_keys = Int(0)
    """Number of presses of the key for the next frame."""
    free_keys = Int(0)
    """Number of presses of the key that releases the cursor."""
    undo_keys = Int(0)
    """Number of presses of the keys that undo a change."""
    redo_keys = Int(0)
    """Number of presses of the keys that redo a change."""
    shared_settings = String("")
    """Settings from the address of the page."""
    dark = Bool(False)
    """True for the dark theme."""


class TileCaption(DataModel):
    """Title of a tile and the smaller line below it; both may contain markup.

    The page writes them beside the figure: in a figure, text cannot wrap, has no name for screen
    readers, and each change triggers a new layout.
    """

    title = String("")
    note = String("")


def is_bounded_number(value: object) -> bool:
    """Return True for a number of reasonable size: a browser may send anything."""
    return isinstance(value, int | float) and abs(value) <= _MAX_NUMBER


def register_position_callback(
    target_figure: figure, event: type[PointEvent], callback: Callable[[float, float], None]
) -> None:
    """Call a function with x and y of events in a figure, if they are numbers."""

    def handle_event(point_event: PointEvent) -> None:
        if is_bounded_number(point_event.x) and is_bounded_number(point_event.y):
            callback(float(point_event.x), float(point_event.y))

    target_figure.on_event(event, handle_event)


def read_studio_asset_text(*path: str) -> str:
    """Read a text file of the studio."""
    return files("dechirp.studio").joinpath(*path).read_text("utf-8")


def browser_javascript() -> str:
    """Return the JavaScript that runs in the browser beside Bokeh."""
    return "".join(map(read_studio_asset_text, _SCRIPTS))
