"""Recordings of the folders of the studio: what is there, what is wrong with it, and its frames."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from html import escape
from typing import Any

from bokeh.models import Button, Column, Div, InlineStyleSheet, Row, Select, Slider, UIElement

from dechirp.core.words import quantity
from dechirp.experiment.scenario import Scenario
from dechirp.studio.browser import is_number
from dechirp.studio.library import MOST_LOOKED, Item, Library, LookedOver, looked_over, opened
from dechirp.studio.moment import Moment
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

BATCH_S = 0.015
"""What a moment may have to wait for while folders are looked through."""

_NONE = ""
_BESIDE = "those in it, or beside it"
_NO_FOLDER = "No folder was given. Start the studio with one: <code>dechirp studio FOLDER</code>."
_OWN_FAULT = "This failed by a fault of its own, which the log of the server tells."
_CSS = """
p, ul { margin: 4px 0; }
ul { padding-left: 16px; overflow-wrap: anywhere; }
li { margin-bottom: 4px; }
li.error b, li.warning b { color: var(--threshold); }
.muted { color: var(--muted); }
"""

_log = logging.getLogger(__name__)


class Recordings(Panel):
    """Files to choose from, what `inspect` finds in one, and a slider over its frames."""

    name = "recordings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._items: dict[str, Item] = {}
        self._scene = session.scenario if session.scenario.scene is not None else None
        self._task: asyncio.Task[None] | None = None
        self._file = Select(title="Recording or scenario", options=[_NONE], value=_NONE)
        self._radar = Select(title="Settings of its radar", options=[_NONE], value=_NONE)
        for select in (self._file, self._radar):
            select.sizing_mode = "stretch_width"
            select.on_change("value", lambda attr, old, new: self._chosen())
        self._open = Button(label="Open", width=54, disabled=True)
        self._open.on_click(self._opened)
        self._back = Button(label="Back to the scene", width=118, disabled=True)
        self._back.on_click(self._returned)
        self._again = Button(label="Look again", width=78)
        self._again.on_click(self._look)
        self._frame = Slider(title="Frame", start=0, end=1, value=0, step=1, visible=False)
        self._frame.update(sizing_mode="stretch_width", margin=(5, 14, 5, 14))
        self._frame.on_change("value_throttled", lambda attr, old, new: self._go(new))
        self._said = Div(disable_math=True, stylesheets=[InlineStyleSheet(css=_CSS)])
        self._said.sizing_mode = "stretch_width"
        buttons = Row(children=[self._open, self._back, self._again], spacing=2)
        self._root = Column(
            name=self.name,
            children=[self._file, self._radar, buttons, self._frame, self._said],
            sizing_mode="stretch_width",
            spacing=4,
        )
        session.on_settings.append(self._take)
        session.on_moment.append(self._show)
        session.document.on_session_destroyed(lambda _: self._begin(None))
        self._look()

    @property
    def root(self) -> UIElement:
        """Choices, buttons, slider and findings."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _take(self, scenario: Scenario) -> None:
        if scenario.scene is not None:
            self._scene = scenario
        is_recording = scenario.recording is not None
        self._back.disabled = not (is_recording and self._scene)
        self._frame.visible = False  # until its first moment says how many there are

    def _show(self, moment: Moment) -> None:
        if self.session.scenario.recording is None or moment.n_frames < 2:
            return
        last, at = moment.n_frames - 1, moment.step % moment.n_frames
        self._frame.update(end=last, value=at, title=f"Frame, of {moment.n_frames}", visible=True)

    def _look(self) -> None:
        if self.session.limits.folders:
            self._said.text = '<p class="muted">Looking through the folders.</p>'
            self._begin(self._looking())
        else:
            self._again.disabled = True
            self._said.text = f"<p>{_NO_FOLDER}</p>"

    def _go(self, frame: float) -> None:
        if is_number(frame):
            self.session.go(int(frame))

    def _chosen(self) -> None:
        item = self._items.get(str(self._file.value))
        self._open.disabled = item is None or item.kind == "recording"
        self._said.text = ""
        if item is not None and item.kind == "recording":
            self._said.text = '<p class="muted">Looking it over.</p>'
            self._begin(self._inspecting(item, self._items.get(str(self._radar.value))))

    def _opened(self) -> None:
        item, radar = (self._items.get(str(one.value)) for one in (self._file, self._radar))
        if item is not None:
            limits = self.session.limits
            made = partial(opened, item=item, settings=radar, limits=limits)
            self.session.go(0)
            self.session.edit("", made)

    def _returned(self) -> None:
        scene = self._scene
        if scene is not None:
            self.session.go(0)
            self.session.edit("", lambda _: scene)

    async def _looking(self) -> None:
        library = Library(self.session.limits)
        while not library.is_done:
            await self.session.work(partial(library.look, BATCH_S))
        self._later(partial(self._list, library))

    async def _inspecting(self, item: Item, radar: Item | None) -> None:
        found = await self.session.work(partial(looked_over, item, radar, self.session.limits))
        self._later(partial(self._tell, found))

    def _begin(self, work: Coroutine[Any, Any, None] | None) -> None:
        """Begin something in the place of what is under way."""
        if self._task is not None:
            self._task.cancel()
        self._task = (
            None if work is None else asyncio.get_running_loop().create_task(self._try(work))
        )

    async def _try(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception:
            _log.exception("the recordings of the studio failed")
            self._later(partial(setattr, self._said, "text", f"<p>{_OWN_FAULT}</p>"))

    def _later(self, job: Callable[[], None]) -> None:
        """Do something with the lock of the document, unless something else was begun by then."""
        task = self._task
        self.session.document.add_next_tick_callback(lambda: job() if self._task is task else None)

    def _list(self, library: Library) -> None:
        self._items = {item.name: item for item in library.items}
        kinds = {"Recordings": "recording", "Scenarios": "scenario"}
        self._file.options = {
            "": [(_NONE, "choose one")],
            **{title: self._options(kind) for title, kind in kinds.items()},
        }
        self._radar.options = [(_NONE, _BESIDE), *self._options("settings")]
        for select in (self._file, self._radar):
            if select.value not in self._items:
                select.value = _NONE
        n = len(self._items)
        words = f"{n} to choose from." if n else "No recording, scenario or settings file in there."
        if library.n_looked == MOST_LOOKED:
            words += f" Only the first {MOST_LOOKED} files were looked at: name a smaller folder."
        self._said.text = f'<p class="muted">{words}</p>'

    def _options(self, kind: str) -> list[tuple[str, str]]:
        return [(item.name, _titled(item)) for item in self._items.values() if item.kind == kind]

    def _tell(self, found: LookedOver) -> None:
        self._open.disabled = found.n_frames is None
        if found.n_frames is None:
            lead = "It cannot be played as it is. Settings of its radar are chosen above:"
        else:
            some = (
                f"the first {found.n_inspected} of " if found.n_inspected < found.n_frames else ""
            )
            lead = f"Found in {some}{found.n_frames} frame{'s' if found.n_frames > 1 else ''}:"
        said = [
            f'<li class="{one.level}"><b>{one.level}</b>: {escape(str(one))}</li>'
            for one in found.findings
        ]
        body = f"<ul>{''.join(said)}</ul>" if said else "<p>Nothing is wrong with it.</p>"
        self._said.text = f"<p>{lead}</p>{body}"


def _titled(item: Item) -> str:
    if item.kind != "recording":
        return item.name
    kind = " or ".join(item.formats) if len(item.formats) < 3 else "bare samples"
    size = f", {quantity(item.n_bytes, 'B', 3)}" if item.n_bytes else ""
    return f"{item.name} ({kind}{size})"
