"""Page of a run of several radars: fields of view from above, fused tracks, and their scores."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import EN_DASH, format_fixed, join_names
from dechirp.evaluation.traffic_scores import (
    MAX_AZIMUTH_RAD,
    TrackConsistency,
    score_track_consistency,
    score_tracks,
    score_traffic,
)
from dechirp.report.figures.style import (
    GREEN,
    INK,
    LINE_COLORS,
    MUTED,
    PALE,
    FigureWithCaption,
    render_svg,
)
from dechirp.report.labels import X_LABEL, Y_LABEL
from dechirp.report.template import load_template
from dechirp.report.traffic_section import describe_track_scores
from dechirp.traffic.outlines import rectangle_corners_m, rotation

if TYPE_CHECKING:
    from dechirp.experiments.run_radars import RadarsResult

_COLUMNS = (
    ("Radar", "name", ""),
    ("x (m)", "x", "num"),
    ("y (m)", "y", "num"),
    ("Yaw (°)", "yaw", "num"),
    ("Frames", "frames", "num"),
    ("Detections", "detections", "num"),
    ("Detected", "detected", "num"),
    ("Position error (m)", "position", "num"),
)
_TRAIL_FRAMES_S = 1.0
_HEIGHT_IN = 3.8
_DRAWN_WIDTH_IN, _LABELS_IN = 4.6, 0.8  # of views from above, without and for labels and legend
_HEIGHTS_IN = (2.4, 6.0)
_MARGIN_M = 3.0
_FIRST_CAPTION = (
    "From above, in the axes of the vehicle: the sector of each radar (within 60° of boresight, up"
    " to its largest range), outlines of the objects, pale where more than half is hidden from all"
    " radars, and confirmed tracks with their path over the ground in the last second."
)
_MAX_TRACKS = 40


def render_radars_report(result: "RadarsResult", *, yaml: str) -> str:
    """Return the HTML of the report on several radars; equal results give equal pages.

    Parameters
    ----------
    result : RadarsResult
        Result of `run_radars`.
    yaml : str
        Scenario of the run, for reproduction.

    Returns
    -------
    str
        Self-contained HTML page, with links to the pages of the radars beside it.
    """
    n_tracks = None if result.tracks is None else result.tracks.sizes["track"]
    headline = format_count_with_noun(len(result.radars), "radar")
    if n_tracks is not None:
        headline += f", {format_count_with_noun(n_tracks, 'fused track')}"
    return load_template("radars.html").render(
        name=result.scenario.name,
        seed=result.scenario.seed,
        headline=headline,
        lead=f"Fields of view, tracks and scores of {join_names(list(result.radars))} together.",
        cards=(),
        scores=describe_fused_tracks(result),
        from_above=None if result.tracks is None else _figures_from_above(result),
        paths=None if result.tracks is None else _draw_paths(result),
        columns=_COLUMNS,
        rows=_radar_rows(result),
        pages=[(name, f"{quote(name)}/report.html") for name in result.radars],
        findings=combine_findings(result),
        yaml=yaml,
    )


def combine_findings(result: "RadarsResult") -> list[Finding]:
    """Return the findings of all radars, each once; those of one radar alone with its name."""
    names_by_finding: dict[Finding, list[str]] = {}
    for name, radar in result.radars.items():
        for finding in radar.findings:
            names_by_finding.setdefault(finding, []).append(name)
    return [
        *result.findings,
        *(
            replace(finding, setting=f"{names[0]}: {finding.setting}")
            if len(names) == 1
            else finding
            for finding, names in names_by_finding.items()
            if finding not in result.findings
        ),
    ]


def describe_fused_tracks(result: "RadarsResult") -> list[str]:
    """Return sentences on the fused tracks, with their scores in traffic."""
    if result.tracks is None:
        return ["No tracks: the scenario has no tracker."]
    sentences = [
        f"{format_count_with_noun(result.tracks.sizes['track'], 'fused track')} in"
        f" {format_count_with_noun(result.tracks.sizes['frame'], 'frame')} of all radars."
    ]
    if result.objects is not None and result.objects.sizes["target"]:
        scored = result.objects, result.objects["in_view"].values, result.tracks
        sentences.append(
            "Against the objects in view of a radar and at most half hidden:"
            f" {describe_track_scores(score_tracks(*scored))}"
        )
        consistency = score_track_consistency(*scored)
        if consistency is not None:
            sentences.append(_describe_consistency(consistency))
    return sentences


def _describe_consistency(consistency: TrackConsistency) -> str:
    low, high = consistency.expected_interval
    return (
        "NEES, the squared error of a track over the variance that it states, per axis:"
        f" {format_fixed(consistency.position_nees, 2)} for the position of the centre and"
        f" {format_fixed(consistency.velocity_nees, 2)} for the velocity, over"
        f" {format_count_with_noun(consistency.n_objects, 'object')}. If the stated errors are"
        f" right, 95 % of such runs have {format_fixed(low, 2)} to {format_fixed(high, 2)}; less:"
        " errors are overstated, more: understated."
    )


def _radar_rows(result: "RadarsResult") -> list[dict[str, str]]:
    rows = []
    for name, radar in result.radars.items():
        mounting = result.mountings[name]
        detected = position = EN_DASH
        if radar.traffic is not None and radar.traffic.sizes["target"]:
            scores = score_traffic(radar.traffic, None)
            if scores.n_object_frames:
                detected = f"{scores.detected_share:.1%}"
                position = format_fixed(scores.position_rmse_m, 2)
        rows.append(
            {
                "name": name,
                "x": format_fixed(mounting.position_m[0], 2),
                "y": format_fixed(mounting.position_m[1], 2),
                "yaw": format_fixed(float(np.degrees(mounting.yaw_rad)), 0),
                "frames": str(radar.n_frames),
                "detections": str(radar.detections.sizes["detection"]),
                "detected": detected,
                "position": position,
            }
        )
    return rows


class _Vehicle(NamedTuple):
    """Centre and heading of the vehicle over the ground at one time."""

    position_m: np.ndarray
    heading_rad: float

    def to_vehicle_m(self, positions_m: np.ndarray) -> np.ndarray:
        """Return positions over the ground, (..., 2), in the axes of the vehicle."""
        return np.asarray((positions_m - self.position_m) @ rotation(self.heading_rad))


def _vehicle_in_frame(result: "RadarsResult", column: int) -> _Vehicle:
    """Return the vehicle at the time of a fused frame, from the pose of its radar."""
    assert result.tracks is not None
    name = str(result.tracks["radar"].values[column])
    mounting, own = result.mountings[name], result.radars[name]
    pose = result.poses[name][int(result.tracks["radar_frame"].values[column]) - own.first_frame]
    heading_rad = pose.yaw_rad - mounting.yaw_rad
    arm_m = rotation(heading_rad) @ np.array(mounting.position_m[:2])
    return _Vehicle(np.array(pose.position_m) - arm_m, heading_rad)


def _figures_from_above(result: "RadarsResult") -> list[FigureWithCaption]:
    """Return a view from above for the first, the middle and the last frame."""
    assert result.tracks is not None
    n_frames = result.tracks.sizes["frame"]
    columns = sorted({0, n_frames // 2, n_frames - 1})
    limits_m = _view_limits_m(result)
    (low_x_m, high_x_m), (low_y_m, high_y_m) = limits_m
    height_in = _DRAWN_WIDTH_IN * (high_x_m - low_x_m) / (high_y_m - low_y_m) + _LABELS_IN
    captions = [_FIRST_CAPTION, *["As before."] * (len(columns) - 1)]
    return [
        FigureWithCaption(
            title=f"Fields of view at {float(result.tracks['time'].values[column]):.2f} s.",
            caption=caption,
            figure=render_svg(
                partial(_draw_view, result=result, column=column, limits_m=limits_m),
                height_in=float(np.clip(height_in, *_HEIGHTS_IN)),
            ),
        )
        for column, caption in zip(columns, captions, strict=True)
    ]


def _draw_view(
    figure: Figure, *, result: "RadarsResult", column: int, limits_m: np.ndarray
) -> Axes:
    assert result.tracks is not None
    axes = figure.subplots()
    vehicle = _vehicle_in_frame(result, column)
    axes.set_aspect("equal")
    axes.set(xlim=limits_m[1, ::-1], ylim=limits_m[0], xlabel=Y_LABEL, ylabel=X_LABEL)
    axes.grid(False)
    for index, name in enumerate(result.radars):
        _draw_sector(axes, result, name, LINE_COLORS[index % len(LINE_COLORS)])
    if result.objects is not None:
        _draw_objects(axes, result.objects.isel(frame=column), vehicle)
    _draw_tracks(axes, result.tracks, column, vehicle)
    axes.set_label("Fields of view of all radars from above, objects and fused tracks")
    handles, labels = axes.get_legend_handles_labels()
    handle_by_label = dict(zip(labels, handles, strict=True))  # one for all tracks
    figure.legend(
        handle_by_label.values(), handle_by_label.keys(), loc="outside upper center", ncols=4
    )
    return axes


def _view_limits_m(result: "RadarsResult") -> np.ndarray:
    """Return the limits along x and y, (2, 2), of the sectors, and of objects in view and tracks.

    In the axes of the vehicle, over all frames.
    """
    assert result.tracks is not None
    points_m = [_sector_m(result, name) for name in result.radars]
    tables = [(result.tracks, result.tracks["status"].values == "confirmed")]
    if result.objects is not None:
        tables.append((result.objects, result.objects["in_view"].values))
    for column in range(result.tracks.sizes["frame"]):
        vehicle = _vehicle_in_frame(result, column)
        for table, is_shown in tables:
            positions_m = np.stack([table[name].values[:, column] for name in "xy"], axis=-1)
            points_m.append(vehicle.to_vehicle_m(positions_m[is_shown[:, column]]))
    joined_m = np.concatenate(points_m)
    return np.stack([joined_m.min(axis=0) - _MARGIN_M, joined_m.max(axis=0) + _MARGIN_M], axis=1)


def _sector_m(result: "RadarsResult", name: str) -> np.ndarray:
    """Return the outline of the field of view of a radar, (n, 2), in the axes of the vehicle."""
    mounting, radar = result.mountings[name], result.radars[name]
    half_rad = min(radar.scenario.chain.field_of_view.azimuth_rad, MAX_AZIMUTH_RAD)
    angles_rad = mounting.yaw_rad + np.linspace(-half_rad, half_rad, 61)
    arc_m = np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=-1)
    arc_m *= radar.radar.frame.chirp.max_range_m
    return np.concatenate([np.zeros((1, 2)), arc_m]) + mounting.position_m[:2]


def _draw_sector(axes: Axes, result: "RadarsResult", name: str, color: str) -> None:
    x_m, y_m = _sector_m(result, name).T
    axes.fill(y_m, x_m, facecolor=color, alpha=0.08, edgecolor=color, linewidth=0.8)
    axes.plot(y_m[0], x_m[0], "^", color=color, markersize=4, linestyle="", label=name)


def _draw_objects(axes: Axes, objects: xr.Dataset, vehicle: _Vehicle) -> None:
    for index in np.flatnonzero(np.isfinite(objects["centre_x"].values)).tolist():
        item = objects.isel(target=index)
        corners_m = vehicle.to_vehicle_m(
            rectangle_corners_m(
                np.array([float(item["centre_x"]), float(item["centre_y"])]),
                float(item["heading"]),
                float(item["length"]),
                float(item["width"]),
            )
        )
        axes.fill(
            corners_m[:, 1],
            corners_m[:, 0],
            facecolor="none",
            edgecolor=GREEN if bool(item["in_view"]) else PALE,
            linewidth=1,
            label="object in view" if bool(item["in_view"]) else None,
        )


def _draw_tracks(axes: Axes, tracks: xr.Dataset, column: int, vehicle: _Vehicle) -> None:
    """Draw the tracks of a frame, and their path over the ground in the last second."""
    times_s = tracks["time"].values
    first = int(np.searchsorted(times_s, times_s[column] - _TRAIL_FRAMES_S))
    is_confirmed = tracks["status"].values == "confirmed"
    for row in np.flatnonzero(is_confirmed[:, column]).tolist():
        frames = first + np.flatnonzero(is_confirmed[row, first : column + 1])
        positions_m = np.stack([tracks[name].values[row, frames] for name in "xy"], axis=-1)
        own_m = vehicle.to_vehicle_m(positions_m)
        axes.plot(own_m[:, 1], own_m[:, 0], color=INK, linewidth=1)
        axes.plot(own_m[-1, 1], own_m[-1, 0], "o", color=INK, markersize=3.5, label="fused track")


def _draw_paths(result: "RadarsResult") -> Markup:
    return render_svg(lambda figure: _draw_ground(figure.subplots(), result), height_in=_HEIGHT_IN)


def _draw_ground(axes: Axes, result: "RadarsResult") -> Axes:
    """Draw the paths of the vehicle, the objects and the tracks over the ground."""
    tracks, objects = result.tracks, result.objects
    assert tracks is not None
    axes.set_aspect("equal", adjustable="datalim")
    vehicle_m = np.array(
        [_vehicle_in_frame(result, column).position_m for column in range(tracks.sizes["frame"])]
    )
    origin_m = vehicle_m[0]
    axes.plot(*(vehicle_m - origin_m).T, color=MUTED, linewidth=2, label="vehicle")
    if objects is not None:
        for index in range(objects.sizes["target"]):
            item = objects.isel(target=index)
            x_m = np.where(item["in_view"].values, item["x"].values, np.nan) - origin_m[0]
            label = "object in view" if index == 0 else None
            axes.plot(x_m, item["y"].values - origin_m[1], color=GREEN, linewidth=3, label=label)
    is_confirmed = tracks["status"].values == "confirmed"
    longest = np.argsort(-is_confirmed.sum(axis=1), kind="stable")[:_MAX_TRACKS]
    for number, row in enumerate(longest.tolist()):
        x_m, y_m = (
            np.where(is_confirmed[row], tracks[name].values[row], np.nan) - origin_m[axis]
            for axis, name in enumerate("xy")
        )
        axes.plot(x_m, y_m, color=INK, linewidth=1, label=None if number else "fused track")
    axes.set(xlabel=X_LABEL, ylabel=Y_LABEL)
    axes.set_label(
        "Paths of the vehicle, of objects and of fused tracks over the ground, from the place where"
        " the vehicle starts"
    )
    axes.legend(loc="best")
    return axes
