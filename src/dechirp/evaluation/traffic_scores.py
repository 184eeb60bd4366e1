"""Scores of a radar in traffic: detected objects, errors, GOSPA and identity switches."""

import numpy as np
import xarray as xr

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.gospa import gospa_of_distances
from dechirp.evaluation.identity import NO_TRACK, identities_from_distances
from dechirp.evaluation.nees import mean_nees_interval, nees

MIN_VISIBLE_SHARE = 0.5
"""An object of which nearer ones hide more counts as shadowed."""
MAX_AZIMUTH_RAD = np.pi / 3
"""Objects farther from boresight are beyond the beam of a front radar."""
CUTOFF_M = 5.0
"""Largest distance of a track from the outline of its object: the length of a car."""


@frozen_dataclass
class TrackScores:
    """Scores of tracks over all objects that are demanded, and all frames."""

    gospa_m: float
    """Mean over frames of confirmed tracks against the outlines of objects."""
    n_identity_switches: int
    """Changes of objects to another track."""
    n_false_tracks: float
    """Mean number of confirmed tracks without an object or a structure, in a frame."""
    n_structure_tracks: float
    """Mean number of confirmed tracks on structures, such as walls and rails, in a frame."""


@frozen_dataclass
class TrackConsistency:
    """Mean NEES per axis of tracks, over objects with a confirmed track; 1 if errors are right."""

    n_objects: int
    position_nees: float
    velocity_nees: float
    expected_interval: tuple[float, float]
    """Interval of either in 95 % of the runs with right stated errors."""


@frozen_dataclass
class TrafficScores:
    """Scores over all objects in view that are not shadowed, and all frames."""

    n_objects: int
    n_object_frames: int
    """Pairs of an object and a frame."""
    detected_share: float
    """Share of them with a detection; NaN without any."""
    lowest_detected_share: float
    """Detected share of the object for which it is lowest."""
    position_rmse_m: float
    """Distance of the detection of a body, see `body_echoes`, from its outline."""
    velocity_rmse_m_per_s: float
    """Velocity of the body against that of the outline there."""
    velocity_known_share: float
    """Share of the detected pairs whose detections determine a velocity; NaN without any."""
    gospa_m: float | None
    """Mean over frames of confirmed tracks against the outlines of objects; None without tracks."""
    n_identity_switches: int | None
    """Changes of objects to another track."""
    n_false_tracks: float | None
    """Mean number of confirmed tracks without an object or a structure, in a frame."""
    n_structure_tracks: float | None
    """Mean number of confirmed tracks on structures, such as walls and rails, in a frame."""


def demanded_object_mask(objects: xr.Dataset) -> np.ndarray:
    """Return True for objects in view and not shadowed, (target, frame)."""
    objects = objects.transpose("target", "frame")
    is_in_view = np.abs(objects["azimuth"].values) <= MAX_AZIMUTH_RAD
    return np.asarray(is_in_view & (objects["visible_share"].values >= MIN_VISIBLE_SHARE))


def score_traffic(objects: xr.Dataset, tracks: xr.Dataset | None) -> TrafficScores:
    """Score detections and tracks against the objects of a run.

    Objects that are shadowed or beyond the beam count neither as detected nor as missed, nor the
    tracks near them as false. Tracks on structures (`on_structure`) that no object has are counted
    on their own.
    """
    objects = objects.transpose("target", "frame")
    is_demanded = demanded_object_mask(objects)
    is_detected = is_demanded & (objects["n_detections"].values > 0)
    n_frames_of_object = is_demanded.sum(axis=1)
    shares = (
        is_detected.sum(axis=1)[n_frames_of_object > 0] / n_frames_of_object[n_frames_of_object > 0]
    )
    n_demanded = int(is_demanded.sum())
    track_scores = None if tracks is None else score_tracks(objects, is_demanded, tracks)
    return TrafficScores(
        n_objects=shares.size,
        n_object_frames=n_demanded,
        detected_share=is_detected.sum() / n_demanded if n_demanded else np.nan,
        lowest_detected_share=float(shares.min()) if shares.size else np.nan,
        position_rmse_m=_rms(objects["position_error"].values[is_demanded]),
        velocity_rmse_m_per_s=_rms(objects["velocity_error"].values[is_demanded]),
        velocity_known_share=(
            float(np.isfinite(objects["velocity_error"].values[is_detected]).mean())
            if is_detected.any()
            else np.nan
        ),
        gospa_m=None if track_scores is None else track_scores.gospa_m,
        n_identity_switches=None if track_scores is None else track_scores.n_identity_switches,
        n_false_tracks=None if track_scores is None else track_scores.n_false_tracks,
        n_structure_tracks=None if track_scores is None else track_scores.n_structure_tracks,
    )


def score_tracks(objects: xr.Dataset, is_demanded: np.ndarray, tracks: xr.Dataset) -> TrackScores:
    """Score tracks against the outlines of objects, (target, frame), of which some are demanded."""
    tracks = tracks.transpose("track", "frame", ...)
    identities, distances_m = object_identities(tracks, objects), _OutlineDistances(tracks, objects)
    is_confirmed = tracks["status"].values == "confirmed"
    n_tracks, n_frames = is_confirmed.shape
    holder = identities["holder"].values
    errors_m = []
    n_structure_tracks = 0
    for frame in range(n_frames):
        # Tracks of objects that are not demanded are neither right nor wrong.
        others = holder[~is_demanded[:, frame], frame]
        is_scored = is_confirmed[:, frame] & ~np.isin(np.arange(n_tracks), others)
        is_object = np.isin(np.arange(n_tracks), holder[:, frame])
        if "on_structure" in tracks:
            is_structure = is_scored & tracks["on_structure"].values[:, frame] & ~is_object
            n_structure_tracks += int(is_structure.sum())
            is_scored &= ~is_structure
        errors_m.append(
            gospa_of_distances(
                distances_m(
                    frame, np.flatnonzero(is_scored), np.flatnonzero(is_demanded[:, frame])
                ),
                cutoff_m=CUTOFF_M,
            ).error_m
        )
    n_per_frame = n_structure_tracks / n_frames
    return TrackScores(
        gospa_m=float(np.mean(errors_m)),
        n_identity_switches=int(identities["n_swaps"].sum()),
        n_false_tracks=float(identities["n_false"].mean()) - n_per_frame,
        n_structure_tracks=n_per_frame,
    )


def score_track_consistency(
    objects: xr.Dataset, is_demanded: np.ndarray, tracks: xr.Dataset
) -> TrackConsistency | None:
    """Compare errors of tracks with their stated errors; None without an object with a track.

    Positions refer to the centres of the objects. Frames of an object are averaged first: the
    offset of its echo from its centre lasts for seconds, so each object is one independent draw.
    """
    objects = objects.transpose("target", "frame")
    tracks = tracks.transpose("track", "frame", "state", "other_state")
    holder = np.where(is_demanded, object_identities(tracks, objects)["holder"].values, NO_TRACK)
    target, frame = np.nonzero(holder != NO_TRACK)
    if not target.size:
        return None
    row, values = holder[target, frame], []
    for states, true_names in ((["x", "y"], ["centre_x", "centre_y"]), (["vx", "vy"],) * 2):
        errors = [
            tracks[state].values[row, frame] - objects[name].values[target, frame]
            for state, name in zip(states, true_names, strict=True)
        ]
        covariance = tracks["covariance"].sel(state=states, other_state=states).values
        per_axis = nees(np.stack(errors, axis=-1), covariance[row, frame]) / len(states)
        n_frames = np.bincount(target)
        is_tracked = n_frames > 0
        sums = np.bincount(target, per_axis)
        values.append(float(np.mean(sums[is_tracked] / n_frames[is_tracked])))
    low, high = mean_nees_interval(2, int(is_tracked.sum()), outside_probability=0.05)
    return TrackConsistency(
        n_objects=int(is_tracked.sum()),
        position_nees=values[0],
        velocity_nees=values[1],
        expected_interval=(low / 2, high / 2),
    )


def object_identities(tracks: xr.Dataset, objects: xr.Dataset) -> xr.Dataset:
    """Assign confirmed tracks to objects by their distances from the outlines.

    Returns what `track_identities` does.
    """
    objects = objects.transpose("target", "frame")
    return identities_from_distances(
        tracks,
        np.isfinite(objects["x"].values),
        _OutlineDistances(tracks.transpose("track", "frame", ...), objects),
        cutoff_m=CUTOFF_M,
    )


class _OutlineDistances:
    """Distances of tracks from the outlines of objects, 0 inside, for the pairs of a frame.

    A track follows the centre of a body. The offset of the echo from the centre is known to metres,
    so a track within the outline has no error that a radar could avoid.
    """

    def __init__(self, tracks: xr.Dataset, objects: xr.Dataset) -> None:
        self._tracks_m = np.stack([tracks[name].values for name in "xy"], axis=-1)
        self._centres_m = np.stack([objects[f"centre_{name}"].values for name in "xy"], axis=-1)
        self._headings_rad = objects["heading"].values
        sizes_m = [objects[name].values for name in ("length", "width")]
        self._half_sizes_m = np.stack(sizes_m, axis=-1) / 2

    def __call__(self, frame: int, rows: np.ndarray, targets: np.ndarray) -> np.ndarray:
        from_centres_m = self._tracks_m[rows, None, frame] - self._centres_m[None, targets, frame]
        heading_rad = self._headings_rad[targets, frame]
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        x_m, y_m = np.moveaxis(from_centres_m, -1, 0)
        along_and_across_m = np.stack([cos * x_m + sin * y_m, cos * y_m - sin * x_m], axis=-1)
        outside_m = np.maximum(np.abs(along_and_across_m) - self._half_sizes_m[targets], 0)
        return np.asarray(np.linalg.norm(outside_m, axis=-1))


def _rms(errors: np.ndarray) -> float:
    known_errors = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known_errors**2))) if known_errors.size else np.nan
