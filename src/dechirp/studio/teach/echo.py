"""Lesson 2: the echo of a target, and its spectrum over range."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
import xarray as xr
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.core.units import decibels, from_decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.experiment.verify.looks import RCS_M2, radar
from dechirp.process.spectrum import Transform, range_profiles
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.studio.teach.lesson import Choice, Dial, Lesson, Try
from dechirp.studio.theme import Theme
from dechirp.studio.views.drawing import Drawing
from dechirp.theory.windows import Window

SHOWN_M = (35.0, 65.0)
LOWEST_DB = -90.0
_FINE_BINS = 16 * 2200
"""Of the spectrum between the bins: sixteen of its points to a range cell."""
_ALONE = "none"
BESIDE: dict[str, tuple[float, float]] = {
    "as strong, 1.2 m behind": (1.2, 0.0),
    "as strong, 3 m behind": (3.0, 0.0),
    "40 dB weaker, 8 m behind": (8.0, -40.0),
}
"""Second targets: how far behind the first, and how strong beside it, dB."""


@dataclass(frozen=True)
class Settings:
    """A target, one beside it, and how its samples are transformed."""

    range_m: float
    beside: str
    window: Window
    padding: str
    """Bins over samples, as a text: it is chosen from a list."""
    n_samples: float


@dataclass(frozen=True, eq=False)
class Seen:
    """Samples of one chirp, and their spectrum."""

    at: Settings
    chirp: Chirp
    """With so many samples as are taken."""
    transform: Transform
    time_s: np.ndarray
    tapered: np.ndarray
    """Real part of the samples under the window; an echo of the first target alone is 1."""
    bins_m: np.ndarray
    bins: np.ndarray
    """Power over that of the first target alone on a bin."""
    fine_m: np.ndarray
    fine: np.ndarray
    """The same between the bins."""

    @property
    def peak_m(self) -> float:
        """Range of the strongest bin."""
        return float(self.bins_m[np.argmax(self.bins)])


@cache
def short_radar() -> Radar:
    """The reference radar with one chirp in a frame."""
    return replace(radar(), frame=replace(radar().frame, n_chirps=1))


def samples(range_m: float, beside: str) -> np.ndarray:
    """Echo of the targets in one chirp, without noise, (sample,); the first alone has power 1."""
    first = Target(position_m=(range_m, 0.0, 0.0), rcs_m2=RCS_M2)
    targets = [first]
    if beside != _ALONE:
        behind_m, level_db = BESIDE[beside]
        # What range takes of the second is given back: both are as strong as they are said to be.
        spread = ((range_m + behind_m) / range_m) ** 4
        rcs_m2 = RCS_M2 * spread * float(from_decibels(level_db))
        targets.append(Target(position_m=(range_m + behind_m, 0.0, 0.0), rcs_m2=rcs_m2))
    alone, both = (
        clean_echoes(Scene(targets=of), short_radar()).values[0, 0, 0]
        for of in ((first,), tuple(targets))
    )
    return np.asarray(both / np.sqrt(np.mean(abs(alone) ** 2)))


def seen(at: Settings) -> Seen:
    """Beat signal and spectrum."""
    n = int(at.n_samples)
    chirp = replace(radar().frame.chirp, n_samples=n)
    taken = samples(at.range_m, at.beside)[:n]
    transform = Transform(window=at.window, n_points=n, n_bins=n * int(at.padding))
    between = replace(transform, n_bins=_FINE_BINS)
    cube = xr.DataArray(taken, dims="sample")
    bins, fine = (range_profiles(cube, chirp, one) for one in (transform, between))
    return Seen(
        at=at,
        chirp=chirp,
        transform=transform,
        time_s=np.arange(n) / chirp.sample_rate_hz,
        tapered=(taken * transform.weights).real,
        bins_m=bins.range.values,
        bins=abs(bins.values) ** 2,
        fine_m=fine.range.values,
        fine=abs(fine.values) ** 2,
    )


class EchoLesson(Lesson[Settings, Seen]):
    """The beat signal over time, and its spectrum below."""

    title = "Target and range transform"
    says = (
        "Each target leaves one tone in the beat signal. A Fourier transform sorts tones by their"
        " frequency, and that is sorting targets by range. A longer look makes finer bins."
    )
    formulas = (
        (r"R = \dfrac{c\,f_\mathrm{b}}{2\,S}", "range of a beat"),
        (r"\Delta R = \dfrac{c}{2\,S\,N/f_\mathrm{s}}", "range bin of N samples"),
    )
    knobs: ClassVar = {
        "range_m": Dial("Range of the target, m", 40, 60, 0.1, 50),
        "beside": Choice("Second target", (_ALONE, *BESIDE), _ALONE),
        "window": Choice("Window", ("rectangular", "hann", "blackman-harris"), "rectangular"),
        "padding": Choice("Zero padding, bins to a sample", ("1", "2", "4", "8"), "1"),
        "n_samples": Dial("Samples N taken of 2,200", 100, 2200, 25, 2200),
    }
    moves = ("n_samples", 25)
    tries = (
        Try(
            "Put the target between two bins",
            {"range_m": 50.5},
            "Its tone fits no bin: two bins share it, up to 3.9 dB too low, and sidelobes appear in"
            " all others. They were there before, but the bins lay on their zeros.",
        ),
        Try(
            "The same, padded with zeros",
            {"range_m": 50.5, "padding": "8"},
            "Bins lie closer on the same curve, and one meets the peak. The lobe is as wide as"
            " before: padding adds points, not resolution.",
        ),
        Try(
            "Two targets a cell apart, padded",
            {"beside": "as strong, 1.2 m behind", "padding": "8"},
            "One lobe or two? That depends on how their phases meet: move the range by 0.1 m and"
            " look. Only bandwidth would part them for sure.",
        ),
        Try(
            "Hide a weak target",
            {"range_m": 50.5, "beside": "40 dB weaker, 8 m behind"},
            "The sidelobes of the strong target lie over the weak one at 58.5 m. No threshold"
            " finds it: the transform has lost it, not the noise.",
        ),
        Try(
            "Find it with a window",
            {"range_m": 50.5, "beside": "40 dB weaker, 8 m behind", "window": "hann"},
            "Hann fades the samples in and out, so sidelobes fall fast, and the weak target"
            " stands clear. The price: a main lobe twice as wide.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(Settings)
        last_us = radar().frame.chirp.sampled_duration_s * 1e6
        self._signal = Drawing(
            x="time since the first sample, µs",
            y="beat signal, real part",
            x_range=(0, last_us * 1.01),
            y_range=(-2.1, 2.1),
        )
        self._signal.line("samples", "track", label="samples under the window", line_width=1.2)
        self._signal.line("window", "muted", label="window", line_width=2)
        self._signal.explained()
        self._spectrum = Drawing(
            x="range, m",
            y="power, dB over the first target",
            x_range=SHOWN_M,
            y_range=(LOWEST_DB, 9),
        )
        self._spectrum.bars("truth", "truth", label="where targets are", line_width=2)
        self._spectrum.line("fine", "muted", label="between the bins", line_width=1)
        self._spectrum.bars("stems", "echo", line_width=1)
        self._spectrum.marks("bins", "echo", label="bins of the transform", size=5)
        self._spectrum.explained()
        self._root = column(self._signal.figure, self._spectrum.figure, sizing_mode="stretch_both")

    @property
    def root(self) -> UIElement:
        """Its figures."""
        return self._root

    def look(self, at: Settings, number: int) -> Seen:
        """What is seen with those settings."""
        return seen(at)

    def show(self, seen: Seen) -> Mapping[str, str]:
        """Draw it, and give the numbers beside it."""
        time_us = seen.time_s * 1e6
        self._signal.put("samples", x=time_us, y=seen.tapered)
        self._signal.put("window", x=time_us, y=seen.transform.weights)
        fine_m, fine_db = _within(seen.fine_m, seen.fine)
        bins_m, bins_db = _within(seen.bins_m, seen.bins)
        self._spectrum.put("fine", x=fine_m, y=fine_db)
        self._spectrum.put("stems", x=bins_m, low=np.full(bins_m.size, LOWEST_DB), high=bins_db)
        self._spectrum.put("bins", x=bins_m, y=bins_db)
        at_m = [seen.at.range_m]
        if seen.at.beside != _ALONE:
            at_m.append(at_m[0] + BESIDE[seen.at.beside][0])
        self._spectrum.put("truth", x=at_m, low=[LOWEST_DB] * len(at_m), high=[9] * len(at_m))
        cell_m = seen.chirp.range_resolution_m
        beat_hz = seen.chirp.beat_frequency_hz(seen.at.range_m)
        n = seen.chirp.n_samples
        self._signal.called(f"{n:,} samples: {time_us[-1]:.1f} µs of the ramp")
        self._spectrum.called(
            f"Spectrum: range bins of {cell_m:.2f} m, the strongest at {seen.peak_m:.2f} m"
        )
        straddle = seen.transform.straddle(beat_hz / seen.chirp.sample_rate_hz)
        return {
            "beat of the target": f"{beat_hz / 1e6:.3f} MHz",
            "strongest bin": f"{seen.peak_m:.2f} m",
            "bin width c / 2B": f"{cell_m:.2f} m",
            "lost between bins": f"{abs(float(decibels(straddle))):.1f} dB",
            "main lobe, zero to zero": f"{2 * cell_m * _lobe_bins(seen):.1f} m",
        }

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in (self._signal, self._spectrum):
            drawing.wear(theme)


def _within(range_m: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is shown of a spectrum, in dB, not below the lowest."""
    shown = (range_m >= SHOWN_M[0]) & (range_m <= SHOWN_M[1])
    return range_m[shown], np.asarray(decibels(np.maximum(power[shown], 10 ** (LOWEST_DB / 10))))


def _lobe_bins(seen: Seen) -> float:
    """Half the width of the main lobe, in bins without padding."""
    return seen.transform.main_lobe_bins * seen.transform.n_points / seen.transform.n_bins
