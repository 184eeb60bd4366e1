# Written by tests/test_api.py.

from dechirp.tracking.fusion import RadarDetections as RadarDetections
from dechirp.tracking.fusion import fuse_detections as fuse_detections
from dechirp.tracking.poses import RadarPose as RadarPose
