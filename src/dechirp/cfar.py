"""CFAR detectors: thresholds of plain arrays, and the settings of the chain."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.processing.cfar")
