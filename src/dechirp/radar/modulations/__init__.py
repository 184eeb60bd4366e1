"""Modulations, a family: differences between the ramps of a round."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
