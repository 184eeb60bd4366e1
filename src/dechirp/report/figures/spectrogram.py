"""Velocity over time: what swings and turns while its target goes along."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.words import power_db, power_unit
from dechirp.report.figures.parts import MAP_AXES, colour_bar, edges
from dechirp.report.figures.range_doppler import noise_power, reduced
from dechirp.report.figures.style import COLORS

_MOST_PIXELS = (220, 420)  # velocity, time: as many as a figure of 500 pixels can show
_LARGEST_SPAN_DB = 60.0


def over_time(axes: Axes, power: xr.DataArray, *, fastest_m_per_s: float | None = None) -> Axes:
    """Draw a spectrogram, as `process.spectrogram` gives it.

    Large ones are drawn from the largest cell of each block, so that no line is lost. Where
    time has gaps the figure has them too.

    Parameters
    ----------
    axes : Axes
        To draw on; a colour bar takes of their room.
    power : DataArray (time, velocity)
        Its `units` tell whether levels are in dBm or relative to full scale.
    fastest_m_per_s : float, optional
        Velocities up to this one of either sign are shown; all without it.

    Returns
    -------
    Axes
        Those given.
    """
    power = power.transpose("velocity", "time")
    if fastest_m_per_s is not None:
        power = power.isel(velocity=abs(power.velocity.values) <= fastest_m_per_s)
    units = "sqrt(W)" if power.attrs.get("units") == "W" else "full scale"
    highest_db = float(power_db(power.values.max(), units))
    noise_db = float(power_db(np.asarray(noise_power(power.values)), units))
    lowest_db = max(noise_db - 6, highest_db - _LARGEST_SPAN_DB)
    time_s = power.time.values
    step_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 1.0
    bottom, top = edges(power.velocity.values)
    cuts = np.flatnonzero(np.diff(time_s) > 1.5 * step_s) + 1
    axes.grid(False)
    for columns in np.split(np.arange(time_s.size), cuts):
        most = (_MOST_PIXELS[0], max(_MOST_PIXELS[1] * columns.size // time_s.size, 1))
        start_s, end_s = time_s[columns[0]] - step_s / 2, time_s[columns[-1]] + step_s / 2
        image = axes.imshow(
            power_db(reduced(power.values[:, columns], most), units),
            cmap=COLORS,
            vmin=lowest_db,
            vmax=max(highest_db, lowest_db + 20),
            extent=(start_s, end_s, bottom, top),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
    axes.set(xlim=(time_s[0] - step_s / 2, time_s[-1] + step_s / 2), ylim=(bottom, top))
    colour_bar(axes, image, f"power, {power_unit(units)}")
    axes.set_xlabel("time, s")
    axes.set_ylabel(MAP_AXES["velocity"])
    axes.set_label("Spectrogram: power over velocity and time")
    return axes
