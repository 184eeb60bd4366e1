"""Functions of single numbers, applied to arrays element by element."""

import inspect
import typing
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, Protocol, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import as_python_number, check_argument_names
from dechirp.core.checks import (
    broadcast_arguments,
    check_plain_numbers,
    check_real_array,
    convert_to_array,
)

P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)


class ElementwiseFunction(Protocol[P, R_co]):
    """Function of numbers that accepts arrays in their place."""

    @overload
    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R_co: ...
    @overload
    def __call__(self, *args: ArrayLike, **kwargs: ArrayLike) -> np.ndarray: ...


def elementwise(function: Callable[P, R_co]) -> ElementwiseFunction[P, R_co]:
    """Make a function accept arrays for its numbers, which broadcast against each other.

    Numbers are the parameters annotated `int` or `float`, alone or in a union. With arrays among
    them, the function computes each element, and those of its `ArrayLike` parameters. Axes of a
    result, as of a pair, come before those of the elements. Numbers of NumPy become those of
    Python, since narrow integers overflow.
    """
    signature = inspect.signature(function)
    hints = {name: parameter.annotation for name, parameter in signature.parameters.items()}
    arrays = {name for name, hint in hints.items() if hint is ArrayLike}
    numbers = {
        name
        for name, hint in hints.items()
        if name not in arrays and {int, float} & set(typing.get_args(hint) or (hint,))
    }

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            arguments = signature.bind(*args, **kwargs).arguments
        except TypeError:
            check_argument_names(signature, function.__name__, args, kwargs)
            raise
        given = [name for name in arguments if name in numbers]
        arguments |= {name: _unwrap_number(name, arguments[name]) for name in given}
        candidates = {name: _as_array_of_numbers(name, arguments[name]) for name in given}
        elements = {name: array for name, array in candidates.items() if array is not None}
        compute = cast(Callable[..., Any], function)
        if not elements:
            return _unwrap_scalar(compute(**arguments))
        for name in (name for name in arguments if name in arrays):
            floats = check_real_array(name, arguments[name])
            array = np.asarray(arguments[name])
            elements[name] = array if array.dtype.kind in "iu" else floats  # counts stay whole
        columns = broadcast_arguments(**elements)
        rows = zip(*(column.ravel().tolist() for column in columns), strict=True)
        results = [compute(**arguments | dict(zip(elements, row, strict=True))) for row in rows]
        stacked = np.asarray(results)
        axes_of_result = stacked.shape[1:]
        stacked = stacked.reshape(columns[0].shape + axes_of_result)
        own = range(-len(axes_of_result), 0)
        return np.moveaxis(stacked, own, range(len(own)))

    # What `help` and notebooks show: arrays are accepted in place of numbers.
    parameters = [
        parameter.replace(annotation="ArrayLike") if parameter.name in numbers else parameter
        for parameter in signature.parameters.values()
    ]
    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return cast("ElementwiseFunction[P, R_co]", call)


def scalar_results(function: Callable[P, R_co]) -> Callable[P, R_co]:
    """Make a function return a NumPy scalar instead of an array without axes, as SciPy does.

    The annotation of the function remains that of an array: a scalar has its methods.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R_co:
        return _unwrap_scalar(function(*args, **kwargs))

    return call


def _unwrap_scalar(result: R) -> R:
    """Return a NumPy scalar for an array without axes; anything else unchanged."""
    return cast("R", result[()]) if isinstance(result, np.ndarray) else result


def _unwrap_number(name: str, value: object) -> object:
    """Return the content of an array without axes, of any library; anything else unchanged."""
    number = as_python_number(value)
    if isinstance(number, int | float) or not hasattr(number, "__array__"):
        return number
    check_plain_numbers(name, number)
    array = convert_to_array(name, number)
    return number if array.ndim else array.item()


def _as_array_of_numbers(name: str, value: object) -> np.ndarray | None:
    """Return an array with axes of numbers; None for anything else, which the function checks."""
    if isinstance(value, int | float | str | bytes | tuple | None):
        return None
    check_plain_numbers(name, value)
    array = convert_to_array(name, value)
    if not (array.ndim and array.dtype.kind in "iuf"):
        return None
    check_real_array(name, array)  # refuses empty arrays
    return array
