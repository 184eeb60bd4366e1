"""CFAR detectors, a family of noise estimators for constant-false-alarm-rate thresholds."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__)
