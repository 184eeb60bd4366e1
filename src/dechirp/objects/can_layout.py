"""What a DBC says of the object list: which signals carry which columns, in what codes."""

import math
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.extra import library
from dechirp.objects.can_bus import LENGTHS

HEADER, PART = "ObjectListHeader", "ObjectListPart"

_NOT_TOLD = ("NotTold", "SNA")
"""Names, in a table of values, of the code for what is not known."""


class Wanted(NamedTuple):
    """What a signal must at least be able to say, in its unit."""

    column: str
    low: float
    high: float
    step: float


_HEADER = {
    "Counter": Wanted("", 0, 15, 1),
    "NumberOfObjects": Wanted("", 0, 15, 1),
    "LeftOut": Wanted("", 0, 15, 1),
    "Frame": Wanted("frame", 0, 65535, 1),
    "Time": Wanted("time", 0, 3600, 1e-3),
    "Checksum": Wanted("", 0, 2**32 - 1, 1),
}
_PART = {"Counter": Wanted("", 0, 15, 1), "Part": Wanted("", 0, 15, 1)}
OBJECT = {
    "Number": Wanted("number", 0, 255, 1),
    "Status": Wanted("status", 0, 2, 1),
    "X": Wanted("x", -100, 100, 0.5),
    "Y": Wanted("y", -100, 100, 0.5),
    "Z": Wanted("z", -10, 10, 0.5),
    "VX": Wanted("vx", -60, 60, 0.5),
    "VY": Wanted("vy", -60, 60, 0.5),
    "XStd": Wanted("x_std", 0, 2, 0.2),
    "YStd": Wanted("y_std", 0, 2, 0.2),
    "VXStd": Wanted("vx_std", 0, 2, 0.2),
    "VYStd": Wanted("vy_std", 0, 2, 0.2),
    "Snr": Wanted("snr", 0, 60, 1),
    "Length": Wanted("length", 0, 20, 0.5),
    "Width": Wanted("width", 0, 5, 0.5),
}
"""Signals of an object, each followed by `_` and its place in the frame. Snr is in dB."""


class Codes(NamedTuple):
    """The codes of a signal: whole numbers, times `scale` plus `offset` its values."""

    scale: float
    offset: float
    low: int
    high: int
    not_told: int | None

    @property
    def least(self) -> float:
        """Smallest value that can be told."""
        return min(self.low * self.scale, self.high * self.scale) + self.offset

    @property
    def most(self) -> float:
        """Largest value that can be told."""
        return max(self.low * self.scale, self.high * self.scale) + self.offset

    def of(self, values: np.ndarray) -> np.ndarray:
        """Nearest code of each value, the last one beyond the ends; NaN is `not_told`."""
        nearest = np.round((values - self.offset) / self.scale)
        codes = np.clip(np.nan_to_num(nearest, posinf=np.inf, neginf=-np.inf), self.low, self.high)
        return np.where(np.isnan(values), self.not_told or 0, codes).astype(np.int64)

    def beyond(self, values: np.ndarray) -> np.ndarray:
        """Which values lie more than half a step beyond the ends."""
        half = abs(self.scale) / 2
        return (values < self.least - half) | (values > self.most + half)

    def values(self, codes: np.ndarray) -> np.ndarray:
        """Value of each code, NaN where it is `not_told`."""
        told = codes != (self.not_told if self.not_told is not None else self.high + 1)
        return np.where(told, codes * self.scale + self.offset, np.nan)


class Layout(NamedTuple):
    """Messages and signals of the object list in a DBC."""

    name: str
    header: Any
    part: Any
    codes: dict[str, Codes]
    """By signal; of an object's, without its place in the frame."""
    n_per_part: int

    @property
    def n_counts(self) -> int:
        """Lists after which the counter begins again."""
        return self.codes["Counter"].high + 1

    @property
    def most_objects(self) -> int:
        """Objects that a list can hold."""
        parts = self.codes["Part"].high + 1
        return min(self.codes["NumberOfObjects"].high, parts * self.n_per_part)

    def coded(self, name: str, values: np.ndarray) -> np.ndarray:
        """Codes of a column; raise `InvalidSetting` where NaN has none."""
        codes = self.codes[name]
        if codes.not_told is None and np.isnan(values).any():
            raise _unfit(
                Path(self.name),
                f"no code in {name} for what is not told, which {OBJECT[name].column} is here",
                f"one named {_NOT_TOLD[0]} in its table of values",
                "Add it to the DBC, outside the range of the signal.",
            )
        return codes.of(values)


def shipped_dbc() -> Path:
    """Path of the DBC that comes with the package."""
    return Path(str(files("dechirp.objects") / "dechirp.dbc"))


def layout(dbc: str | Path | None = None) -> Layout:
    """Read a DBC and find the object list in it.

    Parameters
    ----------
    dbc : path, optional
        The one of the package without it. Names of messages and signals must be those of the
        one of the package; places, byte order, scales, more objects in a frame and more signals
        are free.

    Raises
    ------
    InvalidSetting
        If it cannot be read, lacks a message or a signal, or a signal has too few bits.
    """
    if not isinstance(dbc, str | Path | None):
        raise InvalidSetting("dbc", got=repr(dbc), need="a path", fix="Give it as a text.")
    path = shipped_dbc() if dbc is None else Path(dbc)
    found = {message.name: message for message in _messages(path)}
    for name in (HEADER, PART):
        if name not in found:
            got = ", ".join(found) or "no message"
            raise _unfit(path, got, f"a message {name}", "Add it, as the shipped DBC has it.")
        _must_be_plain(path, found[name])
    header, part = found[HEADER], found[PART]
    if (header.frame_id, header.is_extended_frame) == (part.frame_id, part.is_extended_frame):
        raise _unfit(path, f"one identifier for {HEADER} and {PART}", "two", "Change one of them.")
    codes = dict(_read(path, header, _HEADER, ""))
    in_parts = dict(_read(path, part, _PART, ""))
    if codes["Counter"] != in_parts["Counter"]:
        got = f"a Counter to {codes['Counter'].high} in {HEADER}, to {in_parts['Counter'].high} in "
        raise _unfit(path, f"{got}{PART}", "the same in both", "Give both the same bits.")
    codes.update(in_parts)
    n_per_part = _n_groups(part)
    codes.update(_read(path, part, OBJECT, "_0"))
    for place in range(1, n_per_part):
        for name, one in _read(path, part, OBJECT, f"_{place}"):
            if one != codes[name]:
                got = f"a signal {name}_{place} with other codes than {name}_0"
                raise _unfit(path, got, "the same codes for every object of a frame", "Make it so.")
    return Layout(str(path), header, part, codes, n_per_part)


def _messages(path: Path) -> list[Any]:
    cantools = library("cantools")
    try:
        database = cantools.database.load_file(str(path), database_format="dbc", strict=True)
    except OSError as error:
        why = error.strerror or str(error)
        raise _unfit(path, why, "a DBC that can be read", "Check the path.") from None
    except (cantools.Error, ValueError, KeyError, AttributeError, TypeError, IndexError) as error:
        # The parser meets what is no DBC with whatever its code happens to trip over.
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise _unfit(
            path, f"not a DBC ({why})", "a DBC", "Mend it, or take the shipped one."
        ) from None
    return list(database.messages)


def _must_be_plain(path: Path, message: Any) -> None:
    if message.is_multiplexed() or message.is_container:
        raise _unfit(
            path, f"{message.name} multiplexed", "one that always holds the same", "Flatten it."
        )
    if message.length not in LENGTHS:
        lengths = ", ".join(map(str, LENGTHS))
        got = f"{message.name} of {message.length} bytes"
        raise _unfit(path, got, f"one of {lengths}", "Take the next longer one.")


def _n_groups(part: Any) -> int:
    """Objects in a frame: how many places any of their signals has."""
    names = {signal.name for signal in part.signals}
    place = 0
    while any(f"{name}_{place}" in names for name in OBJECT):
        place += 1
    return max(place, 1)


def _read(
    path: Path, message: Any, wanted: dict[str, Wanted], place: str
) -> Iterator[tuple[str, Codes]]:
    """Codes of each wanted signal of a message; raise `InvalidSetting` where one does not fit."""
    signals = {signal.name: signal for signal in message.signals}
    missing = [f"{name}{place}" for name in wanted if f"{name}{place}" not in signals]
    if missing:
        raise _unfit(
            path,
            f"{message.name} without {', '.join(missing)}",
            f"with {', '.join(f'{name}{place}' for name in wanted)}",
            "Add what is missing, as the shipped DBC has it.",
        )
    for name, need in wanted.items():
        yield name, _codes(path, message.name, signals[f"{name}{place}"], need)


def _codes(path: Path, message: str, signal: Any, need: Wanted) -> Codes:
    where = f"{message}.{signal.name}"
    if signal.conversion.is_float:
        raise _unfit(
            path, f"{where} of floats", "whole numbers with a scale", "Make it an integer."
        )
    if not all(
        _is_finite(one) for one in (signal.scale, signal.offset, signal.minimum, signal.maximum)
    ):
        raise _unfit(path, f"{where} of numbers that no float has", "smaller ones", "Mend them.")
    scale, offset = float(signal.scale), float(signal.offset)
    if not scale or not (need.column or (scale, offset) == (1, 0)):
        got = f"{where} with scale {scale:.6g} and offset {offset:.6g}"
        raise _unfit(path, got, "a scale, and (1,0) for counts", "Write (1,0) before its range.")
    n_bits = min(signal.length, 53)  # codes beyond are no whole numbers to floats
    low = -(2 ** (n_bits - 1)) if signal.is_signed else 0
    high = low + 2**n_bits - 1
    ends = sorted(
        (limit - offset) / scale for limit in (signal.minimum, signal.maximum) if limit is not None
    )
    if len(ends) == 2:  # a DBC without limits writes [0|0], which is none here
        first, last = np.clip(ends, low, high)  # small scales make large limits infinite
        low, high = int(np.ceil(first - 1e-6)), int(np.floor(last + 1e-6))
    texts = {str(text): int(code) for code, text in (signal.choices or {}).items()}
    not_told = next((texts[text] for text in _NOT_TOLD if text in texts), None)
    if not_told is not None:
        low, high = low + (not_told == low), high - (not_told == high)
    codes = Codes(scale, offset, low, high, not_told)
    slack = 1e-9 * max(abs(need.low), abs(need.high))
    fits = codes.least <= need.low + slack and codes.most >= need.high - slack
    if low >= high or not fits or abs(scale) > need.step * (1 + 1e-9):
        raise _unfit(
            path,
            f"{where} of {signal.length} bits, from {codes.least:.6g} to {codes.most:.6g} in "
            f"steps of {abs(scale):.6g}",
            f"from {need.low:.6g} to {need.high:.6g} or more, in steps of {need.step:.6g} or less",
            "Give it more bits, or another scale.",
        )
    if not_told is not None and low <= not_told <= high:
        raise _unfit(
            path,
            f"{where} with the code {not_told} for {_NOT_TOLD[0]} within its range",
            "a code that is no value",
            "Take the first or the last one, and leave it out of the range.",
        )
    return codes


def _is_finite(number: float | None) -> bool:
    try:
        return number is None or math.isfinite(number)
    except OverflowError:  # a whole number beyond all floats
        return False


def _unfit(path: Path, got: str, need: str, fix: str) -> InvalidSetting:
    return InvalidSetting("dbc", got=f"{path} with {got}", need=need, fix=fix)
