"""What one page does: it holds settings and a place in time, and asks for the next moment.

Widgets live on the loop of the server; settings are read and moments made by one worker for all
pages, so that the loop is never held. A browser has three moments at most that it has not told to
have drawn: it tells of every second one, draws one, and one is on its way. So a slow one gets fewer
frames, never a queue of old ones, and a fast one need not wait for the next.
"""

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from time import perf_counter
from typing import NamedTuple, TypeVar

from bokeh.document import Document

from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiment.scenario import Scenario
from dechirp.studio.moment import Moment
from dechirp.studio.player import Player
from dechirp.studio.pointing import Cursor
from dechirp.studio.settings import Limits, changed, parsed

T = TypeVar("T")
Edit = Callable[[Scenario], Scenario]

DRAWN_WITHIN_S = 2.0
"""A browser that has not said by then that it drew a frame is sent the next one all the same."""
_MOST_UNDRAWN = 3
_LONG_S = 0.3
"""Who waits so long for an answer wonders whether there will be one."""

_log = logging.getLogger(__name__)


class Session:
    """Settings, cursor and time of one page.

    Parameters
    ----------
    document : Document
        Of the page; changed under its lock alone.
    worker : Executor
        Of one thread: reads settings and makes moments, of all pages.
    scenario : Scenario
        What it starts with.
    limits : Limits
        What settings may ask for.
    """

    def __init__(
        self, document: Document, worker: Executor, scenario: Scenario, limits: Limits
    ) -> None:
        self.document, self.limits, self.scenario = document, limits, scenario
        self.cursor: Cursor | None = None
        """None: at the strongest detection."""
        self.playing = False
        self.step = 0
        self.moment: Moment | None = None
        """The last one that was shown."""
        self.on_moment: list[Callable[[Moment], None]] = []
        self.on_settings: list[Callable[[Scenario], None]] = []
        """Called when settings were changed, by whomever."""
        self.on_trouble: list[Callable[[tuple[Mistake, ...]], None]] = []
        """Called with what is wrong with an edit or a frame, and with nothing once that is over."""
        self.on_wait: list[Callable[[], None]] = []
        """Called while settings are read or a moment is made, if that takes long."""
        self._worker, self._player = worker, Player(scenario, limits)
        self._edits: dict[str, Edit] = {}
        self._asked, self._drawn = asyncio.Event(), asyncio.Event()
        self._n_shown = self._n_drawn = 0
        self._running: asyncio.Task[None] | None = None
        self._ahead: _Begun | None = None

    # What panels and views call, on the loop.

    def change(self, path: str, text: str) -> None:
        """Put what was typed into a setting, as `--set PATH=VALUE` does."""
        self.edit(path, partial(changed, options=(f"{path}={text}",), limits=self.limits))

    def replace(self, text: str) -> None:
        """Take all settings from the text of a scenario file."""
        self.edit("", lambda _: parsed(text, self.limits))

    def edit(self, key: str, made: Edit) -> None:
        """Change settings by a function, on the worker; of several with one key the last counts."""
        self._edits.pop(key, None)
        self._edits[key] = made
        self._asked.set()

    def play(self, playing: bool) -> None:
        """Go on from step to step, or stay."""
        self.playing = playing
        self._asked.set()

    def go(self, step: int) -> None:
        """Show another step; 0 rewinds: the same noise again."""
        self.step = max(0, step)
        self._asked.set()

    def point(self, cursor: Cursor | None) -> None:
        """Let all views look at another place."""
        self.cursor = cursor
        self._asked.set()

    def drawn(self, n_moments: int) -> None:
        """Hear from the browser how many of the moments that it got it has drawn."""
        self._n_drawn = n_moments
        self._drawn.set()

    # Its life.

    def start(self) -> None:
        """Begin, once everything that listens is there."""
        self._asked.set()
        self._running = asyncio.get_running_loop().create_task(self._run())

    def close(self) -> None:
        """End; what is under way on the worker is let go."""
        if self._running is not None:
            self._running.cancel()

    async def _run(self) -> None:
        while True:
            await self._asked.wait()
            self._asked.clear()
            started, shown = perf_counter(), self.step
            try:
                await self._next()
            except DechirpError as error:
                self.playing = False
                await self.in_document(partial(self._tell, error.mistakes))
            except Exception:
                # The page says so and lives on; so do all others.
                _log.exception("a page of the studio failed")
                self.playing = False
                await self.in_document(partial(self._tell, (_OWN_FAULT,)))
            if self.playing:
                await asyncio.sleep(self.limits.frame_s - (perf_counter() - started))
                if self.playing:  # nobody paused meanwhile
                    self.step += self.step == shown  # or went elsewhere
                    self._asked.set()

    async def _next(self) -> None:
        edits, self._edits = list(self._edits.values()), {}
        wrong: tuple[Mistake, ...] = ()
        if edits:
            scenario, wrong = await self._awaited(self.work(partial(_edited, self.scenario, edits)))
            if scenario is not self.scenario:
                self.scenario, self._player = scenario, Player(scenario, self.limits)
                await self.in_document(lambda: [tell(scenario) for tell in self.on_settings])
            self.playing = self.playing and not wrong
        moment = await self._made(self.step)
        if self.playing:  # the next one is made while the browser draws this one
            self._ahead = self._look(self.step + 1)
        await self._room()
        await self.in_document(partial(self._show, moment, wrong))
        self._n_shown += 1

    async def _room(self) -> None:
        """Wait until the browser takes another moment."""
        while self._n_shown - self._n_drawn >= _MOST_UNDRAWN:
            self._drawn.clear()
            try:
                await asyncio.wait_for(self._drawn.wait(), DRAWN_WITHIN_S)
            except TimeoutError:
                self._n_drawn = self._n_shown

    async def _made(self, step: int) -> Moment:
        """The moment of a step, which may have been begun already."""
        ahead, self._ahead = self._ahead, None
        if ahead is not None and ahead.asked != (self._player, step, self.cursor):
            ahead.moment.cancel()
            ahead.moment.add_done_callback(_let_go)
            ahead = None
        return await self._awaited((ahead or self._look(step)).moment)

    async def _awaited(self, made: asyncio.Future[T]) -> T:
        """What the worker makes; if that takes long, who listens is told."""

        def tell() -> None:
            self.document.add_next_tick_callback(lambda: [wait() for wait in self.on_wait])

        late = asyncio.get_running_loop().call_later(_LONG_S, tell)
        try:
            return await made
        finally:
            late.cancel()

    def _look(self, step: int) -> "_Begun":
        moment = self.work(partial(self._player.look, step, self.cursor))
        return _Begun((self._player, step, self.cursor), moment)

    def _show(self, moment: Moment, wrong: tuple[Mistake, ...]) -> None:
        self.moment = moment
        self._tell(wrong)
        for show in self.on_moment:
            show(moment)

    def _tell(self, mistakes: tuple[Mistake, ...]) -> None:
        for tell in self.on_trouble:
            tell(mistakes)

    def work(self, job: Callable[[], T]) -> asyncio.Future[T]:
        """Do something on the worker; of what takes long a few milliseconds at a time."""
        return asyncio.get_running_loop().run_in_executor(self._worker, job)

    async def in_document(self, job: Callable[[], object]) -> None:
        """Do something with the lock of the document, and wait until it is done."""
        done = asyncio.get_running_loop().create_future()

        def locked() -> None:
            if done.done():  # the page was closed meanwhile
                return
            try:
                job()
            except Exception as error:
                done.set_exception(error)
            else:
                done.set_result(None)

        self.document.add_next_tick_callback(locked)
        await done


class _Begun(NamedTuple):
    """A moment that is being made, and what was asked for."""

    asked: tuple[Player, int, Cursor | None]
    moment: asyncio.Future[Moment]


def _let_go(moment: asyncio.Future[Moment]) -> None:
    """Hear what went wrong with a moment that nobody waits for, or the log would tell it."""
    if not moment.cancelled():
        moment.exception()


def _edited(scenario: Scenario, edits: list[Edit]) -> tuple[Scenario, tuple[Mistake, ...]]:
    """Settings after all edits that can be, and what is wrong with the others."""
    wrong: list[Mistake] = []
    for edit in edits:
        try:
            scenario = edit(scenario)
        except DechirpError as error:
            wrong += error.mistakes
    return scenario, tuple(wrong)


_OWN_FAULT = Mistake(
    setting="this page",
    got="an error of its own, which the log of the server tells",
    need="none",
    fix="Change a setting or rewind; and please report it.",
)
