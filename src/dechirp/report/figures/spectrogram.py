"""Velocity over time: what swings and turns while its target goes along."""

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from dechirp.report.figures.range_doppler import noise_power, reduced
from dechirp.report.figures.style import COLORS, draw
from dechirp.report.words import power_db, power_unit

_MOST_PIXELS = (220, 420)  # velocity, time: as many as a figure of 500 pixels can show
_LARGEST_SPAN_DB = 60.0


def over_time(power: xr.DataArray, *, fastest_m_per_s: float | None = None) -> Markup:
    """Draw a spectrogram (time, velocity), as `process.spectrogram` gives it.

    Large ones are drawn from the largest cell of each block, so that no line is lost. Where
    time has gaps the figure has them too.

    Parameters
    ----------
    power : DataArray (time, velocity)
        Its `units` tell whether levels are in dBm or relative to full scale.
    fastest_m_per_s : float, optional
        Velocities up to this one of either sign are shown; all without it.
    """
    power = power.transpose("velocity", "time")
    if fastest_m_per_s is not None:
        power = power.isel(velocity=abs(power.velocity.values) <= fastest_m_per_s)
    units = "sqrt(W)" if power.attrs.get("units") == "W" else "full scale"
    highest_db = float(power_db(power.values.max(), units))
    noise_db = float(power_db(np.asarray(noise_power(power.values)), units))
    lowest_db = max(noise_db - 6, highest_db - _LARGEST_SPAN_DB)
    time_s, velocity = power.time.values, power.velocity.values
    step_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 1.0
    half = (velocity[-1] - velocity[0]) / max(velocity.size - 1, 1) / 2 or 0.5
    cuts = np.flatnonzero(np.diff(time_s) > 1.5 * step_s) + 1

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.grid(False)
        for columns in np.split(np.arange(time_s.size), cuts):
            most = (_MOST_PIXELS[0], max(_MOST_PIXELS[1] * columns.size // time_s.size, 1))
            image = axes.imshow(
                power_db(reduced(power.values[:, columns], most), units),
                cmap=COLORS,
                vmin=lowest_db,
                vmax=max(highest_db, lowest_db + 20),
                extent=(
                    time_s[columns[0]] - step_s / 2,
                    time_s[columns[-1]] + step_s / 2,
                    velocity[0] - half,
                    velocity[-1] + half,
                ),
                origin="lower",
                aspect="auto",
                interpolation="none",
            )
        axes.set(
            xlim=(time_s[0] - step_s / 2, time_s[-1] + step_s / 2),
            ylim=(velocity[0] - half, velocity[-1] + half),
        )
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
        bar.outline.set_visible(False)
        bar.set_label(f"power, {power_unit(units)}")
        axes.set_xlabel("time, s")
        axes.set_ylabel("velocity, m/s (receding positive)")

    return draw(paint, label="Spectrogram: power over velocity and time", height_in=3.2)
