"""Radar devices, a family: antenna positions and limits of chips on evaluation boards."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__)
