"""DBC layout of the object list: the signal and code of each column."""

import logging
import math
import re
from collections import Counter
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.optional_imports import import_from_extra
from dechirp.results.object_lists.can_bus import FRAME_LENGTHS

__all__ = ["DbcLayout", "read_dbc_layout"]

HEADER, PART = "ObjectListHeader", "ObjectListPart"

_MAX_DBC_CHARACTERS = 2_000_000  # half a minute of parsing; that of a whole car has a tenth
_LONG_NUMBER = re.compile(r"\d{31,}|\d\.?[eE][+-]?0*[1-9]\d{3,}")
_MESSAGE_LENGTH = re.compile(r"\bBO_\s+\d+\s+\w+\s*:\s*(\d+)")
_SIGNAL_BITS = re.compile(r":\s*(\d+)\s*\|\s*(\d+)\s*@")
_NEGATIVE_START = re.compile(r"\bSG_\s+(\w+)[^:\n]*:\s*(-\s*\d+)\s*\|")
_MULTIPLEXER_STATEMENT = re.compile(r"\bSG_MUL_VAL_[^;]*")
_MULTIPLEXER_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")
_COMPLETE_STATEMENTS = {
    "BO_": re.compile(r"BO_\s+\d+\s+\w+\s*:\s*\d+\s+\w+"),
    "SG_": re.compile(r"SG_\s+\w.*:\s*\d+\s*\|.*@.*\(.*\)\s*\[.*\]\s*\".*\"\s*\w.*"),
}
"""Statements that end with their line; others end with a semicolon."""
_ENDED_BY_SEMICOLON = ("BA_", "CM_", "SG_MUL_VAL_", "SIG_", "VAL_", "BO_TX_BU_", "EV_")
_MAX_BYTES = 4095  # the longest message of ISO-TP
_MAX_MULTIPLEXER_VALUES = 65536

_UNKNOWN_NAMES = ("NotAvailable", "SNA")
"""Names, in a value table, of the code for unknown values."""


class RequiredSignal(NamedTuple):
    """Smallest acceptable range and resolution of a signal, in its unit."""

    column: str
    low: float
    high: float
    step: float


_HEADER_SIGNALS = {
    "Counter": RequiredSignal("", 0, 15, 1),
    "NumberOfObjects": RequiredSignal("", 0, 15, 1),
    "LeftOut": RequiredSignal("", 0, 15, 1),
    "Frame": RequiredSignal("frame", 0, 65535, 1),
    "Time": RequiredSignal("time", 0, 3600, 1e-3),
    "Checksum": RequiredSignal("", 0, 2**32 - 1, 1),
}
_PART_SIGNALS = {"Counter": RequiredSignal("", 0, 15, 1), "Part": RequiredSignal("", 0, 15, 1)}
OBJECT_SIGNALS = {
    "Number": RequiredSignal("number", 0, 255, 1),
    "Status": RequiredSignal("status", 0, 2, 1),
    "X": RequiredSignal("x", -100, 100, 0.5),
    "Y": RequiredSignal("y", -100, 100, 0.5),
    "Z": RequiredSignal("z", -10, 10, 0.5),
    "VX": RequiredSignal("vx", -60, 60, 0.5),
    "VY": RequiredSignal("vy", -60, 60, 0.5),
    "XStd": RequiredSignal("x_std", 0, 2, 0.2),
    "YStd": RequiredSignal("y_std", 0, 2, 0.2),
    "VXStd": RequiredSignal("vx_std", 0, 2, 0.2),
    "VYStd": RequiredSignal("vy_std", 0, 2, 0.2),
    "Snr": RequiredSignal("snr", 0, 60, 1),
    "Length": RequiredSignal("length", 0, 20, 0.5),
    "Width": RequiredSignal("width", 0, 5, 0.5),
}
"""Signals of an object, each followed by `_` and its index in the frame. Snr is in dB."""


class SignalCodes(NamedTuple):
    """Integer codes of a signal; value = code x `scale` + `offset`."""

    scale: float
    offset: float
    min_code: int
    max_code: int
    unknown_code: int | None

    @property
    def min_value(self) -> float:
        """Smallest value that has a code."""
        return min(self.min_code * self.scale, self.max_code * self.scale) + self.offset

    @property
    def max_value(self) -> float:
        """Largest value that has a code."""
        return max(self.min_code * self.scale, self.max_code * self.scale) + self.offset

    def encode_values(self, values: np.ndarray) -> np.ndarray:
        """Return the nearest code of each value, clipped to the range.

        NaN becomes `unknown_code`.
        """
        nearest = np.round((values - self.offset) / self.scale)
        codes = np.clip(
            np.nan_to_num(nearest, posinf=np.inf, neginf=-np.inf), self.min_code, self.max_code
        )
        return np.where(np.isnan(values), self.unknown_code or 0, codes).astype(np.int64)

    def out_of_range_mask(self, values: np.ndarray) -> np.ndarray:
        """Return True for values more than half a step outside the range."""
        half = abs(self.scale) / 2
        return (values < self.min_value - half) | (values > self.max_value + half)

    def decode_codes(self, codes: np.ndarray) -> np.ndarray:
        """Return the value of each code, NaN for `unknown_code`."""
        is_known = codes != (self.max_code + 1 if self.unknown_code is None else self.unknown_code)
        return np.where(is_known, codes * self.scale + self.offset, np.nan)


class DbcLayout(NamedTuple):
    """Messages and signals of the object list in a DBC."""

    name: str
    header: Any
    part: Any
    codes: dict[str, SignalCodes]
    """Codes by signal; object signals without their index in the frame."""
    objects_per_part: int

    @property
    def counter_period(self) -> int:
        """Number of lists after which the counter wraps."""
        return self.codes["Counter"].max_code + 1

    @property
    def max_objects(self) -> int:
        """Largest number of objects in a list."""
        parts = self.codes["Part"].max_code + 1
        return min(self.codes["NumberOfObjects"].max_code, parts * self.objects_per_part)

    def encode_signal_values(self, signal: str, values: np.ndarray) -> np.ndarray:
        """Encode a column; raise `InvalidSetting` if NaN has no code."""
        codes = self.codes[signal]
        if codes.unknown_code is None and np.isnan(values).any():
            raise _dbc_error(
                Path(self.name),
                f"no code in {signal} for unknown values, and {OBJECT_SIGNALS[signal].column} has"
                " some",
                f"one named {_UNKNOWN_NAMES[0]} in its value table",
                "add it to the DBC, outside the range of the signal",
            )
        return codes.encode_values(values)


def shipped_dbc_path() -> Path:
    """Return the path of the DBC in the package."""
    return Path(str(files("dechirp.results.object_lists") / "dechirp.dbc"))


@check_argument_types
def read_dbc_layout(dbc: str | Path | None = None) -> DbcLayout:
    """Read the layout of the object list from a DBC.

    Parameters
    ----------
    dbc : path, optional
        Default: the DBC of the package. Another one must have the same message and signal names;
        bit positions, byte order, scales, the number of objects in a frame and further signals are
        free.

    Raises
    ------
    InvalidSetting
        If it cannot be read, lacks a message or a signal, or a signal has too few bits.
    """
    if not isinstance(dbc, str | Path | None):
        raise InvalidSetting("dbc", value=repr(dbc), expected="a path", fix="pass it as a string")
    path = shipped_dbc_path() if dbc is None else Path(dbc)
    messages = {message.name: message for message in load_dbc_messages(path)}
    for name in (HEADER, PART):
        if name not in messages:
            actual = ", ".join(messages) or "no message"
            raise _dbc_error(path, actual, f"a message {name}", "add it as in the shipped DBC")
        _check_not_multiplexed_and_fd_length(path, messages[name])
    header, part = messages[HEADER], messages[PART]
    if (header.frame_id, header.is_extended_frame) == (part.frame_id, part.is_extended_frame):
        raise _dbc_error(
            path, f"one identifier for {HEADER} and {PART}", "two", "change one of them"
        )
    codes = dict(_read_required_signals(path, header, _HEADER_SIGNALS, ""))
    part_codes = dict(_read_required_signals(path, part, _PART_SIGNALS, ""))
    if codes["Counter"] != part_codes["Counter"]:
        actual = (
            f"a Counter to {codes['Counter'].max_code} in {HEADER}, to"
            f" {part_codes['Counter'].max_code} in "
        )
        raise _dbc_error(path, f"{actual}{PART}", "the same in both", "give both the same bits")
    codes.update(part_codes)
    n_per_part = _count_objects_per_part(part)
    codes.update(_read_required_signals(path, part, OBJECT_SIGNALS, "_0"))
    for index in range(1, n_per_part):
        for name, signal_codes in _read_required_signals(path, part, OBJECT_SIGNALS, f"_{index}"):
            if signal_codes != codes[name]:
                actual = f"a signal {name}_{index} with other codes than {name}_0"
                raise _dbc_error(
                    path, actual, "the same codes for every object of a frame", "correct it"
                )
    return DbcLayout(str(path), header, part, codes, n_per_part)


def load_dbc_messages(path: Path, *, strict: bool = True) -> list[Any]:
    """Load the messages of a DBC; strict: all signals must fit their messages.

    Raises
    ------
    InvalidSetting
        If it cannot be read, or has numbers for which the parser would take minutes.
    """
    cantools = import_from_extra("io", "cantools")
    try:
        # As cantools reads files: the encoding of Vector's tools.
        text = path.read_text(encoding="cp1252")
    except OSError as error:
        reason = error.strerror or str(error)
        raise _dbc_error(path, reason, "a readable DBC", "check the path") from None
    except UnicodeDecodeError as error:
        raise _dbc_error(path, f"not a DBC ({error.reason})", "a DBC", "correct it") from None
    _check_number_sizes(path, text)
    _check_is_complete(path, text)
    logger = logging.getLogger("cantools.database.can.database")
    was_disabled = logger.disabled
    logger.disabled = True  # it would print that one message replaces another
    try:
        database = cantools.database.load_string(text, database_format="dbc", strict=strict)
    except (cantools.Error, ValueError, KeyError, AttributeError, TypeError, IndexError) as error:
        # The parser raises various exceptions for files that are not a DBC.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise _dbc_error(
            path, f"not a DBC ({reason})", "a DBC", "correct it, or use the shipped one"
        ) from None
    finally:
        logger.disabled = was_disabled
    messages = list(database.messages)
    for kind, count in (
        ("name", Counter(message.name for message in messages)),
        ("identifier", Counter(message.frame_id for message in messages)),
    ):
        value, n_messages = max(count.items(), key=lambda item: item[1], default=("", 0))
        if strict and n_messages > 1:
            raise _dbc_error(
                path,
                f"{n_messages} messages of the {kind} {value}",
                "one message for each name and identifier",
                "remove one of them",
            )
    return messages


def check_signals_fit(path: Path, message: Any) -> None:
    """Raise `InvalidSetting` if signals overlap or exceed their message."""
    cantools = import_from_extra("io", "cantools")
    try:
        message.refresh(strict=True)
    except cantools.Error as error:
        reason = " ".join(str(error).split())[:200]
        raise _dbc_error(path, reason, "signals that fit their message", "correct it") from None


def _check_is_complete(path: Path, text: str) -> None:
    """Raise `InvalidSetting` if the text ends within a statement, which the parser leaves out."""
    text = text.rstrip()
    last = text.rsplit("\n", 1)[-1].strip()
    keyword = last.split(maxsplit=1)[0] if last else ""
    is_cut = text.count('"') % 2 == 1
    if pattern := _COMPLETE_STATEMENTS.get(keyword):
        is_cut |= pattern.fullmatch(last) is None
    elif keyword.startswith(_ENDED_BY_SEMICOLON):
        is_cut |= not last.endswith(";")
    if is_cut:
        raise _dbc_error(
            path,
            f"an incomplete statement at its end, line {1 + text.count(chr(10))}: {last[:60]!r}",
            "a complete DBC",
            "copy it again from its source",
        )


def _check_number_sizes(path: Path, text: str) -> None:
    """Raise `InvalidSetting` for negative bits, and for numbers that take the parser minutes.

    It makes a list of the bits of each message and of the values of each multiplexer, and computes
    with exact decimals: a message of 64e7 bytes takes 19 s and 5.7 GB.
    """
    if len(text) > _MAX_DBC_CHARACTERS:
        raise _dbc_error(
            path,
            f"{len(text)} characters",
            f"at most {_MAX_DBC_CHARACTERS}",
            "leave out other messages",
        )
    if long_number := _LONG_NUMBER.search(text):
        raise _dbc_error(
            path,
            f"a number of {len(long_number[0])} digits, or with its exponent",
            "at most 30 digits, and exponents to 999",
            "correct it",
        )
    if negative := _NEGATIVE_START.search(text):  # the parser accepts it, and encodes no code
        raise _dbc_error(
            path, f"the signal {negative[1]} at bit {negative[2]}", "bits from 0", "correct it"
        )
    n_bytes = [int(number) for number in _MESSAGE_LENGTH.findall(text)]
    bits = [int(number) for pair in _SIGNAL_BITS.findall(text) for number in pair]
    n_values = [
        int(last) - int(first) + 1
        for statement in _MULTIPLEXER_STATEMENT.findall(text)
        for first, last in _MULTIPLEXER_RANGE.findall(statement)
    ]
    for name, numbers, largest in (
        ("a message length of", n_bytes, _MAX_BYTES),
        ("a signal at bit, or of length,", bits, 8 * _MAX_BYTES),
        ("a number of multiplexer values of", n_values, _MAX_MULTIPLEXER_VALUES),
    ):
        if max(numbers, default=0) > largest:
            raise _dbc_error(path, f"{name} {max(numbers)}", f"at most {largest}", "correct it")


def _check_not_multiplexed_and_fd_length(path: Path, message: Any) -> None:
    if message.is_multiplexed() or message.is_container:
        raise _dbc_error(
            path, f"{message.name} multiplexed", "a message without multiplexing", "flatten it"
        )
    if message.length not in FRAME_LENGTHS:
        lengths = ", ".join(map(str, FRAME_LENGTHS))
        got = f"{message.name} of {message.length} bytes"
        raise _dbc_error(path, got, f"one of {lengths}", "use the next longer length")


def _count_objects_per_part(part: Any) -> int:
    """Return the number of objects in a part frame: the indices of its signals."""
    names = {signal.name for signal in part.signals}
    index = 0
    while any(f"{name}_{index}" in names for name in OBJECT_SIGNALS):
        index += 1
    return max(index, 1)


def _read_required_signals(
    path: Path, message: Any, required_signals: dict[str, RequiredSignal], suffix: str
) -> Iterator[tuple[str, SignalCodes]]:
    """Yield the codes of each required signal; raise `InvalidSetting` if one does not fit."""
    signals = {signal.name: signal for signal in message.signals}
    missing = [f"{name}{suffix}" for name in required_signals if f"{name}{suffix}" not in signals]
    if missing:
        raise _dbc_error(
            path,
            f"{message.name} without {', '.join(missing)}",
            f"with {', '.join(f'{name}{suffix}' for name in required_signals)}",
            "add the missing signals as in the shipped DBC",
        )
    for name, required in required_signals.items():
        yield name, _checked_signal_codes(path, message.name, signals[f"{name}{suffix}"], required)


def _checked_signal_codes(
    path: Path, message: str, signal: Any, required: RequiredSignal
) -> SignalCodes:
    where = f"{message}.{signal.name}"
    codes = read_signal_codes(path, where, signal)
    if not (required.column or (codes.scale, codes.offset) == (1, 0)):
        got = f"{where} with scale {codes.scale:.6g} and offset {codes.offset:.6g}"
        raise _dbc_error(path, got, "a scale, and (1,0) for counts", "write (1,0) before its range")
    slack = 1e-9 * max(abs(required.low), abs(required.high))
    fits = codes.min_value <= required.low + slack and codes.max_value >= required.high - slack
    if not fits or abs(codes.scale) > required.step * (1 + 1e-9):
        raise _dbc_error(
            path,
            f"{where} of {signal.length} bits, from {codes.min_value:.6g} to {codes.max_value:.6g}"
            f" in steps of {abs(codes.scale):.6g}",
            f"from {required.low:.6g} to {required.high:.6g} or more, in"
            f" steps of {required.step:.6g} or less",
            "give it more bits, or another scale",
        )
    return codes


def read_signal_codes(path: Path, where: str, signal: Any) -> SignalCodes:
    """Return the codes of a signal of cantools; raise `InvalidSetting` if it has none.

    `where` names the signal in messages.
    """
    if signal.conversion.is_float:
        raise _dbc_error(path, f"{where} of floats", "integers with a scale", "make it an integer")
    if not all(
        _is_none_or_finite(number)
        for number in (signal.scale, signal.offset, signal.minimum, signal.maximum)
    ):
        raise _dbc_error(
            path,
            f"{where} with numbers beyond the range of floats",
            "smaller numbers",
            "correct them",
        )
    scale, offset = float(signal.scale), float(signal.offset)
    if not scale:
        got = f"{where} with scale 0 and offset {offset:.6g}"
        raise _dbc_error(path, got, "a scale, and (1,0) for counts", "write (1,0) before its range")
    n_bits = min(signal.length, 53)  # larger integers are inexact in floats
    low = -(2 ** (n_bits - 1)) if signal.is_signed else 0
    high = low + 2**n_bits - 1
    limits = sorted(
        (limit - offset) / scale for limit in (signal.minimum, signal.maximum) if limit is not None
    )
    if len(limits) == 2:  # a DBC without limits has [0|0], read as None
        first, last = np.clip(limits, low, high)  # small scales make large limits infinite
        low, high = int(np.ceil(first - 1e-6)), int(np.floor(last + 1e-6))
    texts = {str(text): int(code) for code, text in (signal.choices or {}).items()}
    unknown_code = next((texts[text] for text in _UNKNOWN_NAMES if text in texts), None)
    if unknown_code is not None:
        low, high = low + (unknown_code == low), high - (unknown_code == high)
    codes = SignalCodes(scale, offset, low, high, unknown_code)
    if low >= high:
        raise _dbc_error(
            path,
            f"{where} of {signal.length} bits, from {codes.min_value:.6g} to {codes.max_value:.6g}",
            "two codes or more",
            "give it more bits, or another scale",
        )
    if unknown_code is not None and low <= unknown_code <= high:
        raise _dbc_error(
            path,
            f"{where} with the code {unknown_code} for {_UNKNOWN_NAMES[0]} within its range",
            "a code outside the range",
            "use the first or last code, and exclude it from the range",
        )
    return codes


def _is_none_or_finite(number: float | None) -> bool:
    try:
        return number is None or math.isfinite(number)
    except OverflowError:  # an integer beyond the range of floats
        return False


def _dbc_error(path: Path, value: str, expected: str, fix: str) -> InvalidSetting:
    return InvalidSetting("dbc", value=f"{path} with {value}", expected=expected, fix=fix)
