"""Generators of source code that equals the fixed-point chain bit for bit: a family."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__)
