"""Plots of arrays and results: figures of the report on axes of the user.

The methods `plot` of results and of the accessors `array.dechirp` call these functions.
"""

from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting
from dechirp.processing.angle.aperture import FieldOfView
from dechirp.report import objects_section, page
from dechirp.report.directions_section import ground_detections
from dechirp.report.figures import (
    beat,
    birds_eye,
    directions,
    frames,
    range_doppler,
    recording,
    spectrogram,
    tracks,
)
from dechirp.report.figures.style import report_style
from dechirp.report.labels import X_LABEL, Y_LABEL
from dechirp.scene.aliasing import RangeVelocity

if TYPE_CHECKING:
    from dechirp.experiments.run import Result


_ESTIMATES = ("range", "azimuth", "elevation", "range_std", "azimuth_std", "snr")
_LOCATED_COLUMNS = (*_ESTIMATES, "ambiguity_number", "time")
# Variables that the figures of a dataset draw, by the dimension of its rows.
_DRAWN_COLUMNS = {
    "detection": _LOCATED_COLUMNS,
    "cluster": _LOCATED_COLUMNS,
    "track": ("x", "y", "vx", "vy", "covariance"),
    "target": ("range", "velocity", "azimuth", "elevation"),
}
# Maps on which detections are marked.
_MARKED_MAPS = ({"velocity", "range"}, {"azimuth", "range"}, {"azimuth", "elevation"})


@contextmanager
def user_axes(axes: Axes | None) -> Iterator[Axes]:
    """Yield the axes of the user, or the current ones of pyplot, in the style of the report."""
    with report_style():
        if axes is None:
            from matplotlib import pyplot as plt  # loads a window system, unused with axes

            axes = plt.gca()
        if not isinstance(axes, Axes):
            raise InvalidSetting(
                "ax",
                value=f"a {type(axes).__name__}",
                expected="axes of matplotlib, or None for the current ones",
                fix="pass figure.subplots() or the second result of plt.subplots()",
            )
        yield axes


def plot_result(result: "Result", axes: Axes | None) -> Axes:
    """Draw the first figure of the report: the scene, else the tracks, else the first chirp."""
    with user_axes(axes) as panel:
        return page.draw_first_figure(panel, result)


def plot_power(
    power: xr.DataArray, axes: Axes | None, *, units: str, detections: xr.Dataset | None
) -> Axes:
    """Draw a map, a spectrogram or a spectrum, with detections circled on maps.

    `units` are those of the samples.
    """
    dims = set(power.dims)
    _check_power(power)
    if detections is not None:
        _check_detections(detections, dims)
    with user_axes(axes) as panel:
        if dims == {"velocity", "range"} and detections is not None:
            marked = range_doppler.MarkedMap(
                power=power.transpose("velocity", "range"),
                units=units,
                detections=RangeVelocity(detections.range.values, detections.velocity.values),
            )
            return range_doppler.draw_map(panel, marked)
        if dims in ({"velocity", "range"}, {"range"}):
            rows = power.expand_dims("velocity") if dims == {"range"} else power
            rows = rows.transpose("velocity", "range")
            return recording.draw_map_or_range_profile(panel, rows, units=units)
        if dims == {"azimuth", "range"}:
            places = None
            if detections is not None:
                places = detections.azimuth.values, detections.range.values
            return directions.draw_range_azimuth_map(
                panel, directions.RangeAzimuthMap(power=power, units=units, detections=places)
            )
        if dims == {"azimuth", "elevation"}:
            azimuth, elevation = (
                np.empty(0) if detections is None else np.nan_to_num(detections[name].values)
                for name in ("azimuth", "elevation")
            )
            estimates = directions.Directions(azimuth, elevation)
            return directions.draw_angle_spectrum(panel, power, estimates=estimates)
        if dims == {"time", "velocity"}:
            return spectrogram.draw_spectrogram(panel, power)
    raise InvalidSetting(
        "array.dechirp.plot",
        value=f"an array over {', '.join(map(str, power.dims))}",
        expected="velocity and range, range, azimuth and range, azimuth and elevation, or time and"
        " velocity",
        fix="select one value of other axes, as with isel(frame=0)",
    )


def plot_samples(
    samples: xr.DataArray, axes: Axes | None, *, detections: xr.Dataset | None
) -> Axes:
    """Draw samples over fast time: the first along frames, chirps and receivers, if they exist."""
    is_chirp = set(samples.dims) <= {"frame", "chirp", "rx", "sample"} and samples.size > 1
    is_chirp &= "sample" in samples.coords
    first = samples.isel(
        {name: [0] for name in samples.dims if name != "sample"} if is_chirp else {}
    )
    if not (is_chirp and first.dtype.kind in "fc" and np.isfinite(first.values).all()):
        raise InvalidSetting(
            "array.dechirp.plot",
            value=f"an array {samples.shape} over {', '.join(map(str, samples.dims))}",
            expected="finite samples over the times sample, and over frame, chirp and rx if there"
            " are several",
            fix="pass a result of dc.simulate or dc.open; select one value of other axes with isel",
        )
    if detections is not None:
        _check_detections(detections, set(samples.dims))
    missing = [name for name in ("frame", "chirp", "rx") if name not in first.dims]
    chirp = first.drop_vars(missing, errors="ignore").expand_dims(missing)
    with user_axes(axes) as panel:
        return beat.draw_first_chirp_signal(panel, chirp)


def plot_table(table: xr.Dataset, axes: Axes | None, *, dim: str) -> Axes:
    """Draw detections, clusters, tracks or truth, with rows along `dim`, from above.

    Detections without an azimuth are drawn as ranges over time. Without any row, as in a frame
    without detections, the axes are empty, with a title.
    """
    if dim == "frame":
        raise InvalidSetting(
            "array.dechirp.plot",
            value="ego motion",
            expected="detections, clusters, tracks or truth",
            fix="use the plot method of xarray",
        )
    _check_columns("array.dechirp.plot", table, _DRAWN_COLUMNS[dim])
    n_rows = table.sizes[dim]
    table = table.isel({dim: np.flatnonzero(_is_drawable(table, dim))})
    if n_rows and not table.sizes[dim] and dim != "track":
        raise InvalidSetting(
            "array.dechirp.plot",
            value=f"a dataset without a {dim} to draw",
            expected="at least one finite range",
            fix="pass a result of dc.detect or a similar function, with its ranges",
        )
    with user_axes(axes) as panel:
        if not table.sizes[dim]:
            panel.set_title("No confirmed tracks" if dim == "track" else f"No {dim}s")
            panel.set(xlabel=Y_LABEL, ylabel=X_LABEL, aspect="equal", xlim=(1, -1), ylim=(0, 1))
            return panel
        if dim == "track":
            lines = objects_section.longest_track_lines(table)
            background = tracks.TrackBackground(
                detections_m=np.empty((0, 2)),
                is_static=np.empty(0, bool),
                paths_m=np.empty((0, 1, 2)),
            )
            return tracks.draw_tracks(panel, lines, background)
        if dim == "target":
            points = table.stack(
                detection=[name for name in ("target", "frame") if name in table.dims]
            )
            return recording.draw_points_from_above(panel, points)
        strongest = table.isel({dim: np.argsort(-table.snr.values, kind="stable")})
        located = strongest.isel({dim: np.flatnonzero(np.isfinite(strongest.azimuth.values))})
        if not located.sizes[dim]:
            return frames.draw_estimates_over_time(panel, strongest, variable="range")
        is_known = np.isfinite(located.ambiguity_number.values)
        return birds_eye.draw_detections_from_above(
            panel,
            ground_detections(
                located,
                # Arrays with a single transmitter estimate no ambiguity numbers, and need none.
                is_unambiguous=is_known | ~is_known.any(),
                field_of_view_rad=FieldOfView().azimuth_rad,
            ),
        )


def _check_power(power: xr.DataArray) -> None:
    """Raise `InvalidSetting` for an array over the axes of a figure that has nothing to draw."""
    values, n_cells_needed = power.values, 2 if power.ndim == 1 else 1
    is_known = np.isfinite(values)
    # Maps may leave cells out, which are NaN; a line is drawn through all of its cells.
    n_wrong = np.sum(~is_known) if power.ndim == 1 or not is_known.any() else np.isinf(values).sum()
    if power.size < n_cells_needed:
        value, expected = (
            f"an array {power.shape}",
            f"at least {format_count_with_noun(n_cells_needed, 'cell')}",
        )
    elif n_wrong:
        value, expected = f"{n_wrong} powers that are not finite", "finite powers"
    elif np.min(values, where=is_known, initial=0.0) < 0:
        value, expected = f"a power of {np.nanmin(values):.3g}", "powers of 0 or more, not decibels"
    else:
        value = ""
    for name in power.dims if not value else ():
        if not np.isfinite(power[name].values).all():
            value, expected = f"values of {name} that are not finite", f"finite values of {name}"
    if value:
        raise InvalidSetting(
            "array.dechirp.plot",
            value=value,
            expected=expected,
            fix="pass a result of dc.power_map or a similar function",
        )


def _check_detections(detections: xr.Dataset, dims: set[Hashable]) -> None:
    """Raise `InvalidSetting` unless detections can be marked on a figure over these axes."""
    if dims not in _MARKED_MAPS:
        raise InvalidSetting(
            "detections",
            value=f"given for an array over {', '.join(sorted(map(str, dims)))}",
            expected="a map over range, velocity or directions, on which detections are marked",
            fix="leave detections out",
        )
    _check_columns("detections", detections, sorted(map(str, dims)))


def _check_columns(setting: str, table: xr.Dataset, columns: Sequence[str]) -> None:
    """Raise `InvalidSetting` unless a dataset has all columns that a figure draws."""
    missing = [name for name in columns if name not in table]
    if missing:
        raise InvalidSetting(
            setting,
            value=f"a dataset without {', '.join(missing)}",
            expected=f"a dataset of {', '.join(columns)}",
            fix="pass a result of dc.detect or a similar function, with all of its variables",
        )


def _is_drawable(table: xr.Dataset, dim: str) -> np.ndarray:
    """Return True for each row with a position, of tracks for the confirmed ones."""
    mask = table.status == "confirmed" if dim == "track" else np.isfinite(table.range)
    return mask.any([name for name in mask.dims if name != dim]).values
