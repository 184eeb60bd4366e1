"""Page of a lesson: knobs, play button and the loop with the worker."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from functools import partial
from time import monotonic
from typing import Any

from bokeh.document import Document
from bokeh.layouts import column
from bokeh.models import Button, Div

from dechirp.core.errors import DechirpError
from dechirp.report.check_values import apply_typography
from dechirp.report.equations import equation_svg
from dechirp.studio.browser_events import (
    DRAW_TIMEOUT_S,
    MAX_UNDRAWN_FRAMES,
    BrowserState,
    browser_javascript,
    read_studio_asset_text,
)
from dechirp.studio.compilation import compilation_counter
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.teach.lesson import Experiment, Lesson
from dechirp.studio.theme import DARK, LIGHT, bokeh_widget_theme, page_css

_FRAME_S = 1 / 18
"""Shortest time between frames: 15 per second with the time between two calls."""

_WAIT_NOTICE_S = 0.3
"""Waiting time after which the page shows a notice."""

_log = logging.getLogger(__name__)


class LessonPage:
    """One browser page of a lesson.

    Parameters
    ----------
    document : Document
        Document of the page; changed only under its lock.
    make : callable
        Function that creates the lesson.
    number, n_lessons : int
        Number of the lesson, from 1, and number of lessons.
    worker : Executor
        Worker that computes frames for all pages.
    limits : PageLimits
        Limits, among them the frame rate.
    """

    def __init__(
        self,
        document: Document,
        *,
        make: Callable[[], Lesson[Any, Any]],
        number: int,
        n_lessons: int,
        worker: Executor,
        limits: PageLimits,
    ) -> None:
        self._lesson, self._worker = make(), worker
        self._frame = 0
        self._has_changes, self._playing = True, False
        lesson = self._lesson
        self._browser, self._sent_s = BrowserState(name="browser"), 0.0
        self._pending_frame: asyncio.Future[Any] | None = None
        self._browser.on_change("dark", self._apply_shade)
        self._browser.on_change("play_keys", lambda attr, old, new: self._toggle_play())
        self._knobs = {name: knob.create_widget() for name, knob in lesson.knobs.items()}
        for knob in self._knobs.values():
            knob.on_change("value", self._mark_knobs_changed)
        self._play = _new_button(_PLAY, self._toggle_play, name="play")
        self._numbers = Div(
            name="numbers",
            css_classes=["lesson"],
            sizing_mode="stretch_width",
            disable_math=True,
        )
        self._answer = Div(
            name="answer", text=_INVITATION, sizing_mode="stretch_width", disable_math=True
        )
        tries = [
            _new_button(
                apply_typography(experiment.question),
                partial(self._set_up_experiment, experiment),
                name=f"try_{index}",
            )
            for index, experiment in enumerate(lesson.experiments)
        ]
        lesson.root_element.name, lesson.root_element.tags = "figures", [self._browser]
        lesson.apply_theme(LIGHT)
        knobs = column(*self._knobs.values(), name="knobs", sizing_mode="stretch_width")
        for root in (lesson.root_element, knobs, self._play, self._numbers, *tries, self._answer):
            document.add_root(root)
        document.title = f"{lesson.title} · dechirp"
        document.theme = bokeh_widget_theme()
        # Bokeh connects to an ended session, and fails with arrays: connection.js reports the loss.
        document.config.update(reconnect_session=False, notify_connection_status=False)
        document.template = read_studio_asset_text("teach", "lesson.html")
        document.template_variables.update(
            lesson=lesson,
            introduction=apply_typography(lesson.introduction),
            number=number,
            n_lessons=n_lessons,
            formulas=[(equation_svg(tex), words) for tex, words in lesson.formulas],
            style=page_css(),
            script=browser_javascript(),
        )
        document.add_periodic_callback(
            self._draw_next, round(1000 * max(_FRAME_S, limits.min_frame_interval_s))
        )

    def _mark_knobs_changed(self, attr: str, old: object, new: object) -> None:
        self._has_changes = True

    def _toggle_play(self) -> None:
        """Start or stop playback."""
        self._playing = not self._playing
        self._play.label = _PAUSE if self._playing else _PLAY

    def _set_up_experiment(self, experiment: Experiment) -> None:
        for name, knob in self._lesson.knobs.items():
            self._knobs[name].value = experiment.knob_values.get(name, knob.first)
        self._answer.text = apply_typography(experiment.answer)

    def _apply_shade(self, attr: str, old: bool, dark: bool) -> None:
        self._lesson.apply_theme(DARK if dark else LIGHT)

    async def _draw_next(self) -> None:
        """Draw the next frame if anything changed; the loop is free while it is computed."""
        if self._pending_frame is None and not self._start_next_frame():
            return
        try:
            frame = await self._frame_or_none_after_notice()
            if frame is None:
                return
            self._numbers.text = _numbers_table_html(
                self._lesson.draw_frame_and_format_numbers(frame)
            )
            self._browser.update(n_frames_sent=self._browser.n_frames_sent + 1, frame_status="")
            self._sent_s = monotonic()
        except DechirpError as error:
            self._show_error_and_pause(
                " ".join(f"{m.value}; expected {m.expected}; {m.fix}." for m in error.mistakes)
            )
        except Exception:
            # The page shows an error and continues, as do all others.
            _log.exception("a lesson failed")
            self._show_error_and_pause("Internal error; see the log of the server.")

    def _start_next_frame(self) -> bool:
        """Start to compute a frame if anything changed and the browser can take one."""
        is_late = monotonic() - self._sent_s > DRAW_TIMEOUT_S
        n_undrawn = self._browser.n_frames_sent - self._browser.n_frames_drawn
        if n_undrawn >= MAX_UNDRAWN_FRAMES and not is_late:
            return False
        if self._playing:
            self._frame += 1
            for name, value in self._lesson.next_animated_knob_values(self._knob_values()).items():
                self._knobs[name].value = value
        elif not self._has_changes:
            return False
        self._has_changes = False
        settings = self._lesson.build_settings(self._knob_values())
        self._pending_frame = asyncio.get_running_loop().run_in_executor(
            self._worker, self._lesson.compute_frame, settings, self._frame
        )
        return True

    async def _frame_or_none_after_notice(self) -> object | None:
        """Return the frame; after a while None, with a notice, for which the page must be free."""
        pending = self._pending_frame
        assert pending is not None
        await asyncio.wait({pending}, timeout=_WAIT_NOTICE_S)
        if not pending.done():
            self._browser.frame_status = compilation_counter().progress_text or "computing ..."
            return None
        self._pending_frame = None
        return pending.result()

    def _knob_values(self) -> dict[str, Any]:
        return {name: knob.value for name, knob in self._knobs.items()}

    def _show_error_and_pause(self, reason: str) -> None:
        self._answer.text = reason
        if self._playing:
            self._toggle_play()


_PLAY, _PAUSE = "▶ Play", "❚❚ Pause"
_INVITATION = "First predict the result. Then press a button and read the explanation here."


def _new_button(label: str, on_press: Callable[[], None], *, name: str) -> Button:
    button = Button(label=label, name=name, css_classes=["lesson"], sizing_mode="stretch_width")
    button.on_event("button_click", lambda *_: on_press())
    return button


def _numbers_table_html(numbers: Mapping[str, str]) -> str:
    """Format labelled numbers as HTML; both come from the lessons, not from users."""
    rows = (
        f"<tr><td>{apply_typography(name)}</td><td>{apply_typography(value)}</td></tr>"
        for name, value in numbers.items()
    )
    return f'<table class="follows">{"".join(rows)}</table>'
