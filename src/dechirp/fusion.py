"""Several radars on one vehicle, and common tracks from the detections of all: `dc.fusion`."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    names_by_module={
        "dechirp.experiments.mounted_radar": "MountedRadar",
        "dechirp.experiments.run_radars": "RadarsResult run_radars",
        "dechirp.experiments.vehicle_tracks": "convert_tracks_to_vehicle_axes",
        "dechirp.tracking.fusion": "RadarDetections fuse_detections",
        "dechirp.tracking.poses": "RadarPose",
    },
)
