"""Page sessions: edits, steps, playback and slow browsers."""

import asyncio
import re
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import pytest
from bokeh.document import Document
from bokeh.models import Div

from dechirp.core.compiled_kernels import compilation_listeners, kernel
from dechirp.core.errors import Mistake
from dechirp.experiments.scenario import RecordingSource, Scenario, reference
from dechirp.processing.cfar import base as cfar_base
from dechirp.studio import page as pages
from dechirp.studio import session as sessions
from dechirp.studio.compilation import CompilationCounter, compilation_counter
from dechirp.studio.frame_player import FramePlayer, calibrate_detector
from dechirp.studio.page import page_builders_by_address
from dechirp.studio.panels.knob_widgets import make_setting_changer
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.session import Session
from dechirp.studio.views.base import View


class DocumentStub:
    """Document with the one method that a session calls."""

    def add_next_tick_callback(self, job: Callable[[], None]) -> None:
        asyncio.get_running_loop().call_soon(job)


class PlayerStub:
    """Player whose frames contain their step and seed."""

    def __init__(self, scenario: Scenario, limits: PageLimits, *, previous: object = None) -> None:
        self.scenario = scenario

    def open_source(self) -> SimpleNamespace:
        return SimpleNamespace(scenario=self.scenario, radar=self.scenario.radar)

    def process_frame_at_step(self, step: int, cursor: object) -> SimpleNamespace:
        return SimpleNamespace(step=step, seed=self.scenario.seed, scenario=self.scenario)


class Page:
    """Session with the frames, mistakes and settings that it reported."""

    def __init__(self, worker: ThreadPoolExecutor, *, draws: bool) -> None:
        self.session = Session(
            DocumentStub(), worker, reference(), PageLimits(min_frame_interval_s=1e-3)
        )
        self.frames, self.mistakes, self.settings = [], [], []
        self.session.on_frame.append(self.frames.append)
        self.session.on_mistakes.append(self.mistakes.append)
        self.session.on_settings.append(self.settings.append)
        if draws:
            self.session.on_frame.append(lambda _: self.session.drawn_soon(len(self.frames)))

    async def wait_until(self, holds: Callable[[], bool]) -> None:
        async with asyncio.timeout(60):
            while not holds():
                await asyncio.sleep(1e-3)


@pytest.fixture
def run_page(monkeypatch):
    """Run an interaction on a page whose browser draws immediately, or never."""
    monkeypatch.setattr(sessions, "FramePlayer", PlayerStub)

    def run(interaction, *, draws: bool = True) -> None:
        async def run_session() -> None:
            loop = asyncio.get_running_loop()
            monkeypatch.setattr(
                Session,
                "drawn_soon",
                lambda self, n: loop.call_soon(self.confirm_frames_drawn, n),
                raising=False,
            )
            with ThreadPoolExecutor(1) as worker:
                page = Page(worker, draws=draws)
                page.session.start()
                try:
                    await page.wait_until(lambda: page.frames)
                    await interaction(page)
                finally:
                    page.session.close()

        asyncio.run(run_session())

    return run


def test_valid_edits_apply_and_invalid_ones_are_reported(run_page):
    async def interaction(page: Page) -> None:
        page.session.change_setting("seed", "5")
        page.session.change_setting("n_frames", "rubbish")
        page.session.change_setting("chain.range_window", "hamming")
        await page.wait_until(lambda: page.settings)
        await page.wait_until(lambda: page.frames[-1].seed == 5)
        assert page.session.scenario.chain.range_window == "hamming"
        assert page.session.scenario.n_frames == 1
        (mistake,) = page.mistakes[-1]
        assert mistake.setting == "n_frames"
        page.session.go_to_step(1)
        await page.wait_until(lambda: page.frames[-1].step == 1)
        assert page.mistakes[-1] == ()  # cleared by the next step

    run_page(interaction)


def test_last_edit_of_setting_applies(run_page):
    async def interaction(page: Page) -> None:
        for seed in range(3, 9):
            page.session.change_setting("seed", str(seed))
        await page.wait_until(lambda: page.settings)
        assert [scenario.seed for scenario in page.settings] == [8]

    run_page(interaction)


def test_plays_every_step_and_rewinds_while_playing(run_page):
    async def interaction(page: Page) -> None:
        page.session.set_playing(True)
        await page.wait_until(lambda: page.frames[-1].step >= 5)
        steps = [frame.step for frame in page.frames]
        assert steps == sorted(steps) and set(range(5)) <= set(steps)
        n_before_rewind = len(page.frames)
        page.session.go_to_step(0)
        await page.wait_until(
            lambda: any(frame.step == 0 for frame in page.frames[n_before_rewind:])
        )

    run_page(interaction)


def test_pause_stops_at_current_step(run_page):
    async def interaction(page: Page) -> None:
        page.session.set_playing(True)
        await page.wait_until(lambda: page.frames[-1].step >= 3)
        page.session.set_playing(False)
        step = page.session.step
        await asyncio.sleep(0.05)
        assert page.frames[-1].step == page.session.step == step

    run_page(interaction)


def test_at_most_three_frames_are_in_flight_per_browser(run_page):
    async def interaction(page: Page) -> None:
        page.session.set_playing(True)
        await page.wait_until(lambda: len(page.frames) == 3)
        await asyncio.sleep(0.1)
        assert len(page.frames) == 3
        page.session.confirm_frames_drawn(1)
        await page.wait_until(lambda: len(page.frames) == 4)
        await asyncio.sleep(0.1)
        assert len(page.frames) == 4

    run_page(interaction, draws=False)


def test_unconfirmed_frames_between_confirmed_ones_cause_no_timeout(run_page):
    async def interaction(page: Page) -> None:
        page.session.on_frame.append(
            lambda _: len(page.frames) % 2 or page.session.drawn_soon(len(page.frames))
        )
        page.session.set_playing(True)
        async with asyncio.timeout(0.9 * sessions.DRAW_TIMEOUT_S):
            await page.wait_until(lambda: len(page.frames) == 40)

    run_page(interaction, draws=False)


def test_failing_view_is_reported_and_page_continues(run_page, caplog):
    async def interaction(page: Page) -> None:
        def fail(_: object) -> None:
            raise RuntimeError("a view")

        page.session.on_frame.append(fail)
        page.session.go_to_step(1)
        await page.wait_until(lambda: page.mistakes[-1] != ())
        assert page.mistakes[-1][0].setting == "this page"
        page.session.on_frame.remove(fail)
        page.session.go_to_step(2)
        await page.wait_until(lambda: page.mistakes[-1] == ())

    run_page(interaction)
    assert "a page of the studio failed" in caplog.text


def test_mistakes_are_notified_only_after_edits_and_failures(run_page):
    """Panels would spend 1 ms of each frame on the same news."""

    async def interaction(page: Page) -> None:
        session = page.session
        await page.wait_until(lambda: page.mistakes == [()])
        session.set_playing(True)
        await page.wait_until(lambda: len(page.frames) > 10)
        session.set_playing(False)
        assert page.mistakes == [()]
        session.change_setting("n_frames", "rubbish")
        await page.wait_until(lambda: len(page.mistakes) == 2)
        session.go_to_step(session.step + 1)
        await page.wait_until(lambda: len(page.mistakes) == 3)
        assert page.mistakes[1] and page.mistakes[2] == ()
        session.change_setting("seed", "5")
        await page.wait_until(lambda: page.frames[-1].seed == 5)
        assert page.mistakes[3:] == [()]

    run_page(interaction)


def test_wait_notice_appears_only_for_slow_frames(run_page, monkeypatch):
    async def interaction(page: Page) -> None:
        waits = []
        page.session.on_wait.append(lambda: waits.append(len(page.frames)))
        page.session.go_to_step(1)
        await page.wait_until(lambda: page.frames[-1].step == 1)
        assert waits == []
        monkeypatch.setattr(sessions, "_WAIT_NOTICE_S", 0.01)
        monkeypatch.setattr(PlayerStub, "process_frame_at_step", compute_slowly)
        page.session.go_to_step(2)
        await page.wait_until(lambda: page.frames[-1].step == 2)
        assert len(waits) > 1  # its progress is shown again and again
        assert set(waits) == {len(page.frames) - 1}  # before the frame

    def compute_slowly(self: PlayerStub, step: int, cursor: object) -> SimpleNamespace:
        time.sleep(0.5)
        return SimpleNamespace(step=step, seed=self.scenario.seed)

    monkeypatch.setattr(sessions, "_WAIT_NOTICE_S", 30.0)
    run_page(interaction)


def test_detector_is_calibrated_while_worker_serves_other_pages(run_page, monkeypatch):
    async def interaction(page: Page) -> None:
        threads, is_released = [], threading.Event()

        def calibrate(source: SimpleNamespace) -> None:
            threads.append(threading.current_thread().name)
            is_released.wait(60)

        monkeypatch.setattr(sessions, "calibrate_detector", calibrate)
        page.session.change_setting("chain.cfar.estimator", "{kind: two-step}")
        await page.wait_until(lambda: threads)
        assert await page.session.run_on_worker(lambda: "free") == "free"
        n_frames = len(page.frames)
        is_released.set()
        await page.wait_until(lambda: len(page.frames) > n_frames)
        page.session.go_to_step(1)
        await page.wait_until(lambda: page.frames[-1].step == 1)
        assert len(threads) == 1  # once for each change of settings

    run_page(interaction)


def test_velocities_are_measured_off_the_worker_and_shown_when_known(run_page, monkeypatch):
    async def interaction(page: Page) -> None:
        threads, is_released = [], threading.Event()

        def detect(player: PlayerStub, progress: Callable[[int, int], None]) -> None:
            threads.append(threading.current_thread().name)
            is_released.wait(60)
            progress(1, 1)

        monkeypatch.setattr(sessions, "_OPENING_S", 0.01)
        monkeypatch.setattr(PlayerStub, "detect_in_all_frames", detect, raising=False)
        source = RecordingSource(path="drive.npy")
        recorded = Scenario(radar=reference().radar, recording=source)
        page.session.queue_edit("", lambda _: recorded)
        await page.wait_until(lambda: threads and page.session.frame_state.scenario is recorded)
        page.session.go_to_step(1)
        await page.wait_until(lambda: page.frames[-1].step == 1)  # frames go on meanwhile
        n_frames = len(page.frames)
        is_released.set()
        await page.wait_until(lambda: len(page.frames) > n_frames)  # shown without a click
        assert threads == ["velocities_0"]

    run_page(interaction)


def test_frame_after_calibration_needs_no_other():
    scenario = reference()
    cfar = replace(scenario.chain.cfar, false_alarm_probability=2.5e-5)
    scenario = replace(scenario, chain=replace(scenario.chain, cfar=cfar))
    player = FramePlayer(scenario)
    factors = cfar_base._threshold_factors_per_box_row_and_error
    n_initial = factors.cache_info().misses
    calibrate_detector(player.open_source())
    assert factors.cache_info().misses == n_initial + 1
    player.process_frame_at_step(0, None)
    assert factors.cache_info().misses == n_initial + 1


def test_undo_and_redo_restore_settings(run_page):
    async def interact(page) -> None:
        session = page.session
        for seed in (7, 8):
            session.change_setting("seed", str(seed))
            await page.wait_until(lambda seed=seed: page.frames[-1].seed == seed)
            session.undo_history._last_change = frozenset(), 0.0  # as after a second
        session.undo()
        await page.wait_until(lambda: page.frames[-1].seed == 7)
        session.undo()
        await page.wait_until(lambda: page.frames[-1].seed == reference().seed)
        assert not session.undo_history.can_undo
        session.redo()
        await page.wait_until(lambda: page.frames[-1].seed == 7)
        session.change_setting("seed", "9")
        await page.wait_until(lambda: page.frames[-1].seed == 9)
        assert not session.undo_history.can_redo

    run_page(interact)


def test_settings_that_constrain_each_other_are_typed_in_any_order(run_page):
    """A shorter ramp is refused as long as its samples do not fit into it."""
    chirp = reference().radar.frame.chirp
    ramp_us, n_samples = chirp.ramp_duration_s * 1e6 / 2, chirp.n_samples // 4

    async def interact(page) -> None:
        session, path = page.session, "radar.frame.chirp"
        change = make_setting_changer(session)
        change(f"{path}.ramp_duration", f"{ramp_us} us")
        await page.wait_until(lambda: page.mistakes[-1])
        assert session.scenario.radar.frame.chirp == chirp
        change(f"{path}.n_samples", str(n_samples))
        await page.wait_until(lambda: not page.mistakes[-1])
        both = session.scenario.radar.frame.chirp
        assert both.n_samples == n_samples
        assert both.ramp_duration_s == pytest.approx(ramp_us / 1e6)

    run_page(interact)


def test_compilation_starts_with_server_and_is_counted():
    counter = compilation_counter()
    n_initial = counter.n_compiled

    @kernel(cache=False)
    def double(value):
        return 2 * value

    assert double(2) == 4
    assert counter.n_compiled == n_initial + 1
    assert re.search(rf"minute: {counter.n_compiled} loops in \d+ s\.", counter.progress_text)
    stopped = CompilationCounter()
    stopped.stop()
    try:
        with pytest.raises(RuntimeError, match="ended"):
            double(2.0)
    finally:
        compilation_listeners.remove(stopped)
    with ThreadPoolExecutor(1) as worker:
        submitted = []
        worker.submit = lambda *job: submitted.append(job)
        page_builders_by_address(worker, scenario=reference(), limits=PageLimits())
    assert [job[0].__name__ for job in submitted] == ["process_frame_at_step"] * 2


def test_texts_and_tables_show_same_frames(monkeypatch):
    now_s = 0.0
    shown_steps = {"table": [], "caption": [], "map": [], "slower map": []}

    class Table(View):
        name = "table"

        def __init__(self, session: Session) -> None:
            super().__init__(session)
            self._root = Div(name=self.name)

        @property
        def root_element(self) -> Div:
            return self._root

        def show_frame(self, frame_state: SimpleNamespace) -> None:
            shown_steps[self.name].append(frame_state.step)

        def update_caption(self, frame_state: SimpleNamespace) -> None:
            shown_steps["caption"].append((self.name, frame_state.step))

        def apply_theme(self, theme: object) -> None:
            pass

    class Map(Table):
        name = "map"
        frames_per_update = 1

    class SlowerMap(Table):
        name = "slower map"
        frames_per_update = 2

    built = []

    def remember(session: Session) -> None:
        built.append(session)

    def read_clock() -> float:
        nonlocal now_s
        now_s += 0.003  # each reading takes time, so that separate limits drift
        return now_s

    def show_frame_of_step(step: int, period_s: float) -> None:
        nonlocal now_s
        now_s += period_s - 3 * 0.003
        session.frame_state = SimpleNamespace(step=step, number=step, time_s=0.0)
        for show in session.on_frame:
            show(session.frame_state)

    monkeypatch.setattr(Session, "start", remember)
    monkeypatch.setattr(pages, "perf_counter", read_clock)
    monkeypatch.setattr(pages, "_VIEWS", (Table, Map, SlowerMap))
    monkeypatch.setattr(pages, "_PANELS", ())
    pages.build_live_page(Document(), worker=None, scenario=reference(), limits=PageLimits())
    (session,) = built
    session.playing = True
    for step in range(100):
        show_frame_of_step(step, 0.039)
    assert shown_steps["map"] == list(range(100))
    assert shown_steps["slower map"] == list(range(0, 100, 2))
    # 100 frames of 0.039 s / 0.198 s = 20.
    assert 18 <= len(shown_steps["table"]) <= 22
    for name in ("table", "map", "slower map"):
        captions = [step for shown, step in shown_steps["caption"] if shown == name]
        assert captions == shown_steps["table"]
    session.playing = False
    show_frame_of_step(101, 0.039)
    assert {steps[-1] for name, steps in shown_steps.items() if name != "caption"} == {101}
    session.playing = True
    for step in range(200, 210):
        show_frame_of_step(step, 0.25)
    assert shown_steps["slower map"][-10:] == list(range(200, 210))
    show_frame_of_step(211, 0.039)
    assert shown_steps["slower map"][-1] == 209
    session.stop_and_mark_outdated(
        Mistake(setting="frame", value="a gap", expected="samples", fix="choose another")
    )
    assert shown_steps["slower map"][-1] == 211
