"""Displacement from the phase of one range cell over slow time."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.processing.slow_time")
