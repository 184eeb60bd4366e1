"""The beat signal of the first chirp, and its spectrum."""

import math
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.core.displayed import several
from dechirp.core.words import power_db, power_of_ten, power_unit
from dechirp.process.chain import Chain
from dechirp.process.spectrum import range_profiles
from dechirp.radar.chirp import Chirp
from dechirp.report.figures.parts import legend, panels
from dechirp.report.figures.style import BLUE, INK, thinned

Part = Literal["real", "imaginary"]

_COLORS: dict[Part, str] = {"real": "#8fbbdb", "imaginary": "#e5b08c"}
_ALONE = "#4d94c6"
_MOST_CHIRPS = 256  # averaged for the spectrum: the mean is smooth to 0.3 dB by then


def signal(
    axes: Axes,
    cube: xr.DataArray,
    *,
    part: Part = "real",
    doppler_frequency_hz: float | None = None,
) -> Axes:
    """Draw the samples of the first chirp at the first receiver over fast time.

    Parameters
    ----------
    axes : Axes
        To draw on.
    cube : DataArray (frame, chirp, rx, sample)
        Complex or real samples, sqrt(W) or full scale; chirps of one slot, where slots differ.
    part : real or imaginary
        Of complex samples.
    doppler_frequency_hz : float, optional
        Of a detection: draws also the echo within the samples, the mean over the chirps, each
        turned back by its Doppler phase. Complex samples only.

    Returns
    -------
    Axes
        Those given.
    """
    first = cube.isel(frame=0, chirp=0, rx=0)
    samples, time_us = first.values, first["sample"].values * 1e6
    is_complex = np.iscomplexobj(samples)
    of_part = np.real if part == "real" else np.imag
    exponent = engineering_exponent(float(abs(samples).max()))
    scaled = samples / 10.0**exponent
    axes.plot(
        *thinned(time_us, of_part(scaled)),
        color=_COLORS[part] if is_complex else _ALONE,
        linewidth=0.7,
    )
    if doppler_frequency_hz is not None and is_complex:
        some = cube.isel(frame=0, rx=0, chirp=slice(_MOST_CHIRPS)).transpose("chirp", "sample")
        turned = np.exp(-2j * np.pi * doppler_frequency_hz * some["chirp"].values)
        echo = turned @ some.values / turned.size
        axes.plot(*thinned(time_us, of_part(echo) / 10.0**exponent), color=INK, linewidth=0.8)
    reach = 1.1 * float(max(abs(scaled.real).max(), abs(scaled.imag).max())) or 1.0
    axes.set(ylim=(-reach, reach), xlim=(time_us[0], time_us[-1]))
    unit = cube.attrs.get("units", "").replace("sqrt(W)", "√W")
    unit = unit if exponent == 0 else f"{power_of_ten(exponent)} {unit}"
    name = f"{part} part" if is_complex else "samples"
    axes.set_ylabel(f"{name}\n{unit}")
    axes.set_xlabel("time since the start of the ramp, µs")
    of = f", {part} part" if is_complex else ""
    axes.set_label(f"Beat signal of the first chirp over time{of}")
    return axes


def whole_signal(
    figure: FigureBase, cube: xr.DataArray, *, doppler_frequency_hz: float | None = None
) -> list[Axes]:
    """Draw both parts of complex samples, one above the other; of real samples the one.

    Parameters
    ----------
    figure : Figure or SubFigure
        To fill.
    cube, doppler_frequency_hz
        See `signal`.

    Returns
    -------
    list of Axes
        The real part, and below it the imaginary one.
    """
    parts: tuple[Part, ...] = ("real", "imaginary") if np.iscomplexobj(cube) else ("real",)
    rows = panels(figure, len(parts), 1, sharex=True)[:, 0].tolist()
    for axes, part in zip(rows, parts, strict=True):
        signal(axes, cube, part=part, doppler_frequency_hz=doppler_frequency_hz)
        axes.label_outer()
    return rows


def spectrum(
    axes: Axes,
    cube: xr.DataArray,
    chirp: Chirp,
    chain: Chain,
    *,
    truth_m: np.ndarray | None = None,
) -> Axes:
    """Draw power over range: of the first chirp, and the mean over the chirps.

    Parameters
    ----------
    axes : Axes
        To draw on.
    cube : DataArray (frame, chirp, rx, sample)
        The first frame at the first receiver is shown; chirps of one slot, where ramps differ.
    chirp : Chirp
        That was sent.
    chain : Chain
        Has the window and the length of the transform.
    truth_m : array (n,), optional
        Ranges where the echoes of the truth appear, marked below the line.

    Returns
    -------
    Axes
        Those given.
    """
    transform = chain.over_range(chirp)
    some = cube.isel(frame=0, rx=0, chirp=slice(_MOST_CHIRPS))
    profiles = range_profiles(some, chirp, transform).transpose("chirp", "range")
    power, range_m = abs(profiles.values) ** 2, profiles.range.values
    units = cube.attrs.get("units", "")
    first, mean = power_db(power[0], units), power_db(power.mean(axis=0), units)
    # Single noise cells reach down without end: 12 dB below their median is enough to see.
    lowest, highest = float(np.median(first)) - 12, float(max(first.max(), mean.max()))
    axes.plot(
        *thinned(range_m, np.maximum(first, lowest)),
        color="#b4bec8",
        linewidth=0.6,
        label="first chirp",
    )
    axes.plot(
        *thinned(range_m, mean),
        color=BLUE,
        linewidth=1.0,
        label=f"mean power of {several(power.shape[0], 'chirp')}",
    )
    if truth_m is not None and truth_m.size:
        axes.plot(
            truth_m,
            np.full(truth_m.size, lowest + 0.02 * (highest - lowest)),
            linestyle="",
            marker="^",
            markersize=5,
            color=INK,
            label="truth",
        )
    axes.set(xlim=(0, range_m[-1]), ylim=(lowest, highest + 0.05 * (highest - lowest) + 1))
    axes.set_xlabel("range, m")
    axes.set_ylabel(f"power, {power_unit(units)}")
    legend(axes)
    axes.set_label("Spectrum of the beat signal over range")
    return axes


def engineering_exponent(largest: float) -> int:
    """Power of ten, a multiple of three, that leaves an amplitude of 1 to 1000; 0 for none."""
    if not (math.isfinite(largest) and largest > 0):
        return 0
    return 3 * math.floor(math.log10(largest) / 3)
