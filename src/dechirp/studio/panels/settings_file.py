"""Panel of all settings as a file for `dechirp run`, to edit, copy and download."""

from html import escape

from bokeh.models import Button, Column, Div, Row, TextAreaInput, UIElement

from dechirp.config.dumping import dump_yaml
from dechirp.core.errors import Mistake
from dechirp.experiments.scenario import Scenario
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_WAIT_MS = 300
"""Delay from a change to its text: a dragged target changes thirty times a second, and writing
the text takes 10 ms."""


class SettingsFile(Panel):
    """Text of the current settings."""

    name = "settings_file"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        text = dump_yaml(session.scenario)
        self._is_update_scheduled = self._is_applying = False
        self._area = TextAreaInput(
            title="Settings for dechirp run",
            value=text,
            tags=[text],
            rows=30,
            max_length=session.limits.max_text_length,
            sizing_mode="stretch_width",
            css_classes=["code"],
            margin=(6, 0, 0, 0),
        )
        self._messages = Div(visible=False, sizing_mode="stretch_width", disable_math=True)
        self._messages.css_classes = ["wrong"]
        apply = Button(label="Apply", button_type="primary", width=80)
        copy, download = Button(label="Copy", width=80), Button(label="Download", width=90)
        apply.on_click(self._apply_edited_text)
        # page.js handles both with the current text in the tags: the text in the area may be
        # invalid.
        copy.html_attributes = {"data-copies": self._area.id}
        download.html_attributes = {"data-downloads": self._area.id}
        self._root = Column(
            name=self.name,
            children=[Row(children=[apply, copy, download], spacing=6), self._messages, self._area],
            sizing_mode="stretch_width",
        )
        session.on_settings.append(self._schedule_text_update)
        session.on_mistakes.append(self._show_mistakes_while_applying)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _apply_edited_text(self) -> None:
        self._is_applying = True
        self.session.replace_settings(self._area.value)

    def _schedule_text_update(self, _: Scenario) -> None:
        self._is_applying = False
        if not self._is_update_scheduled:
            self._is_update_scheduled = True
            self.session.document.add_timeout_callback(self._show_current_settings, _WAIT_MS)

    def _show_current_settings(self) -> None:
        self._is_update_scheduled = False
        text = dump_yaml(self.session.scenario)
        self._area.update(value=text, tags=[text])
        self._messages.visible = False

    def _show_mistakes_while_applying(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes and self._is_applying:
            self._messages.text = "<br>".join(escape(str(mistake)) for mistake in mistakes)
            self._messages.visible = True
