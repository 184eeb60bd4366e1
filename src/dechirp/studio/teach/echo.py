"""Lesson 2: the echo of a target and its range spectrum."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
import xarray as xr
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.certificate.reference_trials import RCS_M2, reference_radar
from dechirp.core.units import from_decibels, to_decibels
from dechirp.processing.spectrum import Transform, range_profiles
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.report.labels import RANGE_LABEL
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.simulate import simulate_ideal_echoes
from dechirp.studio.teach.lesson import Choice, Dial, Experiment, Lesson
from dechirp.studio.theme import Theme
from dechirp.studio.views.line_figure import LineFigure
from dechirp.theory.windows import Window

SHOWN_M = (35.0, 65.0)
LOWEST_DB = -90.0
_FINE_BINS = 16 * 2200
"""Bins of the interpolated spectrum: sixteen points per range cell."""
_NO_SECOND_TARGET = "none"
SECOND_TARGETS: dict[str, tuple[float, float]] = {
    "as strong, 1.2 m behind": (1.2, 0.0),
    "as strong, 3 m behind": (3.0, 0.0),
    "40 dB weaker, 8 m behind": (8.0, -40.0),
}
"""Second targets: distance behind the first in m, and relative level in dB."""


@dataclass(frozen=True)
class EchoSettings:
    """Target, second target and transform."""

    range_m: float
    second_target: str
    window: Window
    padding: str
    """Ratio of bins to samples as text, chosen from a list."""
    n_samples: float


@dataclass(frozen=True, eq=False)
class EchoFrame:
    """Samples of one chirp and their spectrum."""

    settings: EchoSettings
    chirp: Chirp
    """Chirp with the selected number of samples."""
    transform: Transform
    time_s: np.ndarray
    tapered: np.ndarray
    """Real part of the windowed samples; an echo of the first target alone has amplitude 1."""
    bins_m: np.ndarray
    bins: np.ndarray
    """Power relative to the first target alone on a bin."""
    fine_m: np.ndarray
    fine: np.ndarray
    """Interpolated power between the bins."""

    @property
    def strongest_range_m(self) -> float:
        """Range of the strongest bin."""
        return float(self.bins_m[np.argmax(self.bins)])


@cache
def reference_radar_with_one_chirp() -> Radar:
    """Return the reference radar with one chirp per frame."""
    return replace(reference_radar(), frame=replace(reference_radar().frame, n_chirps=1))


def noise_free_echo_samples(range_m: float, second_target: str) -> np.ndarray:
    """Return the noise-free echoes (sample,) of one chirp; the first alone has power 1."""
    first = Target(position_m=(range_m, 0.0, 0.0), rcs_m2=RCS_M2)
    targets = [first]
    if second_target != _NO_SECOND_TARGET:
        behind_m, level_db = SECOND_TARGETS[second_target]
        # Compensate the larger range of the second target to obtain the stated level.
        spread = ((range_m + behind_m) / range_m) ** 4
        rcs_m2 = RCS_M2 * spread * float(from_decibels(level_db))
        targets.append(Target(position_m=(range_m + behind_m, 0.0, 0.0), rcs_m2=rcs_m2))
    first_echo, both = (
        simulate_ideal_echoes(
            Scene(targets=scene_targets), reference_radar_with_one_chirp()
        ).values[0, 0, 0]
        for scene_targets in ((first,), tuple(targets))
    )
    return np.asarray(both / np.sqrt(np.mean(abs(first_echo) ** 2)))


def compute_echo_and_spectrum(settings: EchoSettings) -> EchoFrame:
    """Compute the beat signal and its spectrum."""
    n = int(settings.n_samples)
    chirp = replace(reference_radar().frame.chirp, n_samples=n)
    kept_samples = noise_free_echo_samples(settings.range_m, settings.second_target)[:n]
    transform = Transform(window=settings.window, n_points=n, n_bins=n * int(settings.padding))
    fine_transform = replace(transform, n_bins=_FINE_BINS)
    cube = xr.DataArray(kept_samples, dims="sample")
    bins, fine = (
        range_profiles(cube, chirp, range_transform)
        for range_transform in (transform, fine_transform)
    )
    return EchoFrame(
        settings=settings,
        chirp=chirp,
        transform=transform,
        time_s=np.arange(n) / chirp.sample_rate_hz,
        tapered=(kept_samples * transform.weights).real,
        bins_m=bins.range.values,
        bins=abs(bins.values) ** 2,
        fine_m=fine.range.values,
        fine=abs(fine.values) ** 2,
    )


class EchoLesson(Lesson[EchoSettings, EchoFrame]):
    """Beat signal over time with its spectrum below."""

    title = "Target and range transform"
    introduction = (
        "Each target causes one tone in the beat signal. A Fourier transform separates the tones"
        " by frequency, and so the targets by range. More samples give narrower bins."
    )
    formulas = (
        (r"R = \dfrac{c\,f_\mathrm{b}}{2\,S}", "range of a beat"),
        (r"\Delta R = \dfrac{c}{2\,S\,N/f_\mathrm{s}}", "range bin of N samples"),
    )
    knobs: ClassVar = {
        "range_m": Dial("Range of the target (m)", 40, 60, 0.1, 50),
        "second_target": Choice(
            "Second target", (_NO_SECOND_TARGET, *SECOND_TARGETS), _NO_SECOND_TARGET
        ),
        "window": Choice("Window", ("rectangular", "hann", "blackman-harris"), "rectangular"),
        "padding": Choice("Zero padding (bins per sample)", ("1", "2", "4", "8"), "1"),
        "n_samples": Dial("Samples N, of 2,200", 100, 2200, 25, 2200),
    }
    animated_dial = ("n_samples", 25)
    experiments = (
        Experiment(
            "Put the target between two bins",
            {"range_m": 50.5},
            "The frequency is between two bins. Both show the tone, up to 3.9 dB too weak, and"
            " sidelobes appear in all other bins. They existed before, but the bins were at their"
            " nulls.",
        ),
        Experiment(
            "The same with zero padding",
            {"range_m": 50.5, "padding": "8"},
            "The bins are closer together on the same curve, and one is at the peak. The main lobe"
            " is as wide as before: zero padding adds points, not resolution.",
        ),
        Experiment(
            "Two targets one cell apart, zero padded",
            {"second_target": "as strong, 1.2 m behind", "padding": "8"},
            "One lobe or two? The result depends on the phase between the two echoes: move the"
            " range by 0.1 m to see it. Only more bandwidth separates them reliably.",
        ),
        Experiment(
            "Hide a weak target",
            {"range_m": 50.5, "second_target": "40 dB weaker, 8 m behind"},
            "The sidelobes of the strong target cover the weak one at 58.5 m. No threshold can"
            " detect it: the sidelobes hide it, not the noise.",
        ),
        Experiment(
            "Find it with a window",
            {"range_m": 50.5, "second_target": "40 dB weaker, 8 m behind", "window": "hann"},
            "A Hann window fades the samples in and out. Its sidelobes fall quickly, and the weak"
            " target becomes visible. The cost is a main lobe twice as wide.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(EchoSettings)
        last_us = reference_radar().frame.chirp.sampled_duration_s * 1e6
        self._signal = LineFigure(
            x="Time since the first sample (µs)",
            y="Beat signal, real part",
            x_range=(0, last_us * 1.01),
            y_range=(-2.1, 2.1),
        )
        self._signal.add_line("samples", "track", label="samples under the window", line_width=1.2)
        self._signal.add_line("window", "muted", label="window", line_width=2)
        self._signal.add_legend()
        self._spectrum = LineFigure(
            x=RANGE_LABEL,
            y="Power relative to the first target (dB)",
            x_range=SHOWN_M,
            y_range=(LOWEST_DB, 9),
        )
        self._spectrum.add_vertical_lines("truth", "truth", label="targets", line_width=2)
        self._spectrum.add_line("fine", "muted", label="between the bins", line_width=1)
        self._spectrum.add_vertical_lines("stems", "echo", line_width=1)
        self._spectrum.add_marks("bins", "echo", label="bins of the transform", size=5)
        self._spectrum.add_legend()
        self._root = column(self._signal.figure, self._spectrum.figure, sizing_mode="stretch_both")

    @property
    def root_element(self) -> UIElement:
        return self._root

    def compute_frame(self, settings: EchoSettings, frame_number: int) -> EchoFrame:
        return compute_echo_and_spectrum(settings)

    def draw_frame_and_format_numbers(self, frame: EchoFrame) -> Mapping[str, str]:
        time_us = frame.time_s * 1e6
        self._signal.set_data("samples", x=time_us, y=frame.tapered)
        self._signal.set_data("window", x=time_us, y=frame.transform.weights)
        fine_m, fine_db = _crop_to_shown_ranges_db(frame.fine_m, frame.fine)
        bins_m, bins_db = _crop_to_shown_ranges_db(frame.bins_m, frame.bins)
        self._spectrum.set_data("fine", x=fine_m, y=fine_db)
        self._spectrum.set_data(
            "stems", x=bins_m, low=np.full(bins_m.size, LOWEST_DB), high=bins_db
        )
        self._spectrum.set_data("bins", x=bins_m, y=bins_db)
        targets_m = [frame.settings.range_m]
        if frame.settings.second_target != _NO_SECOND_TARGET:
            targets_m.append(targets_m[0] + SECOND_TARGETS[frame.settings.second_target][0])
        self._spectrum.set_data(
            "truth", x=targets_m, low=[LOWEST_DB] * len(targets_m), high=[9] * len(targets_m)
        )
        cell_m = frame.chirp.range_resolution_m
        beat_hz = frame.chirp.beat_frequency_hz(frame.settings.range_m)
        n = frame.chirp.n_samples
        self._signal.set_title(f"{n:,} samples: {time_us[-1]:.1f} µs of the ramp")
        self._spectrum.set_title(
            f"Spectrum: range bins of {cell_m:.2f} m,"
            f" the strongest at {frame.strongest_range_m:.2f} m"
        )
        main_lobe_m = 2 * cell_m * _half_main_lobe_in_unpadded_bins(frame)
        straddle = frame.transform.straddling_loss(beat_hz / frame.chirp.sample_rate_hz)
        return {
            "beat of the target": f"{beat_hz / 1e6:.3f} MHz",
            "strongest bin": f"{frame.strongest_range_m:.2f} m",
            "bin width c / 2B": f"{cell_m:.2f} m",
            "lost between bins": f"{abs(float(to_decibels(straddle))):.1f} dB",
            "main lobe, zero to zero": f"{main_lobe_m:.1f} m",
        }

    def apply_theme(self, theme: Theme) -> None:
        for drawing in (self._signal, self._spectrum):
            drawing.apply_theme(theme)


def _crop_to_shown_ranges_db(
    range_m: np.ndarray, power: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the shown part of a spectrum in dB, limited from below."""
    is_shown = (range_m >= SHOWN_M[0]) & (range_m <= SHOWN_M[1])
    return range_m[is_shown], np.asarray(
        to_decibels(np.maximum(power[is_shown], 10 ** (LOWEST_DB / 10)))
    )


def _half_main_lobe_in_unpadded_bins(frame: EchoFrame) -> float:
    """Return half the main-lobe width in bins without zero padding."""
    return (
        frame.transform.main_lobe_half_width_bins
        * frame.transform.n_points
        / frame.transform.n_bins
    )
