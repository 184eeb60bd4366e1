"""A mapping of `vary`: its numbers, and all that is wrong with it at once."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from decimal import Decimal

from dechirp.config.fields import Slot, words
from dechirp.config.mistakes import Spot
from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.quantities import difference_in, number_in, written
from dechirp.config.shown import shown
from dechirp.config.tree import Node
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake
from dechirp.core.kinds import KINDS

LEVELS = {name for kind in KINDS.values() for name, _ in kind.levels}
"""Units of levels, whose equal steps are equal ratios."""


class Told:
    """What a mapping of `vary` says, and what is wrong with it."""

    def __init__(self, spot: Spot) -> None:
        assert isinstance(spot.node.content, dict)
        self.spot, self.path, self.content = spot, spot.path, spot.node.content
        self.wrong: list[Mistake] = []

    def add(self, name: str, *, got: str, need: str, fix: str) -> None:
        """Keep what is wrong with one setting of it."""
        node = self.content.get(name)
        place = node.place if node is not None else self.spot.place
        self.wrong.append(place.mistake(f"{self.path}.{name}", got=got, need=need, fix=fix))

    def stop(self) -> None:
        """Raise `InvalidFile` with all that is wrong so far."""
        if self.wrong:
            raise InvalidFile(*self.wrong)

    def only(self, words: Sequence[str]) -> None:
        """Find names that have no place beside these."""
        for name, node in self.content.items():
            if name not in words:
                self.wrong.append(unknown(self.spot, name, node, words))

    def need(self, name: str) -> None:
        """Find that a name is missing."""
        if name not in self.content:
            self.add(name, got="missing", need="given", fix=f"Add {name}.")

    def must_be_numeric(self, what: str) -> None:
        """Find that the setting is none of numbers."""
        if not is_numeric(self.spot.slot):
            self.wrong.append(
                self.spot.place.mistake(
                    self.path,
                    got=what,
                    need="a list: this setting takes " + words(self.spot.slot),
                    fix="Write the values in brackets.",
                )
            )
            self.stop()  # the rest of it has no meaning here

    def symbol(self, names: Sequence[str], unit: str | None) -> str:
        """Unit of the first of them that has one."""
        found = ""
        for name in names:
            text = self._text(name)
            if text is None:
                continue
            with self._asked(name):
                found = found or written(text, unit)[1]
        return found

    def number(self, name: str, symbol: str, unit: str | None) -> Decimal:
        """Number of a quantity in a unit; 0 beside what is wrong."""
        with self._asked(name):
            number = number_in(symbol, self.content[name].text, unit)
            if number is not None:
                return number
            self.add(
                name,
                got=self.content[name].shown,
                need=f"a level in {symbol}, as the other end has",
                fix="Write it in dB, or both without.",
            )
        return Decimal(0)

    def difference(self, name: str, symbol: str) -> Decimal:
        """Number of a difference; 0 beside what is wrong."""
        if self._text(name) is not None:
            with self._asked(name):
                return difference_in(symbol, self.content[name].text, suffix_of(self.spot.slot))
        return Decimal(0)

    def few(self, n: float, name: str, at_most: int) -> None:
        """Find that there are too many values."""
        if n >= at_most + 1:
            few = n < 1e15
            made = f"{n:.0f}" if few else f"{n:.0e}"
            self.add(
                name,
                got=f"{self.content[name].shown}, which makes {made} values",
                need=f"at most at_most_points, {at_most}",
                fix=f"Take fewer, or confirm it: at_most_points: {made}." if few else "Take fewer.",
            )

    def _text(self, name: str) -> str | None:
        node = self.content.get(name)
        if node is None:
            return None
        if isinstance(node.content, bool) or not isinstance(node.content, str | int | float):
            need = KINDS[suffix_of(self.spot.slot)].words
            self.add(name, got=node.shown, need=need, fix="Write one number.")
            return None
        return node.text

    @contextmanager
    def _asked(self, name: str) -> Iterator[None]:
        try:
            yield
        except InvalidSetting as error:
            (one,) = error.mistakes
            self.add(name, got=one.got, need=one.need, fix=one.fix)


def is_numeric(slot: Slot) -> bool:
    """Whether a setting takes numbers."""
    return float in slot.choices or int in slot.choices


def is_whole(slot: Slot) -> bool:
    """Whether its numbers are whole."""
    return float not in slot.choices


def suffix_of(slot: Slot) -> str | None:
    """Unit suffix of the numbers of a setting; counts are bare, as probabilities are."""
    return "probability" if is_whole(slot) else slot.unit


def unit_apart(symbol: str) -> str:
    """Unit of a difference."""
    return {"degC": "K"}.get(symbol, "dB" if symbol in LEVELS else symbol)


def unknown(spot: Spot, name: str, node: Node, words: Sequence[str]) -> Mistake:
    """A name that has no place beside these words."""
    return node.named_at.mistake(
        f"{spot.path}.{shown(name)}",
        got="not a known name",
        need=f"one of {', '.join(words)}",
        fix=did_you_mean(name, words, OR_NONE),
    )
