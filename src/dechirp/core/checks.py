"""Checks of the fields of values and the arguments of functions."""

import math
import reprlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.lib.array_utils import normalize_axis_tuple
from numpy.typing import ArrayLike

from dechirp.core.argument_types import has_unit
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory

# Squares and fourth powers of larger numbers overflow, and those of smaller ones vanish.
LARGEST_MAGNITUDE, SMALLEST_MAGNITUDE = 1e60, 1e-60
Vector = tuple[float, float, float]
_T = TypeVar("_T")


def check_positive_fields(
    owner: object, *names: str, at_least: float = 0.0, at_most: float = math.inf
) -> None:
    """Raise `InvalidSetting` unless the named numbers are finite, above zero, within bounds.

    Parameters
    ----------
    owner : object
        Value whose fields are checked.
    *names : str
        Names of the fields.
    at_least, at_most : float
        Smallest and largest value that are accepted.
    """
    for name in names:
        number = getattr(owner, name)
        setting = f"{type(owner).__name__}.{name}"
        if not (_is_finite_number(number) and number > 0):
            raise InvalidSetting(
                setting,
                value=_quote_text(number),
                expected="a finite number above 0",
                fix="give a positive value",
            )
        _check_bounds(setting, number, at_least, at_most)


def check_non_negative_fields(owner: object, *names: str, at_most: float = math.inf) -> None:
    """Raise `InvalidSetting` unless the named numbers are finite, at least zero, within bounds.

    Parameters
    ----------
    owner : object
        Value whose fields are checked.
    *names : str
        Names of the fields.
    at_most : float
        Largest value that is accepted.
    """
    for name in names:
        number = getattr(owner, name)
        setting = f"{type(owner).__name__}.{name}"
        if not (_is_finite_number(number) and number >= 0):
            raise InvalidSetting(
                setting,
                value=_quote_text(number),
                expected="a finite number, 0 or more",
                fix="give 0 or a positive value",
            )
        _check_bounds(setting, number, 0.0, at_most)


def check_integer_fields(
    owner: object, *names: str, at_least: int = 1, at_most: int = 2**31 - 1
) -> None:
    """Raise `InvalidSetting` unless the named fields are integers within bounds."""
    for name in names:
        check_integer(
            f"{type(owner).__name__}.{name}",
            getattr(owner, name),
            at_least=at_least,
            at_most=at_most,
        )


def check_integer(setting: str, number: Any, *, at_least: int, at_most: int = 2**31 - 1) -> None:
    """Raise `InvalidSetting` for `setting` unless a number is an integer within bounds."""
    is_whole = _is_real_number(number) and isinstance(number, int | np.integer)
    if not (is_whole and at_least <= number <= at_most):
        raise InvalidSetting(
            setting,
            value=_quote_text(number),
            expected=f"a whole number from {at_least} to {at_most}",
            fix="give a whole number in these bounds",
        )


def check_whole_numbers(
    setting: str, array: ArrayLike, *, at_least: int, at_most: int = 2**31 - 1
) -> np.ndarray:
    """Return an array of integers, or raise `InvalidSetting` unless all are, within bounds."""
    values = check_finite_array(setting, array)
    numbers = np.asarray(array)
    is_whole = numbers.dtype.kind in "iu"
    wrong = numbers[(values < at_least) | (values > at_most) | (not is_whole)]
    if wrong.size:
        check_integer(setting, wrong.flat[0], at_least=at_least, at_most=at_most)
    return values.astype(np.int64)


def check_number(
    setting: str,
    x: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> float:
    """Return one finite number as a float, or raise `InvalidSetting` for `setting`.

    Arrays with axes, text, None, complex numbers and booleans are refused.
    """
    scalar = _unwrap_scalar(x)
    value = float(scalar) if _is_finite_number(scalar) else math.nan
    is_valid = (
        math.isfinite(value)
        and (above is None or value > above)
        and (at_least is None or value >= at_least)
        and (at_most is None or value <= at_most)
    )
    if not is_valid:
        bounds = [(above, "above"), (at_least, "at least"), (at_most, "at most")]
        requirements = [
            f"{relation} {_format_bound(setting, bound)}"
            for bound, relation in bounds
            if bound is not None
        ]
        raise InvalidSetting(
            setting,
            value=x if _is_real_number(scalar) else reprlib.repr(x),
            expected=", ".join(["one finite number", *requirements]),
            fix="check the sign and the unit",
        )
    return value


def check_probability(setting: str, number: float) -> None:
    """Raise `InvalidSetting` for `setting` unless 0 < number < 1."""
    scalar = _unwrap_scalar(number)
    if not (_is_real_number(scalar) and 0 < scalar < 1):
        is_array = as_tuple_or_none(number) is not None
        raise InvalidSetting(
            setting,
            value=_quote_text(number),
            expected=f"{'one number ' if is_array else ''}between 0 and 1, both excluded",
            fix="give a probability",
        )


def check_probabilities(setting: str, array: ArrayLike) -> np.ndarray:
    """Return an array of floats, or raise `InvalidSetting` unless all are in (0, 1)."""
    values = check_real_array(setting, array)
    for wrong in values[~((values > 0) & (values < 1))]:
        check_probability(setting, float(wrong))
    return values


def broadcast_arguments(**arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Broadcast arguments against each other, or raise `InvalidSetting` that names their shapes."""
    try:
        return np.broadcast_arrays(*arrays.values())
    except ValueError:
        shapes = [f"{name} {array.shape}" for name, array in arrays.items() if array.ndim]
        raise InvalidSetting(
            " and ".join(name for name, array in arrays.items() if array.ndim),
            value=f"arrays {', '.join(shapes)}",
            expected="shapes that broadcast against each other",
            fix="give arrays of equal shape, or add axes of length 1",
        ) from None


def check_false_alarm_probability(setting: str, number: float) -> None:
    """Raise `InvalidSetting` for `setting` unless 1e-300 <= number <= 1 - 1e-9.

    Nearer to 0 a threshold may overflow, nearer to 1 rounding errors exceed it.
    """
    check_probability(setting, number)
    if not 1e-300 <= number <= 1 - 1e-9:
        raise InvalidSetting(
            setting,
            value=_quote_text(number),
            expected="from 1e-300 to 1 - 1e-9",
            fix="give a probability that floats distinguish from 0 and from 1",
        )


def check_detection_probability(
    detection_probability: float, false_alarm_probability: float
) -> None:
    """Raise `InvalidSetting` unless false-alarm probability < detection probability < 1."""
    check_probability("detection_probability", detection_probability)
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    if not detection_probability > false_alarm_probability:
        raise InvalidSetting(
            "detection_probability",
            value=detection_probability,
            expected=f"above the false-alarm probability, {false_alarm_probability}",
            fix="raise the detection probability, or lower the false-alarm probability",
        )


def check_non_negative_ratios(
    setting: str,
    array: ArrayLike,
    *,
    at_most: float = LARGEST_MAGNITUDE,
    may_be_empty: bool = False,
) -> np.ndarray:
    """Return an array of floats, or raise `InvalidSetting` unless all are from 0 to `at_most`."""
    values = check_real_array(setting, array, may_be_empty=may_be_empty)
    _check_ratios_by_mask(setting, values, values >= 0, "finite, 0 or more", at_most)
    return values


def check_positive_ratios(
    setting: str,
    array: ArrayLike,
    *,
    at_least: float = SMALLEST_MAGNITUDE,
    at_most: float = LARGEST_MAGNITUDE,
) -> np.ndarray:
    """Return an array of floats, or raise `InvalidSetting` unless all are within the limits."""
    values = check_real_array(setting, array)
    bound = f", {at_least:g} or more" if at_least >= 1 else f" and above 0, from {at_least:g}"
    _check_ratios_by_mask(setting, values, values >= at_least, f"finite{bound}", at_most)
    return values


def check_finite_array(
    setting: str,
    array: ArrayLike,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    below: float = math.inf,
    largest: float = LARGEST_MAGNITUDE,
    may_be_empty: bool = False,
) -> np.ndarray:
    """Return an array of floats, or raise `InvalidSetting` unless all are finite, within bounds.

    Magnitudes are at most `largest`, and at least its inverse where they must be above 0, so that
    products and quotients of a few of them are finite.
    """
    values = check_real_array(setting, array, may_be_empty=may_be_empty)
    smallest = 1 / largest if above == 0 else at_least
    wrong = values[
        ~((above < values) & (values >= max(at_least, smallest)) & (values < below))
        | (abs(values) > largest)
    ]
    if wrong.size:
        bounds = [
            (above, f"above {above:.6g}"),
            (at_least, f"at least {at_least:.6g}"),
            (below, f"below {below:.6g}"),
        ]
        if largest < abs(wrong.flat[0]) < math.inf:
            bounds.append((largest, f"of magnitude up to {largest:g}"))
        if 0 < wrong.flat[0] < smallest:
            bounds.append((smallest, f"from {smallest:g}"))
        raise InvalidSetting(
            setting,
            value=wrong.flat[0],
            expected=" and ".join(
                ["finite", *(relation for bound, relation in bounds if math.isfinite(bound))]
            ),
            fix="check the sign and the unit",
        )
    return values


def check_real_array(setting: str, array: ArrayLike, *, may_be_empty: bool = False) -> np.ndarray:
    """Convert real numbers to a float array.

    Text, ragged rows, masked values, and empty arrays unless they are permitted, are refused by
    `InvalidSetting`.
    """
    check_plain_numbers(setting, array)
    values = convert_to_array(setting, array)
    if not (values.size or may_be_empty):
        raise InvalidSetting(
            setting,
            value=f"an empty array {values.shape}",
            expected="one number or more",
            fix="skip the call where there is nothing to compute",
        )
    check_free_memory(
        f"the check of {setting}", needed_bytes=9.0 * values.size, fix="give fewer at once"
    )
    # NumPy stores integers beyond 64 bits as objects.
    if values.dtype.kind in "iuf" or all(_is_finite_number(value) for value in values.flat):
        return values.astype(float)
    raise InvalidSetting(
        setting,
        value=reprlib.repr(array),
        expected="a real number or an array of them",
        fix="give numbers, in rows of equal length",
    )


def convert_to_array(setting: str, array: object) -> np.ndarray:
    """Convert to an array, None in it for ragged rows; `InvalidSetting` if its library refuses."""
    try:
        return np.asarray(array)
    except (TypeError, ValueError, RuntimeError) as error:
        if hasattr(array, "__array__"):  # datasets, tensors on a device or with gradients
            raise InvalidSetting(
                setting,
                value=f"a {type(array).__name__}: {error}",
                expected="an array that NumPy can read",
                fix="convert it first, a tensor with tensor.detach().cpu().numpy()",
            ) from error
        return np.asarray(None)  # ragged rows


def check_finite_samples(
    setting: str,
    samples: ArrayLike,
    *,
    axes: str,
    fits: Callable[[np.ndarray], bool],
    may_be_empty: bool = False,
) -> np.ndarray:
    """Return real or complex numbers as an array, or raise `InvalidSetting`.

    Refused are text, empty arrays unless they are permitted, values that are not finite or whose
    powers might overflow, and shapes that do not fit `axes`, their description, or whose values are
    masked.
    """
    check_plain_numbers(setting, samples)
    array = convert_to_array(setting, samples)
    if array.dtype.kind not in "iufc" or not (array.size or may_be_empty) or not fits(array):
        raise InvalidSetting(
            setting,
            value=f"an array {array.shape} of {array.dtype}",
            expected=f"numbers over {axes}",
            fix="give real or complex numbers, with filled axes in this order",
        )
    check_free_memory(f"the check of {setting}", needed_bytes=array.size, fix="give fewer at once")
    n_wrong = np.count_nonzero(~np.isfinite(array))
    if n_wrong:
        raise InvalidSetting(
            setting,
            value=f"{n_wrong} values that are not finite",
            expected="finite numbers",
            fix="set lost samples to 0, or leave them out: one NaN would invalidate the result",
        )
    largest = largest_part(array)
    if largest > LARGEST_MAGNITUDE:
        raise InvalidSetting(
            setting,
            value=largest,
            expected=f"magnitudes up to {LARGEST_MAGNITUDE:g}",
            fix="scale them, such as to volts or to full scale",
        )
    return array


def largest_part(array: np.ndarray) -> float:
    """Return the largest magnitude of a real or imaginary part; 0 of none."""
    parts = (array.real, array.imag) if np.iscomplexobj(array) else (array,)
    return max(max(float(x.max(initial=0)), -float(x.min(initial=0))) for x in parts)


def check_plain_numbers(setting: str, array: object) -> None:
    """Raise `InvalidSetting` for a mask, a unit, or a time of an array, or of one in a list.

    NumPy's functions drop the mask and the unit of most arrays without a warning.
    """
    members = array if isinstance(array, list | tuple) else (array,)
    masked_arrays = [member for member in members if isinstance(member, np.ma.MaskedArray)]
    n_masked = sum(np.count_nonzero(np.ma.getmask(member)) for member in masked_arrays)
    if n_masked:
        raise InvalidSetting(
            setting,
            value=f"{n_masked} masked values",
            expected="values without a mask",
            fix="set lost samples to 0 with array.filled(0), or leave them out with"
            " array.compressed()",
        )
    if any(map(has_unit, members)):
        raise InvalidSetting(
            setting,
            value=reprlib.repr(array),
            expected="plain numbers in SI units",
            fix="convert a quantity with q.to('m').magnitude, or that of astropy with"
            " q.to_value('m'), and a duration with t / np.timedelta64(1, 's')",
        )


def check_axes(
    setting: str, axes: object, array: np.ndarray, *, n_axes: tuple[int, ...]
) -> tuple[int, ...]:
    """Return axes as numbers from 0, or raise `InvalidSetting` unless their number is allowed."""
    members = as_tuple_or_none(axes) or (axes,)
    try:
        numbers = normalize_axis_tuple(members, array.ndim)
        if len(numbers) in n_axes and not any(isinstance(member, bool) for member in members):
            return numbers
    except (TypeError, ValueError, OverflowError):  # among them AxisError
        pass
    raise InvalidSetting(
        setting,
        value=axes,
        expected=f"{' or '.join(map(str, n_axes))} different axes of an array {array.shape}, from"
        f" {-array.ndim} to {array.ndim - 1}",
        fix="count axes from 0, or from the last with -1",
    )


def check_and_convert_vector_field(owner: object, name: str, *, max_magnitude: float) -> None:
    """Set the named field to three floats within +-`max_magnitude`, or raise `InvalidSetting`."""
    setting = f"{type(owner).__name__}.{name}"
    object.__setattr__(
        owner, name, _to_bounded_vector(setting, getattr(owner, name), max_magnitude)
    )


def check_and_convert_vectors_field(owner: object, name: str, *, max_magnitude: float) -> None:
    """Set the named field to a tuple of at least one vector, or raise `InvalidSetting`."""
    setting = f"{type(owner).__name__}.{name}"
    rows = getattr(owner, name)
    vectors = tuple(
        _to_bounded_vector(setting, row, max_magnitude) for row in as_tuple_or_none(rows) or ()
    )
    if not vectors:
        raise InvalidSetting(
            setting,
            value=rows,
            expected="at least one position (x, y, z)",
            fix="give one, as [[x, y, z]]",
        )
    object.__setattr__(owner, name, vectors)


def as_tuple_or_none(value: object) -> tuple[Any, ...] | None:
    """Return the members of any list; None for a text, a mapping or a scalar."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return None
    try:
        return tuple(value)
    except TypeError:  # an array without axes, of any library, or a quantity of pint
        return None


def check_numbers(
    setting: str,
    numbers: object,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> tuple[float, ...]:
    """Return a list of numbers as floats, or raise `InvalidSetting` for the list or a member."""
    members = as_tuple_or_none(numbers)
    if members is None:
        raise InvalidSetting(
            setting,
            value=reprlib.repr(numbers),
            expected="a list of numbers",
            fix="write it in brackets, even a single number",
        )
    return tuple(
        check_number(f"{setting}.{index}", member, above=above, at_least=at_least, at_most=at_most)
        for index, member in enumerate(members)
    )


def check_field_classes(owner: object, **classes: type) -> None:
    """Raise `InvalidSetting` for a field whose value is not an instance of its class."""
    for name, cls in classes.items():
        value = getattr(owner, name)
        if not isinstance(value, cls):
            raise InvalidSetting(
                f"{type(owner).__name__}.{name}",
                value=reprlib.repr(value),
                expected=f"a {cls.__name__}",
                fix=f"give {cls.__name__}(...)",
            )


def check_instances(setting: str, values: object, cls: type[_T], *, fix: str) -> tuple[_T, ...]:
    """Return instances of a class as a tuple, or raise `InvalidSetting` for list or member."""
    members = as_tuple_or_none(values)
    if members is None:
        expected = f"a list, each a {cls.__name__}"
        raise InvalidSetting(setting, value=reprlib.repr(values), expected=expected, fix=fix)
    for index, member in enumerate(members):
        if not isinstance(member, cls):
            expected = f"a {cls.__name__}, as each in the list"
            raise InvalidSetting(
                f"{setting}.{index}", value=reprlib.repr(member), expected=expected, fix=fix
            )
    return members


def _check_ratios_by_mask(
    setting: str,
    array: np.ndarray,
    is_valid: np.ndarray,
    expected: str,
    at_most: float = LARGEST_MAGNITUDE,
) -> None:
    wrong = array[~(is_valid & (array <= at_most))]
    if wrong.size:
        raise InvalidSetting(
            setting,
            value=wrong.flat[0],
            expected=f"{expected}, at most {at_most:g}",
            fix="give a ratio of powers, not dB",
        )


def _to_bounded_vector(setting: str, coordinates: Any, max_magnitude: float) -> Vector:
    numbers = as_tuple_or_none(coordinates) or ()
    if len(numbers) != 3 or not all(_is_finite_number(n) for n in numbers):
        raise InvalidSetting(
            setting,
            value=coordinates,
            expected="three finite numbers (x, y, z)",
            fix="give all three",
        )
    x, y, z = (float(n) for n in numbers)
    for number in (x, y, z):
        _check_bounds(setting, number, -max_magnitude, max_magnitude)
    return (x, y, z)


def _check_bounds(setting: str, number: float, at_least: float, at_most: float) -> None:
    if not at_least <= number <= at_most:
        low, high = _format_bound(setting, at_least), _format_bound(setting, at_most)
        raise InvalidSetting(
            setting,
            value=_quote_text(number),
            expected=f"a number from {low} to {high}",
            fix="check the unit",
        )


def _format_bound(setting: str, bound: float) -> str:
    """Write a bound; angles also in degrees, the unit of settings files."""
    is_angle = setting.rstrip(".0123456789").endswith("_rad")
    return f"{bound:.6g} rad ({math.degrees(bound):.4g} deg)" if is_angle else f"{bound:.6g}"


def _quote_text(value: object) -> object:
    """Return a text in quotation marks, and any other value unchanged."""
    return reprlib.repr(value) if isinstance(value, str | bytes) else value


def _unwrap_scalar(thing: Any) -> Any:
    """Return the scalar of a zero-dimensional array, and anything else unchanged."""
    return thing[()] if isinstance(thing, np.ndarray) and thing.ndim == 0 else thing


def _is_finite_number(thing: Any) -> bool:
    try:
        return _is_real_number(thing) and math.isfinite(thing)
    except OverflowError:  # an integer beyond the largest float
        return False


def _is_real_number(thing: object) -> bool:
    # NumPy counts durations among its integers.
    return isinstance(thing, int | float | np.integer | np.floating) and not isinstance(
        thing, bool | np.timedelta64
    )
