"""Page of the studio without a browser, and random browser messages to it."""

import asyncio
import random
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from bokeh.document import Document
from bokeh.model import Model

import dechirp.studio.session as sessions
from dechirp.core.errors import Mistake
from dechirp.studio.page import build_live_page
from dechirp.studio.scenario_edits import PageLimits, parse_scenario

SMALL_SCENARIO = """
name: small
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 3 us, ramp_duration: 29 us,
            sample_rate: 10 MHz, n_samples: 64, sampling: complex}
    n_chirps: 16
    interval: 35 us
  array: {rx: [[0, 0, 0], [0, 1.944 mm, 0]]}
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene: {targets: [{name: car, position: [30 m, 3 m, 0], rcs: 10 dBsm}]}
impairments: [{kind: thermal-noise}]
chain: {angle: {kind: capon}, cluster: {}}
"""
MESSAGE_VALUES: tuple[Any, ...] = (
    *("", " ", "0", "-1", "nan", "inf", "1e999", "9" * 400, "1 GHz", "-3 dB", "77GHz", "0x10"),
    *("\0", "\ud800", "{", "[", "]", "a: [b", "&a 1", "<script>", "../../etc/passwd", "x" * 70_000),
    *("{kind: nothing}", "[1, 2, 3, 4]", "null", "true", "scene.targets", "name=x", "\n- a\n"),
    *(True, False, None, 0, 1, -1, 7, 2**31, 2**63, 10**400, 0.5, -1e300),
    *(float("nan"), float("inf"), [], [1], ["a"] * 50, {}, {"a": 1}, [[]], {"indices": [9**9]}),
)


class _Document(Document):
    """Document that runs callbacks on the event loop instead of under the server lock."""

    def add_next_tick_callback(self, job: Callable[[], None]) -> Any:
        asyncio.get_running_loop().call_soon(job)
        return None


class Page:
    """Live page; `internal_errors` are the errors that it reports as internal."""

    def __init__(self, worker: ThreadPoolExecutor) -> None:
        self.document = _Document()
        self.internal_errors: list[Mistake] = []
        self.n_reports = 0
        sessions_created: list[sessions.Session] = []
        start = sessions.Session.start
        try:
            sessions.Session.start = lambda self: sessions_created.append(self)  # noqa: PLW0108
            build_live_page(
                self.document,
                worker=worker,
                scenario=parse_scenario(SMALL_SCENARIO, PageLimits()),
                limits=PageLimits(),
            )
        finally:
            sessions.Session.start = start
        (self.session,) = sessions_created
        self.session.on_mistakes.append(self._record_mistakes)
        self.session.on_frame.append(self._record_frame)
        self.session.start()

    def _record_frame(self, _: object) -> None:
        self.session.confirm_frames_drawn(self.session._n_shown + 1)
        self.n_reports += 1

    def _record_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        self.n_reports += bool(mistakes)  # a frame that failed is not shown
        self.internal_errors += [
            mistake for mistake in mistakes if mistake == sessions._INTERNAL_ERROR
        ]

    def iter_listeners(self) -> Iterator[tuple[Model, str]]:
        """Iterate over properties and events of the page that have listeners."""
        # Sorted by order of creation: the order of a set varies.
        for model in sorted(self.document.models, key=lambda model: (len(model.id), model.id)):
            for attribute in model._callbacks:
                yield model, attribute
            for event in model._event_callbacks:
                yield model, f"on {event}"

    def send(self, model: Model, attribute: str, value: Any) -> None:
        """Send a message like a browser; ignore errors that Bokeh raises itself."""
        if attribute.startswith("on "):
            entries = [("model", {"id": model.id}), ("x", value), ("y", value)]
            if attribute == "on button_click":
                entries = entries[:1]
            values = {"type": "map", "entries": entries}
            data = {"type": "event", "name": attribute[3:], "values": values}
            patch = {"kind": "MessageSent", "msg_type": "bokeh_event", "msg_data": data}
        else:
            patch = {
                "kind": "ModelChanged",
                "model": {"id": model.id},
                "attr": attribute,
                "new": value,
            }
        try:
            self.document.apply_json_patch({"events": [patch]})
        except Exception as error:
            if _is_raised_by_studio(error):
                raise

    async def wait_until_idle(self) -> None:
        """Wait until all messages are processed and two further reports have arrived."""
        self.session.set_playing(False)
        for _ in range(2):
            n_before = self.n_reports
            self.session.go_to_step(0)
            async with asyncio.timeout(60):
                while self.session._edits or self.n_reports == n_before:
                    await asyncio.sleep(2e-3)


def _is_raised_by_studio(error: Exception) -> bool:
    """Return whether a handler of the studio raised the exception, not a check of Bokeh."""
    trace = error.__traceback__
    while trace is not None:
        if "/dechirp/studio/" in trace.tb_frame.f_code.co_filename:
            return True
        trace = trace.tb_next
    return False


def send_random_messages(seed: int, n_messages: int, *, batch_size: int = 40) -> None:
    """Send random messages in batches; fail if the page reports an internal error."""

    async def run_page() -> None:
        with ThreadPoolExecutor(1) as worker:
            page = Page(worker)
            rng = random.Random(seed)
            await page.wait_until_idle()
            for first_index in range(0, n_messages, batch_size):
                listeners = list(page.iter_listeners())
                messages = [
                    (*rng.choice(listeners), rng.choice(MESSAGE_VALUES)) for _ in range(batch_size)
                ]
                for model, attribute, value in messages:
                    page.send(model, attribute, value)
                await page.wait_until_idle()
                descriptions = [(type(m).__name__, a, str(v)[:60]) for m, a, v in messages]
                assert not page.internal_errors, f"message {first_index}: {descriptions}"
            page.session.replace_settings(SMALL_SCENARIO)
            await page.wait_until_idle()
            assert page.session.scenario.name == "small"
            page.session.close()

    asyncio.run(run_page())
