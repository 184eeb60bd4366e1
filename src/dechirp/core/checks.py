"""Checks that values make of their fields, and functions of their arguments."""

import math
import reprlib
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.errors import InvalidSetting

Vector = tuple[float, float, float]
_T = TypeVar("_T")


def positive(owner: object, *names: str, at_least: float = 0.0, at_most: float = math.inf) -> None:
    """Raise `InvalidSetting` unless the named numbers are finite, above zero, within bounds."""
    for name in names:
        number = getattr(owner, name)
        where = f"{type(owner).__name__}.{name}"
        if not (_is_finite(number) and number > 0):
            raise InvalidSetting(
                where, got=number, need="a finite number above 0", fix="Give a positive value."
            )
        _within(where, number, at_least, at_most)


def not_negative(owner: object, *names: str, at_most: float = math.inf) -> None:
    """Raise `InvalidSetting` unless the named numbers are finite, at least zero, within bounds."""
    for name in names:
        number = getattr(owner, name)
        where = f"{type(owner).__name__}.{name}"
        if not (_is_finite(number) and number >= 0):
            raise InvalidSetting(
                where,
                got=number,
                need="a finite number, 0 or more",
                fix="Give 0 or a positive value.",
            )
        _within(where, number, 0.0, at_most)


def count(owner: object, *names: str, at_least: int = 1, at_most: int = 2**31 - 1) -> None:
    """Raise `InvalidSetting` unless the named numbers are whole and within bounds."""
    for name in names:
        whole(
            f"{type(owner).__name__}.{name}",
            getattr(owner, name),
            at_least=at_least,
            at_most=at_most,
        )


def whole(where: str, number: Any, *, at_least: int, at_most: int = 2**31 - 1) -> None:
    """Raise `InvalidSetting`, about the setting `where`, unless a number is whole and bounded."""
    is_whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
    if not (is_whole and at_least <= number <= at_most):
        raise InvalidSetting(
            where,
            got=number,
            need=f"a whole number from {at_least} to {at_most}",
            fix="Give a whole number in these bounds.",
        )


def number(
    where: str,
    x: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> float:
    """Keep one finite number as a float, or raise `InvalidSetting`, about the setting `where`.

    What is not one real number has axes, is text, None, complex or a truth value.
    """
    one = _without_axes(x)
    found = float(one) if _is_finite(one) else math.nan
    right = (
        math.isfinite(found)
        and (above is None or found > above)
        and (at_least is None or found >= at_least)
        and (at_most is None or found <= at_most)
    )
    if not right:
        bounds = [(above, "above"), (at_least, "at least"), (at_most, "at most")]
        need = [f"{says} {_bound(where, bound)}" for bound, says in bounds if bound is not None]
        raise InvalidSetting(
            where,
            got=x if _is_number(one) else reprlib.repr(x),
            need=", ".join(["one finite number", *need]),
            fix="Check the sign and the unit.",
        )
    return found


def probability(where: str, number: float) -> None:
    """Raise `InvalidSetting`, about the setting `where`, unless one number, 0 < number < 1."""
    one = _without_axes(number)
    if not (_is_number(one) and 0 < one < 1):
        raise InvalidSetting(
            where, got=number, need="between 0 and 1, both excluded", fix="Give a probability."
        )


def false_alarms(where: str, number: float) -> None:
    """Raise `InvalidSetting`, about the setting `where`, unless 1e-300 <= number <= 1 - 1e-9.

    Nearer to 0 a threshold may be beyond all floats, nearer to 1 below all rounding errors.
    """
    probability(where, number)
    if not 1e-300 <= number <= 1 - 1e-9:
        raise InvalidSetting(
            where,
            got=number,
            need="from 1e-300 to 1 - 1e-9",
            fix="Give one that can be told from 0 and from 1.",
        )


def detection_above_false_alarms(
    detection_probability: float, false_alarm_probability: float
) -> None:
    """Raise `InvalidSetting` unless a false-alarm probability < detection probability < 1."""
    probability("detection_probability", detection_probability)
    false_alarms("false_alarm_probability", false_alarm_probability)
    if not detection_probability > false_alarm_probability:
        raise InvalidSetting(
            "detection_probability",
            got=detection_probability,
            need=f"above the false-alarm probability, {false_alarm_probability}",
            fix="Ask for more detections, or allow fewer false alarms.",
        )


def ratios(where: str, array: ArrayLike) -> np.ndarray:
    """Keep an array as floats, or raise `InvalidSetting` unless all are finite and 0 or more."""
    found = _floats(where, array)
    _must_be_ratios(where, found, found >= 0, "finite, 0 or more")
    return found


def positive_ratios(where: str, array: ArrayLike) -> np.ndarray:
    """Keep an array as floats, or raise `InvalidSetting` unless all are finite and above 0."""
    found = _floats(where, array)
    _must_be_ratios(where, found, found > 0, "finite and above 0")
    return found


def numbers(
    where: str, array: ArrayLike, *, above: float = -math.inf, below: float = math.inf
) -> np.ndarray:
    """Keep an array as floats, or raise `InvalidSetting` unless all are finite, within bounds."""
    found = _floats(where, array)
    wrong = found[~((above < found) & (found < below))]  # infinite is not below infinity
    if wrong.size:
        bounds = [(above, f"above {above:.6g}"), (below, f"below {below:.6g}")]
        raise InvalidSetting(
            where,
            got=wrong.flat[0],
            need=" and ".join(
                ["finite", *(says for bound, says in bounds if math.isfinite(bound))]
            ),
            fix="Check the sign and the unit.",
        )
    return found


def vector(owner: object, name: str, *, at_most: float) -> None:
    """Keep the named field as three floats, none larger, or raise `InvalidSetting`."""
    where = f"{type(owner).__name__}.{name}"
    object.__setattr__(owner, name, _vector(where, getattr(owner, name), at_most))


def vectors(owner: object, name: str, *, at_most: float) -> None:
    """Keep the named field as a tuple of at least one vector, or raise `InvalidSetting`."""
    where = f"{type(owner).__name__}.{name}"
    rows = getattr(owner, name)
    made = tuple(_vector(where, row, at_most) for row in listed(rows) or ())
    if not made:
        raise InvalidSetting(
            where, got=rows, need="at least one position (x, y, z)", fix="Give one, as [[x, y, z]]."
        )
    object.__setattr__(owner, name, made)


def listed(thing: object) -> tuple[Any, ...] | None:
    """Members of what is a list to a user; None for a text, a mapping, a number or array of one."""
    is_number = isinstance(thing, np.ndarray) and not thing.ndim
    is_one = is_number or isinstance(thing, str | bytes | Mapping)
    return tuple(thing) if isinstance(thing, Iterable) and not is_one else None


def series(
    where: str,
    given: object,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> tuple[float, ...]:
    """Keep a list of numbers as floats, or raise `InvalidSetting`, about `where` or one in it."""
    members = listed(given)
    if members is None:
        raise InvalidSetting(
            where,
            got=reprlib.repr(given),
            need="a list of numbers",
            fix="Write it in brackets, also where it is one number.",
        )
    return tuple(
        number(f"{where}.{place}", one, above=above, at_least=at_least, at_most=at_most)
        for place, one in enumerate(members)
    )


def instances(where: str, thing: object, kind: type[_T], *, fix: str) -> tuple[_T, ...]:
    """Keep a list of values of one class, or raise `InvalidSetting`, about `where` or one in it."""
    members = listed(thing)
    if members is None:
        need = f"a list, each a {kind.__name__}"
        raise InvalidSetting(where, got=reprlib.repr(thing), need=need, fix=fix)
    for place, member in enumerate(members):
        if not isinstance(member, kind):
            need = f"a {kind.__name__}, as each in the list"
            raise InvalidSetting(f"{where}.{place}", got=reprlib.repr(member), need=need, fix=fix)
    return members


def _floats(where: str, array: ArrayLike) -> np.ndarray:
    """Keep real numbers as floats, or raise `InvalidSetting`: no text, no rows of many lengths."""
    try:
        found = np.asarray(array)
    except ValueError:  # rows of many lengths
        found = np.asarray(None)
    # Whole numbers beyond 64 bits are objects to NumPy.
    if found.dtype.kind in "iuf" or all(_is_finite(one) for one in found.flat):
        return found.astype(float)
    raise InvalidSetting(
        where,
        got=reprlib.repr(array),
        need="real numbers, in an array or alone",
        fix="Give numbers, in rows of one length.",
    )


def _must_be_ratios(where: str, array: np.ndarray, right: np.ndarray, need: str) -> None:
    wrong = array[~(right & np.isfinite(array))]
    if wrong.size:
        raise InvalidSetting(
            where, got=wrong.flat[0], need=need, fix="Give a ratio of powers, not dB."
        )


def _vector(where: str, row: Any, at_most: float) -> Vector:
    numbers = listed(row) or ()
    if len(numbers) != 3 or not all(_is_finite(n) for n in numbers):
        raise InvalidSetting(
            where, got=row, need="three finite numbers (x, y, z)", fix="Give all three."
        )
    x, y, z = (float(n) for n in numbers)
    for number in (x, y, z):
        _within(where, number, -at_most, at_most)
    return (x, y, z)


def _within(where: str, number: float, at_least: float, at_most: float) -> None:
    if not at_least <= number <= at_most:
        raise InvalidSetting(
            where,
            got=number,
            need=f"a number from {_bound(where, at_least)} to {_bound(where, at_most)}",
            fix="Check the unit.",
        )


def _bound(where: str, bound: float) -> str:
    """Write a bound, of angles in degrees as well: settings files have those."""
    is_angle = where.rstrip(".0123456789").endswith("_rad")
    return f"{bound:.6g} rad ({math.degrees(bound):.4g} deg)" if is_angle else f"{bound:.6g}"


def _without_axes(thing: Any) -> Any:
    """What the functions of one ratio return is an array without axes, and one number."""
    return thing[()] if isinstance(thing, np.ndarray) and thing.ndim == 0 else thing


def _is_finite(thing: Any) -> bool:
    try:
        return _is_number(thing) and math.isfinite(thing)
    except OverflowError:  # a whole number beyond all floats
        return False


def _is_number(thing: object) -> bool:
    return isinstance(thing, int | float | np.integer | np.floating) and not isinstance(thing, bool)
