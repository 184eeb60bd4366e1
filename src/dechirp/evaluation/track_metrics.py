"""Metrics of tracks against the truth, and random trials of a tracker: `dc.track_metrics`."""

from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.identity import track_identities
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.ospa import ospa_m
from dechirp.evaluation.track_trial import (
    TrackTrial,
    assess_track_completeness,
    draw_truth_and_detections,
)

__all__ = [
    "TrackTrial",
    "assess_track_completeness",
    "draw_truth_and_detections",
    "gospa",
    "mean_nees_interval",
    "nees",
    "ospa_m",
    "track_identities",
]
