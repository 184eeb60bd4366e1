"""Value classes: frozen dataclasses with keyword-only fields, the base of all settings."""

from dataclasses import dataclass, fields
from typing import Any, TypeVar, dataclass_transform

from dechirp.core.display import Displayable

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def frozen_dataclass(cls: type[T]) -> type[T]:
    """Turn a class into a frozen dataclass with keyword-only fields.

    Field names carry their SI unit (`slope_hz_per_s`); settings files use the name
    without it. `dataclasses.replace` creates a variant and checks it again. Zero-dimensional
    arrays become Python numbers, since arrays have no hash. A `Displayable` class keeps its
    own `repr`.
    """
    check = getattr(cls, "__post_init__", None)

    def normalise_fields(self: Any) -> None:
        for field in fields(self):
            content = getattr(self, field.name)
            # A dtype has `ndim`, but no `item`.
            if getattr(content, "ndim", None) == 0 and hasattr(content, "item"):
                object.__setattr__(self, field.name, content.item())
        if check is not None:
            check(self)

    target: Any = cls
    target.__post_init__ = normalise_fields
    return dataclass(frozen=True, kw_only=True, repr=not issubclass(cls, Displayable))(cls)
