"""Messages on the live page: invalid settings, failed frames, and findings."""

from collections.abc import Sequence
from html import escape

from bokeh.models import Div, UIElement

from dechirp.core.errors import Mistake
from dechirp.core.findings import Finding
from dechirp.studio.frame_state import FrameState
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Errors(Panel):
    """Note above the views while there are mistakes."""

    name = "trouble"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._root = Div(
            name=self.name,
            visible=False,
            sizing_mode="stretch_width",
            margin=(0, 0, 6, 0),
            disable_math=True,
        )
        session.on_mistakes.append(self._show_mistakes)

    @property
    def root_element(self) -> UIElement:
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


class Findings(Panel):
    """List of findings, updated with each frame."""

    name = "findings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._findings: Sequence[Finding] | None = None
        self._root = Div(name=self.name, sizing_mode="stretch_width", disable_math=True)
        session.on_frame.append(self._show_findings_of_frame)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _show_findings_of_frame(self, frame_state: FrameState) -> None:
        scenario = self.session.scenario
        findings = [entry for find in self.session.setting_findings for entry in find(scenario)]
        findings += frame_state.findings
        if findings == self._findings:  # mostly unchanged between frames
            return
        self._findings = findings
        items = [f"<li><b>{finding.level}</b>: {escape(str(finding))}</li>" for finding in findings]
        empty_text = "No findings."
        self._root.text = f"<ul>{''.join(items)}</ul>" if items else empty_text
