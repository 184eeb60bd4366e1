"""The page of a lesson: its knobs, its play button, and the loop between them and the worker."""

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
from dechirp.report.amounts import typographic
from dechirp.report.equations import svg
from dechirp.studio.browser import Browser, script, text_of
from dechirp.studio.settings import Limits
from dechirp.studio.teach.lesson import Lesson, Try
from dechirp.studio.theme import DARK, LIGHT, of_pages, of_widgets

_FRAME_S = 1 / 15
"""Shortest time between frames: enough to see things move, and lessons share one worker."""

_log = logging.getLogger(__name__)

_DRAWN_WITHIN_S = 2.0
"""A browser that has not said by then that it drew a frame is sent the next one all the same."""


class LessonPage:
    """One browser page of a lesson.

    Parameters
    ----------
    document : Document
        What it is put into; changed under its lock alone.
    make : callable
        Makes the lesson.
    number, n_lessons : int
        Its place among the lessons, from 1, and how many there are.
    worker : Executor
        Computes what is seen, for all pages.
    limits : Limits
        The frame rate among them.
    """

    def __init__(
        self,
        document: Document,
        *,
        make: Callable[[], Lesson[Any, Any]],
        number: int,
        n_lessons: int,
        worker: Executor,
        limits: Limits,
    ) -> None:
        self._lesson, self._worker = make(), worker
        self._frame = 0
        self._asked, self._playing = True, False
        lesson = self._lesson
        self._browser, self._sent_s = Browser(name="browser"), 0.0
        self._browser.on_change("dark", self._wear)
        self._browser.on_change("play_keys", lambda attr, old, new: self._turn())
        self._knobs = {name: knob.widget() for name, knob in lesson.knobs.items()}
        for knob in self._knobs.values():
            knob.on_change("value", self._turned)
        self._play = _button(_PLAY, self._turn, name="play")
        self._numbers = Div(name="numbers", css_classes=["lesson"], sizing_mode="stretch_width")
        self._answer = Div(name="answer", text=_UNTRIED, sizing_mode="stretch_width")
        tries = [
            _button(typographic(one.ask), partial(self._try, one), name=f"try_{index}")
            for index, one in enumerate(lesson.tries)
        ]
        lesson.root.name, lesson.root.tags = "figures", [self._browser]
        lesson.wear(LIGHT)
        knobs = column(*self._knobs.values(), name="knobs", sizing_mode="stretch_width")
        for root in (lesson.root, knobs, self._play, self._numbers, *tries, self._answer):
            document.add_root(root)
        document.title = f"{lesson.title} · dechirp"
        document.theme = of_widgets()
        document.template = text_of("teach", "lesson.html")
        document.template_variables.update(
            lesson=lesson,
            says=typographic(lesson.says),
            number=number,
            n_lessons=n_lessons,
            formulas=[(svg(tex), words) for tex, words in lesson.formulas],
            style=of_pages(),
            script=script(),
        )
        document.add_periodic_callback(self._next, round(1000 * max(_FRAME_S, limits.frame_s)))

    def _turned(self, attr: str, old: object, new: object) -> None:
        self._asked = True

    def _turn(self) -> None:
        """Play, or stay."""
        self._playing = not self._playing
        self._play.label = _PAUSE if self._playing else _PLAY

    def _try(self, one: Try) -> None:
        for name, knob in self._lesson.knobs.items():
            self._knobs[name].value = one.sets.get(name, knob.first)
        self._answer.text = typographic(one.answer)

    def _wear(self, attr: str, old: bool, dark: bool) -> None:
        self._lesson.wear(DARK if dark else LIGHT)

    async def _next(self) -> None:
        """One frame, where there is something new to see; the loop is free while it is computed."""
        late = monotonic() - self._sent_s > _DRAWN_WITHIN_S
        if self._browser.drawn < self._browser.shown and not late:
            return
        if self._playing:
            self._frame += 1
            for name, onward in self._lesson.onward(self._values()).items():
                self._knobs[name].value = onward
        elif not self._asked:
            return
        self._asked = False
        at = self._lesson.settings(self._values())
        loop = asyncio.get_running_loop()
        try:
            seen = await loop.run_in_executor(self._worker, self._lesson.look, at, self._frame)
            self._numbers.text = _listed(self._lesson.show(seen))
            self._browser.shown += 1
            self._sent_s = monotonic()
        except DechirpError as error:
            self._stop(" ".join(f"{m.got}; needed is {m.need}. {m.fix}" for m in error.mistakes))
        except Exception:
            # The page says so and lives on; so do all others.
            _log.exception("a lesson failed")
            self._stop("This page made an error, which the log of the server tells.")

    def _values(self) -> dict[str, Any]:
        return {name: knob.value for name, knob in self._knobs.items()}

    def _stop(self, why: str) -> None:
        self._answer.text = why
        if self._playing:
            self._turn()


_PLAY, _PAUSE = "▶ Play", "❚❚ Pause"
_UNTRIED = "First guess what will happen. Then press, and read here what is seen, and why."


def _button(label: str, pressed: Callable[[], None], *, name: str) -> Button:
    made = Button(label=label, name=name, css_classes=["lesson"], sizing_mode="stretch_width")
    made.on_event("button_click", lambda *_: pressed())
    return made


def _listed(numbers: Mapping[str, str]) -> str:
    """Numbers by what they are, as HTML; both come from the lessons, not from users."""
    rows = (
        f"<tr><td>{typographic(name)}</td><td>{typographic(value)}</td></tr>"
        for name, value in numbers.items()
    )
    return f'<table class="follows">{"".join(rows)}</table>'
