"""Mapping of the signals of a vendor's DBC to the columns of an object list."""

import math
import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.results.object_lists.can_layout import (
    SignalCodes,
    check_signals_fit,
    load_dbc_messages,
    read_signal_codes,
)

__all__ = ["CanMapping", "MappedSignal", "StatusSignal", "VendorLayout", "read_vendor_layout"]

_UNITS = {"SI": 1.0, "deg": math.pi / 180, "km/h": 1 / 3.6}
"""Size of a unit in SI units; dB is no factor."""

QUANTITIES = (
    "x",
    "y",
    "z",
    "vx",
    "vy",
    "range",
    "azimuth",
    "elevation",
    "range_rate",
    "x_std",
    "y_std",
    "vx_std",
    "vy_std",
    "snr",
    "length",
    "width",
)
"""Quantities that a mapping can take from a signal."""

_NUMBER_IN_SIGNAL = -1
_MAX_STATUS_CODE = 255


@frozen_dataclass
class MappedSignal:
    """Signal of one quantity: the quantity is `factor` times its physical value, plus `offset`."""

    signal: str
    factor: float = 1.0
    """-1 where the vendor's positive direction is the opposite one."""
    offset: float = 0.0
    """In the SI unit of the quantity, or in dB."""
    unit: Literal["SI", "deg", "km/h", "dB"] = "SI"
    """Unit of the physical value, which many DBCs do not state."""
    empty: float | None = None
    """Physical value of messages without an object, such as the largest distance; None: no such."""

    def __post_init__(self) -> None:
        _check_text("MappedSignal.signal", self.signal)
        check_number("MappedSignal.factor", self.factor, at_least=-1e9, at_most=1e9)
        check_number("MappedSignal.offset", self.offset, at_least=-1e9, at_most=1e9)
        if self.factor == 0:
            raise InvalidSetting(
                "MappedSignal.factor", value=0, expected="a number other than 0", fix="use 1 or -1"
            )
        if self.empty is not None:
            check_number("MappedSignal.empty", self.empty, at_least=-1e9, at_most=1e9)

    def quantity_from_physical(self, physical: np.ndarray) -> np.ndarray:
        """Return the quantity in SI units, ratios for dB."""
        values = physical * self.factor * _UNITS.get(self.unit, 1.0) + self.offset
        with np.errstate(over="ignore"):
            return np.asarray(10 ** (values / 10) if self.unit == "dB" else values)

    def physical_from_quantity(self, quantity: np.ndarray) -> np.ndarray:
        """Return the physical value of the signal."""
        with np.errstate(divide="ignore"):  # no signal at all is minus infinity
            values = 10 * np.log10(quantity) if self.unit == "dB" else quantity
        with np.errstate(over="ignore"):  # infinite values are clipped, with a warning
            return np.asarray((values - self.offset) / (self.factor * _UNITS.get(self.unit, 1.0)))


@frozen_dataclass
class StatusSignal:
    """Signal with the status of an object; all codes that are not listed are empty messages."""

    signal: str
    confirmed: tuple[int, ...] = ()
    """Codes of confirmed tracks. Objects are written with the first code of their status, or of
    the first status that has one."""
    tentative: tuple[int, ...] = ()
    detection: tuple[int, ...] = ()
    empty: int = 0
    """Code that is written to messages without an object."""

    def __post_init__(self) -> None:
        _check_text("StatusSignal.signal", self.signal)
        codes = [code for codes in self.codes.values() for code in codes]
        is_valid = all(0 <= code <= _MAX_STATUS_CODE for code in (*codes, self.empty))
        if not codes or not is_valid or len({*codes, self.empty}) <= len(codes):
            raise InvalidSetting(
                "StatusSignal",
                value=f"codes {', '.join(map(str, codes)) or '(none)'}; empty {self.empty}",
                expected=f"codes from 0 to {_MAX_STATUS_CODE}, each once",
                fix="list the codes of confirmed and tentative tracks, or of detections",
            )

    @property
    def codes(self) -> dict[str, tuple[int, ...]]:
        """Codes by status."""
        return {
            "confirmed": self.confirmed,
            "tentative": self.tentative,
            "detection": self.detection,
        }


@frozen_dataclass
class CanMapping:
    """Mapping of the signals of a DBC to the columns of an object list.

    An object has one message, or several whose names contain the same number. x points forward, y
    left, z up; azimuths are positive to the left and range rates receding.
    """

    messages: tuple[str, ...]
    """Names of object messages, such as `TRACK_A_#`, where # stands for the number of the object;
    without #, a signal has the number."""
    number: str | None = None
    """Signal with the number of the object."""
    counter: str | None = None
    """Signal that changes from list to list. Without one, and in any case, a list ends before
    a message of an object that it already contains."""
    start: str | None = None
    """Message that begins each list, if there is one."""
    checksum: str | None = None
    """Signal with the sum of the bytes of the identifier, the number of bytes and all other bytes,
    modulo its size, as Toyota defines it. It is computed when messages that have it are written."""
    status: StatusSignal | None = None
    """None: every message has a confirmed object."""
    x: MappedSignal | None = None
    y: MappedSignal | None = None
    z: MappedSignal | None = None
    range: MappedSignal | None = None
    """With the azimuth, instead of x and y."""
    azimuth: MappedSignal | None = None
    elevation: MappedSignal | None = None
    vx: MappedSignal | None = None
    vy: MappedSignal | None = None
    range_rate: MappedSignal | None = None
    """Instead of vx and vy, which become its components along the line of sight."""
    x_std: MappedSignal | None = None
    y_std: MappedSignal | None = None
    vx_std: MappedSignal | None = None
    vy_std: MappedSignal | None = None
    snr: MappedSignal | None = None
    length: MappedSignal | None = None
    width: MappedSignal | None = None

    def __post_init__(self) -> None:
        n_numbers = {name.count("#") + (self.number is not None) for name in self.messages}
        if n_numbers != {1}:
            raise _mapping_error(
                "messages",
                f"{', '.join(self.messages) or 'none'}; number {self.number!r}",
                "the number of the object from one # in each name, or from a signal",
                "write TRACK_A_# for TRACK_A_0, TRACK_A_1, ..., or name the signal of the number",
            )
        has_position = (self.x and self.y) or (self.range and self.azimuth)
        if not has_position or (self.x and self.range):
            raise _mapping_error(
                "x",
                ", ".join(self.signals) or "no quantity",
                "either x and y, or range and azimuth",
                "map the signals of the position",
            )
        if self.range_rate and (self.vx or self.vy):
            raise _mapping_error(
                "range_rate", "with vx or vy", "either of them", "remove one of them"
            )

    @property
    def signals(self) -> "dict[str, MappedSignal]":
        """Signals by quantity."""
        named = {name: getattr(self, name) for name in QUANTITIES}
        return {name: signal for name, signal in named.items() if signal is not None}


class SignalBits(NamedTuple):
    """Bits of a signal in the integer that the bytes of its message form."""

    name: str
    is_big_endian: bool
    shift: int
    mask: int
    sign_bit: int
    """0 for a signal without sign."""


class SignalDecoder(NamedTuple):
    """Decoder of the mapped signals of one message to integer codes."""

    message: Any
    length: int
    """Bytes of the message."""
    bits: tuple[SignalBits, ...] | None
    """None: cantools decodes the message, as multiplexers choose its signals."""

    def decode_codes(self, data: bytes) -> dict[str, int]:
        """Return the codes by signal; 1.5 us a message, of which cantools takes 16."""
        if self.bits is None:
            decoded = self.message.decode(
                data, decode_choices=False, scaling=False, allow_excess=True
            )
            return dict(decoded)
        data = data[: self.length]
        big, little = int.from_bytes(data, "big"), int.from_bytes(data, "little")
        codes = {}
        for name, is_big_endian, shift, mask, sign_bit in self.bits:
            code = ((big if is_big_endian else little) >> shift) & mask
            codes[name] = code - ((code & sign_bit) << 1)
        return codes


def build_signal_decoder(message: Any, names: set[str]) -> SignalDecoder:
    """Build the decoder of the signals that have one of the names."""
    if message.is_multiplexed():
        return SignalDecoder(message, message.length, None)
    bits = []
    for signal in message.signals:
        if signal.name not in names:
            continue
        is_big_endian = signal.byte_order == "big_endian"
        # Motorola: the start is the most significant bit, counted from bit 7 of the first byte.
        first = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 8 * message.length - first - signal.length if is_big_endian else signal.start
        sign_bit = 1 << (signal.length - 1) if signal.is_signed else 0
        bits.append(
            SignalBits(signal.name, is_big_endian, shift, (1 << signal.length) - 1, sign_bit)
        )
    return SignalDecoder(message, message.length, tuple(bits))


class VendorLayout(NamedTuple):
    """Object messages of a vendor's DBC, with the mapping of their signals."""

    name: str
    mapping: CanMapping
    messages: dict[tuple[int, bool], Any]
    """Object messages of cantools by identifier and whether it is extended."""
    decoders: dict[tuple[int, bool], SignalDecoder]
    """Decoder of each object message."""
    slots: dict[tuple[int, bool], int | None]
    """Number of the object of each message; None if a signal has it."""
    codes: dict[str, SignalCodes]
    """Codes by signal, equal in all messages."""
    start: Any | None
    """Message that begins a list."""
    empty_codes: dict[str, int]
    """Codes by signal of a message without an object; each of them says that there is none."""

    @property
    def counter_period(self) -> int:
        """Number of lists after which the counter wraps; 1 without a counter."""
        counter = self.mapping.counter
        return 1 if counter is None else self.codes[counter].max_code + 1

    @property
    def identifiers(self) -> set[tuple[int, bool]]:
        """Identifiers of the messages of a list."""
        begin = () if self.start is None else (message_identifier(self.start),)
        return {*self.messages, *begin}


def message_identifier(message: Any) -> tuple[int, bool]:
    """Return identifier and whether it is extended."""
    return message.frame_id, message.is_extended_frame


def shipped_mappings() -> dict[str, Path]:
    """Return the paths of the mappings in the package by name."""
    folder = Path(str(files("dechirp.results.object_lists"))) / "mappings"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


@check_argument_types
def read_vendor_layout(dbc: str | Path, mapping: str | Path | CanMapping) -> VendorLayout:
    """Read the object messages of a vendor's DBC.

    Parameters
    ----------
    dbc : path
        The vendor's DBC; the package contains none.
    mapping : name, path or CanMapping
        `toyota-adas`, `delphi-esr`, or a YAML file with the fields of `CanMapping`.

    Raises
    ------
    InvalidSetting
        If the DBC cannot be read or does not have the messages and signals of the mapping.
    InvalidFile
        If the mapping file has mistakes.
    """
    if not isinstance(mapping, CanMapping):
        shipped = shipped_mappings()
        path = shipped.get(str(mapping)) or Path(mapping)
        if not path.is_file():
            raise InvalidSetting(
                "mapping",
                value=str(mapping),
                expected=f"a YAML file, or one of {', '.join(shipped)}",
                fix="check the path",
            )
        from dechirp.config.loading import read_settings  # 0.1 s, unused by `dechirp list`

        mapping = read_settings(path, CanMapping)
    messages = load_dbc_messages(Path(dbc), strict=False)
    numbers = [
        (message, number)
        for message in messages
        if (number := _number_in_name(message.name, mapping)) is not None
    ]
    if not numbers:
        raise _vendor_dbc_error(
            dbc,
            f"no message {' or '.join(mapping.messages)}",
            "messages of objects",
            "check the mapping",
        )
    for message, _ in numbers:
        check_signals_fit(Path(dbc), message)
    start = next((message for message in messages if message.name == mapping.start), None)
    if mapping.start is not None and start is None:
        raise _vendor_dbc_error(
            dbc, f"no message {mapping.start}", "the message that begins a list", "check `start`"
        )
    codes = dict(_iter_codes_of_mapped_signals(dbc, mapping, [m for m, _ in numbers]))
    _check_status_codes_fit(dbc, mapping, codes)
    empty_codes = dict(_iter_empty_codes(dbc, mapping, codes))
    return VendorLayout(
        name=str(dbc),
        mapping=mapping,
        messages={message_identifier(message): message for message, _ in numbers},
        decoders={
            message_identifier(message): build_signal_decoder(message, set(codes))
            for message, _ in numbers
        },
        slots={
            message_identifier(message): None if number == _NUMBER_IN_SIGNAL else number
            for message, number in numbers
        },
        codes=codes,
        start=start,
        empty_codes=empty_codes,
    )


def _number_in_name(name: str, mapping: CanMapping) -> int | None:
    """Return the number in the name of an object message, -1 without #; None for others."""
    for pattern in mapping.messages:
        before, has_number, after = pattern.partition("#")
        if not has_number and name == pattern:
            return _NUMBER_IN_SIGNAL
        digits = name.removeprefix(before).removesuffix(after)
        if has_number and name == before + digits + after and re.fullmatch("[0-9]{1,9}", digits):
            return int(digits)
    return None


def _iter_codes_of_mapped_signals(
    dbc: str | Path, mapping: CanMapping, messages: list[Any]
) -> Iterator[tuple[str, SignalCodes]]:
    """Yield the codes of each mapped signal; raise `InvalidSetting` if messages disagree."""
    names = {signal.signal for signal in mapping.signals.values()}
    others = (mapping.number, mapping.counter, mapping.checksum)
    names |= {name for name in others if name is not None}
    names |= set() if mapping.status is None else {mapping.status.signal}
    for name in sorted(names):
        signals = [(m, s) for m in messages for s in m.signals if s.name == name]
        if not signals:
            raise _vendor_dbc_error(
                dbc, f"no signal {name} in {messages[0].name}", f"{name}", "check the mapping"
            )
        all_codes = {
            read_signal_codes(Path(dbc), f"{message.name}.{name}", signal)
            for message, signal in signals
        }
        if len(all_codes) > 1:
            raise _vendor_dbc_error(
                dbc,
                f"different scales or ranges of {name} in its messages",
                "the same in all messages of objects",
                "map messages of one kind",
            )
        yield name, all_codes.pop()


def _check_status_codes_fit(
    dbc: str | Path, mapping: CanMapping, codes: dict[str, SignalCodes]
) -> None:
    if mapping.status is None:
        return
    listed = [code for codes_of in mapping.status.codes.values() for code in codes_of]
    fitting = codes[mapping.status.signal]
    for code in (*listed, mapping.status.empty):
        if not fitting.min_code <= code <= fitting.max_code:
            raise _vendor_dbc_error(
                dbc,
                f"{mapping.status.signal} from {fitting.min_code} to {fitting.max_code}",
                f"a signal with the code {code}",
                "correct the codes of the mapping",
            )


def _iter_empty_codes(
    dbc: str | Path, mapping: CanMapping, codes: dict[str, SignalCodes]
) -> Iterator[tuple[str, int]]:
    """Yield the signals that mark a message without an object, and their codes."""
    if mapping.status is not None:
        yield mapping.status.signal, mapping.status.empty
    for mapped in mapping.signals.values():
        if mapped.empty is None:
            continue
        signal_codes, value = codes[mapped.signal], np.array([mapped.empty])
        if signal_codes.out_of_range_mask(value).any():
            raise _vendor_dbc_error(
                dbc,
                f"{mapped.signal} from {signal_codes.min_value:g} to {signal_codes.max_value:g}",
                f"a signal with the value {mapped.empty:g}",
                "correct `empty` of the mapping",
            )
        yield mapped.signal, int(signal_codes.encode_values(value)[0])


def _check_text(setting: str, text: str) -> None:
    if not text.strip():
        raise InvalidSetting(
            setting, value=text or "empty", expected="the name of a signal", fix="name it"
        )


def _mapping_error(field: str, value: str, expected: str, fix: str) -> InvalidSetting:
    return InvalidSetting(f"CanMapping.{field}", value=value, expected=expected, fix=fix)


def _vendor_dbc_error(dbc: str | Path, value: str, expected: str, fix: str) -> InvalidSetting:
    return InvalidSetting("dbc", value=f"{dbc} with {value}", expected=expected, fix=fix)
