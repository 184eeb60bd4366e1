"""The name that was probably meant."""

from collections.abc import Iterable
from difflib import SequenceMatcher


def nearest(word: str, names: Iterable[str]) -> str | None:
    """Most alike of the right names, the first of equals; None where none is alike."""
    word = word.lower()[:100]  # nobody means a name of that length, and matching takes its square
    alike = {name: SequenceMatcher(None, word, name.lower()).ratio() for name in names}
    best = max(alike, key=alike.__getitem__, default=None)
    return best if best is not None and alike[best] >= 0.6 else None


OR_NONE = "Take one of these, or leave it out."
"""Of what need not be given."""


def did_you_mean(word: str, names: Iterable[str], otherwise: str = "Take one of these.") -> str:
    """How to mend a wrong name, beside a list of the right ones, which may be empty."""
    known = tuple(names)
    meant = nearest(word, known)
    if meant:
        return f"Did you mean {meant}?"
    return otherwise if known else "Leave it out."
