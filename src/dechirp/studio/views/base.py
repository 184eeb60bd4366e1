"""A view: a tile of the page that shows one thing of a moment."""

from abc import ABC, abstractmethod
from typing import ClassVar

from bokeh.models import UIElement

from dechirp.studio.moment import Moment
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class View(ABC):
    """A tile. Made once a page; then it only changes data, which costs the browser little."""

    name: ClassVar[str]
    """Its place in page.html."""
    least_s: ClassVar[float] = 0.0
    """Time between two shows while it plays: 0.19 makes 5 a second, for what is read."""

    def __init__(self, session: Session) -> None:
        self.session = session

    @property
    @abstractmethod
    def root(self) -> UIElement:
        """What the page embeds."""

    @abstractmethod
    def show(self, moment: Moment) -> None:
        """Show a moment."""

    def tell(self, moment: Moment) -> None:  # noqa: B027 - not every view has words
        """Put into words what is seen. While it plays this is done 5 times a second at most.

        Nobody reads faster, and a page with other words is laid out again: a third of the
        browser's work on a frame.
        """

    @abstractmethod
    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
