"""Fixed-point processing up to the detector, bit-accurate for given word lengths."""

from dechirp.core.namespaces import lazy_namespace

__getattr__, __dir__ = lazy_namespace(__name__)
