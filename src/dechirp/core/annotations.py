"""Values compared with the annotations of their fields or arguments, to explain a failure."""

import inspect
import numbers
import reprlib
import types
import typing
from collections.abc import Mapping
from typing import Any

from dechirp.core.errors import InvalidSetting

_NUMBERS: dict[Any, tuple[type, str]] = {
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    complex: (numbers.Complex, "a complex number"),
}
"""Classes of the numbers that each annotation admits, among them NumPy's; and its description."""


def check_annotations(
    owner: Any, values: Mapping[str, Any], *, setting: str, error: Exception
) -> None:
    """Raise `InvalidSetting` for the first value that contradicts its annotation.

    Parameters
    ----------
    owner : class or function
        It has the annotations.
    values : mapping
        Fields or arguments by name.
    setting : str
        Name of a setting in the message, with {} for the name of the field.
    error : Exception
        Failure that a contradiction would explain.
    """
    try:
        hints = typing.get_type_hints(owner)
    except NameError:  # names that only type checkers import
        return
    for name, value in values.items():
        if name in hints and not _fits_annotation(value, hints[name]):
            raise InvalidSetting(
                setting.format(name),
                value=reprlib.repr(value),
                expected=_describe_annotation(hints[name]),
                fix=f"see help({owner.__qualname__})",
            ) from error


def _fits_annotation(value: Any, hint: Any) -> bool:
    """Return False for a value that an annotation excludes; True where that is undecidable."""
    origin, members = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits_annotation(value, member) for member in members)
    if origin is typing.Literal:
        return isinstance(value, str | int | None) and value in members
    if hint in _NUMBERS:
        return isinstance(value, _NUMBERS[hint][0]) and not isinstance(value, bool)
    cls = types.NoneType if hint is None else origin or hint
    if cls is Any or not inspect.isclass(cls) or getattr(cls, "_is_protocol", False):
        return True
    if cls is not str and isinstance(value, str) and issubclass(cls, typing.Iterable):
        return False  # a text is no list of its characters
    # Classes convert lists to tuples.
    is_instance = isinstance(value, tuple | list if cls is tuple else cls)
    return is_instance and (
        not isinstance(value, tuple | list) or _members_fit_annotations(value, members)
    )


def _members_fit_annotations(values: tuple[Any, ...] | list[Any], members: tuple[Any, ...]) -> bool:
    """Return False for a list whose members or whose length an annotation excludes."""
    if (members and len(members) == 2 and members[1] is Ellipsis) or len(members) == 1:
        return all(_fits_annotation(value, members[0]) for value in values)
    return not members or (
        len(values) == len(members) and all(map(_fits_annotation, values, members))
    )


def _describe_annotation(hint: Any) -> str:
    origin, members = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(map(_describe_annotation, members))
    if origin is typing.Literal:
        return f"one of {', '.join(map(repr, members))}"
    if origin is tuple and members[-1] is not Ellipsis:
        return f"a tuple ({', '.join(map(_describe_annotation, members))})"
    if members and inspect.isclass(origin) and issubclass(origin, typing.Iterable):
        return f"a list, each {_describe_annotation(members[0])}"
    if hint in _NUMBERS:
        return _NUMBERS[hint][1]
    names = {None: "None", types.NoneType: "None", str: "a text", bool: "True or False"}
    return names.get(hint) or f"a {getattr(hint, '__name__', hint)}"
