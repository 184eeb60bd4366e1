"""What a user should know of settings and frame: requirements not met, physics that surprises."""

from collections.abc import Sequence
from html import escape

from bokeh.models import Div, UIElement

from dechirp.core.findings import Finding
from dechirp.studio.moment import Moment
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Findings(Panel):
    """Sentences, as they come with the moments."""

    name = "findings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._shown: Sequence[Finding] | None = None
        self._root = Div(name=self.name, sizing_mode="stretch_width", disable_math=True)
        session.on_moment.append(self._show)

    @property
    def root(self) -> UIElement:
        """The sentences."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _show(self, moment: Moment) -> None:
        if moment.findings == self._shown:  # most frames are like the one before
            return
        self._shown = moment.findings
        said = [f"<li><b>{one.level}</b>: {escape(str(one))}</li>" for one in moment.findings]
        none = "Nothing: no requirement is missed, and nothing surprises."
        self._root.text = f"<ul>{''.join(said)}</ul>" if said else none
