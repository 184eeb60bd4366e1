"""What the page shows of objects: the radar's own motion, clusters, tracks with their targets."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.words import NONE, decimals_of, fixed
from dechirp.evaluate.match import visible
from dechirp.report.figures import tracks as figure
from dechirp.report.figures.style import svg
from dechirp.report.view import View

if TYPE_CHECKING:
    from dechirp.experiment.run import Result

_STATE = ("x", "vx", "y", "vy")
_MOST_LOOKS = 33  # frames in which tracks are beside the truth
MOST_DRAWN = 60
_MOST_POINTS = 5000  # steps of tracks that are drawn: more make the page large
# A track is of a target whose nearest point is within so many standard errors and cells of it.
_ERRORS, _CELLS = 3.0, 2.0


def about(result: "Result") -> list[str]:
    """Say what was found beyond detections, a sentence for each part."""
    said = []
    n = result.n_frames
    within = "" if n == 1 else f" in {n} frames"
    if result.ego is not None:
        said.append(_of_ego(result.ego, n))
    if result.clusters is not None:
        n_all, n_alone = result.detections.sizes["detection"], _n_noise(result.detections)
        noise = f", {n_alone} of them in none" if n_alone else ""
        n_clusters = result.clusters.sizes["cluster"]
        said.append(f"{n_clusters} clusters of {n_all} detections{within}{noise}.")
    if result.tracks is not None:
        n_tracks = result.tracks.sizes["track"]
        said.append(f"{n_tracks} track{'' if n_tracks == 1 else 's'} confirmed{within}.")
    return said


def _of_ego(ego: xr.Dataset, n_frames: int) -> str:
    told = np.isfinite(ego.vx.values)
    n = int(told.sum())
    if not n:
        return f"The radar's own motion is not told in any of {n_frames} frames."
    forward, left = (float(np.median(ego[name].values[told])) for name in ("vx", "vy"))
    error = float(np.median(np.hypot(ego.vx_std.values[told], ego.vy_std.values[told])))
    many = decimals_of(error)
    frames = "the frame" if n_frames == 1 else f"{n} of {n_frames} frames, the median"
    return (
        f"The radar drives at {fixed(forward, many)} m/s forward and {fixed(left, many)} m/s to"
        f" the left, by what stands still in {frames}; standard error {fixed(error, many)} m/s."
    )


def _n_noise(detections: xr.Dataset) -> int:
    return int(np.sum(detections.cluster.values < 0)) if "cluster" in detections else 0


def rows(result: "Result", n_rows: int) -> list[dict[str, str]]:
    """Write the lines of the table of tracks, at most so many, those first that began first."""
    if result.tracks is None:
        return []
    made = []
    some = result.tracks.isel(track=slice(n_rows))
    for track, names in zip(_tracks(some), targets(result, some), strict=True):
        confirmed = np.flatnonzero(track.status.values == "confirmed")
        numbers, last = track.frame.values, track.isel(frame=confirmed[-1])
        stds = np.sqrt(np.diagonal(last.covariance.transpose("state", "other_state").values))
        std_of = dict(zip(last.state.values.tolist(), stds.tolist(), strict=True))
        made.append(
            {
                "number": str(int(track.track)),
                "frames": f"{numbers[confirmed[0]]} to {numbers[confirmed[-1]]}",
                **{name: _with_std(float(last[name]), std_of[name]) for name in _STATE},
                "target": ", then ".join(names) or NONE,
            }
        )
    return made


def summary(result: "Result") -> str:
    """Say of how many targets there are tracks, of how many none; nothing without a truth."""
    if result.tracks is None or result.truth is None:
        return ""
    at_last = [names[-1] if names else None for names in targets(result, result.tracks)]
    held = set(at_last) - {None}
    n_none = at_last.count(None)
    n_more = len(at_last) - n_none - len(held)
    said = f"Tracks are of {len(held)} of {_followed(result)}"
    said += f"; {n_more} more of the same" if n_more else ", one of each" if held else ""
    return f"{said}; {n_none} of none." if n_none else f"{said}."


def _followed(result: "Result") -> str:
    """How many targets may have a track: where own motion is known, those that move."""
    scene, truth = result.scenario.scene, result.truth
    assert scene is not None and truth is not None
    if result.ego is None:
        return f"{len(scene.targets)} targets"
    times_s = truth.time.values
    moves = [target.velocities_at_m_per_s(times_s).any() for target in scene.targets]
    return f"{sum(moves)} targets that move over ground"


def targets(result: "Result", tracks: xr.Dataset) -> list[list[str]]:
    """Names of the targets that each track is of, in the order of time; none without a truth.

    In each of some frames the target whose scatterer is nearest, if it is near enough.
    """
    names: list[list[str]] = [[] for _ in range(tracks.sizes["track"])]
    scene, truth = result.scenario.scene, result.truth
    if scene is None or truth is None or not scene.targets:
        return names
    places_m = np.stack([tracks[name].transpose("track", "frame").values for name in "xy"], axis=-1)
    confirmed = tracks.status.transpose("track", "frame").values == "confirmed"
    near_m = _near_m(tracks, result.radar.frame.chirp.range_resolution_m)
    for at in range(0, tracks.sizes["frame"], -(-tracks.sizes["frame"] // _MOST_LOOKS)):
        time_s = float(truth.time.values[at])
        shown = visible(scene, time_s, result.radar)
        points_m, owners = scene.positions_m([time_s])[0, shown, :2], scene.owners[shown]
        for track in np.flatnonzero(confirmed[:, at] & shown.any()).tolist():
            apart_m = np.hypot(*(points_m - places_m[track, at]).T)
            name = scene.names[owners[apart_m.argmin()]]
            if apart_m.min() <= near_m[track, at] and names[track][-1:] != [name]:
                names[track].append(name)
    return names


def _near_m(tracks: xr.Dataset, cell_m: float) -> np.ndarray:
    """How near a target of each track is, (track, frame); NaN where the track is not."""
    covariance = _of_place(tracks).transpose("track", "frame", "state", "other_state").values
    there = np.isfinite(covariance).all(axis=(-2, -1))
    largest = np.linalg.eigvalsh(np.where(there[..., None, None], covariance, 0.0))[..., -1]
    return np.where(there, _ERRORS * np.sqrt(np.maximum(largest, 0.0)) + _CELLS * cell_m, np.nan)


def _of_place(tracks: xr.Dataset) -> xr.DataArray:
    """Covariance of x and y alone."""
    return tracks.covariance.sel(state=["x", "y"], other_state=["x", "y"])


def from_above(view: View) -> Markup | None:
    """Draw the tracks over all frames, of many the longest; None without any."""
    tracks = view.result.tracks
    if tracks is None or not tracks.sizes["track"]:
        return None
    n_confirmed = np.sum(tracks.status.transpose("track", "frame").values == "confirmed", axis=1)
    longest = np.argsort(-n_confirmed, kind="stable")[:MOST_DRAWN]
    tracks = tracks.isel(track=np.sort(longest))
    step = max(tracks.sizes["track"] * tracks.sizes["frame"] // _MOST_POINTS, 1)
    lines, around = [_line(track, step) for track in _tracks(tracks)], _ground(view)
    return svg(
        lambda page: figure.from_above(page.subplots(), lines, around),
        height_in=figure.height_in(lines),
    )


def _line(track: xr.Dataset, step: int) -> figure.Line:
    confirmed = track.status.values == "confirmed"
    last = track.isel(frame=np.flatnonzero(confirmed)[-1])
    there = np.flatnonzero(track.status.values != "")
    chosen = np.union1d(there[::step], [np.flatnonzero(confirmed)[-1], there[-1]])
    return figure.Line(
        number=int(track.track),
        way_m=np.stack([track.x.values, track.y.values], axis=-1)[chosen],
        is_confirmed=confirmed[chosen],
        velocity_m_per_s=np.array([float(last.vx), float(last.vy)]),
        covariance_m2=_of_place(last).transpose("state", "other_state").values,
    )


def _ground(view: View) -> figure.Ground:
    found, scene, truth = view.strongest, view.result.scenario.scene, view.result.truth
    found = found.isel(detection=np.flatnonzero(np.isfinite(found.azimuth.values)))
    level_m = found.range.values * np.cos(np.nan_to_num(found.elevation.values))
    azimuth = found.azimuth.values
    static = found.motion.values == "static" if "motion" in found else np.zeros(len(azimuth), bool)
    paths_m = np.empty((0, 1, 2))
    if scene is not None and truth is not None:
        paths_m = scene.target_positions_m(truth.time.values)[..., :2].swapaxes(0, 1)
    return figure.Ground(
        found_m=np.stack([level_m * np.cos(azimuth), level_m * np.sin(azimuth)], axis=-1),
        is_static=static,
        paths_m=paths_m,
    )


def _tracks(tracks: xr.Dataset) -> Iterator[xr.Dataset]:
    return (tracks.isel(track=at) for at in range(tracks.sizes["track"]))


def _with_std(amount: float, std: float) -> str:
    """With one digit of the error, for many columns side by side."""
    many = min(max(decimals_of(std) - 1, 1), 2)
    return f"{fixed(amount, many)} ±\N{NO-BREAK SPACE}{fixed(std, many)}"
