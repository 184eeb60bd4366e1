"""Value classes: frozen dataclasses with keyword-only fields, the base of all settings."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from inspect import signature
from operator import attrgetter
from reprlib import recursive_repr
from typing import Any, TypeVar, dataclass_transform

from dechirp.core.annotations import check_annotations
from dechirp.core.argument_types import check_argument_names, has_unit
from dechirp.core.display import Displayable
from dechirp.core.errors import DechirpError, InvalidSetting

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def frozen_dataclass(cls: type[T]) -> type[T]:
    """Turn a class into a frozen dataclass with keyword-only fields.

    Field names carry their SI unit (`slope_hz_per_s`); settings files use the name
    without it. `dataclasses.replace` creates a variant and checks it again. Zero-dimensional
    arrays become Python numbers, since arrays have no hash. A `Displayable` class keeps its
    own `repr`. Calls with unknown, missing or positional arguments raise `InvalidSetting`, as
    do values whose type contradicts the annotation where the checks of the class fail on them.

    Parameters
    ----------
    cls : type
        Class with annotated fields; `__post_init__`, if there is one, checks them.
    """
    if not isinstance(cls, type):
        raise InvalidSetting(
            "cls",
            value=f"a {type(cls).__name__}",
            expected="a class",
            fix="write @frozen_dataclass above a class",
        )
    check = getattr(cls, "__post_init__", None)

    def normalise_fields(self: Any) -> None:
        for field in fields(self):
            content = getattr(self, field.name)
            # A dtype has `ndim`, but no `item`; a duration would lose its unit, nanoseconds, and
            # a masked number its mask.
            if (
                getattr(content, "ndim", None) == 0
                and hasattr(content, "item")
                and not has_unit(content)
                and not getattr(content, "mask", False)
            ):
                object.__setattr__(self, field.name, content.item())
        if check is not None:
            check(self)

    target: Any = cls
    target.__post_init__ = normalise_fields
    built = dataclass(frozen=True, kw_only=True, repr=False, eq=False)(cls)
    target.__init__ = _name_wrong_arguments(target.__init__)
    _add_comparison_and_repr(target)
    return built


def _add_comparison_and_repr(cls: Any) -> None:
    """Give a dataclass `__eq__`, `__hash__` and, unless it is `Displayable`, `__repr__`.

    Python up to 3.12 compiles each method of a dataclass from a text: of 1.0 s CPU of
    `dechirp list`, with 257 classes, these three took 0.08 s.
    """
    shown = [field.name for field in fields(cls) if field.repr]
    contents = attrgetter("__class__", *(field.name for field in fields(cls) if field.compare))

    def __eq__(self: Any, other: object) -> Any:  # noqa: N807
        return contents(self) == contents(other) if type(other) is type(self) else NotImplemented

    def __hash__(self: Any) -> int:  # noqa: N807
        return hash(contents(self))

    @recursive_repr()
    def __repr__(self: Any) -> str:  # noqa: N807
        pairs = (f"{name}={getattr(self, name)!r}" for name in shown)
        return f"{type(self).__qualname__}({', '.join(pairs)})"

    methods = [__eq__, __hash__] if issubclass(cls, Displayable) else [__eq__, __hash__, __repr__]
    for method in methods:
        if method.__name__ not in vars(cls):
            setattr(cls, method.__name__, method)


def _name_wrong_arguments(initialise: Callable[..., None]) -> Callable[..., None]:
    """Make the `__init__` of a class raise `InvalidSetting` that names a wrong argument."""

    @wraps(initialise)
    def checked(self: Any, *args: Any, **kwargs: Any) -> None:
        try:
            initialise(self, *args, **kwargs)
        except DechirpError:
            raise
        except Exception as error:
            # Checked after a failure only: values are also created within loops.
            cls = type(self)
            if isinstance(error, TypeError):
                check_argument_names(signature(cls), cls.__name__, args, kwargs)
            check_annotations(cls, kwargs, setting=f"{cls.__name__}.{{}}", error=error)
            raise

    return checked
