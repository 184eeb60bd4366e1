"""A panel: widgets beside the views, which turn settings or tell numbers."""

from abc import ABC, abstractmethod
from typing import ClassVar

from bokeh.models import UIElement

from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Panel(ABC):
    """Widgets that belong together. It listens to the session by its `on_...` lists."""

    name: ClassVar[str]
    """Its place in page.html."""

    def __init__(self, session: Session) -> None:
        self.session = session

    @property
    @abstractmethod
    def root(self) -> UIElement:
        """What the page embeds."""

    @abstractmethod
    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
