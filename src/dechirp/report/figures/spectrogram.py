"""Spectrogram: power over velocity and time."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.report.figures.common import AXIS_LABELS, add_colour_bar, outer_cell_edges
from dechirp.report.figures.range_doppler import block_maxima, noise_power_from_median
from dechirp.report.figures.style import COLORS
from dechirp.report.labels import TIME_LABEL, power_label

_MAX_PIXELS = (220, 420)  # velocity, time: the resolution of a figure of 500 pixels
_LARGEST_SPAN_DB = 60.0


def draw_spectrogram(
    axes: Axes, power: xr.DataArray, *, fastest_m_per_s: float | None = None
) -> Axes:
    """Draw a spectrogram, the result of `processing.spectrogram`.

    Large spectrograms are reduced to block maxima, so that no line is lost. Gaps in time remain
    gaps in the figure.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar uses part of their space.
    power : DataArray (time, velocity)
        Spectrogram, whose `units` select dBm or dB relative to full scale.
    fastest_m_per_s : float, optional
        Largest velocity to show, of either sign; default: all.

    Returns
    -------
    Axes
        The given axes.
    """
    power = power.transpose("velocity", "time")
    if fastest_m_per_s is not None:
        power = power.isel(velocity=abs(power.velocity.values) <= fastest_m_per_s)
    units = "W**0.5" if power.attrs.get("units") == "W" else "1"
    highest_db = float(power_to_dbm_or_dbfs(power.values.max(), units))
    noise_db = float(power_to_dbm_or_dbfs(np.asarray(noise_power_from_median(power.values)), units))
    lowest_db = max(noise_db - 6, highest_db - _LARGEST_SPAN_DB)
    time_s = power.time.values
    step_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 1.0
    bottom, top = outer_cell_edges(power.velocity.values)
    cuts = np.flatnonzero(np.diff(time_s) > 1.5 * step_s) + 1
    axes.grid(False)
    for columns in np.split(np.arange(time_s.size), cuts):
        max_shape = (_MAX_PIXELS[0], max(_MAX_PIXELS[1] * columns.size // time_s.size, 1))
        start_s, end_s = time_s[columns[0]] - step_s / 2, time_s[columns[-1]] + step_s / 2
        image = axes.imshow(
            power_to_dbm_or_dbfs(block_maxima(power.values[:, columns], max_shape), units),
            cmap=COLORS,
            vmin=lowest_db,
            vmax=max(highest_db, lowest_db + 20),
            extent=(start_s, end_s, bottom, top),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
    axes.set(xlim=(time_s[0] - step_s / 2, time_s[-1] + step_s / 2), ylim=(bottom, top))
    add_colour_bar(axes, image, power_label(power_level_unit(units)))
    axes.set_xlabel(TIME_LABEL)
    axes.set_ylabel(AXIS_LABELS["velocity"])
    axes.set_label("Spectrogram: power over velocity and time")
    return axes
