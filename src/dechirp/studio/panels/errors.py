"""Messages about invalid settings or a failed frame."""

from html import escape

from bokeh.models import Div, UIElement

from dechirp.core.errors import Mistake
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Errors(Panel):
    """Note above the views while there are mistakes."""

    name = "trouble"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._root = Div(
            name=self.name, visible=False, sizing_mode="stretch_width", disable_math=True
        )
        session.on_mistakes.append(self._show_mistakes)

    @property
    def root(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        self._root.styles = {
            "padding": "8px 12px",
            "color": theme.ink,
            "background": theme.tile,
            "border": f"2px solid {theme.threshold}",
            "border-radius": "6px",
            "box-sizing": "border-box",
        }

    def _show_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes:
            self._root.text = "<br>".join(escape(str(mistake)) for mistake in mistakes)
        self._root.visible = bool(mistakes)
