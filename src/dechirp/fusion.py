"""Several radars: common tracks from the detections of all: `dc.fusion`."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    names_by_module={
        "dechirp.tracking.poses": "RadarPose",
        "dechirp.tracking.fusion": "RadarDetections fuse_detections",
    },
)
