"""Self-contained HTML report on a digital twin of a recording."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.text import format_fixed, format_number
from dechirp.report.figures import range_doppler
from dechirp.report.figures import twin as figures
from dechirp.report.figures.common import MapAxis
from dechirp.report.figures.style import TALL_IN, render_svg
from dechirp.report.template import load_template

if TYPE_CHECKING:
    from dechirp.experiments.twin.twin import Twin

_MAX_ROWS = 100
_LOW_IN = 2.8


def render_twin_page(twin: "Twin", document: Mapping[str, Any], *, yaml: str) -> str:
    """Return the HTML of the page; equal twins give equal pages.

    Parameters
    ----------
    twin : Twin
        Twin whose maps are drawn.
    document : mapping
        Result of `experiments.twin.document`, and `version`.
    yaml : str
        Scenario of the twin.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    recorded, simulated = maps_in_recorded_units(twin)
    figures_by_name = _draw_recorded_and_simulated_maps(recorded, simulated, twin.recording_units)
    figures_by_name["noise"] = render_svg(
        lambda figure: figures.draw_noise_levels_over_range(
            figure.subplots(), document["floor"]["over_range"], unit=document["unit"]
        ),
        height_in=_LOW_IN,
    )
    cell = _map_cell_of_strongest_peak(twin)
    figures_by_name["cut_range"] = _draw_recorded_and_simulated_cut(
        recorded, simulated, "range", cell, twin.recording_units
    )
    if recorded.sizes["velocity"] > 1:
        figures_by_name["cut_velocity"] = _draw_recorded_and_simulated_cut(
            recorded, simulated, "velocity", cell, twin.recording_units
        )
    if document["differences"]:
        figures_by_name["apart"] = render_svg(
            lambda figure: figures.draw_peak_power_differences(
                figure.subplots(),
                document["differences"],
                tolerance_db=document["within"]["power_db"],
            ),
            height_in=_LOW_IN,
        )
    return load_template("twin.html").render(
        d=document,
        headline=format_headline(document),
        lead=_describe_frame_and_full_scale(document),
        cards=(),
        verdict=describe_judged_peaks(document),
        figures=figures_by_name,
        rows=[
            _peak_difference_table_row(difference)
            for difference in document["differences"][:_MAX_ROWS]
        ],
        n_more=max(len(document["differences"]) - _MAX_ROWS, 0),
        has_azimuth=any(
            difference["azimuth_deg"] is not None for difference in document["differences"]
        ),
        yaml=yaml,
    )


def _draw_recorded_and_simulated_maps(
    recorded: xr.DataArray, simulated: xr.DataArray, units: str
) -> dict[str, Markup]:
    """Draw both maps in the colours of the recording."""
    first = range_doppler.MarkedMap(power=recorded, units=units)
    second = range_doppler.MarkedMap(power=simulated, units=units)
    return {
        "recorded": render_svg(
            lambda figure: range_doppler.draw_map(figure.subplots(), first), height_in=TALL_IN
        ),
        "simulated": render_svg(
            lambda figure: range_doppler.draw_map(
                figure.subplots(), second, colour_reference=first
            ),
            height_in=TALL_IN,
        ),
    }


def _draw_recorded_and_simulated_cut(
    recorded: xr.DataArray,
    simulated: xr.DataArray,
    axis: MapAxis,
    cell: tuple[int, int],
    units: str,
) -> Markup:
    return render_svg(
        lambda figure: figures.draw_recorded_and_twin_cut(
            figure.subplots(), recorded, simulated, along=axis, cell=cell, units=units
        ),
        height_in=_LOW_IN,
    )


def _map_cell_of_strongest_peak(twin: "Twin") -> tuple[int, int]:
    """Return the cell (velocity, range) of the strongest peak other than leakage."""
    peaks = twin.differences.isel(peak=np.flatnonzero(~twin.differences.is_leakage.values))
    if peaks.sizes["peak"]:
        first = peaks.isel(peak=0)
        return int(first.velocity_cell), int(first.range_cell)
    row, column = np.unravel_index(int(twin.recorded.values.argmax()), twin.recorded.shape)
    return int(row), int(column)


def maps_in_recorded_units(twin: "Twin") -> tuple[xr.DataArray, xr.DataArray]:
    """Return both maps in the units of the recording."""
    watts_per_unit = twin.watts_per_unit
    return twin.recorded / watts_per_unit, twin.simulated / watts_per_unit


def format_headline(document: Mapping[str, Any]) -> str:
    """Describe the agreement in one line."""
    difference_db = document["floor"]["difference_db"]
    noise = (
        "No noise"
        if difference_db is None
        else f"Noise difference {format_fixed(abs(difference_db), 1)} dB"
    )
    judged = [peak for peak in document["differences"] if peak["judged"]]
    if not judged:
        return f"{noise}, no peak to judge"
    n_within = sum(peak["within"] for peak in judged)
    return (
        f"{noise}, {n_within} of {len(judged)} judged peaks within {_format_tolerances(document)}"
    )


def _describe_frame_and_full_scale(document: Mapping[str, Any]) -> str:
    sentence = (
        f"Frame {document['frame']} of the recording and its simulation, seed {document['seed']}."
    )
    full_scale_dbm = document["full_scale_dbm"]
    if full_scale_dbm is not None:
        sentence += f" Full scale is assumed to be {format_number(full_scale_dbm)} dBm."
    return sentence


def describe_judged_peaks(document: Mapping[str, Any]) -> str:
    """Describe the judged peaks and their differences."""
    rows = document["differences"]
    judged = [peak for peak in rows if peak["judged"]]
    if not rows:
        return "No peak exceeds the noise, so the twin contains only noise."
    text = f"{len(judged)} of {len(rows)} peaks can be judged by {_format_tolerances(document)}"
    if judged:
        worst = max(abs(peak["power_difference_db"]) for peak in judged)
        largest_offset = max(
            abs(peak[f"{axis}_difference_bins"])
            for peak in judged
            for axis in ("range", "velocity")
        )
        text += f"; the largest differences are {format_fixed(worst, 2)} dB and"
        text += f" {format_fixed(largest_offset, 2)} bins"
    weak = sum(peak["searched"] and not peak["judged"] for peak in rows)
    if weak:
        text += f". {weak} {'is' if weak == 1 else 'are'} too weak or too close to a stronger peak:"
        text += " the noise of the twin changes power or position by more than a third of the"
        text += " tolerance"
    n_clean = sum(peak["within_clean"] for peak in rows)
    text += f". Without noise in the twin, {n_clean} of {len(rows)} peaks are within the tolerance"
    mirrored = sum(not peak["searched"] for peak in rows)
    if mirrored:
        text += ". Leakage is not judged: it overlaps with the mirror image of real samples"
    return f"{text}."


def _format_tolerances(document: Mapping[str, Any]) -> str:
    tolerances = document["within"]
    return (
        f"{format_number(tolerances['power_db'])} dB and {format_number(tolerances['bins'])} bins"
    )


def _peak_difference_table_row(peak: Mapping[str, Any]) -> dict[str, str]:
    def format_field(name: str, decimals: int, *, sign: bool = True) -> str:
        return "" if peak[name] is None else format_fixed(peak[name], decimals, sign=sign)

    notes = ["leakage"] if peak["leakage"] else []
    if not peak["judged"]:
        notes.append("not judged")
    elif not peak["within"]:
        notes.append("outside the tolerance")
    return {
        "range": format_field("range_m", 3, sign=False),
        "velocity": format_field("velocity_m_per_s", 3, sign=False),
        "azimuth": format_field("azimuth_deg", 1, sign=False),
        "power": format_field("power_db", 1, sign=False),
        "snr": format_field("snr_db", 1, sign=False),
        "power_apart": format_field("power_difference_db", 2),
        "power_std": format_field("power_std_db", 2, sign=False),
        "range_apart": format_field("range_difference_bins", 3),
        "velocity_apart": format_field("velocity_difference_bins", 3),
        "std": format_field("std_bins", 3, sign=False),
        "azimuth_apart": format_field("azimuth_difference_deg", 1),
        "clean": format_field("power_difference_clean_db", 2),
        "notes": ", ".join(notes),
    }
