"""Closed-form radar theory: detection, CFAR, bounds, intervals, attenuation and windows."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
