"""What is wrong with what was typed, or with a frame: the words of the error itself."""

from html import escape

from bokeh.models import Div, UIElement

from dechirp.core.errors import Mistake
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Trouble(Panel):
    """A note over the views, while something is wrong."""

    name = "trouble"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._root = Div(
            name=self.name, visible=False, sizing_mode="stretch_width", disable_math=True
        )
        session.on_trouble.append(self._tell)

    @property
    def root(self) -> UIElement:
        """The note."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self._root.styles = {
            "padding": "8px 12px",
            "color": theme.ink,
            "background": theme.tile,
            "border": f"2px solid {theme.threshold}",
            "border-radius": "6px",
            "box-sizing": "border-box",
        }

    def _tell(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes:
            self._root.text = "<br>".join(escape(str(mistake)) for mistake in mistakes)
        self._root.visible = bool(mistakes)
