"""Multiplexing, a family: sharing of the chirps of a frame among transmitters."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
