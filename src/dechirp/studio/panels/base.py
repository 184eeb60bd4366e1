"""Base class of panels: widgets that change settings or show numbers."""

from abc import ABC, abstractmethod
from typing import ClassVar

from bokeh.models import UIElement

from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Panel(ABC):
    """Group of widgets that registers callbacks in the `on_...` lists of the session."""

    name: ClassVar[str]
    """Name of its position in page.html."""

    def __init__(self, session: Session) -> None:
        self.session = session

    @property
    @abstractmethod
    def root_element(self) -> UIElement:
        """Root element that the page embeds."""

    @abstractmethod
    def apply_theme(self, theme: Theme) -> None:
        """Apply the colours of a theme."""

    def show_frame_number(self, frame_state: FrameState) -> None:  # noqa: B027
        """Show which frame it is, as often as texts change; nothing by default."""
