"""Impairments, a family: oscillator, propagation and receiver effects."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
