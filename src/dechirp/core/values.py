"""What every setting of the package is: a frozen value that knows its names."""

from dataclasses import dataclass, fields
from typing import Any, TypeVar, dataclass_transform

from dechirp.core.displayed import Displayed

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def value(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass with keyword-only fields.

    Field names carry their SI unit (`slope_hz_per_s`); settings files use the name
    without it. `dataclasses.replace` makes a variant and checks it again. What functions of
    one number return, an array without axes, is kept as that number: arrays have no hash.
    One that is `Displayed` says its own line.
    """
    check = getattr(cls, "__post_init__", None)

    def keep(self: Any) -> None:
        for field in fields(self):
            given = getattr(self, field.name)
            if getattr(given, "ndim", None) == 0 and hasattr(given, "item"):  # a dtype has none
                object.__setattr__(self, field.name, given.item())
        if check is not None:
            check(self)

    made: Any = cls
    made.__post_init__ = keep
    return dataclass(frozen=True, kw_only=True, repr=not issubclass(cls, Displayed))(cls)
