"""Object stage: ego motion, clusters and tracks from the detections of all frames."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, capture_warned_findings
from dechirp.experiments.scenario import Scenario, prefix_setting_of_errors
from dechirp.processing.cluster import cluster
from dechirp.radar.radar import Radar
from dechirp.tracking.batch import track
from dechirp.tracking.ego import ego_motion, label_static_and_moving
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.groups import LiveGroupTracker, track_groups
from dechirp.tracking.online import LiveTracker


class ObjectStage(NamedTuple):
    """Detections with `motion` and `cluster` where known, and the objects derived from them."""

    detections: xr.Dataset
    ego: xr.Dataset | None
    """Ego motion over frames, see `tracking.ego`; None if not requested."""
    clusters: xr.Dataset | None
    tracks: xr.Dataset | None
    findings: tuple[Finding, ...]


class GroupedDetections(NamedTuple):
    """Detections of frames, with objects that follow from single frames; as in `ObjectStage`."""

    detections: xr.Dataset
    ego: xr.Dataset | None
    clusters: xr.Dataset | None
    findings: tuple[Finding, ...]

    def rows_to_track(self, scenario: Scenario, radar: Radar) -> xr.Dataset:
        """Return the input of the tracker: clusters if there are any, else detections.

        Groups consist of detections. Static rows are left out, and velocities of unresolved
        ambiguity where chirp intervals differ.
        """
        is_clustered = self.clusters is not None and scenario.group_tracker is None
        rows = self.clusters if self.clusters is not None and is_clustered else self.detections
        return drop_static_rows_and_unresolved_velocities(rows, radar)


def estimate_ego_motion_clusters_tracks(
    detections: xr.Dataset,
    times_s: Sequence[float],
    scenario: Scenario,
    radar: Radar,
    *,
    first_frame: int = 0,
) -> ObjectStage:
    """Estimate ego motion, clusters and tracks, as far as a scenario requests them.

    Tracks follow groups of detections, clusters if there are any, or detections; with known ego
    motion, static ones are excluded.

    Parameters
    ----------
    detections : Dataset over `detection`
        Detections of all frames, as `detect` returns them.
    times_s : sequence of float
        Middle of each frame, including frames without detections.
    scenario : Scenario
        Its settings `ego_motion`, `chain.cluster`, `tracker` and `group_tracker`.
    radar : Radar
        Radar of the detections.
    first_frame : int
        Number of the first frame.
    """
    groups = estimate_ego_motion_and_clusters(detections, scenario, radar)
    tracks, findings = None, list(groups.findings)
    rows, span_m_per_s = groups.rows_to_track(scenario, radar), _velocity_span_m_per_s(radar)
    with capture_warned_findings() as warned:
        if scenario.tracker is not None:
            with prefix_setting_of_errors("tracker", instead_of="Tracker"):
                tracks = track(
                    *(rows, times_s, scenario.tracker),
                    first=first_frame,
                    velocity_span_m_per_s=span_m_per_s,
                )
        if scenario.group_tracker is not None:
            tracks = track_groups(
                *(rows, times_s, scenario.group_tracker),
                first=first_frame,
                velocity_span_m_per_s=span_m_per_s,
            )
            findings += _too_small_group_findings(rows, tracks, scenario.group_tracker)
    findings += warned
    return ObjectStage(groups.detections, groups.ego, groups.clusters, tracks, tuple(findings))


def start_live_tracker(scenario: Scenario, radar: Radar) -> LiveTracker | LiveGroupTracker | None:
    """Start the tracker of a scenario; None if it has none.

    Raises
    ------
    InvalidSetting
        If a library is missing.
    """
    span_m_per_s = _velocity_span_m_per_s(radar)
    if scenario.group_tracker is not None:
        return LiveGroupTracker(scenario.group_tracker, velocity_span_m_per_s=span_m_per_s)
    if scenario.tracker is None:
        return None
    with prefix_setting_of_errors("tracker", instead_of="Tracker"):
        return LiveTracker(scenario.tracker, velocity_span_m_per_s=span_m_per_s)


def _velocity_span_m_per_s(radar: Radar) -> float:
    return 2 * radar.frame.for_frame(0).max_velocity_m_per_s


def estimate_ego_motion_and_clusters(
    detections: xr.Dataset, scenario: Scenario, radar: Radar
) -> GroupedDetections:
    """Estimate ego motion and clusters, as far as requested.

    Arguments as of `estimate_ego_motion_clusters_tracks`.
    """
    ego, clusters, findings = None, None, []
    if scenario.ego_motion is not None:
        ego = ego_motion(detections, radar, scenario.ego_motion)
        detections = label_static_and_moving(detections, ego, radar, scenario.ego_motion)
        findings += _unknown_ego_motion_findings(ego)
    if scenario.chain.cluster is not None:
        detections, clusters = cluster(detections, radar, scenario.chain.cluster)
        if ego is not None and scenario.ego_motion is not None:
            rows = clusters.rename(cluster="detection")
            labelled_rows = label_static_and_moving(rows, ego, radar, scenario.ego_motion)
            clusters = labelled_rows.rename(detection="cluster")
    return GroupedDetections(detections, ego, clusters, tuple(findings))


def drop_static_rows_and_unresolved_velocities(rows: xr.Dataset, radar: Radar) -> xr.Dataset:
    """Select the rows that may belong to a track; drop velocities of unresolved ambiguity."""
    if "motion" in rows:
        (row_dimension,) = rows["motion"].dims
        rows = rows.isel({row_dimension: np.flatnonzero(rows["motion"].values != "static")})
    if radar.frame.n_intervals > 1:
        # Each interval has its own unambiguous span: unresolved velocities are dropped.
        rows = rows.assign(velocity=rows["velocity"].where(np.isfinite(rows["ambiguity_number"])))
    return rows


def _too_small_group_findings(
    rows: xr.Dataset, tracks: xr.Dataset, tracker: GroupTracker
) -> list[Finding]:
    """Return a warning if no frame has a confirmed group, though frames have detections."""
    n_rows, n_frames = rows["range"].size, tracks.sizes["frame"]
    if tracks.sizes["track"] or n_rows < n_frames or n_frames < tracker.confirm_after[0]:
        return []
    return [
        Finding(
            level="warning",
            setting="group_tracker.min_points",
            value=f"{tracker.min_points}, and no group of neighbouring detections is confirmed"
            f" among the {n_rows} in {n_frames} frames",
            expected="at most the detections that an object has in most frames",
            fix="lower it, to 1 where objects have single detections, or set size_std to that of"
            " the objects",
        )
    ]


def _unknown_ego_motion_findings(ego: xr.Dataset) -> list[Finding]:
    """Return a warning if the ego motion is unknown in most frames."""
    n_unknown = int(np.isnan(ego["vx"]).sum())
    if 2 * n_unknown <= ego.sizes["frame"]:
        return []
    return [
        Finding(
            level="warning",
            setting="ego_motion",
            value=f"no motion of the radar in {n_unknown} of {ego.sizes['frame']} frames",
            expected="enough detections of what stands still, in more than one direction",
            fix="lower ego_motion.min_static, or leave ego_motion out where nothing stands still",
        )
    ]
