"""A/B: two settings counted against each other, while the page lives."""

import asyncio
import logging
from collections.abc import Sequence
from functools import partial
from html import escape
from time import perf_counter

import numpy as np
from bokeh.models import Button, Column, Div, InlineStyleSheet, Row, Toggle, UIElement

from dechirp.core.errors import DechirpError
from dechirp.core.words import MINUS, NONE, number, small
from dechirp.experiment.scenario import Scenario
from dechirp.report.settings_words import Scale, scale_of, score_words, told, with_unit
from dechirp.studio import compare
from dechirp.studio.compare import Comparison, Told, differences
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

BATCH_S = 0.015
"""What a moment may have to wait for, beside the one trial that is under way: 5 to 15 ms."""
SHOWN_EVERY_S = 0.5
SURE = 0.95
"""Below it a difference is said to be no more than chance may give."""
_MOST_DIFFERENCES = 3

_HOW = (
    "The first frame of the scene, without tracks, again and again; the same trial has the same"
    " noise in A and B. Small: 95 % intervals. They hold for a number of trials that was chosen"
    " before; who stops when it looks good is fooled more often."
)
_FIRST = "Press <b>Keep as A</b>: these settings become A. Then turn what you want to compare."
_RECORDING = (
    "Nobody knows the truth of a recording, and it has one trial only. Open a scene to compare."
)
_CSS = """
p { margin: 4px 0; max-width: 100ch; color: var(--ink); }
p.muted, small, td.law, td.unsure { color: var(--muted); }
p.muted { margin: 0 0 2px; }
table { border-collapse: collapse; font-size: 11px; font-variant-numeric: tabular-nums; }
th, td { padding: 1px 9px 1px 0; text-align: left; white-space: nowrap; }
th { position: sticky; top: 0; color: var(--muted); background: var(--tile); font-weight: 600; }
td { border-top: 1px solid var(--rule); }
small { font-size: 10px; }
td.sure { font-weight: 600; }
"""

_log = logging.getLogger(__name__)


class Compare(Panel):
    """Buttons that keep the present settings as A and as B, and the table of what was counted."""

    name = "compare"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._kept: dict[str, Scenario] = {}
        self._going = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._keepers = {of: Button(label=f"Keep as {of}") for of in ("A", "B")}
        for of, button in self._keepers.items():
            button.on_click(partial(self._keep, of))
        self._count = Toggle(label="Count", disabled=True)
        self._count.on_change("active", lambda attr, old, new: self._turn(new))
        self._reset = Button(label="Reset")
        self._reset.on_click(self._forget)
        self._said = Div(
            text=f"<p>{_FIRST}</p>", disable_math=True, stylesheets=[InlineStyleSheet(css=_CSS)]
        )
        self._said.sizing_mode = "stretch_width"
        buttons = [*self._keepers.values(), self._count, self._reset]
        for one in buttons:
            one.update(width=84, height=24, margin=0)
        held = Column(children=buttons, spacing=3, styles={"position": "sticky", "top": "4px"})
        self._root = Row(
            name=self.name,
            children=[held, self._said],
            sizing_mode="stretch_width",
            spacing=10,
            styles={"align-items": "flex-start", "padding": "4px 8px", "box-sizing": "border-box"},
        )
        self._take(session.scenario)
        session.on_settings.append(self._take)
        session.document.on_session_destroyed(lambda _: self._stop())

    @property
    def root(self) -> UIElement:
        """Buttons and table."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _take(self, scenario: Scenario) -> None:
        """Only what can be tried may be kept."""
        is_scene = scenario.scene is not None
        for button in self._keepers.values():
            button.disabled = not is_scene
        if not self._kept:
            self._say(_FIRST if is_scene else _RECORDING)

    def _keep(self, of: str) -> None:
        self._kept[of] = self.session.scenario
        self._stop()
        if len(self._kept) < 2:
            other = "B" if of == "A" else "A"
            self._say(f"{of} is kept. Turn a knob, then press <b>Keep as {other}</b> to count.")
            return
        self._say("A and B are made ready.")
        self._count.update(disabled=False, active=True)
        self._going.set()
        running = self._run(self._kept["A"], self._kept["B"])
        self._task = asyncio.get_running_loop().create_task(running)

    def _turn(self, going: bool) -> None:
        self._count.label = "Pause" if going else "Count"
        if going:
            self._going.set()
        else:
            self._going.clear()

    def _forget(self) -> None:
        self._stop()
        self._kept.clear()
        self._count.update(active=False, disabled=True)
        self._take(self.session.scenario)

    def _stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _run(self, a: Scenario, b: Scenario) -> None:
        task = asyncio.current_task()

        def show(text: str) -> None:
            if self._task is task:  # another pair may have been kept meanwhile
                self._said.text = text

        lead = _lead(a, b)
        try:
            comparison = await self.session.work(partial(Comparison, a, b))
            while not comparison.is_done:
                await self._going.wait()
                until_s = perf_counter() + SHOWN_EVERY_S
                while self._going.is_set() and perf_counter() < until_s:
                    await self.session.work(partial(comparison.go_on, BATCH_S))
                rows = await self.session.work(comparison.rows)
                text = _table(comparison.n_trials, rows, lead)
                self.session.document.add_next_tick_callback(partial(show, text))
        except DechirpError as error:
            words = "<br>".join(escape(str(mistake)) for mistake in error.mistakes)
            self.session.document.add_next_tick_callback(partial(show, f"<p>{words}</p>"))
        except Exception:
            _log.exception("a comparison of the studio failed")
            words = "<p>The comparison failed by a fault of its own, which the log tells.</p>"
            self.session.document.add_next_tick_callback(partial(show, words))

    def _say(self, words: str) -> None:
        self._said.text = f"<p>{words}</p>"


def _lead(a: Scenario, b: Scenario) -> str:
    """What differs, in a line."""
    apart = differences(a, b)
    if not apart:
        return "A and B are the same settings."
    said = [f"{escape(one.path)} {escape(one.a)} | {escape(one.b)}" for one in apart]
    more = len(said) - _MOST_DIFFERENCES
    tail = [f"{more} more"] if more > 0 else []
    return "A | B: " + "; ".join(said[:_MOST_DIFFERENCES] + tail)


def _table(n_trials: int, rows: Sequence[compare.Row], lead: str) -> str:
    heads = ("", "", "A", "theory", "B", "theory", f"B {MINUS} A", "how sure")
    head = "".join(f"<th>{one}</th>" for one in heads)
    body = "".join(f"<tr>{_line(row)}</tr>" for row in rows)
    about = f"{n_trials:,} trials each. {lead}"
    return (
        f'<p class="muted" title="{_HOW}">{about}</p>'
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        f'<p class="muted">{_HOW}</p>'
    )


def _line(row: compare.Row) -> str:
    numbers = [n for of in (row.a, row.b) if of for n in (of.value, of.theory)]
    scale = scale_of(row.score.unit, np.array(numbers))
    words = with_unit(score_words(row.score.label()), scale.unit)
    words = words.replace("probability", "prob.")  # all columns side by side need 840 pixels
    meaning = escape((row.score.__doc__ or "").partition("\n")[0])
    cells = [f'<td title="{meaning}">{words}</td><td>{escape(row.target or "")}</td>']
    for of in (row.a, row.b):
        cells += _cells(of, scale)
    return "".join([*cells, *_change(row, scale)])


def _cells(of: Told | None, scale: Scale) -> list[str]:
    if of is None:
        return [f"<td>{NONE}</td>", f'<td class="law">{NONE}</td>']
    value, interval = told(*(scale.factor * one for one in of[:3]))
    law = scale.factor * of.theory
    words = small(law) if 0 < law < 1e-3 else number(law)
    return [f"<td>{value} <small>{interval}</small></td>", f'<td class="law">{words}</td>']


def _change(row: compare.Row, scale: Scale) -> list[str]:
    """The difference, and which of the two is better, if that is sure."""
    found = row.change
    if found is None or not np.isfinite(found.value):
        return [f"<td>{NONE}</td>", "<td></td>"]
    if found.value == 0:
        return ["<td>0</td>", '<td class="unsure">no difference</td>']
    value, interval = told(*(scale.factor * one for one in found[:3]))
    sign = "+" if found.value > 0 else ""
    change = f'<td title="95 % interval: {interval}">{sign}{value}</td>'
    if not found.certainty >= SURE:
        return [change, '<td class="unsure">may be chance</td>']
    better = "B" if (found.value > 0) == (row.score.better == "more") else "A"
    share = min(np.floor(1000 * found.certainty) / 10, 99.9)
    return [change, f'<td class="sure">{better} better, {share:.1f} %</td>']
