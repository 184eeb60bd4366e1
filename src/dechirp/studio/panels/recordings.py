"""Panel of recordings: files of the folders, their findings and frames."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from html import escape
from typing import Any

from bokeh.models import Button, Column, Div, InlineStyleSheet, Row, Select, Slider, UIElement

from dechirp.core.errors import Mistake
from dechirp.core.text import format_with_si_prefix
from dechirp.experiments.scenario import Scenario
from dechirp.studio.browser_events import is_bounded_number
from dechirp.studio.frame_state import FrameState
from dechirp.studio.library import (
    MAX_SCANNED,
    FolderScan,
    InspectedRecording,
    LibraryItem,
    inspect_first_frames,
    open_item_as_scenario,
)
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

BATCH_S = 0.015
"""Longest delay of a frame while folders are scanned."""

_NONE = ""
_DEFAULT_SETTINGS = "found automatically"
_NO_FOLDER = "No folder was given. Start the studio with one: <code>dechirp studio FOLDER</code>."
_INTERNAL_ERROR = "Internal error; see the log of the server."
_CSS = """
p, ul { margin: 4px 0; }
ul { padding-left: 16px; overflow-wrap: anywhere; }
li { margin-bottom: 4px; }
li.error b, li.warning b { color: var(--threshold); }
.muted { color: var(--muted); }
"""

_log = logging.getLogger(__name__)


class Recordings(Panel):
    """Choice of files, findings of `inspect`, and a slider over frames."""

    name = "recordings"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._items: dict[str, LibraryItem] = {}
        self._scene = session.scenario if session.scenario.scene is not None else None
        self._opened_name = ""
        """Name of the file whose frames are shown."""
        self._task: asyncio.Task[None] | None = None
        self._file = Select(title="Recording or scenario", options=[_NONE], value=_NONE)
        self._radar = Select(title="Settings of its radar", options=[_NONE], value=_NONE)
        for select in (self._file, self._radar):
            select.sizing_mode = "stretch_width"
            select.on_change("value", lambda attr, old, new: self._inspect_chosen_file())
        self._open_button = Button(label="Open", width=54, disabled=True)
        self._open_button.on_click(self._open_chosen_file)
        self._back_button = Button(label="Back to the scene", width=118, disabled=True)
        self._back_button.on_click(self._return_to_scene)
        self._rescan_button = Button(label="Rescan", width=78)
        self._rescan_button.on_click(self._rescan_folders)
        self._frame = Slider(title="Frame", start=0, end=1, value=0, step=1, visible=False)
        self._frame.update(sizing_mode="stretch_width", margin=(5, 14, 5, 14))
        self._frame.on_change("value_throttled", lambda attr, old, new: self._go_to_frame(new))
        self._message = Div(disable_math=True, stylesheets=[InlineStyleSheet(css=_CSS)])
        self._message.sizing_mode = "stretch_width"
        buttons = Row(
            children=[self._open_button, self._back_button, self._rescan_button], spacing=2
        )
        self._root = Column(
            name=self.name,
            children=[self._file, self._radar, buttons, self._frame, self._message],
            sizing_mode="stretch_width",
            spacing=4,
        )
        session.on_settings.append(self._remember_scene_and_hide_slider)
        session.document.on_session_destroyed(lambda _: self._replace_running_task(None))
        self._rescan_folders()

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _remember_scene_and_hide_slider(self, scenario: Scenario) -> None:
        if scenario.scene is not None:
            self._scene = scenario
        is_recording = scenario.recording is not None
        self._back_button.disabled = not (is_recording and self._scene)
        self._frame.visible = False  # until its first frame is known

    def show_frame_number(self, frame_state: FrameState) -> None:
        """Move the slider to the frame, with the number of frames and the name of the file."""
        if self.session.scenario.recording is None or frame_state.n_frames < 2:
            return
        last, frame = frame_state.n_frames - 1, frame_state.step % frame_state.n_frames
        name = self._opened_name  # empty if the studio was started with the recording
        self._frame.update(
            end=last,
            value=frame,
            title=f"Frame, of {frame_state.n_frames}" + (name and f" of {name}"),
            visible=True,
        )

    def _rescan_folders(self) -> None:
        if self.session.limits.folders:
            self._message.text = '<p class="muted">Scanning the folders.</p>'
            self._replace_running_task(self._scan())
        else:
            self._rescan_button.disabled = True
            self._message.text = f"<p>{_NO_FOLDER}</p>"

    def _go_to_frame(self, frame: float) -> None:
        if is_bounded_number(frame):
            self.session.go_to_step(int(frame))

    def _inspect_chosen_file(self) -> None:
        item = self._items.get(str(self._file.value))
        self._open_button.disabled = item is None or item.kind == "recording"
        self._message.text = ""
        if item is not None and item.kind == "recording":
            self._message.text = '<p class="muted">Inspecting the recording.</p>'
            self._replace_running_task(self._inspect(item, self._items.get(str(self._radar.value))))

    def _open_chosen_file(self) -> None:
        item, radar = (self._items.get(str(select.value)) for select in (self._file, self._radar))
        if item is not None:
            limits = self.session.limits
            edit = partial(open_item_as_scenario, item=item, radar_settings=radar, limits=limits)
            self._opened_name = item.name
            self.session.go_to_step(0)
            self.session.queue_edit("", edit)

    def _return_to_scene(self) -> None:
        scene = self._scene
        if scene is not None:
            self.session.go_to_step(0)
            self.session.queue_edit("", lambda _: scene)

    async def _scan(self) -> None:
        library = FolderScan(self.session.limits)
        while not library.is_done:
            await self.session.run_on_worker(partial(library.scan_for, BATCH_S))
        self._schedule_unless_task_replaced(partial(self._offer_scanned_files, library))

    async def _inspect(self, item: LibraryItem, radar: LibraryItem | None) -> None:
        inspected = await self.session.run_on_worker(
            partial(inspect_first_frames, item, radar, self.session.limits)
        )
        self._schedule_unless_task_replaced(partial(self._show_inspection, inspected))

    def _replace_running_task(self, work: Coroutine[Any, Any, None] | None) -> None:
        """Start a task in place of the current one."""
        if self._task is not None:
            self._task.cancel()
        self._task = (
            None if work is None else asyncio.get_running_loop().create_task(self._run_logged(work))
        )

    async def _run_logged(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception:
            _log.exception("the recordings of the studio failed")
            self._schedule_unless_task_replaced(
                partial(setattr, self._message, "text", f"<p>{_INTERNAL_ERROR}</p>")
            )

    def _schedule_unless_task_replaced(self, job: Callable[[], None]) -> None:
        """Schedule a job in the document, unless another task starts before."""
        task = self._task
        self.session.document.add_next_tick_callback(lambda: job() if self._task is task else None)

    def _offer_scanned_files(self, library: FolderScan) -> None:
        self._items = {item.name: item for item in library.items}
        kinds = {"Recordings": "recording", "Scenarios": "scenario"}
        self._file.options = {
            "": [(_NONE, "choose one")],
            **{title: self._file_choices_of_kind(kind) for title, kind in kinds.items()},
        }
        self._radar.options = [(_NONE, _DEFAULT_SETTINGS), *self._file_choices_of_kind("settings")]
        for select in (self._file, self._radar):
            if select.value not in self._items:
                select.value = _NONE
        n = len(self._items)
        text = f"{n} to choose from." if n else "No recording, scenario or settings file in there."
        if library.n_scanned == MAX_SCANNED:
            text += f" Only the first {MAX_SCANNED} files were scanned: name a smaller folder."
        self._message.text = f'<p class="muted">{text}</p>'

    def _file_choices_of_kind(self, kind: str) -> list[tuple[str, str]]:
        return [
            (item.name, _file_choice_title(item))
            for item in self._items.values()
            if item.kind == kind
        ]

    def _show_inspection(self, inspected: InspectedRecording) -> None:
        self._open_button.disabled = inspected.n_frames is None
        if inspected.n_frames is None:
            lead = "It cannot be played:"
            self.session.stop_and_mark_outdated(
                Mistake(
                    setting=str(self._file.value),
                    value="a file that cannot be played",
                    expected="a recording with the settings of its radar",
                    fix="see the reasons under Recordings; Play continues what was shown before",
                )
            )
        else:
            part = (
                f"the first {inspected.n_inspected} of "
                if inspected.n_inspected < inspected.n_frames
                else ""
            )
            lead = (
                f"Found in {part}{inspected.n_frames} frame{'s' if inspected.n_frames > 1 else ''}:"
            )
        items = [
            f'<li class="{finding.level}"><b>{finding.level}</b>: {escape(str(finding))}</li>'
            for finding in inspected.findings
        ]
        body = f"<ul>{''.join(items)}</ul>" if items else "<p>No faults were found.</p>"
        self._message.text = f"<p>{lead}</p>{body}"


def _file_choice_title(item: LibraryItem) -> str:
    if item.kind != "recording":
        return item.name
    kind = " or ".join(item.formats) if len(item.formats) < 3 else "bare samples"
    size = f", {format_with_si_prefix(item.n_bytes, 'B', 3)}" if item.n_bytes else ""
    return f"{item.name} ({kind}{size})"
