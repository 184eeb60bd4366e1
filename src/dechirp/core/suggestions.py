"""Suggestions for misspelt names."""

import re
from collections.abc import Iterable
from difflib import SequenceMatcher


def nearest_name(word: str, valid_names: Iterable[str]) -> str | None:
    """Return the most similar valid name, the first of equals; None if none is similar.

    Without a similar one, it is a name that the word abbreviates, or an abbreviation of the word.
    """
    word = word.lower()[:100]  # longer than any name; matching time grows with the square
    similarity = {name: SequenceMatcher(None, word, name.lower()).ratio() for name in valid_names}
    best = max(similarity, key=similarity.__getitem__, default=None)
    if best is not None and similarity[best] >= 0.6:
        return best
    related = (
        name
        for name in similarity
        if _is_abbreviation(word, name.lower()) or _is_abbreviation(name.lower(), word)
    )
    return next(related, None)


def _is_abbreviation(short: str, name: str) -> bool:
    """Return True for the initials of the first words of a name, two or more, in any order.

    `pfa` is the probability of false alarm, `false_alarm_probability`; units come last in a name.
    """
    initials = [word[0] for word in re.split("[_-]", name) if word]
    return len(short) > 1 and sorted(short) == sorted(initials[: len(short)])


CHOOSE_OR_OMIT = "use one of these, or omit it"
"""Fix for optional settings."""


def did_you_mean_fix(word: str, names: Iterable[str], otherwise: str = "use one of these") -> str:
    """Return the fix for a wrong name, given the valid ones."""
    valid_names = tuple(names)
    suggestion = nearest_name(word, valid_names)
    if suggestion:
        return f"did you mean {suggestion}?"
    return otherwise if valid_names else "omit it"
