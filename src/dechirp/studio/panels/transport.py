"""Playback controls, undo, and the seed of the noise."""

from bokeh.models import Button, Row, TextInput, Toggle, UIElement

from dechirp.experiments.scenario import Scenario
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Transport(Panel):
    """Buttons for play, step, rewind, undo and redo, and the seed."""

    name = "transport"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._rewind = Button(label="Rewind", width=68)
        self._play = Toggle(label="Play", width=62)
        self._step = Button(label="Step", width=52)
        self._seed = TextInput(title="Seed", value=str(session.scenario.seed), width=100)
        self._seed.css_classes = ["in-line"]
        self._undo = Button(label="Undo", width=56, disabled=True)
        self._redo = Button(label="Redo", width=56, disabled=True)
        self._undo.on_click(session.undo)
        self._redo.on_click(session.redo)
        self._rewind.on_click(lambda: session.go_to_step(0))
        self._play.on_change("active", lambda attr, old, new: self._play_or_pause())
        self._step.on_click(lambda: session.go_to_step(session.step + 1))
        self._seed.on_change("value", lambda attr, old, new: self._change_seed(new))
        parts = [self._rewind, self._play, self._step, self._undo, self._redo, self._seed]
        self._root = Row(
            name=self.name,
            children=parts,
            sizing_mode="stretch_width",
            spacing=6,
            styles={"align-items": "center"},
        )
        session.on_frame.append(lambda _: self._update_play_button())
        session.on_settings.append(self._show_seed_and_undo)
        session.on_mistakes.append(lambda _: self._update_play_button())

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _play_or_pause(self) -> None:
        if self._play.active != self.session.playing:
            self.session.set_playing(self._play.active)
        self._update_play_button()

    def _change_seed(self, text: str) -> None:
        if text != str(self.session.scenario.seed):
            self.session.change_setting("seed", text)

    def _update_play_button(self) -> None:
        playing = self.session.playing
        self._play.active, self._play.label = playing, "Pause" if playing else "Play"

    def _show_seed_and_undo(self, scenario: Scenario) -> None:
        self._seed.value = str(scenario.seed)
        self._undo.disabled = not self.session.undo_history.can_undo
        self._redo.disabled = not self.session.undo_history.can_redo
