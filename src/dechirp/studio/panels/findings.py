"""Findings on settings and frame: unmet requirements and surprising physics."""

from collections.abc import Sequence
from html import escape

from bokeh.models import Div, UIElement

from dechirp.core.findings import Finding
from dechirp.studio.frame_state import FrameState
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Findings(Panel):
    """List of findings, updated with each frame."""

    name = "findings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._findings: Sequence[Finding] | None = None
        self._root = Div(name=self.name, sizing_mode="stretch_width", disable_math=True)
        session.on_frame.append(self._show_frame)

    @property
    def root(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _show_frame(self, moment: FrameState) -> None:
        if moment.findings == self._findings:  # mostly unchanged between frames
            return
        self._findings = moment.findings
        items = [
            f"<li><b>{finding.level}</b>: {escape(str(finding))}</li>"
            for finding in moment.findings
        ]
        empty_text = "No findings."
        self._root.text = f"<ul>{''.join(items)}</ul>" if items else empty_text
