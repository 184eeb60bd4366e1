"""Play, pause, step and rewind; and the seed that noise is drawn by."""

from bokeh.models import Button, Div, Row, TextInput, Toggle, UIElement

from dechirp.experiment.scenario import Scenario
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme


class Transport(Panel):
    """The buttons of a player, for frames."""

    name = "transport"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._rewind = Button(label="Rewind", width=68)
        self._play = Toggle(label="Play", width=62)
        self._step = Button(label="Step", width=52)
        self._seed = TextInput(value=str(session.scenario.seed), width=64)
        self._rewind.on_click(lambda: session.go(0))
        self._play.on_change("active", lambda attr, old, new: self._turned())
        self._step.on_click(lambda: session.go(session.step + 1))
        self._seed.on_change("value", lambda attr, old, new: self._sow(new))
        parts = [self._rewind, self._play, self._step, Div(text="Seed"), self._seed]
        self._root = Row(
            name=self.name,
            children=parts,
            sizing_mode="stretch_width",
            spacing=6,
            styles={"align-items": "center"},
        )
        session.on_moment.append(lambda _: self._turn())
        session.on_settings.append(self._take)
        session.on_trouble.append(lambda _: self._turn())

    @property
    def root(self) -> UIElement:
        """The row of buttons."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _turned(self) -> None:
        if self._play.active != self.session.playing:
            self.session.play(self._play.active)
        self._turn()

    def _sow(self, text: str) -> None:
        if text != str(self.session.scenario.seed):
            self.session.change("seed", text)

    def _turn(self) -> None:
        playing = self.session.playing
        self._play.active, self._play.label = playing, "Pause" if playing else "Play"

    def _take(self, scenario: Scenario) -> None:
        self._seed.value = str(scenario.seed)
