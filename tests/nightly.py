"""Whether the long certificates run too: they take an hour, and set DECHIRP_NIGHTLY."""

import os

import pytest

NIGHTLY = bool(os.environ.get("DECHIRP_NIGHTLY"))
nightly = pytest.mark.skipif(not NIGHTLY, reason="takes minutes: DECHIRP_NIGHTLY")
