"""Lesson 4: noise. Where the report's rule goes blind, and how far the radar sees beyond."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.core.units import decibels
from dechirp.experiment.verify.looks import REFERENCE
from dechirp.studio.teach.lesson import Choice, Dial, Lesson, Try
from dechirp.studio.teach.trials import SNR_DB, Seen, Settings, Tally, seen
from dechirp.studio.theme import Theme
from dechirp.studio.views.drawing import Drawing

_SHOWN_M = (20.0, 80.0)
_SWEEPS, _STAYS = "more noise than the last", "as much noise as the last"


class NoiseLesson(Lesson[Settings, Seen]):
    """One frame with both thresholds, and the shares of frames in which the target is found."""

    title = "Noise: how faint an echo may be"
    says = (
        "In each sample the echo may be thousands of times weaker than the noise: both transforms"
        " gather it in one cell. The report stops at -24 dB. Its rule takes amplitudes for"
        " powers; the radar sees on to -40 dB."
    )
    formulas = (
        (r"g = N\,M", "gain: 281,600, or 54.5 dB"),
        (
            r"T = \dfrac{\pi}{4}\left(10^{\Delta/10}\right)^2",
            "the report's threshold over the mean noise: Δ = 15 dB of amplitude are 29 dB of power",
        ),
    )
    knobs: ClassVar = {
        "snr_db": Dial("Echo over noise in each sample, dB", *SNR_DB, 1, -24),
        "window": Choice("Window of the right detector", ("rectangular", "hann"), "rectangular"),
        "play": Choice("Each new frame has", (_SWEEPS, _STAYS), _SWEEPS),
    }
    moves = ("snr_db", -1)
    tries = (
        Try(
            "The report's limit: -24 dB",
            {"snr_db": -24},
            "The peak only just reaches the upper threshold, which takes 29 dB; the lower one, of"
            " 11.5 dB, it clears by far. Noise alone never comes near either.",
        ),
        Try(
            "A little more noise: -27 dB",
            {"snr_db": -27},
            "The peak still stands 27 dB over the noise, 15 dB over the lower threshold, and anyone"
            " can see it. The report's rule is blind to it.",
        ),
        Try(
            "Forty decibels below: -40 dB",
            {"snr_db": -40, "play": _STAYS},
            "10,000 times weaker than the noise in a sample, and 14 dB stronger in its cell. Press"
            " play and count: it is found in 97 of 100 frames.",
        ),
        Try(
            "The same under a Hann window",
            {"snr_db": -40, "play": _STAYS, "window": "hann"},
            "The window costs 3.5 dB in range and velocity together, and here that matters: two"
            " frames in three are lost. Low sidelobes have a price.",
        ),
        Try(
            "Beyond the end: -46 dB",
            {"snr_db": -46, "play": _STAYS},
            "Now noise hides the echo in its own cell. Only more energy helps: more chirps, more"
            " power, or a nearer target.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(Settings)
        self._tally = Tally()
        self._cut = Drawing(
            x="range, m", y="power over the mean noise, dB", x_range=_SHOWN_M, y_range=(-8, 56)
        )
        self._cut.line("power", "echo", label="power", line_width=1.5)
        self._cut.line("report", "track", label="the report's threshold", line_width=2)
        self._cut.line("chain", "threshold", label="cell averaging, 1e-6", line_width=2)
        self._cut.bars("truth", "truth", label="target", line_width=2, line_dash="dotted")
        self._cut.explained(orientation="horizontal")
        self._shares = Drawing(
            x="echo over noise in each sample, dB",
            y="probability of detection",
            x_range=(SNR_DB[0] - 0.5, SNR_DB[1] + 0.5),
            y_range=(-0.04, 1.08),
        )
        self._shares.bars("now", "cursor", line_width=1, line_dash="dashed")
        for who, role, called, marker in (
            ("chain", "threshold", "cell averaging", "circle"),
            ("report", "track", "the report's rule", "square"),
        ):
            self._shares.line(f"{who} theory", role, label=called, line_width=2)
            self._shares.bars(f"{who} interval", role, line_width=2, line_alpha=0.5)
            self._shares.marks(who, role, label=called, size=7, marker=marker)
        self._shares.explained("center_right")
        self._root = column(self._cut.figure, self._shares.figure, sizing_mode="stretch_both")

    @property
    def root(self) -> UIElement:
        """Its figures."""
        return self._root

    def look(self, at: Settings, number: int) -> Seen:
        """What is seen with those settings."""
        return seen(at, number)

    def show(self, seen: Seen) -> Mapping[str, str]:
        """Draw it, and give the numbers beside it."""
        at = seen.at
        self._tally.add(seen)
        # The report's bins are padded and lie elsewhere, but its threshold is as smooth.
        self._cut.put("power", **_columns(seen.chain.range_m, seen.chain.power))
        self._cut.put("chain", **_columns(seen.chain.range_m, seen.chain.threshold))
        self._cut.put("report", **_columns(seen.report.range_m, seen.report.threshold))
        self._cut.put("truth", x=[REFERENCE.range_m], low=[-8], high=[56])
        self._shares.put("now", x=[at.snr_db], low=[-0.04], high=[1.08])
        numbers = {
            "echo over noise in its cell": f"{seen.in_cell_db:.1f} dB",
            f"found at {at.snr_db:.0f} dB by": "",
        }
        for who, called, curve, aside_db in (
            ("chain", "cell averaging", seen.theory, -0.1),
            ("report", "the report's rule", seen.theory_of_report, 0.1),
        ):
            shares = self._tally.shares(at.window, who)
            self._shares.put(f"{who} theory", x=seen.theory_db, y=curve)
            at_db = shares[:, 0] + aside_db  # so that neither hides the other
            self._shares.put(f"{who} interval", x=at_db, low=shares[:, 2], high=shares[:, 3])
            self._shares.put(who, x=at_db, y=shares[:, 1])
            here = shares[shares[:, 0] == at.snr_db][0]
            expected = float(np.interp(at.snr_db, seen.theory_db, curve))
            numbers[called] = f"{here[1] * here[4]:.0f} of {here[4]:.0f}; theory {expected:.0%}"
        self._cut.called(
            f"One frame at {at.snr_db:.0f} dB: cell averaging {_verb(seen.found[0])} the target,"
            f" the report's rule {_verb(seen.found_by_report[0])} it"
        )
        self._shares.called(
            "Share of frames in which the target is found: lines by theory, marks counted, with"
            " 95 % intervals"
        )
        return numbers

    def onward(self, values: Mapping[str, Any]) -> Mapping[str, float]:
        """More noise in the next frame, or as much."""
        return {} if values["play"] == _STAYS else super().onward(values)

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in (self._cut, self._shares):
            drawing.wear(theme)


def _columns(range_m: np.ndarray, power: np.ndarray) -> dict[str, np.ndarray]:
    shown = (range_m >= _SHOWN_M[0] - 1) & (range_m <= _SHOWN_M[1] + 1)
    return {"x": range_m[shown], "y": np.maximum(decibels(power[shown]), -8)}


def _verb(found: np.bool_) -> str:
    return "finds" if found else "misses"
