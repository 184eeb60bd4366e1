"""Marker of long tests, which run if DECHIRP_NIGHTLY is set and take an hour together."""

import os

import pytest

NIGHTLY = bool(os.environ.get("DECHIRP_NIGHTLY"))
nightly = pytest.mark.skipif(not NIGHTLY, reason="takes minutes: DECHIRP_NIGHTLY")
