"""Mitigation of static echoes, leakage and interference in the samples of a frame."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
