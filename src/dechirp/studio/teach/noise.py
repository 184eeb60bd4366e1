"""Lesson 4: detection limits of the report's rule and of cell averaging in noise."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.certificate.reference_trials import REFERENCE_TARGET
from dechirp.core.units import to_decibels
from dechirp.report.labels import (
    DETECTION_PROBABILITY_LABEL,
    POWER_OVER_NOISE_LABEL,
    RANGE_LABEL,
    SNR_PER_SAMPLE_LABEL,
)
from dechirp.studio.teach.lesson import Choice, Dial, Experiment, Lesson
from dechirp.studio.teach.trials import (
    SNR_DB,
    HitCounter,
    NoiseFrame,
    NoiseSettings,
    compute_cuts_and_hits,
)
from dechirp.studio.theme import Theme
from dechirp.studio.views.line_figure import LineFigure

_SHOWN_M = (20.0, 80.0)
_FINDERS = {
    (True, True): "both",
    (True, False): "cell averaging only",
    (False, True): "the students' rule only",
    (False, False): "neither",
}
"""Detectors that found the target, by the hits of cell averaging and of the students' rule."""
_INCREASING_NOISE, _CONSTANT_NOISE = "more noise", "the same noise level"


class NoiseLesson(Lesson[NoiseSettings, NoiseFrame]):
    """One frame with both thresholds, and the proportion of frames with a detection."""

    title = "Noise and the weakest detectable echo"
    introduction = (
        "In a sample, the echo can be thousands of times weaker than the noise. Both transforms"
        " concentrate it in one cell. The students' report, whose radar these lessons use, stops"
        " at -24 dB, as its rule treats amplitudes as powers; this radar detects down to -40 dB."
    )
    formulas = (
        (r"g = N\,M", "gain: 281,600, or 54.5 dB"),
        (
            r"T = \dfrac{\pi}{4}\left(10^{\Delta/10}\right)^2",
            "the students' threshold over the mean noise: Δ = 15 dB of amplitude are 29 dB of"
            " power",
        ),
    )
    knobs: ClassVar = {
        "snr_db": Dial(SNR_PER_SAMPLE_LABEL, *SNR_DB, 1, -24),
        "window": Choice("Window of cell averaging", ("rectangular", "hann"), "rectangular"),
        "play": Choice(
            "The next frame has", (_INCREASING_NOISE, _CONSTANT_NOISE), _INCREASING_NOISE
        ),
    }
    animated_dial = ("snr_db", -1)
    experiments = (
        Experiment(
            "The limit of the students' report: -24 dB",
            {"snr_db": -24},
            "The peak just reaches the upper threshold, at 29 dB. It is far above the lower one, at"
            " 11.5 dB, which noise alone exceeds in one cell in a million.",
        ),
        Experiment(
            "A little more noise: -27 dB",
            {"snr_db": -27},
            "The peak is 27 dB above the noise and 15 dB above the lower threshold, so it is easy"
            " to see. The students' rule misses it.",
        ),
        Experiment(
            "Forty decibels below the noise: -40 dB",
            {"snr_db": -40, "play": _CONSTANT_NOISE},
            "The echo is 10,000 times weaker than the noise in a sample, and 14 dB stronger in its"
            " cell. Press Play and count: it is detected in 97 of 100 frames.",
        ),
        Experiment(
            "The same with a Hann window",
            {"snr_db": -40, "play": _CONSTANT_NOISE, "window": "hann"},
            "The windows of range and velocity cost 3.5 dB together. At this level, the target is"
            " missed in two frames of three. Low sidelobes have a cost.",
        ),
        Experiment(
            "Below the limit: -46 dB",
            {"snr_db": -46, "play": _CONSTANT_NOISE},
            "Now noise hides the echo in its own cell. More energy or less noise helps: more"
            " chirps, more power, a shorter range, or a better receiver.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(NoiseSettings)
        self._hits = HitCounter()
        self._cut = LineFigure(
            x=RANGE_LABEL, y=POWER_OVER_NOISE_LABEL, x_range=_SHOWN_M, y_range=(-8, 56)
        )
        self._cut.add_line("power", "echo", label="power", line_width=1.5)
        self._cut.add_line("report", "track", label="the students' threshold", line_width=2)
        self._cut.add_line("chain", "threshold", label="cell averaging, 1e-6", line_width=2)
        self._cut.add_vertical_lines(
            "truth", "truth", label="target", line_width=2, line_dash="dotted"
        )
        self._cut.add_legend(orientation="horizontal")
        self._shares = LineFigure(
            x=SNR_PER_SAMPLE_LABEL,
            y=DETECTION_PROBABILITY_LABEL,
            x_range=(SNR_DB[0] - 0.5, SNR_DB[1] + 0.5),
            y_range=(-0.04, 1.08),
        )
        self._shares.add_vertical_lines("now", "cursor", line_width=1, line_dash="dashed")
        for detector, role, label, marker in (
            ("chain", "threshold", "cell averaging", "circle"),
            ("report", "track", "the students' rule", "square"),
        ):
            self._shares.add_line(f"{detector} theory", role, label=label, line_width=2)
            self._shares.add_vertical_lines(
                f"{detector} interval", role, line_width=2, line_alpha=0.5
            )
            self._shares.add_marks(detector, role, label=label, size=7, marker=marker)
        self._shares.add_legend("center_right")
        self._root = column(self._cut.figure, self._shares.figure, sizing_mode="stretch_both")

    @property
    def root_element(self) -> UIElement:
        return self._root

    def compute_frame(self, settings: NoiseSettings, frame_number: int) -> NoiseFrame:
        return compute_cuts_and_hits(settings, frame_number)

    def draw_frame_and_format_numbers(self, frame: NoiseFrame) -> Mapping[str, str]:
        settings = frame.settings
        self._hits.add_hits_of_frame(frame)
        # The report's bins are zero-padded and lie elsewhere, but its threshold is as smooth.
        self._cut.set_data(
            "power", **_crop_to_shown_line_db(frame.chain.range_m, frame.chain.power)
        )
        self._cut.set_data(
            "chain", **_crop_to_shown_line_db(frame.chain.range_m, frame.chain.threshold)
        )
        self._cut.set_data(
            "report", **_crop_to_shown_line_db(frame.report.range_m, frame.report.threshold)
        )
        self._cut.set_data("truth", x=[REFERENCE_TARGET.range_m], low=[-8], high=[56])
        self._shares.set_data("now", x=[settings.snr_db], low=[-0.04], high=[1.08])
        numbers = {
            "SNR in the cell of the echo": f"{frame.snr_in_cell_db:.1f} dB",
            f"detected at {settings.snr_db:.0f} dB by": "",
        }
        for detector, name, curve, offset_db in (
            ("chain", "cell averaging", frame.theory, -0.1),
            ("report", "the students' rule", frame.report_theory, 0.1),
        ):
            shares = self._hits.hit_rates_with_intervals(settings.window, detector)
            self._shares.set_data(f"{detector} theory", x=frame.theory_db, y=curve)
            shown_db = shares[:, 0] + offset_db  # keeps both marks visible
            self._shares.set_data(
                f"{detector} interval", x=shown_db, low=shares[:, 2], high=shares[:, 3]
            )
            self._shares.set_data(detector, x=shown_db, y=shares[:, 1])
            row = shares[shares[:, 0] == settings.snr_db][0]
            expected = float(np.interp(settings.snr_db, frame.theory_db, curve))
            numbers[name] = f"{row[1] * row[4]:.0f} of {row[4]:.0f}; theory {expected:.0%}"
        self._cut.set_title(
            f"One frame at {settings.snr_db:.0f} dB: target found by"
            f" {_FINDERS[bool(frame.hits[0]), bool(frame.report_hits[0])]}"
        )
        self._shares.set_title("Detection probability: theory; counted, with 95 % intervals")
        return numbers

    def next_animated_knob_values(self, knob_values: Mapping[str, Any]) -> Mapping[str, float]:
        return (
            {}
            if knob_values["play"] == _CONSTANT_NOISE
            else super().next_animated_knob_values(knob_values)
        )

    def apply_theme(self, theme: Theme) -> None:
        for drawing in (self._cut, self._shares):
            drawing.apply_theme(theme)


def _crop_to_shown_line_db(range_m: np.ndarray, power: np.ndarray) -> dict[str, np.ndarray]:
    is_shown = (range_m >= _SHOWN_M[0] - 1) & (range_m <= _SHOWN_M[1] + 1)
    return {"x": range_m[is_shown], "y": np.maximum(to_decibels(power[is_shown]), -8)}
