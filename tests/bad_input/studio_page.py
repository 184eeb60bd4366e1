"""A whole page of the studio without a browser, and what a browser might send to it."""

import asyncio
import random
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from bokeh.document import Document
from bokeh.model import Model

import dechirp.studio.session as sessions
from dechirp.core.errors import Mistake
from dechirp.studio.page import build_page
from dechirp.studio.scenario_edits import PageLimits, parse_scenario

SMALL = """
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
VALUES: tuple[Any, ...] = (
    *("", " ", "0", "-1", "nan", "inf", "1e999", "9" * 400, "1 GHz", "-3 dB", "77GHz", "0x10"),
    *("\0", "\ud800", "{", "[", "]", "a: [b", "&a 1", "<script>", "../../etc/passwd", "x" * 70_000),
    *("{kind: nothing}", "[1, 2, 3, 4]", "null", "true", "scene.targets", "name=x", "\n- a\n"),
    *(True, False, None, 0, 1, -1, 7, 2**31, 2**63, 10**400, 0.5, -1e300),
    *(float("nan"), float("inf"), [], [1], ["a"] * 50, {}, {"a": 1}, [[]], {"indices": [9**9]}),
)


class _Document(Document):
    """Runs on the loop what a server would run under the lock of the document."""

    def add_next_tick_callback(self, job: Callable[[], None]) -> Any:
        asyncio.get_running_loop().call_soon(job)
        return None


class Page:
    """A live page; `own_faults` are what it calls an error of its own."""

    def __init__(self, worker: ThreadPoolExecutor) -> None:
        self.document = _Document()
        self.own_faults: list[Mistake] = []
        self.n_told = 0
        made: list[sessions.Session] = []
        start = sessions.Session.start
        try:
            sessions.Session.start = lambda self: made.append(self)  # noqa: PLW0108
            build_page(
                self.document,
                worker=worker,
                scenario=parse_scenario(SMALL, PageLimits()),
                limits=PageLimits(),
            )
        finally:
            sessions.Session.start = start
        (self.session,) = made
        self.session.on_mistakes.append(self._hear)
        self.session.on_frame.append(
            lambda _: self.session.confirm_drawn(self.session._n_shown + 1)
        )
        self.session.start()

    def _hear(self, mistakes: tuple[Mistake, ...]) -> None:
        self.n_told += 1  # with each moment, and for each that cannot be made
        self.own_faults += [one for one in mistakes if one == sessions._INTERNAL_ERROR]

    def ends(self) -> Iterator[tuple[Model, str]]:
        """Every property and event of the page that something listens to."""
        # In the order in which they were made: a set has another each time.
        for model in sorted(self.document.models, key=lambda one: (len(one.id), one.id)):
            for attribute in model._callbacks:
                yield model, attribute
            for event in model._event_callbacks:
                yield model, f"on {event}"

    def send(self, model: Model, attribute: str, value: Any) -> None:
        """Send as a browser does; what Bokeh refuses it answers itself, and the page lives on."""
        if attribute.startswith("on "):
            of = [("model", {"id": model.id}), ("x", value), ("y", value)]
            if attribute == "on button_click":
                of = of[:1]
            values = {"type": "map", "entries": of}
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
            if _is_ours(error):
                raise

    async def settled(self) -> None:
        """Wait until what was sent is worked off, and two answers more came."""
        self.session.set_playing(False)
        for _ in range(2):
            told = self.n_told
            self.session.go_to_step(0)
            async with asyncio.timeout(60):
                while self.session._edits or self.n_told == told:
                    await asyncio.sleep(2e-3)


def _is_ours(error: Exception) -> bool:
    """Whether an exception comes from a handler of ours, and not from what Bokeh checks first."""
    trace = error.__traceback__
    while trace is not None:
        if "/dechirp/studio/" in trace.tb_frame.f_code.co_filename:
            return True
        trace = trace.tb_next
    return False


def flood(seed: int, n_messages: int, *, at_once: int = 40) -> None:
    """Send so many messages by chance of a seed, some at once; fails where the page does."""

    async def lived() -> None:
        with ThreadPoolExecutor(1) as worker:
            one = Page(worker)
            rng = random.Random(seed)
            await one.settled()
            for at in range(0, n_messages, at_once):
                ends = list(one.ends())
                sent = [(*rng.choice(ends), rng.choice(VALUES)) for _ in range(at_once)]
                for model, attribute, value in sent:
                    one.send(model, attribute, value)
                await one.settled()
                told = [(type(m).__name__, a, str(v)[:60]) for m, a, v in sent]
                assert not one.own_faults, f"message {at}: {told}"
            one.session.replace_settings(SMALL)
            await one.settled()
            assert one.session.scenario.name == "small"
            one.session.close()

    asyncio.run(lived())
