"""The name that was probably meant."""

from collections.abc import Iterable
from difflib import SequenceMatcher


def nearest(word: str, names: Iterable[str]) -> str | None:
    """Most alike of the right names, the first of equals; None where none is alike."""
    word = word.lower()[:100]  # nobody means a name of that length, and matching takes its square
    alike = {name: SequenceMatcher(None, word, name.lower()).ratio() for name in names}
    best = max(alike, key=alike.__getitem__, default=None)
    return best if best is not None and alike[best] >= 0.6 else None


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """How to mend a wrong name, beside a list of the right ones."""
    meant = nearest(word, names)
    return f"Did you mean {meant}?" if meant else "Take one of these, or leave it out."
