"""Transmitted ramp, its echo and the beat signal."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.core.text import format_with_si_prefix
from dechirp.core.units import to_decibels
from dechirp.report.figures.common import add_colour_bar, create_panels, outer_cell_edges
from dechirp.report.figures.style import BLUE, COLORS, INK, MUTED, ORANGE
from dechirp.report.labels import POWER_RELATIVE_TO_PEAK_LABEL

_SPAN_DB = 30.0


def draw_ramp_frequencies(
    figure: FigureBase,
    *,
    start_frequency_hz: float,
    bandwidth_hz: float,
    chirp_duration_s: float,
    delay_s: float,
    beat_frequency_hz: float,
    n_chirps: int = 3,
) -> list[Axes]:
    """Draw the transmitted and received frequency over a few chirps, and a close-up.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill.
    start_frequency_hz, bandwidth_hz, chirp_duration_s : float
        Parameters of the chirps, which follow each other without a pause.
    delay_s, beat_frequency_hz : float
        Delay and beat frequency of the echo.
    n_chirps : int
        Chirps in the first panel.

    Returns
    -------
    list of Axes
        Axes of the chirps, and of the close-up of the first one.
    """
    time_us = np.array([0.0, 1.0]) * chirp_duration_s * 1e6
    frequency_ghz = (start_frequency_hz + np.array([0.0, bandwidth_hz])) / 1e9
    delay_us, beat_ghz = delay_s * 1e6, beat_frequency_hz / 1e9

    def ramps(axes: Axes) -> None:
        for chirp in range(n_chirps):
            start_us = chirp * chirp_duration_s * 1e6
            first = chirp == 0
            axes.plot(
                time_us + start_us,
                frequency_ghz,
                color=BLUE,
                linewidth=1.3,
                label="transmitted" if first else None,
            )
            axes.plot(
                time_us + start_us + delay_us,
                frequency_ghz,
                color=ORANGE,
                linewidth=1.3,
                label="received" if first else None,
            )
        axes.set_xlabel("Time (µs)")

    few, close = create_panels(figure, 1, 2, width_ratios=(1.5, 1.0))[0].tolist()
    ramps(few)
    few.set(xlim=(0, (n_chirps + 0.1) * chirp_duration_s * 1e6))
    few.set_ylabel("Frequency (GHz)")
    ramps(close)
    close.set_ylabel("Frequency (GHz)")
    reach_us = 3.2 * delay_us
    slope = beat_ghz / delay_us
    close.set(
        xlim=(0, reach_us),
        ylim=(frequency_ghz[0] - 0.15 * slope * reach_us, frequency_ghz[0] + slope * reach_us),
    )
    at_us = 2.2 * delay_us
    top, bottom = (frequency_ghz[0] + slope * x for x in (at_us, at_us - delay_us))
    _draw_dimension_arrow(close, (at_us, bottom), (at_us, top))
    close.text(
        at_us - 0.1 * delay_us,
        top + 0.1 * slope * delay_us,
        format_with_si_prefix(beat_frequency_hz, "Hz"),
        ha="right",
        va="bottom",
    )
    low = frequency_ghz[0] - 0.05 * slope * reach_us
    _draw_dimension_arrow(close, (0.0, low), (delay_us, low))
    close.plot([delay_us] * 2, [low, frequency_ghz[0]], color=MUTED, linewidth=0.6)
    close.text(1.1 * delay_us, low, format_with_si_prefix(delay_s, "s"), ha="left", va="center")
    figure.legend(
        *few.get_legend_handles_labels(), loc="outside upper center", ncols=2, handlelength=1.4
    )
    few.set_label("Instantaneous transmitted and received frequency")
    close.set_label("Close-up of the start of the first chirp")
    return [few, close]


def draw_ramp_and_beat_spectrograms(
    figure: FigureBase,
    ramp: np.ndarray,
    beat: np.ndarray,
    sample_rate_hz: float,
    *,
    slope_hz_per_s: float,
    highest_beat_hz: float,
) -> list[Axes]:
    """Draw spectrograms of the ramp, mixed down, and of the beat signal of one chirp.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill.
    ramp, beat : array (n_samples,)
        Complex samples.
    sample_rate_hz, slope_hz_per_s : float
        Sample rate and slope of both.
    highest_beat_hz : float
        Largest displayed beat frequency; negative ones are displayed up to a third of it.

    Returns
    -------
    list of Axes
        Axes of the ramp and of the beat signal.
    """
    # A window of sqrt(1 / slope) gives the narrowest line of a ramp; a tone needs a long one.
    short = round(sample_rate_hz / np.sqrt(slope_hz_per_s))
    bandwidth_hz = slope_hz_per_s * ramp.size / sample_rate_hz
    parts = (
        ("ramp, mixed down", ramp, short, (0.0, bandwidth_hz)),
        ("beat signal with noise", beat, 4 * short, (-highest_beat_hz / 3, highest_beat_hz)),
    )
    both: list[Axes] = create_panels(figure, 1, 2)[0].tolist()
    for axes, (title, samples, n_window, over_hz) in zip(both, parts, strict=True):
        power, time_s, frequency_hz = _short_time_power_spectra(samples, sample_rate_hz, n_window)
        is_shown = (frequency_hz >= over_hz[0]) & (frequency_hz <= over_hz[1])
        axes.grid(False)
        image = axes.imshow(
            to_decibels(power[is_shown] / power.max()),
            cmap=COLORS,
            vmin=-_SPAN_DB,
            vmax=0.0,
            extent=(
                *outer_cell_edges(time_s * 1e6),
                *outer_cell_edges(frequency_hz[is_shown] / 1e6),
            ),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        axes.set_title(title, loc="left")
        axes.set_label(f"Spectrogram of {title}")
        axes.set_xlabel("Time (µs)")
        axes.set_ylabel("Frequency (MHz)")
    add_colour_bar(both, image, POWER_RELATIVE_TO_PEAK_LABEL)
    return both


def _short_time_power_spectra(
    samples: np.ndarray, sample_rate_hz: float, n_window: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return power (frequency, time) with a Hann window, times (s) and frequencies (Hz)."""
    step, n_bins = max(n_window // 8, 1), 8 * n_window
    pieces = np.lib.stride_tricks.sliding_window_view(samples, n_window)[::step]
    spectra = np.fft.fft(pieces * np.hanning(n_window), n_bins, axis=1)
    power = np.fft.fftshift(abs(spectra) ** 2, axes=1).T
    time_s = (np.arange(len(pieces)) * step + n_window / 2) / sample_rate_hz
    return power, time_s, np.fft.fftshift(np.fft.fftfreq(n_bins, 1 / sample_rate_hz))


def _draw_dimension_arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0},
    )
