"""Diagnosis of arrays that other programs made."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.processing.diagnosis.diagnose")
