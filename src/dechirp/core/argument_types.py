"""Types of the arguments of public functions, checked at each call."""

import inspect
import types
import typing
from collections.abc import Callable
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

from dechirp.core.errors import InvalidSetting

P = ParamSpec("P")
R = TypeVar("R")


def check_argument_types(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise `InvalidSetting`, which names the argument, for one of a wrong type.

    Arguments whose annotation is a class, or a union of classes and None, are checked, and missing
    ones are reported; numbers, sequences and functions are left to the checks of their values.
    """
    signature, name = inspect.signature(function), function.__name__
    parameters = {
        parameter.name: parameter
        for parameter in signature.parameters.values()
        if parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
    }

    @cache
    def classes_by_argument() -> dict[str, tuple[type, ...]]:
        hints = typing.get_type_hints(function)
        return {
            argument: classes
            for argument in parameters
            if argument in hints and (classes := _checkable_classes(hints[argument]))
        }

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        arguments = signature.bind_partial(*args, **kwargs).arguments
        for argument, parameter in parameters.items():
            if parameter.default is parameter.empty and argument not in arguments:
                raise _argument_error(name, argument, "missing", classes_by_argument())
        for argument, classes in classes_by_argument().items():
            if argument in arguments and not isinstance(arguments[argument], classes):
                type_text = f"a {type(arguments[argument]).__name__}"
                raise _argument_error(name, argument, type_text, classes_by_argument())
        return function(*args, **kwargs)

    return checked


def _argument_error(
    function: str, argument: str, value: str, classes: dict[str, tuple[type, ...]]
) -> InvalidSetting:
    names = ["None" if cls is types.NoneType else cls.__name__ for cls in classes.get(argument, ())]
    return InvalidSetting(
        argument,
        value=value,
        expected=" or ".join(names) or "a value",
        fix=f"see help(dechirp.{function})",
    )


def _checkable_classes(hint: Any) -> tuple[type, ...]:
    """Return the classes of an annotation; none if it holds numbers or generic types."""
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    members = typing.get_args(hint) if is_union else (hint,)
    is_checkable = all(
        inspect.isclass(member)
        and typing.get_origin(member) is None
        and member not in (int, float, bool, object, Any)
        for member in members
    )
    return tuple(members) if is_checkable else ()
