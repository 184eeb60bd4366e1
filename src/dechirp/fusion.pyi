# Written by tests/test_api.py.

from dechirp.experiments.mounted_radar import MountedRadar as MountedRadar
from dechirp.experiments.run_radars import RadarsResult as RadarsResult
from dechirp.experiments.run_radars import run_radars as run_radars
from dechirp.experiments.vehicle_tracks import convert_tracks_to_vehicle_axes as convert_tracks_to_vehicle_axes
from dechirp.tracking.fusion import RadarDetections as RadarDetections
from dechirp.tracking.fusion import fuse_detections as fuse_detections
from dechirp.tracking.poses import RadarPose as RadarPose
