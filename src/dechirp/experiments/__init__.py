"""Experiments: the only place where the scene and the processing meet."""
