"""Section of the page on ego motion, clusters and tracks."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.text import (
    EN_DASH,
    decimals_for_column,
    decimals_for_std,
    format_fixed,
    format_with_std,
)
from dechirp.evaluation.association import visible_scatterer_mask
from dechirp.report.figures import tracks as figure
from dechirp.report.figures.style import render_svg
from dechirp.report.page_context import PageContext

if TYPE_CHECKING:
    from dechirp.experiments.run import Result

_STATE = ("x", "vx", "y", "vy")
_MAX_SAMPLED_FRAMES = 33  # frames in which tracks are matched with targets
MAX_TRACKS = 60
_MAX_POINTS = 5000  # drawn points of all tracks, for the size of the page
# Largest distance between a track and its target, in standard errors plus range cells.
_MATCH_STDS, _MATCH_CELLS = 3.0, 2.0


def describe_ego_clusters_and_tracks(result: "Result") -> list[str]:
    """Return a sentence on each of ego motion, clusters and tracks, if present."""
    sentences = []
    n = result.n_frames
    frame_text = "" if n == 1 else f" in {n} frames"
    if result.ego is not None:
        sentences.append(_describe_ego_motion(result.ego, n))
    if result.clusters is not None:
        n_all, n_alone = (
            result.detections.sizes["detection"],
            _count_unclustered_detections(result.detections),
        )
        noise = f", {n_alone} of them unclustered" if n_alone else ""
        n_clusters = result.clusters.sizes["cluster"]
        sentences.append(f"{n_clusters} clusters of {n_all} detections{frame_text}{noise}.")
    if result.tracks is not None:
        n_tracks = result.tracks.sizes["track"]
        sentences.append(f"{n_tracks} track{'' if n_tracks == 1 else 's'} confirmed{frame_text}.")
        if "length" in result.tracks and n_tracks:
            n_at_once = int((result.tracks.status == "confirmed").sum("track").max())
            sentences.append(f"At most {n_at_once} groups of detections at once.")
    return sentences


def _describe_ego_motion(ego: xr.Dataset, n_frames: int) -> str:
    is_finite = np.isfinite(ego.vx.values)
    n = int(is_finite.sum())
    if not n:
        return f"The ego motion could not be estimated in any of {n_frames} frames."
    directions = {"vx": "forward", "vy": "to the left", "vz": "upwards"}
    names = [name for name in directions if name in ego]
    stds = np.array([ego[f"{name}_std"].values[is_finite] for name in names])
    error = float(np.median(np.linalg.norm(stds, axis=0)))
    decimals = decimals_for_std(error)
    *others, last = [
        f"{format_fixed(float(np.median(ego[name].values[is_finite])), decimals)} m/s"
        f" {directions[name]}"
        for name in names
    ]
    frames = "the frame" if n_frames == 1 else f"{n} of {n_frames} frames (median)"
    return (
        f"Ego motion: {', '.join(others)} and {last}, estimated from static detections in"
        f" {frames}; standard error {format_fixed(error, decimals)} m/s."
    )


def _count_unclustered_detections(detections: xr.Dataset) -> int:
    return int(np.sum(detections.cluster.values < 0)) if "cluster" in detections else 0


def track_table_rows(result: "Result", max_rows: int) -> list[dict[str, str]]:
    """Return the rows of the track table in order of their start, at most `max_rows`."""
    if result.tracks is None:
        return []
    shown_tracks = result.tracks.isel(track=slice(max_rows))
    numbers = shown_tracks.frame.values
    confirmed = [
        np.flatnonzero(track.status.values == "confirmed") for track in _iter_tracks(shown_tracks)
    ]
    last_states = [
        track.isel(frame=indices[-1])
        for track, indices in zip(_iter_tracks(shown_tracks), confirmed, strict=True)
    ]
    stds = np.array(
        [
            np.sqrt(np.diagonal(last.covariance.transpose("state", "other_state").values))
            for last in last_states
        ]
    ).reshape(-1, shown_tracks.sizes["state"])
    std_of = dict(zip(shown_tracks.state.values.tolist(), stds.T, strict=True))
    # One digit of the standard error, for narrow columns.
    decimals = {
        name: decimals_for_column(np.concatenate([std_of[other] for other in pair]), digits=1)
        for pair in (("x", "y"), ("vx", "vy"))
        for name in pair
    }
    return [
        {
            "number": str(int(last.track)),
            "frames": f"{numbers[indices[0]]} to {numbers[indices[-1]]}",
            **{
                name: format_with_std(float(last[name]), std_of[name][row], decimals[name])
                for name in _STATE
            },
            **({"size": _format_group_size(last)} if "length" in last else {}),
            "target": ", then ".join(names) or EN_DASH,
        }
        for row, (last, indices, names) in enumerate(
            zip(last_states, confirmed, target_names_per_track(result, shown_tracks), strict=True)
        )
    ]


def _format_group_size(group: xr.Dataset) -> str:
    """Format the axes of the ellipse of a group of detections."""
    return f"{format_fixed(float(group.length), 1)} x {format_fixed(float(group.width), 1)}"


def describe_number_of_targets_with_tracks(result: "Result") -> str:
    """Describe how many targets have tracks; empty without the truth."""
    if result.tracks is None or result.truth is None:
        return ""
    final_targets = [
        names[-1] if names else None for names in target_names_per_track(result, result.tracks)
    ]
    covered_targets = set(final_targets) - {None}
    n_none = final_targets.count(None)
    n_more = len(final_targets) - n_none - len(covered_targets)
    sentence = (
        f"Tracks cover {len(covered_targets)} of {_describe_number_of_trackable_targets(result)}"
    )
    sentence += (
        f"; {n_more} more for the same targets"
        if n_more
        else ", one each"
        if covered_targets
        else ""
    )
    return f"{sentence}; {n_none} without a target." if n_none else f"{sentence}."


def _describe_number_of_trackable_targets(result: "Result") -> str:
    """Describe how many targets can have a track: with ego motion, the moving ones."""
    scene, truth = result.scenario.scene, result.truth
    assert scene is not None and truth is not None
    if result.ego is None:
        return f"{len(scene.targets)} targets"
    times_s = truth.time.values
    moves = [target.velocities_at_m_per_s(times_s).any() for target in scene.targets]
    return f"{sum(moves)} targets that move over ground"


def target_names_per_track(result: "Result", tracks: xr.Dataset) -> list[list[str]]:
    """Return the names of the targets of each track in order of time; empty without the truth.

    In a selection of frames, a track belongs to the target with the nearest scatterer, if it is
    near enough.
    """
    names: list[list[str]] = [[] for _ in range(tracks.sizes["track"])]
    scene, truth = result.scenario.scene, result.truth
    if scene is None or truth is None or not scene.targets:
        return names
    positions_m = np.stack(
        [tracks[name].transpose("track", "frame").values for name in "xy"], axis=-1
    )
    confirmed = tracks.status.transpose("track", "frame").values == "confirmed"
    max_distance_m = _max_match_distances_m(tracks, result.radar.frame.chirp.range_resolution_m)
    for frame in range(0, tracks.sizes["frame"], -(-tracks.sizes["frame"] // _MAX_SAMPLED_FRAMES)):
        time_s = float(truth.time.values[frame])
        is_visible = visible_scatterer_mask(scene, time_s, result.radar)
        points_m, owners = (
            scene.scatterer_positions_m([time_s])[0, is_visible, :2],
            scene.target_index_of_scatterer[is_visible],
        )
        for track in np.flatnonzero(confirmed[:, frame] & is_visible.any()).tolist():
            distance_m = np.hypot(*(points_m - positions_m[track, frame]).T)
            name = scene.names[owners[distance_m.argmin()]]
            if distance_m.min() <= max_distance_m[track, frame] and names[track][-1:] != [name]:
                names[track].append(name)
    return names


def _max_match_distances_m(tracks: xr.Dataset, cell_m: float) -> np.ndarray:
    """Return the largest distance between a track and its target, (track, frame), or NaN."""
    covariance = (
        _position_covariance(tracks).transpose("track", "frame", "state", "other_state").values
    )
    is_present = np.isfinite(covariance).all(axis=(-2, -1))
    largest = np.linalg.eigvalsh(np.where(is_present[..., None, None], covariance, 0.0))[..., -1]
    return np.where(
        is_present, _MATCH_STDS * np.sqrt(np.maximum(largest, 0.0)) + _MATCH_CELLS * cell_m, np.nan
    )


def _position_covariance(tracks: xr.Dataset) -> xr.DataArray:
    """Return the covariance of x and y."""
    return tracks.covariance.sel(state=["x", "y"], other_state=["x", "y"])


def draw_longest_tracks(context: PageContext) -> Markup | None:
    """Draw the longest tracks over all frames; None without tracks."""
    tracks = context.result.tracks
    if tracks is None or not tracks.sizes["track"]:
        return None
    lines, background = longest_track_lines(tracks), detections_and_true_paths(context)
    return render_svg(
        lambda page: figure.draw_tracks(page.subplots(), lines, background),
        height_in=figure.figure_height_in(lines),
    )


def longest_track_lines(tracks: xr.Dataset) -> list[figure.TrackLine]:
    """Return the lines of the longest tracks."""
    n_confirmed = np.sum(tracks.status.transpose("track", "frame").values == "confirmed", axis=1)
    longest = np.argsort(-n_confirmed, kind="stable")[:MAX_TRACKS]
    tracks = tracks.isel(track=np.sort(longest))
    step = max(tracks.sizes["track"] * tracks.sizes["frame"] // _MAX_POINTS, 1)
    return [_track_line(track, step) for track in _iter_tracks(tracks)]


def _track_line(track: xr.Dataset, frame_step: int) -> figure.TrackLine:
    confirmed = track.status.values == "confirmed"
    last = track.isel(frame=np.flatnonzero(confirmed)[-1])
    present_frames = np.flatnonzero(track.status.values != "")
    shown_frames = np.union1d(
        present_frames[::frame_step], [np.flatnonzero(confirmed)[-1], present_frames[-1]]
    )
    return figure.TrackLine(
        number=int(track.track),
        positions_m=np.stack([track.x.values, track.y.values], axis=-1)[shown_frames],
        is_confirmed=confirmed[shown_frames],
        velocity_m_per_s=np.array([float(last.vx), float(last.vy)]),
        covariance_m2=_position_covariance(last).transpose("state", "other_state").values,
    )


def detections_and_true_paths(context: PageContext) -> figure.TrackBackground:
    """Return the detections and the true paths behind the tracks."""
    detections, scene, truth = (
        context.strongest,
        context.result.scenario.scene,
        context.result.truth,
    )
    detections = detections.isel(detection=np.flatnonzero(np.isfinite(detections.azimuth.values)))
    level_m = detections.range.values * np.cos(np.nan_to_num(detections.elevation.values))
    azimuth = detections.azimuth.values
    is_static = (
        detections.motion.values == "static"
        if "motion" in detections
        else np.zeros(len(azimuth), bool)
    )
    paths_m = np.empty((0, 1, 2))
    if scene is not None and truth is not None:
        paths_m = scene.target_positions_m(truth.time.values)[..., :2].swapaxes(0, 1)
    elif (objects := context.result.traffic) is not None:
        paths_m = np.stack([objects[name].values for name in "xy"], axis=-1)
    return figure.TrackBackground(
        detections_m=np.stack([level_m * np.cos(azimuth), level_m * np.sin(azimuth)], axis=-1),
        is_static=is_static,
        paths_m=paths_m,
    )


def _iter_tracks(tracks: xr.Dataset) -> Iterator[xr.Dataset]:
    return (tracks.isel(track=index) for index in range(tracks.sizes["track"]))
