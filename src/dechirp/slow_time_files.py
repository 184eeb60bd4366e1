"""Slow-time files: I/Q values of range cells over time, without chirps."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.recordings.slow_time_files")
