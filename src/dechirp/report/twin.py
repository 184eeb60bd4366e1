"""The page about a twin: both maps, where they differ, and what was assumed."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.words import fixed, number
from dechirp.report.figures import range_doppler
from dechirp.report.figures import twin as figures
from dechirp.report.figures.parts import Axis
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.template import template

if TYPE_CHECKING:
    from dechirp.experiment.twin.twin import Twin

_MOST_ROWS = 100
_LOW_IN = 2.8


def render(made: "Twin", found: Mapping[str, Any], *, yaml: str) -> str:
    """Return the HTML of the page; one twin always gives one page.

    Parameters
    ----------
    made : Twin
        Its maps are drawn.
    found : mapping
        What `experiment.twin.document` gives, and `version`.
    yaml : str
        The scenario of the twin.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    recorded, simulated = in_recorded_units(made)
    drawn = _maps(recorded, simulated, made.recording_units)
    drawn["noise"] = svg(
        lambda figure: figures.noise(
            figure.subplots(), found["floor"]["over_range"], unit=found["unit"]
        ),
        height_in=_LOW_IN,
    )
    cell = _strongest(made)
    drawn["cut_range"] = _cut(recorded, simulated, "range", cell, made.recording_units)
    if recorded.sizes["velocity"] > 1:
        drawn["cut_velocity"] = _cut(recorded, simulated, "velocity", cell, made.recording_units)
    if found["differences"]:
        drawn["apart"] = svg(
            lambda figure: figures.apart(
                figure.subplots(), found["differences"], within_db=found["within"]["power_db"]
            ),
            height_in=_LOW_IN,
        )
    return template("twin.html").render(
        d=found,
        headline=headline(found),
        lead=_lead(found),
        cards=(),
        verdict=verdict(found),
        figures=drawn,
        rows=[_row(one) for one in found["differences"][:_MOST_ROWS]],
        n_more=max(len(found["differences"]) - _MOST_ROWS, 0),
        has_azimuth=any(one["azimuth_deg"] is not None for one in found["differences"]),
        yaml=yaml,
    )


def _maps(recorded: xr.DataArray, simulated: xr.DataArray, units: str) -> dict[str, Markup]:
    """Both in the colours of the recording."""
    first = range_doppler.MarkedMap(power=recorded, units=units)
    second = range_doppler.MarkedMap(power=simulated, units=units)
    return {
        "recorded": svg(
            lambda figure: range_doppler.whole(figure.subplots(), first), height_in=TALL_IN
        ),
        "simulated": svg(
            lambda figure: range_doppler.whole(figure.subplots(), second, in_colours_of=first),
            height_in=TALL_IN,
        ),
    }


def _cut(
    recorded: xr.DataArray, simulated: xr.DataArray, along: Axis, cell: tuple[int, int], units: str
) -> Markup:
    return svg(
        lambda figure: figures.cut(
            figure.subplots(), recorded, simulated, along=along, cell=cell, units=units
        ),
        height_in=_LOW_IN,
    )


def _strongest(made: "Twin") -> tuple[int, int]:
    """Cell (velocity, range) of the strongest peak that is no leakage; without any of the map."""
    peaks = made.differences.isel(peak=np.flatnonzero(~made.differences.leaks.values))
    if peaks.sizes["peak"]:
        first = peaks.isel(peak=0)
        return int(first.velocity_cell), int(first.range_cell)
    row, column = np.unravel_index(int(made.recorded.values.argmax()), made.recorded.shape)
    return int(row), int(column)


def in_recorded_units(made: "Twin") -> tuple[xr.DataArray, xr.DataArray]:
    """Both maps in the units of the recording."""
    over = made.watts_per_unit
    return made.recorded / over, made.simulated / over


def headline(found: Mapping[str, Any]) -> str:
    """Whether it is a twin, in a line."""
    apart = found["floor"]["difference_db"]
    noise = "No noise" if apart is None else f"Noise {fixed(abs(apart), 1)} dB apart"
    judged = [one for one in found["differences"] if one["judged"]]
    if not judged:
        return f"{noise}, no peak to judge"
    n_within = sum(one["within"] for one in judged)
    return f"{noise}, {n_within} of {len(judged)} judged peaks within {_bar(found)}"


def _lead(found: Mapping[str, Any]) -> str:
    said = f"Frame {found['frame']} of the recording beside its simulation, seed {found['seed']}."
    full_scale_dbm = found["full_scale_dbm"]
    if full_scale_dbm is not None:
        said += f" Full scale is taken as {number(full_scale_dbm)} dBm."
    return said


def verdict(found: Mapping[str, Any]) -> str:
    """What was judged, and what could not be, in sentences."""
    rows = found["differences"]
    judged = [one for one in rows if one["judged"]]
    if not rows:
        return "No peak stands out of the noise: the twin is noise alone."
    said = f"{len(judged)} of {len(rows)} peaks can be judged by {_bar(found)}"
    if judged:
        worst = max(abs(one["power_difference_db"]) for one in judged)
        away = max(
            abs(one[f"{axis}_difference_bins"]) for one in judged for axis in ("range", "velocity")
        )
        said += f"; they differ by {fixed(worst, 2)} dB and {fixed(away, 2)} bins at most"
    weak = sum(one["searched"] and not one["judged"] for one in rows)
    if weak:
        said += f". {weak} {'is' if weak == 1 else 'are'} so weak, or so near a stronger one, that"
        said += " the noise of the twin alone moves power or place by more than a third of that"
    n_clean = sum(one["within_clean"] for one in rows)
    said += f". Without the noise of the twin {n_clean} of all {len(rows)} are within that"
    mirrored = sum(not one["searched"] for one in rows)
    if mirrored:
        said += ". Leakage lies where real samples are their own mirror image, and is not judged"
    return f"{said}."


def _bar(found: Mapping[str, Any]) -> str:
    within = found["within"]
    return f"{number(within['power_db'])} dB and {number(within['bins'])} bins"


def _row(one: Mapping[str, Any]) -> dict[str, str]:
    def told(name: str, decimals: int, *, sign: bool = True) -> str:
        return "" if one[name] is None else fixed(one[name], decimals, sign=sign)

    notes = ["leakage"] if one["leakage"] else []
    if not one["judged"]:
        notes.append("not judged")
    elif not one["within"]:
        notes.append("beyond the bar")
    return {
        "range": told("range_m", 3, sign=False),
        "velocity": told("velocity_m_per_s", 3, sign=False),
        "azimuth": told("azimuth_deg", 1, sign=False),
        "power": told("power_db", 1, sign=False),
        "snr": told("snr_db", 1, sign=False),
        "power_apart": told("power_difference_db", 2),
        "power_std": told("power_std_db", 2, sign=False),
        "range_apart": told("range_difference_bins", 3),
        "velocity_apart": told("velocity_difference_bins", 3),
        "std": told("std_bins", 3, sign=False),
        "azimuth_apart": told("azimuth_difference_deg", 1),
        "clean": told("power_difference_clean_db", 2),
        "notes": ", ".join(notes),
    }
