"""What every setting of the package is: a frozen value that knows its names."""

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def value(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass with keyword-only fields.

    Field names carry their SI unit (`slope_hz_per_s`); settings files use the name
    without it. `dataclasses.replace` makes a variant and checks it again.
    """
    return dataclass(frozen=True, kw_only=True)(cls)
