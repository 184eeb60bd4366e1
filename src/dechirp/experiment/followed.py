"""What follows from the detections of all frames: own motion, clusters, tracks."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, heard
from dechirp.experiment.scenario import Scenario
from dechirp.process.cluster import cluster
from dechirp.radar.radar import Radar
from dechirp.tracking.ego import ego_motion, labelled
from dechirp.tracking.tracks import track


class Followed(NamedTuple):
    """Detections with `motion` and `cluster` where those are known, and what became of them."""

    detections: xr.Dataset
    ego: xr.Dataset | None
    """The radar's own motion over frames, see `tracking.ego`; None where it is not asked for."""
    clusters: xr.Dataset | None
    tracks: xr.Dataset | None
    findings: tuple[Finding, ...]


class Grouped(NamedTuple):
    """Detections of frames, and what follows from each frame alone; as in `Followed`."""

    detections: xr.Dataset
    ego: xr.Dataset | None
    clusters: xr.Dataset | None
    findings: tuple[Finding, ...]

    @property
    def rows(self) -> xr.Dataset:
        """What tracks are of: clusters where there are any, else detections."""
        return self.detections if self.clusters is None else self.clusters


def follow(
    detections: xr.Dataset,
    times_s: Sequence[float],
    scenario: Scenario,
    radar: Radar,
    *,
    first: int = 0,
) -> Followed:
    """Own motion, clusters and tracks, those of them that a scenario asks for.

    Tracks are of clusters where there are any, else of detections; where the radar's own motion
    is known, of those that do not stand still.

    Parameters
    ----------
    detections : Dataset over `detection`
        Of all frames, as `detect` gives them.
    times_s : sequence of float
        Of the middle of each frame, those without detections too.
    scenario : Scenario
        What to do: `ego_motion`, `chain.cluster`, `tracker`.
    radar : Radar
        Whose they are.
    first : int
        Number of the first frame.
    """
    found = grouped(detections, scenario, radar)
    tracks, findings = None, list(found.findings)
    if scenario.tracker is not None:
        with heard() as said:
            tracks = track(
                tracked_rows(found.rows, radar),
                times_s,
                scenario.tracker,
                first=first,
                velocity_span_m_per_s=2 * radar.frame.at(0).max_velocity_m_per_s,
            )
        findings += said
    return Followed(found.detections, found.ego, found.clusters, tracks, tuple(findings))


def grouped(detections: xr.Dataset, scenario: Scenario, radar: Radar) -> Grouped:
    """Own motion and clusters, those of them that a scenario asks for; arguments as `follow`."""
    ego, clusters, findings = None, None, []
    if scenario.ego_motion is not None:
        ego = ego_motion(detections, radar, scenario.ego_motion)
        detections = labelled(detections, ego, radar, scenario.ego_motion)
        findings += _untold(ego)
    if scenario.chain.cluster is not None:
        detections, clusters = cluster(detections, radar, scenario.chain.cluster)
        if ego is not None and scenario.ego_motion is not None:
            rows = clusters.rename(cluster="detection")
            told = labelled(rows, ego, radar, scenario.ego_motion)
            clusters = told.rename(detection="cluster")
    return Grouped(detections, ego, clusters, tuple(findings))


def tracked_rows(rows: xr.Dataset, radar: Radar) -> xr.Dataset:
    """Rows that a track may be of, their velocities only where it is known what they mean."""
    if "motion" in rows:
        (over,) = rows["motion"].dims
        rows = rows.isel({over: np.flatnonzero(rows["motion"].values != "static")})
    if radar.frame.n_intervals > 1:
        # Each interval folds by a span of its own: a rate that is not unfolded is left out.
        rows = rows.assign(velocity=rows["velocity"].where(np.isfinite(rows["fold"])))
    return rows


def _untold(ego: xr.Dataset) -> list[Finding]:
    """What is said where the radar's own motion is not told in most frames."""
    n_untold = int(np.isnan(ego["vx"]).sum())
    if 2 * n_untold <= ego.sizes["frame"]:
        return []
    return [
        Finding(
            level="warning",
            setting="ego_motion",
            got=f"no motion of the radar in {n_untold} of {ego.sizes['frame']} frames",
            need="enough detections of what stands still, in more than one direction",
            fix="Lower ego_motion.min_static, or leave ego_motion out where nothing stands still.",
        )
    ]
