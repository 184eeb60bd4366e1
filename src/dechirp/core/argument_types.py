"""Names and types of the arguments of public functions and classes, checked at each call."""

import inspect
import sys
import types
import typing
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from dechirp.core.annotations import check_annotations
from dechirp.core.display import describe_class
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.suggestions import did_you_mean_fix

P = ParamSpec("P")
R = TypeVar("R")


def check_argument_types(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise `InvalidSetting`, which names the argument, for one of a wrong type.

    Arguments whose annotation is a class, or a union of classes and None, are checked, and missing
    and unknown ones are reported; numbers, sequences and functions are left to the checks of their
    values, and compared with their annotation when the call fails with another error. Numbers of
    NumPy, alone or in a tuple, become those of Python, since narrow integers overflow.
    """
    signature = _unpack_options(inspect.signature(function))
    name = function.__qualname__.removesuffix(".__init__")
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
        try:
            arguments = signature.bind_partial(*args, **kwargs).arguments
        except TypeError:
            check_argument_names(signature, name, args, kwargs)
            raise
        for argument, parameter in parameters.items():
            if parameter.default is parameter.empty and argument not in arguments:
                raise _argument_error(name, argument, "missing", classes_by_argument())
        for argument, classes in classes_by_argument().items():
            if argument in arguments and not isinstance(arguments[argument], classes):
                raise _type_error(name, argument, arguments[argument], classes_by_argument())
        converted: Any = [as_python_number(value) for value in args]
        options: Any = {key: as_python_number(value) for key, value in kwargs.items()}
        try:
            return function(*converted, **options)
        except DechirpError:
            raise
        except Exception as error:
            check_annotations(function, arguments, setting="{}", error=error)
            raise

    return checked


def check_argument_names(
    signature: inspect.Signature, function: str, args: tuple[Any, ...], kwargs: dict[str, Any]
) -> None:
    """Raise `InvalidSetting` that names the first unknown, superfluous or missing argument.

    Parameters
    ----------
    signature : inspect.Signature
        Of a function or a class.
    function : str
        Name of the function or the class, for the message.
    args, kwargs
        Positional arguments, and arguments by name.
    """
    parameters = {name: p for name, p in signature.parameters.items() if name != "self"}
    args = args[len(signature.parameters) - len(parameters) :]
    names = list(parameters)
    kinds = {name: parameter.kind for name, parameter in parameters.items()}
    accepts_any_name = inspect.Parameter.VAR_KEYWORD in kinds.values()
    by_position = [n for n in names if kinds[n] is inspect.Parameter.POSITIONAL_OR_KEYWORD]
    for argument in kwargs:
        if argument not in names and not accepts_any_name:
            raise InvalidSetting(
                f"{function}.{argument}",
                value="unknown argument",
                expected=f"one of {', '.join(names)}" if names else "no argument",
                fix=did_you_mean_fix(argument, names),
            )
    if len(args) > len(by_position) and inspect.Parameter.VAR_POSITIONAL not in kinds.values():
        raise InvalidSetting(
            function,
            value=f"{len(args)} given without a name",
            expected=f"at most {len(by_position)}, all others by name",
            fix=f"write {function}({names[-1]}=...)" if names else "omit them",
        )
    for argument in by_position[: len(args)]:
        if argument in kwargs:
            raise InvalidSetting(
                f"{function}.{argument}",
                value="two values, one without and one with the name",
                expected="one value",
                fix="omit one of them",
            )
    for argument, parameter in parameters.items():
        is_given = argument in kwargs or argument in by_position[: len(args)]
        is_variable = kinds[argument] in (
            inspect.Parameter.VAR_POSITIONAL,
            inspect.Parameter.VAR_KEYWORD,
        )
        if parameter.default is parameter.empty and not is_given and not is_variable:
            raise InvalidSetting(
                f"{function}.{argument}",
                value="missing",
                expected="a value",
                fix=f"write {function}({argument}=...)",
            )


def _unpack_options(signature: inspect.Signature) -> inspect.Signature:
    """Return a signature with the keys of a `TypedDict` as arguments, in place of `**options`."""
    parameters: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        if typing.get_origin(parameter.annotation) is typing.Unpack:
            (options,) = typing.get_args(parameter.annotation)
            parameters += [
                inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None)
                for name in options.__annotations__
            ]
        else:
            parameters.append(parameter)
    return signature.replace(parameters=parameters)


def _type_error(
    function: str, argument: str, value: object, classes: dict[str, tuple[type, ...]]
) -> InvalidSetting:
    """Return the error of an argument of a wrong type.

    A class that a function of the package reads from files names it in `_file_reader`.
    """
    if isinstance(value, str | Path):
        text = repr(str(value))
        readers = [getattr(cls, "_file_reader", None) for cls in classes.get(argument, ())]
        reader = next(filter(None, readers), None)
        fix = f"read a file with {reader}({text})" if reader else None
    elif isinstance(value, type):
        text = f"the class {value.__name__}"
        is_accepted = issubclass(value, classes.get(argument, ()))
        fix = f"write {value.__name__}(...), an instance" if is_accepted else None
    else:
        text, fix = describe_class(type(value)), None
    return _argument_error(function, argument, text, classes, fix)


def _argument_error(
    function: str,
    argument: str,
    value: str,
    classes: dict[str, tuple[type, ...]],
    fix: str | None = None,
) -> InvalidSetting:
    """Return the error of a missing argument, or of one of a wrong type."""
    public_names = getattr(sys.modules.get("dechirp"), "__all__", ())
    prefix = "dechirp." if function.partition(".")[0] in public_names else ""
    accepted = classes.get(argument, ())
    names = ["None" if cls is types.NoneType else cls.__name__ for cls in accepted]
    return InvalidSetting(
        argument,
        value=value,
        expected=" or ".join(names) or "a value",
        fix=fix or f"see help({prefix}{function})",
    )


def as_python_number(value: Any) -> Any:
    """Return a real number of NumPy as one of Python, in a tuple too; anything else unchanged."""
    if type(value) is tuple:
        return tuple(as_python_number(member) for member in value)
    # Without an import of NumPy, which some commands do without.
    if type(value).__module__ != "numpy" or getattr(value, "ndim", None) != 0:
        return value
    kind = value.dtype.kind
    if kind == "O":
        return value.item()
    return int(value) if kind in "iu" else float(value) if kind == "f" else value


def has_unit(thing: object) -> bool:
    """Return whether it is a quantity of pint or astropy, or consists of times or durations.

    xarray's arrays, which name their unit in an attribute, are plain numbers.
    """
    is_quantity = any(
        hasattr(thing, unit) and hasattr(thing, number)
        for unit, number in (("units", "magnitude"), ("unit", "value"))
    )
    return is_quantity or getattr(getattr(thing, "dtype", None), "kind", None) in ("m", "M")


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
