"""Radar equation and resolution of FMCW signals, on numbers and arrays."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.theory.link_budget")
