"""radarsimpy: compiled, handed out by its makers alone; no job is written for it."""

REQUIRES = ("radarsimpy",)
