"""What one page does with edits, steps and a browser that may be slow."""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from dechirp.experiments.scenario import Scenario, reference
from dechirp.studio import session as sessions
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.session import Session


class Document:
    """As much of a document as a session asks for."""

    def add_next_tick_callback(self, job: Callable[[], None]) -> None:
        asyncio.get_running_loop().call_soon(job)


class Player:
    """Moments that say which step and settings they are of."""

    def __init__(self, scenario: Scenario, limits: PageLimits) -> None:
        self.scenario = scenario

    def frame_at(self, step: int, cursor: object) -> SimpleNamespace:
        return SimpleNamespace(step=step, seed=self.scenario.seed)


class Page:
    """A session, and what it showed and told."""

    def __init__(self, worker: ThreadPoolExecutor, *, draws: bool) -> None:
        self.session = Session(
            Document(), worker, reference(), PageLimits(min_frame_interval_s=1e-3)
        )
        self.shown, self.told, self.taken = [], [], []
        self.session.on_frame.append(self.shown.append)
        self.session.on_mistakes.append(self.told.append)
        self.session.on_settings.append(self.taken.append)
        if draws:
            self.session.on_frame.append(lambda _: self.session.drawn_soon(len(self.shown)))

    async def until(self, holds: Callable[[], bool]) -> None:
        async with asyncio.timeout(60):
            while not holds():
                await asyncio.sleep(1e-3)


@pytest.fixture
def lived(monkeypatch):
    """Run what a page lives through; with a browser that draws at once, or not at all."""
    monkeypatch.setattr(sessions, "FramePlayer", Player)

    def live(life, *, draws: bool = True) -> None:
        async def whole() -> None:
            loop = asyncio.get_running_loop()
            monkeypatch.setattr(
                Session,
                "drawn_soon",
                lambda self, n: loop.call_soon(self.confirm_drawn, n),
                raising=False,
            )
            with ThreadPoolExecutor(1) as worker:
                page = Page(worker, draws=draws)
                page.session.start()
                try:
                    await page.until(lambda: page.shown)
                    await life(page)
                finally:
                    page.session.close()

        asyncio.run(whole())

    return live


def test_of_several_edits_those_that_can_be_hold_and_the_others_are_told(lived):
    async def life(page: Page) -> None:
        page.session.change_setting("seed", "5")
        page.session.change_setting("n_frames", "rubbish")
        page.session.change_setting("chain.range_window", "hamming")
        await page.until(lambda: page.taken)
        await page.until(lambda: page.shown[-1].seed == 5)
        assert page.session.scenario.chain.range_window == "hamming"
        assert page.session.scenario.n_frames == 1
        (mistake,) = page.told[-1]
        assert mistake.setting == "n_frames"
        page.session.go_to_step(1)
        await page.until(lambda: page.shown[-1].step == 1)
        assert page.told[-1] == ()  # it is over

    lived(life)


def test_of_edits_of_one_setting_the_last_holds(lived):
    async def life(page: Page) -> None:
        for seed in range(3, 9):
            page.session.change_setting("seed", str(seed))
        await page.until(lambda: page.taken)
        assert [scenario.seed for scenario in page.taken] == [8]

    lived(life)


def test_it_plays_step_by_step_and_a_rewind_meanwhile_shows_the_first(lived):
    async def life(page: Page) -> None:
        page.session.set_playing(True)
        await page.until(lambda: page.shown[-1].step >= 5)
        steps = [moment.step for moment in page.shown]
        assert steps == sorted(steps) and set(range(5)) <= set(steps)
        seen = len(page.shown)
        page.session.go_to_step(0)
        await page.until(lambda: any(moment.step == 0 for moment in page.shown[seen:]))

    lived(life)


def test_when_it_pauses_no_other_step_comes(lived):
    async def life(page: Page) -> None:
        page.session.set_playing(True)
        await page.until(lambda: page.shown[-1].step >= 3)
        page.session.set_playing(False)
        step = page.session.step
        await asyncio.sleep(0.05)
        assert page.shown[-1].step == page.session.step == step

    lived(life)


def test_a_browser_that_draws_nothing_has_three_moments_at_most(lived):
    async def life(page: Page) -> None:
        page.session.set_playing(True)
        await page.until(lambda: len(page.shown) == 3)
        await asyncio.sleep(0.1)
        assert len(page.shown) == 3
        page.session.confirm_drawn(1)
        await page.until(lambda: len(page.shown) == 4)
        await asyncio.sleep(0.1)
        assert len(page.shown) == 4

    lived(life, draws=False)


def test_a_browser_that_answers_every_second_moment_is_never_waited_for_in_vain(lived):
    async def life(page: Page) -> None:
        page.session.on_frame.append(
            lambda _: len(page.shown) % 2 or page.session.drawn_soon(len(page.shown))
        )
        page.session.set_playing(True)
        async with asyncio.timeout(0.9 * sessions.DRAW_TIMEOUT_S):
            await page.until(lambda: len(page.shown) == 40)

    lived(life, draws=False)


def test_a_view_that_fails_is_told_and_the_page_lives_on(lived, caplog):
    async def life(page: Page) -> None:
        def fail(_: object) -> None:
            raise RuntimeError("a view")

        page.session.on_frame.append(fail)
        page.session.go_to_step(1)
        await page.until(lambda: page.told[-1] != ())
        assert page.told[-1][0].setting == "this page"
        page.session.on_frame.remove(fail)
        page.session.go_to_step(2)
        await page.until(lambda: page.told[-1] == ())

    lived(life)
    assert "a page of the studio failed" in caplog.text


def test_what_takes_long_is_said_to_be_under_way_and_what_does_not_is_not(lived, monkeypatch):
    async def life(page: Page) -> None:
        waits = []
        page.session.on_wait.append(lambda: waits.append(len(page.shown)))
        page.session.go_to_step(1)
        await page.until(lambda: page.shown[-1].step == 1)
        assert waits == []
        monkeypatch.setattr(sessions, "_WAIT_NOTICE_S", 0.01)
        monkeypatch.setattr(Player, "frame_at", slow)
        page.session.go_to_step(2)
        await page.until(lambda: page.shown[-1].step == 2)
        assert waits == [len(page.shown) - 1]  # before it came

    def slow(self: Player, step: int, cursor: object) -> SimpleNamespace:
        time.sleep(0.5)
        return SimpleNamespace(step=step, seed=self.scenario.seed)

    monkeypatch.setattr(sessions, "_WAIT_NOTICE_S", 30.0)
    lived(life)
