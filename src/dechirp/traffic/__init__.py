"""Traffic of other simulators and of recorded roads, and a radar on one of its vehicles."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    source=__name__,
    names_by_module={
        "dechirp.traffic.frame_scenes": "FrameScenes",
        "dechirp.traffic.osi_export": "sensor_views",
        "dechirp.traffic.source": "TrafficSource",
        "dechirp.traffic.true_objects": "find_true_objects",
        "dechirp.experiments.scenario": "traffic_scenario",
    },
)
