"""Direction estimators, a family."""
