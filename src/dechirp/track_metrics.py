"""Metrics of tracks against the truth, and random trials of a tracker."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.evaluation.track_metrics")
