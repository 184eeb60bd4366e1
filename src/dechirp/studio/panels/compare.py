"""A/B comparison of two settings while the page is open."""

import asyncio
import logging
from collections.abc import Sequence
from functools import partial
from html import escape
from time import perf_counter

import numpy as np
from bokeh.models import Button, Column, Div, InlineStyleSheet, Row, Toggle, UIElement

from dechirp.core.errors import DechirpError
from dechirp.core.text import EN_DASH, MINUS_SIGN, format_number, format_probability
from dechirp.experiments.scenario import Scenario
from dechirp.report.labels import (
    DisplayScale,
    choose_display_scale,
    format_with_interval,
    label_with_unit,
    score_label,
)
from dechirp.studio import compare
from dechirp.studio.compare import Comparison, ScoreEstimate, changed_settings
from dechirp.studio.panels.base import Panel
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

BATCH_S = 0.015
"""Longest delay of a frame by a batch of trials, beside the current trial of 5 to 15 ms."""
UPDATE_INTERVAL_S = 0.5
CERTAIN = 0.95
"""Certainty below which a difference is reported as possibly random."""
_MAX_DIFFERENCES = 3

_METHOD_NOTE = (
    "Repeated trials of the first frame of the scene, without tracks; A and B have the same noise"
    " in"
    " each trial. Small: 95 % intervals. They hold for a number of trials chosen in advance;"
    " stopping"
    " when the result looks good makes wrong conclusions more frequent."
)
_INTRODUCTION = (
    "Press <b>Keep as A</b> to store these settings as A. Then change the settings to compare."
)
_RECORDING_NOTE = (
    "The truth of a recording is unknown, and it has only one trial. Open a scene to compare."
)
_CSS = """
p { margin: 4px 0; max-width: 100ch; color: var(--ink); }
p.muted, small, td.law, td.unsure { color: var(--muted); }
p.muted { margin: 0 0 2px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 1px 9px 1px 0; text-align: left; white-space: nowrap; }
th { position: sticky; top: 0; color: var(--muted); background: var(--tile); font-weight: 600; }
td { border-top: 1px solid var(--rule); }
td.law small { display: inline-block; max-width: 16ch; white-space: normal; line-height: 1.1; }
small { font-size: 12px; }
td.sure { font-weight: 600; }
@media (max-width: 800px) {
  thead { display: none; }
  tr { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 1fr); padding: 4px 0; }
  tr { border-top: 1px solid var(--rule); }
  td { border: 0; white-space: normal; overflow-wrap: anywhere; }
  td:nth-child(-n+2) { font-weight: 600; }
  td:nth-child(3)::before { content: "A: "; }
  td:nth-child(5)::before { content: "B: "; }
  td:is(:nth-child(4), :nth-child(6))::before { content: "theory: "; }
  td:nth-child(7)::before { content: "B \\2212  A: "; }
  td.law small { max-width: none; }
}
"""
"""Style of the table; on narrow screens each row has four lines of two cells."""

_log = logging.getLogger(__name__)


class Compare(Panel):
    """Buttons that store the current settings as A and B, and the table of results."""

    name = "compare"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._scenarios: dict[str, Scenario] = {}
        self._is_counting = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._keep_buttons = {variant: Button(label=f"Keep as {variant}") for variant in ("A", "B")}
        for variant, button in self._keep_buttons.items():
            button.on_click(partial(self._store_variant_and_compare_if_both, variant))
        self._count = Toggle(label="Count", disabled=True)
        self._count.on_change("active", lambda attr, old, new: self._resume_or_pause_trials(new))
        self._reset = Button(label="Reset")
        self._reset.on_click(self._reset_comparison)
        self._output = Div(
            text=f"<p>{_INTRODUCTION}</p>",
            disable_math=True,
            stylesheets=[InlineStyleSheet(css=_CSS)],
        )
        self._output.sizing_mode = "stretch_width"
        buttons = [*self._keep_buttons.values(), self._count, self._reset]
        for keep_button in buttons:
            keep_button.update(width=84, height=24, margin=0)
        button_column = Column(
            children=buttons, spacing=3, styles={"position": "sticky", "top": "4px"}
        )
        self._root = Row(
            name=self.name,
            children=[button_column, self._output],
            sizing_mode="stretch_width",
            spacing=10,
            styles={"align-items": "flex-start", "padding": "4px 8px", "box-sizing": "border-box"},
        )
        self._enable_buttons_for_scenes(session.scenario)
        session.on_settings.append(self._enable_buttons_for_scenes)
        session.document.on_session_destroyed(lambda _: self._cancel_comparison())

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _enable_buttons_for_scenes(self, scenario: Scenario) -> None:
        """Enable the buttons only for simulated scenes."""
        is_scene = scenario.scene is not None
        for button in self._keep_buttons.values():
            button.disabled = not is_scene
        if not self._scenarios:
            self._show_message(_INTRODUCTION if is_scene else _RECORDING_NOTE)

    def _store_variant_and_compare_if_both(self, variant: str) -> None:
        self._scenarios[variant] = self.session.scenario
        self._cancel_comparison()
        if len(self._scenarios) < 2:
            other = "B" if variant == "A" else "A"
            self._show_message(
                f"{variant} is stored. Change a setting, then press <b>Keep as {other}</b> to"
                f" count."
            )
            return
        self._show_message("Preparing A and B.")
        self._count.update(disabled=False, active=True)
        self._is_counting.set()
        running = self._run(self._scenarios["A"], self._scenarios["B"])
        self._task = asyncio.get_running_loop().create_task(running)

    def _resume_or_pause_trials(self, is_counting: bool) -> None:
        self._count.label = "Pause" if is_counting else "Count"
        if is_counting:
            self._is_counting.set()
        else:
            self._is_counting.clear()

    def _reset_comparison(self) -> None:
        self._cancel_comparison()
        self._scenarios.clear()
        self._count.update(active=False, disabled=True)
        self._enable_buttons_for_scenes(self.session.scenario)

    def _cancel_comparison(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _run(self, a: Scenario, b: Scenario) -> None:
        task = asyncio.current_task()

        def show(text: str) -> None:
            if self._task is task:  # another pair may have been stored meanwhile
                self._output.text = text

        lead = _changed_settings_line(a, b)
        try:
            comparison = await self.session.run_on_worker(partial(Comparison, a, b))
            while not comparison.is_done:
                await self._is_counting.wait()
                until_s = perf_counter() + UPDATE_INTERVAL_S
                while self._is_counting.is_set() and perf_counter() < until_s:
                    await self.session.run_on_worker(partial(comparison.run_trials_for, BATCH_S))
                rows = await self.session.run_on_worker(comparison.comparison_rows_so_far)
                text = _comparison_table_html(comparison.n_trials, rows, lead)
                self.session.document.add_next_tick_callback(partial(show, text))
        except DechirpError as error:
            words = "<br>".join(escape(str(mistake)) for mistake in error.mistakes)
            self.session.document.add_next_tick_callback(partial(show, f"<p>{words}</p>"))
        except Exception:
            _log.exception("a comparison of the studio failed")
            words = (
                "<p>The comparison failed with an internal error; see the log of the server.</p>"
            )
            self.session.document.add_next_tick_callback(partial(show, words))

    def _show_message(self, message_html: str) -> None:
        self._output.text = f"<p>{message_html}</p>"


def _changed_settings_line(a: Scenario, b: Scenario) -> str:
    """Summarise the differing settings in one line."""
    settings = changed_settings(a, b)
    if not settings:
        return "A and B are the same settings."
    texts = [
        f"{escape(setting.path)} {escape(setting.a)} | {escape(setting.b)}" for setting in settings
    ]
    more = len(texts) - _MAX_DIFFERENCES
    tail = [f"{more} more"] if more > 0 else []
    return "A | B: " + "; ".join(texts[:_MAX_DIFFERENCES] + tail)


def _comparison_table_html(
    n_trials: int, rows: Sequence[compare.ComparisonRow], settings_line: str
) -> str:
    heads = ("", "", "A", "theory", "B", "theory", f"B {MINUS_SIGN} A", "how sure")
    head = "".join(f"<th>{heading}</th>" for heading in heads)
    body = "".join(f"<tr>{_comparison_row_html(row)}</tr>" for row in rows)
    summary = f"{n_trials:,} trials each. {settings_line}"
    return (
        f'<p class="muted" title="{_METHOD_NOTE}">{summary}</p>'
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        f'<p class="muted">{_METHOD_NOTE}</p>'
    )


def _comparison_row_html(row: compare.ComparisonRow) -> str:
    numbers = [
        n for estimate in (row.a, row.b) if estimate for n in (estimate.value, estimate.theory)
    ]
    scale = choose_display_scale(row.score.unit, np.array(numbers))
    score_text = label_with_unit(score_label(row.score.kind()), scale.unit)
    # All columns side by side need 840 pixels.
    score_text = score_text.replace("probability", "prob.")
    meaning = escape((row.score.__doc__ or "").partition("\n")[0])
    cells = [f'<td title="{meaning}">{score_text}</td><td>{escape(row.target or "")}</td>']
    for estimate in (row.a, row.b):
        cells += _estimate_and_theory_cells_html(estimate, scale)
    return "".join([*cells, *_difference_cells_html(row, scale)])


def _estimate_and_theory_cells_html(
    estimate: ScoreEstimate | None, scale: DisplayScale
) -> list[str]:
    if estimate is None:
        return [f"<td>{EN_DASH}</td>", f'<td class="law">{EN_DASH}</td>']
    value, interval = format_with_interval(*(scale.factor * number for number in estimate[:3]))
    theory = scale.factor * estimate.theory
    theory_text = format_probability(theory) if 0 < theory < 1e-3 else format_number(theory)
    reason = escape(estimate.missing_theory)
    law = f"<small>none: {reason}</small>" if reason else theory_text
    return [f"<td>{value} <small>{interval}</small></td>", f'<td class="law">{law}</td>']


def _difference_cells_html(row: compare.ComparisonRow, scale: DisplayScale) -> list[str]:
    """Return the cells of the difference and of the better variant, if it is certain."""
    change_estimate = row.change
    if change_estimate is None or not np.isfinite(change_estimate.value):
        return [f"<td>{EN_DASH}</td>", "<td></td>"]
    if change_estimate.value == 0:
        return ["<td>0</td>", '<td class="unsure">no difference</td>']
    value, interval = format_with_interval(
        *(scale.factor * number for number in change_estimate[:3])
    )
    sign = "+" if change_estimate.value > 0 else ""
    change = f'<td title="95 % interval: {interval}">{sign}{value}</td>'
    if not change_estimate.certainty >= CERTAIN:
        return [change, '<td class="unsure">may be chance</td>']
    better = "B" if (change_estimate.value > 0) == (row.score.better == "more") else "A"
    share = min(np.floor(1000 * change_estimate.certainty) / 10, 99.9)
    return [change, f'<td class="sure">{better} better, {share:.1f} %</td>']
