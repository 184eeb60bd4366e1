"""Radar devices, a family: antenna positions and limits of chips on evaluation boards."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
