"""Session of one page: settings, position in time and the requests for frames.

Widgets run on the event loop of the server; one worker for all pages parses settings and computes
frames, so the loop is never blocked. At most three frames are in flight per browser: it confirms
every second one, draws one, and one is on its way. So a slow browser skips frames instead of
lagging, and a fast one does not wait.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from functools import cache, partial
from time import perf_counter, sleep
from typing import NamedTuple, TypeVar

from bokeh.document import Document

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.experiments.scenario import Scenario
from dechirp.studio.browser_events import DRAW_TIMEOUT_S, MAX_UNDRAWN_FRAMES
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_player import FramePlayer, calibrate_detector
from dechirp.studio.frame_state import FrameState
from dechirp.studio.scenario_edits import PageLimits, apply_overrides, parse_scenario
from dechirp.studio.undo import UndoHistory

T = TypeVar("T")
Edit = Callable[[Scenario], Scenario]

_OPENING_S = 3.0
"""Longest time for which the first frame of a recording waits for the velocities over all frames.
"""
_WAIT_NOTICE_S = 0.3
"""Waiting time after which the page shows a notice, and time between two of them."""

_log = logging.getLogger(__name__)


class Session:
    """Settings, cursor and time of one page.

    Parameters
    ----------
    document : Document
        Document of the page; changed only under its lock.
    worker : Executor
        Single thread that parses settings and computes frames for all pages.
    scenario : Scenario
        Initial scenario.
    limits : PageLimits
        Limits of the settings.
    """

    def __init__(
        self, document: Document, worker: Executor, scenario: Scenario, limits: PageLimits
    ) -> None:
        self.document, self.limits, self.scenario = document, limits, scenario
        self.cursor: Cursor | None = None
        """None: it follows a detection, first the strongest one."""
        self.playing = False
        self.step = 0
        self.frame_state: FrameState | None = None
        """Last frame that was shown."""
        self.shows_current_settings = False
        """True if that frame belongs to the settings; False after a frame that failed."""
        self.on_frame: list[Callable[[FrameState], None]] = []
        self.on_settings: list[Callable[[Scenario], None]] = []
        """Called when settings have changed."""
        self.on_mistakes: list[Callable[[tuple[Mistake, ...]], None]] = []
        """Called with the mistakes of an edit or a frame, and with none after a success that
        follows an edit or a failure."""
        self.setting_findings: list[Callable[[Scenario], tuple[Finding, ...]]] = []
        """Functions that return findings on the settings, beside those of a frame."""
        self.on_wait: list[Callable[[], None]] = []
        """Called while settings are parsed or a frame is computed, if that takes long."""
        self._worker, self._player = worker, FramePlayer(scenario, limits)
        self._calibrated_player: FramePlayer | None = None
        self.undo_history = UndoHistory()
        self._edits: dict[str, Edit] = {}
        self._refused_edits: dict[str, Edit] = {}
        """Refused edits of single settings: they may become valid with a later edit."""
        self._retried_keys: set[str] = set()
        """Keys of the edits that are tried again after a refusal."""
        self._has_work, self._draw_confirmed = asyncio.Event(), asyncio.Event()
        self.activity = "computing"
        """Word for what the page waits for."""
        self._n_shown = self._n_drawn = 0
        self._has_unresolved_mistakes = True
        """True until `on_mistakes` was called without mistakes."""
        self._task: asyncio.Task[None] | None = None
        self._measuring: set[asyncio.Task[None]] = set()
        self._opened_path: str | None = None
        self._is_closed = False
        self._next_frame: _PendingFrame | None = None

    # Interface of panels and views, called on the event loop.

    def change_setting(self, path: str, text: str) -> None:
        """Change a setting to a typed text, as `--set PATH=VALUE` does."""
        self.queue_edit(
            path, partial(apply_overrides, overrides=(f"{path}={text}",), limits=self.limits)
        )

    def undo(self) -> None:
        """Restore the settings before the last change."""
        if self.undo_history.can_undo:
            self._restore_scenario(self.undo_history.step_back(self.scenario))

    def redo(self) -> None:
        """Restore the settings after the last change that was undone."""
        if self.undo_history.can_redo:
            self._restore_scenario(self.undo_history.step_forward(self.scenario))

    def replace_settings(self, text: str) -> None:
        """Replace all settings by the text of a scenario file."""
        self.queue_edit("", lambda _: parse_scenario(text, self.limits))

    def queue_edit(self, key: str, edit: Edit, *, retry: bool = False) -> None:
        """Queue an edit for the worker; only the last edit of each key is applied.

        With `retry`, a refused edit is tried again after each later edit. So settings that
        constrain each other, as the duration of the ramp and its samples, can be typed in any
        order.
        """
        self._edits.pop(key, None)
        self._edits[key] = edit
        self._refused_edits.pop(key, None)
        (self._retried_keys.add if retry else self._retried_keys.discard)(key)
        self._has_work.set()

    def has_queued_edit(self, key: str) -> bool:
        """Return True if an edit of a key waits for the worker."""
        return key in self._edits

    def _restore_scenario(self, scenario: Scenario) -> None:
        self._refused_edits.clear()
        self._edits = {_RESTORE: lambda _: scenario}
        self._has_work.set()

    def set_playing(self, playing: bool) -> None:
        """Start or stop playback."""
        self.playing = playing
        self._has_work.set()

    def go_to_step(self, step: int) -> None:
        """Show another step; 0 rewinds to the same noise."""
        self.step = max(0, step)
        self._has_work.set()

    def move_cursor(self, cursor: Cursor | None) -> None:
        """Move the cursor of all views; None selects the strongest detection."""
        self.cursor = cursor
        self._has_work.set()

    def stop_and_mark_outdated(self, mistake: Mistake) -> None:
        """Stop playback and mark the shown frame as outdated, with the reason."""
        self.playing = self.shows_current_settings = False
        self._notify_mistake_listeners((mistake,))

    def confirm_frames_drawn(self, n_frames: int) -> None:
        """Record the number of frames that the browser has drawn."""
        self._n_drawn = n_frames
        self._draw_confirmed.set()

    # Life cycle.

    def start(self) -> None:
        """Start the session after all callbacks are registered."""
        self._has_work.set()
        self._task = asyncio.get_running_loop().create_task(self._run_loop())

    def close(self) -> None:
        """Stop the session; running work is abandoned."""
        self._is_closed = True
        for task in (self._task, *self._measuring):
            if task is not None:
                task.cancel()

    async def _run_loop(self) -> None:
        while True:
            await self._has_work.wait()
            self._has_work.clear()
            started, shown_step = perf_counter(), self.step
            try:
                await self._process_next()
            except DechirpError as error:
                self.playing = self.shows_current_settings = False
                await self.run_in_document(partial(self._notify_mistake_listeners, error.mistakes))
            except Exception:
                # The page shows an error and continues, as do all others.
                _log.exception("a page of the studio failed")
                self.playing = self.shows_current_settings = False
                await self.run_in_document(
                    partial(self._notify_mistake_listeners, (_INTERNAL_ERROR,))
                )
            if self.playing:
                await asyncio.sleep(self.limits.min_frame_interval_s - (perf_counter() - started))
                if self.playing:  # not paused meanwhile
                    self.step += self.step == shown_step  # or went elsewhere
                    self._has_work.set()

    async def _process_next(self) -> None:
        edits, self._edits = self._edits, {}
        wrong: tuple[Mistake, ...] = ()
        if edits:
            tried = edits if "" in edits else {**self._refused_edits, **edits}
            scenario, refusals = await self._await_with_notice(
                self.run_on_worker(partial(_apply_valid_edits, self.scenario, tried))
            )
            self._refused_edits = {
                key: tried[key]
                for key in refusals
                if key in self._retried_keys and key not in self._edits
            }
            wrong = tuple(mistake for mistakes in refusals.values() for mistake in mistakes)
            if scenario is not self.scenario:
                if _RESTORE not in edits:
                    self.undo_history.record_change(self.scenario, frozenset(edits))
                self._player = FramePlayer(scenario, self.limits, previous=self._player)
                self.scenario = scenario
                await self.run_in_document(self._notify_settings_listeners)
            self.playing = self.playing and not wrong
        if self._player is not self._calibrated_player:
            await self._await_with_notice(self._calibrate_off_worker())
            self._calibrated_player = self._player
            if self.scenario.recording is not None:
                await self._await_with_notice(self._start_measuring_velocities(self._player))
        frame_state = await self._frame_of_step(self.step)
        if self.playing:  # the next one is made while the browser draws this one
            self._next_frame = self._start_computing_frame(self.step + 1)
        await self._wait_for_browser()
        must_notify = bool(edits) or self._has_unresolved_mistakes
        await self.run_in_document(
            partial(self._show_frame_and_mistakes, frame_state, wrong if must_notify else None)
        )
        self._n_shown += 1

    async def _calibrate_off_worker(self) -> None:
        """Calibrate the detector on another thread: on the worker, all pages would stop."""
        source = await self.run_on_worker(self._player.open_source)
        self.activity = "calibrating the threshold"
        try:
            await asyncio.get_running_loop().run_in_executor(
                _calibration_thread(), partial(calibrate_detector, source)
            )
        finally:
            self.activity = "computing"

    async def _start_measuring_velocities(self, player: FramePlayer) -> None:
        """Measure the velocities that all frames of a recording give, on another thread.

        At opening, wait for them for a few seconds; after a change of settings, frames go on.
        """
        measuring = asyncio.get_running_loop().create_task(self._measure_velocities(player))
        self._measuring.add(measuring)
        measuring.add_done_callback(self._measuring.discard)
        assert self.scenario.recording is not None
        path, self._opened_path = self._opened_path, self.scenario.recording.path
        if path == self._opened_path:
            return
        self.activity = "measuring velocities over all frames"
        try:
            await asyncio.wait({measuring}, timeout=_OPENING_S)
        finally:
            self.activity = "computing"

    async def _measure_velocities(self, player: FramePlayer) -> None:
        """Measure velocities over all frames, and show the current frame with them."""

        def make_way(n_done: int, n_frames: int) -> None:
            if player is not self._player or self._is_closed:
                raise _SettingsChanged
            if self.playing:  # the frames of the page go first
                sleep(self.limits.min_frame_interval_s)

        with suppress(DechirpError, _SettingsChanged):  # frames report their errors when shown
            await asyncio.get_running_loop().run_in_executor(
                _measuring_thread(), partial(player.detect_in_all_frames, make_way)
            )
            self._has_work.set()

    async def _wait_for_browser(self) -> None:
        """Wait until the browser can take another frame."""
        while self._n_shown - self._n_drawn >= MAX_UNDRAWN_FRAMES:
            self._draw_confirmed.clear()
            try:
                await asyncio.wait_for(self._draw_confirmed.wait(), DRAW_TIMEOUT_S)
            except TimeoutError:
                self._n_drawn = self._n_shown

    async def _frame_of_step(self, step: int) -> FrameState:
        """Return the frame of a step, which may already be in progress."""
        pending, self._next_frame = self._next_frame, None
        if pending is not None and pending.request != (self._player, step, self.cursor):
            pending.future.cancel()
            pending.future.add_done_callback(_discard_exception)
            pending = None
        return await self._await_with_notice((pending or self._start_computing_frame(step)).future)

    async def _await_with_notice(self, future: Awaitable[T]) -> T:
        """Await a result of the worker; notify `on_wait` again and again if it takes long."""
        notices = asyncio.get_running_loop().create_task(self._notify_while_waiting())
        try:
            return await future
        finally:
            notices.cancel()

    async def _notify_while_waiting(self) -> None:
        while True:
            await asyncio.sleep(_WAIT_NOTICE_S)
            self.document.add_next_tick_callback(lambda: [wait() for wait in self.on_wait])

    def _start_computing_frame(self, step: int) -> "_PendingFrame":
        frame_state = self.run_on_worker(
            partial(self._player.process_frame_at_step, step, self.cursor)
        )
        return _PendingFrame((self._player, step, self.cursor), frame_state)

    def _show_frame_and_mistakes(
        self, frame_state: FrameState, mistakes: tuple[Mistake, ...] | None
    ) -> None:
        """Show a frame, and the mistakes of the edits before it; None: they are as before."""
        self.frame_state, self.shows_current_settings = frame_state, True
        if mistakes is not None:
            self._notify_mistake_listeners(mistakes)
        for show in self.on_frame:
            show(frame_state)

    def _notify_settings_listeners(self) -> None:
        for listener in self.on_settings:
            listener(self.scenario)

    def _notify_mistake_listeners(self, mistakes: tuple[Mistake, ...]) -> None:
        self._has_unresolved_mistakes = bool(mistakes)
        for listener in self.on_mistakes:
            listener(mistakes)

    def run_on_worker(self, job: Callable[[], T]) -> asyncio.Future[T]:
        """Run a job on the worker; long jobs must be split into parts of a few milliseconds."""
        return asyncio.get_running_loop().run_in_executor(self._worker, job)

    async def run_in_document(self, job: Callable[[], object]) -> None:
        """Run a job with the lock of the document and wait for it."""
        finished = asyncio.get_running_loop().create_future()

        def run_job() -> None:
            if finished.done():  # the page was closed meanwhile
                return
            try:
                job()
            except Exception as error:
                finished.set_exception(error)
            else:
                finished.set_result(None)

        self.document.add_next_tick_callback(run_job)
        await finished


class _SettingsChanged(Exception):
    """Settings have changed or the page was closed: the velocities are not wanted any more."""


@cache
def _measuring_thread() -> Executor:
    """Return the thread that measures velocities over all frames, one page after another."""
    return ThreadPoolExecutor(1, thread_name_prefix="velocities")


@cache
def _calibration_thread() -> Executor:
    """Return the thread that calibrates detectors of all pages, one after another."""
    return ThreadPoolExecutor(1, thread_name_prefix="calibration")


class _PendingFrame(NamedTuple):
    """Frame in progress and its request."""

    request: tuple[FramePlayer, int, Cursor | None]
    future: asyncio.Future[FrameState]


def _discard_exception(future: asyncio.Future[FrameState]) -> None:
    """Retrieve the exception of an abandoned frame; asyncio would log it otherwise."""
    if not future.cancelled():
        future.exception()


def _apply_valid_edits(
    scenario: Scenario, edits: Mapping[str, Edit]
) -> tuple[Scenario, dict[str, tuple[Mistake, ...]]]:
    """Apply edits until no further one is valid; return the mistakes of the others by key."""
    refusals: dict[str, tuple[Mistake, ...]] = dict.fromkeys(edits, ())
    n_before = len(edits) + 1
    while 0 < len(refusals) < n_before:
        n_before = len(refusals)
        for key in [*refusals]:
            try:
                scenario = edits[key](scenario)
            except DechirpError as error:
                refusals[key] = error.mistakes
            else:
                del refusals[key]
    return scenario, refusals


_RESTORE = "restore"
"""Key of the edit that restores an earlier or later scenario."""
_INTERNAL_ERROR = Mistake(
    setting="this page",
    value="an internal error; see the log of the server",
    expected="no error",
    fix="change a setting or rewind, and report the error",
)
