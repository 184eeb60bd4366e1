"""Section of the page of a run on traffic: objects in view, scores, and the view from above."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.core.display import format_count_with_noun
from dechirp.core.text import EN_DASH, format_fixed
from dechirp.evaluation.traffic_scores import (
    CUTOFF_M,
    MIN_VISIBLE_SHARE,
    TrackScores,
    TrafficScores,
    demanded_object_mask,
    object_identities,
    score_traffic,
)
from dechirp.report.figures.style import GREEN, INK, ORANGE, PALE, render_svg
from dechirp.report.labels import X_LABEL, Y_LABEL
from dechirp.traffic.outlines import rectangle_corners_m

if TYPE_CHECKING:
    from dechirp.experiments.run import Result

TRAFFIC_COLUMNS = (
    ("Object", "name", ""),
    ("Frames", "frames", "num"),
    ("Nearest (m)", "range", "num"),
    ("Detected", "detected", "num"),
    ("Position error (m)", "position", "num"),
    ("Velocity error (m/s)", "velocity", "num"),
    ("Track changes", "switches", "num"),
)
_HEIGHT_IN = 3.6


def describe_traffic_scores(result: "Result") -> list[str]:
    """Return sentences on detected objects, errors and tracks; empty without traffic."""
    if result.traffic is None:
        return []
    scores = score_traffic(result.traffic, result.tracks)
    if not scores.n_object_frames:
        return ["No object is in view of the radar and less than half hidden."]
    sentences = [
        f"{format_count_with_noun(scores.n_objects, 'object')} in view, at least"
        f" {MIN_VISIBLE_SHARE:.0%} of each not hidden by others: detected in"
        f" {scores.detected_share:.1%} of {scores.n_object_frames} sightings, the least often"
        f" detected one in {scores.lowest_detected_share:.1%}.",
        f"Echo of each body: RMS distance from the outline"
        f" {format_fixed(scores.position_rmse_m, 2)} m, RMS error of the velocity"
        f" {format_fixed(scores.velocity_rmse_m_per_s, 2)} m/s, known in"
        f" {scores.velocity_known_share:.1%}.",
    ]
    if scores.gospa_m is not None:
        sentences.append(f"Tracks: {describe_track_scores(scores)}")
    return sentences


def describe_track_scores(scores: TrackScores | TrafficScores) -> str:
    """Return the end of a sentence on the tracks of one or of several radars."""
    text = (
        f"mean GOSPA {format_fixed(scores.gospa_m or 0.0, 2)} m (cut-off {CUTOFF_M:g} m, order 2),"
        f" {format_count_with_noun(scores.n_identity_switches or 0, 'identity switch')},"
        f" {format_fixed(scores.n_false_tracks or 0.0, 2)} false tracks in a frame"
    )
    if scores.n_structure_tracks:
        text += f" and {format_fixed(scores.n_structure_tracks, 2)} on structures"
    return f"{text}."


def traffic_table_rows(result: "Result") -> list[dict[str, str]]:
    """Return a row for each object in view that is not hidden, by its distance."""
    objects = result.traffic
    if objects is None:
        return []
    objects = objects.transpose("target", "frame")
    is_demanded = demanded_object_mask(objects)
    n_switches = _track_changes(objects, result.tracks)
    nearest_m = np.where(is_demanded, objects["range"].values, np.inf).min(axis=1, initial=np.inf)
    rows = []
    for index in np.argsort(nearest_m, kind="stable").tolist():
        frames = np.flatnonzero(is_demanded[index])
        if not frames.size:
            continue
        item = objects.isel(target=index, frame=frames)
        rows.append(
            {
                "name": str(item["target"].item()),
                "frames": str(frames.size),
                "range": format_fixed(float(nearest_m[index]), 1),
                "detected": f"{np.mean(item['n_detections'].values > 0):.1%}",
                "position": _format_rms(item["position_error"].values),
                "velocity": _format_rms(item["velocity_error"].values),
                "switches": EN_DASH if n_switches is None else str(n_switches[index]),
            }
        )
    return rows


def draw_traffic_from_above(result: "Result") -> Markup | None:
    """Draw outlines and detections in the first, a middle and the last frame; None otherwise."""
    if result.traffic is None or not result.traffic.sizes["target"]:
        return None
    frames = sorted({0, result.n_frames // 2, result.n_frames - 1})
    return render_svg(lambda figure: _draw_frames(figure, result, frames), height_in=_HEIGHT_IN)


def _draw_frames(figure: Figure, result: "Result", frames: list[int]) -> Axes:
    objects = result.traffic
    assert objects is not None
    all_axes = figure.subplots(1, len(frames), sharex=True, sharey=True, squeeze=False)[0]
    front_m = float(np.nanmax(objects["centre_x"].values)) + 5
    side_m = float(np.nanmax(np.abs(objects["centre_y"].values))) + 5
    for axes, frame in zip(all_axes, frames, strict=True):
        axes.set_aspect("equal")
        axes.set(xlim=(side_m, -side_m), ylim=(-5, front_m))
        _draw_outlines(axes, objects.isel(frame=frame))
        detections = result.detections.isel(
            detection=np.flatnonzero(result.detections["frame"].values == frame)
        )
        range_m, azimuth_rad = detections["range"].values, detections["azimuth"].values
        axes.plot(
            range_m * np.sin(azimuth_rad),
            range_m * np.cos(azimuth_rad),
            ".",
            color=ORANGE,
            markersize=3,
        )
        axes.plot(0, 0, "^", color=INK, markersize=5)
        axes.set_title(f"{float(objects['time'].values[frame]):.2f} s", fontsize=9)
        axes.set_xlabel(Y_LABEL)
    all_axes[0].set_ylabel(X_LABEL)
    all_axes[0].set_label("Outlines of objects and detections from above, in three frames")
    return all_axes[0]


def _draw_outlines(axes: Axes, objects: xr.Dataset) -> None:
    for index in np.flatnonzero(np.isfinite(objects["range"].values)).tolist():
        item = objects.isel(target=index)
        corners_m = rectangle_corners_m(
            np.array([float(item["centre_x"]), float(item["centre_y"])]),
            float(item["heading"]),
            float(item["length"]),
            float(item["width"]),
        )
        is_hidden = float(item["visible_share"]) < MIN_VISIBLE_SHARE
        axes.fill(
            corners_m[:, 1],
            corners_m[:, 0],
            facecolor="none",
            edgecolor=PALE if is_hidden else GREEN,
            linewidth=1,
        )


def _track_changes(objects: xr.Dataset, tracks: xr.Dataset | None) -> np.ndarray | None:
    if tracks is None:
        return None
    return np.asarray(object_identities(tracks, objects)["n_swaps"].values)


def _format_rms(errors: np.ndarray) -> str:
    known_errors = errors[np.isfinite(errors)]
    return (
        format_fixed(float(np.sqrt(np.mean(known_errors**2))), 2) if known_errors.size else EN_DASH
    )
