"""Tracks of extended objects, people and cars seen as groups of points: `dc.group_tracking`."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.tracking.groups")
