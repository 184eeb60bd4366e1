"""Object stage: ego motion, clusters and tracks from the detections of all frames."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, capture_warned_findings
from dechirp.experiments.scenario import Scenario
from dechirp.processing.cluster import cluster
from dechirp.radar.radar import Radar
from dechirp.tracking.batch import track
from dechirp.tracking.ego import ego_motion, label_static_and_moving


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

    @property
    def clusters_or_detections(self) -> xr.Dataset:
        """Input of the tracker: clusters if there are any, else detections."""
        return self.detections if self.clusters is None else self.clusters


def estimate_ego_motion_clusters_tracks(
    detections: xr.Dataset,
    times_s: Sequence[float],
    scenario: Scenario,
    radar: Radar,
    *,
    first_frame: int = 0,
) -> ObjectStage:
    """Estimate ego motion, clusters and tracks, as far as a scenario requests them.

    Tracks follow clusters if there are any, else detections; with known ego motion, static ones
    are excluded.

    Parameters
    ----------
    detections : Dataset over `detection`
        Detections of all frames, as `detect` returns them.
    times_s : sequence of float
        Middle of each frame, including frames without detections.
    scenario : Scenario
        Its settings `ego_motion`, `chain.cluster` and `tracker`.
    radar : Radar
        Radar of the detections.
    first_frame : int
        Number of the first frame.
    """
    groups = estimate_ego_motion_and_clusters(detections, scenario, radar)
    tracks, findings = None, list(groups.findings)
    if scenario.tracker is not None:
        with capture_warned_findings() as warned:
            tracks = track(
                drop_static_rows_and_unresolved_velocities(groups.clusters_or_detections, radar),
                times_s,
                scenario.tracker,
                first=first_frame,
                velocity_span_m_per_s=2 * radar.frame.for_frame(0).max_velocity_m_per_s,
            )
        findings += warned
    return ObjectStage(groups.detections, groups.ego, groups.clusters, tracks, tuple(findings))


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
