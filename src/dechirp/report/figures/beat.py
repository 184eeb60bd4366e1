"""The beat signal of the first chirp, and its spectrum."""

import math

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from dechirp.process.chain import Chain
from dechirp.process.spectrum import range_profiles
from dechirp.radar.chirp import Chirp
from dechirp.report.figures.style import BLUE, INK, draw, thinned
from dechirp.report.words import power_db, power_of_ten, power_unit

_MOST_CHIRPS = 256  # averaged for the spectrum: the mean is smooth to 0.3 dB by then


def signal(cube: xr.DataArray, *, doppler_frequency_hz: float | None = None) -> Markup:
    """Draw the samples of the first chirp at the first receiver over fast time.

    With the Doppler frequency of a detection, also the echo within them: the mean over the
    chirps, each turned back by its Doppler phase. Complex samples only.
    """
    first = cube.isel(frame=0, chirp=0, rx=0)
    samples, time_us = first.values, first["sample"].values * 1e6
    echo = None
    if doppler_frequency_hz is not None and np.iscomplexobj(samples):
        some = cube.isel(frame=0, rx=0, chirp=slice(_MOST_CHIRPS)).transpose("chirp", "sample")
        turned = np.exp(-2j * np.pi * doppler_frequency_hz * some["chirp"].values)
        echo = turned @ some.values / turned.size
    exponent = engineering_exponent(float(abs(samples).max()))
    scaled = samples / 10.0**exponent
    unit = cube.attrs.get("units", "").replace("sqrt(W)", "√W")
    unit = unit if exponent == 0 else f"{power_of_ten(exponent)} {unit}"
    parts = [("samples", scaled.real, "#4d94c6")]
    if np.iscomplexobj(samples):
        parts = [
            ("real part", scaled.real, "#8fbbdb"),
            ("imaginary part", scaled.imag, "#e5b08c"),
        ]
    reach = 1.1 * max(float(abs(values).max()) for _, values, _ in parts) or 1.0

    def paint(figure: Figure) -> None:
        rows = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values, color) in zip(rows, parts, strict=True):
            axes.plot(*thinned(time_us, values), color=color, linewidth=0.7)
            if echo is not None:
                part = (echo.real if values is parts[0][1] else echo.imag) / 10.0**exponent
                axes.plot(*thinned(time_us, part), color=INK, linewidth=0.8)
            axes.set(ylim=(-reach, reach), xlim=(time_us[0], time_us[-1]))
            axes.set_ylabel(f"{name}\n{unit}")
        rows[-1].set_xlabel("time since the start of the ramp, µs")

    return draw(paint, label="Beat signal of the first chirp over time", height_in=3.2)


def spectrum(
    cube: xr.DataArray, chirp: Chirp, chain: Chain, *, truth_m: np.ndarray | None = None
) -> Markup:
    """Draw power over range: of the first chirp, and the mean over the chirps.

    `truth_m` are the ranges where the echoes of the truth appear, marked below the line.
    """
    transform = chain.over_range(chirp)
    some = cube.isel(frame=0, rx=0, chirp=slice(_MOST_CHIRPS))
    profiles = range_profiles(some, chirp, transform).transpose("chirp", "range")
    power, range_m = abs(profiles.values) ** 2, profiles.range.values
    units = cube.attrs.get("units", "")
    first, mean = power_db(power[0], units), power_db(power.mean(axis=0), units)
    # Single noise cells reach down without end: 12 dB below their median is enough to see.
    lowest, highest = float(np.median(first)) - 12, float(max(first.max(), mean.max()))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
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
            label=f"mean power of the first {power.shape[0]} chirps",
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
        axes.set(xlim=(0, range_m[-1]), ylim=(lowest, highest + 0.12 * (highest - lowest) + 1))
        axes.set_xlabel("range, m")
        axes.set_ylabel(f"power, {power_unit(units)}")
        axes.legend(loc="upper right", ncols=3, handlelength=1.2, columnspacing=1.2)

    return draw(paint, label="Spectrum of the beat signal over range", height_in=3.2)


def engineering_exponent(largest: float) -> int:
    """Power of ten, a multiple of three, that leaves an amplitude between 1 and 1000."""
    if not (math.isfinite(largest) and largest > 0):
        return 0
    return 3 * math.floor(math.log10(largest) / 3)
