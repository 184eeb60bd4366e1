"""Settings of a study, and the statistical sensor."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    "dechirp.experiments.study.study",
    names_by_module={
        "dechirp.experiments.statistical.sensor": "draw_statistical_detections",
    },
)
