"""Scores of trials: a family, whose kinds are their names in study files."""
