"""Base class of views: tiles of the page."""

from abc import ABC, abstractmethod
from typing import ClassVar

from bokeh.models import UIElement

from dechirp.studio.browser_events import TileCaption
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

SLOW_INTERVAL_S = 0.198
"""Shortest time between two changes of texts, tables and curves during playback: 5 per second, so
that they can be read."""


class View(ABC):
    """Tile that is created once per page and then only updates its data."""

    name: ClassVar[str]
    """Name of its position in page.html."""
    frames_per_update: ClassVar[int | None] = None
    """Frames from one update to the next during playback; None: at most 5 updates a second."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.caption = TileCaption(name=f"{self.name}-caption")
        self.controls: UIElement | None = None
        """Switch beside the title."""

    @property
    @abstractmethod
    def root_element(self) -> UIElement:
        """Root element that the page embeds."""

    @abstractmethod
    def show_frame(self, frame_state: FrameState) -> None:
        """Show a frame."""

    def update_caption(self, frame_state: FrameState) -> None:  # noqa: B027 - not every view has one
        """Update title and note; at most 5 times a second, so that they can be read."""

    @abstractmethod
    def apply_theme(self, theme: Theme) -> None:
        """Apply the colours of a theme."""
