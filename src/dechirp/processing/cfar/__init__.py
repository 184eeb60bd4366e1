"""CFAR detectors, a family of noise estimators for constant-false-alarm-rate thresholds."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
