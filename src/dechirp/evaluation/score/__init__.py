"""Scores of trials: a family, whose kinds are their names in study files."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
