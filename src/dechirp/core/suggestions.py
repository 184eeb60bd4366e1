"""Suggestions for misspelt names."""

from collections.abc import Iterable
from difflib import SequenceMatcher


def nearest_name(word: str, valid_names: Iterable[str]) -> str | None:
    """Return the most similar valid name, the first of equals; None if none is similar."""
    word = word.lower()[:100]  # longer than any name; matching time grows with the square
    similarity = {name: SequenceMatcher(None, word, name.lower()).ratio() for name in valid_names}
    best = max(similarity, key=similarity.__getitem__, default=None)
    return best if best is not None and similarity[best] >= 0.6 else None


CHOOSE_OR_OMIT = "use one of these, or omit it"
"""Fix for optional settings."""


def did_you_mean_fix(word: str, names: Iterable[str], otherwise: str = "use one of these") -> str:
    """Return the fix for a wrong name, given the valid ones."""
    valid_names = tuple(names)
    suggestion = nearest_name(word, valid_names)
    if suggestion:
        return f"did you mean {suggestion}?"
    return otherwise if valid_names else "omit it"
