"""radarsimpy: compiled package, not on PyPI; no job is implemented."""

REQUIRES = ("radarsimpy",)
