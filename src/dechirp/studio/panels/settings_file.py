"""All settings as a file: what `dechirp run` takes, to edit, copy and download."""

from html import escape

from bokeh.models import Button, Column, Div, Row, TextAreaInput, UIElement

from dechirp.config.texts import dump
from dechirp.core.errors import Mistake
from dechirp.experiment.scenario import Scenario
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_WAIT_MS = 300
"""From a change to its text: a target that is dragged changes thirty times a second, and a text
takes 10 ms."""


class SettingsFile(Panel):
    """The text of the settings in force."""

    name = "settings_file"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        text = dump(session.scenario)
        self._waits = self._asked = False
        self._area = TextAreaInput(
            title="Settings, as dechirp run takes them",
            value=text,
            tags=[text],
            rows=30,
            max_length=session.limits.most_text,
            sizing_mode="stretch_width",
            css_classes=["code"],
            margin=(6, 0, 0, 0),
        )
        self._words = Div(visible=False, sizing_mode="stretch_width", disable_math=True)
        self._words.css_classes = ["wrong"]
        apply = Button(label="Apply", button_type="primary", width=80)
        copy, download = Button(label="Copy", width=80), Button(label="Download", width=90)
        apply.on_click(self._apply)
        # page.js answers, with the text in force, which lies in the tags: the one in the area may
        # be wrong.
        copy.html_attributes = {"data-copies": self._area.id}
        download.html_attributes = {"data-downloads": self._area.id}
        self._root = Column(
            name=self.name,
            children=[Row(children=[apply, copy, download], spacing=6), self._words, self._area],
            sizing_mode="stretch_width",
        )
        session.on_settings.append(self._changed)
        session.on_trouble.append(self._tell)

    @property
    def root(self) -> UIElement:
        """The text, under its buttons."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _apply(self) -> None:
        self._asked = True
        self.session.replace(self._area.value)

    def _changed(self, _: Scenario) -> None:
        self._asked = False
        if not self._waits:
            self._waits = True
            self.session.document.add_timeout_callback(self._write, _WAIT_MS)

    def _write(self) -> None:
        self._waits = False
        text = dump(self.session.scenario)
        self._area.update(value=text, tags=[text])
        self._words.visible = False

    def _tell(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes and self._asked:
            self._words.text = "<br>".join(escape(str(mistake)) for mistake in mistakes)
            self._words.visible = True
