"""Validation of settings files: a pydantic model for each value class, built from its fields."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import GenericAlias, UnionType
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Strict,
    Tag,
    TypeAdapter,
    ValidationInfo,
    WrapValidator,
    create_model,
)
from pydantic_core import PydanticCustomError

from dechirp.config.fields import Slot, is_family, is_path_field, list_settings
from dechirp.config.quantities import parse_quantity
from dechirp.core.errors import InvalidFile, Mistake
from dechirp.core.families import Family
from dechirp.core.findings import PhysicsWarning

Readers = Mapping[type, Callable[[Path], Any]]


@dataclass(frozen=True)
class ValidationContext:
    """Context of a validation: folder of the file, and readers of referenced files."""

    folder: Path
    """Folder that relative paths refer to."""
    readers: Readers
    """Functions that read a value given as a file path."""


class ReferencedFileError(ValueError):
    """Mistakes in another settings file that this one names."""

    def __init__(self, mistakes: tuple[Mistake, ...]) -> None:
        super().__init__()
        self.mistakes = mistakes


@cache
def build_validator(slot: Slot) -> TypeAdapter[Any]:
    """Build the validator of a slot: from plain data to a value, given a `ValidationContext`."""
    return TypeAdapter(_validated_type(slot.hint, slot.field, slot.unit))


@cache
def _build_model(cls: type) -> type[BaseModel]:
    model_fields: dict[str, Any] = {}
    for key, setting in list_settings(cls).items():
        hint = _validated_type(setting.slot.hint, setting.field, setting.slot.unit)
        default = ... if setting.is_required else None
        model_fields[setting.field] = (hint, Field(default, alias=key))
    return create_model(cls.__name__, __config__=ConfigDict(extra="forbid"), **model_fields)


def _validated_type(hint: Any, field: str, unit: str | None) -> Any:
    """Return the annotated type of a field with its checks."""
    annotation: Any = None
    if hint is float:
        annotation = Annotated[Any, PlainValidator(partial(_validate_number, unit=unit))]
    elif hint is int:
        annotation = Annotated[int, Strict(), BeforeValidator(_integer_from_float)]
    elif hint is bool:
        annotation = Annotated[bool, Strict()]
    elif hint is str and is_path_field(field):
        annotation = Annotated[str, AfterValidator(_resolve_path)]
    elif hint in (str, type(None)) or get_origin(hint) is Literal:
        annotation = hint
    elif {get_origin(argument) or argument for argument in get_args(hint)} == {float, tuple}:
        # A number or a list: tagged, so that a mistake in a list is reported once.
        tagged = tuple(
            Annotated[
                _validated_type(argument, field, unit), Tag(str(get_origin(argument) is tuple))
            ]
            for argument in get_args(hint)
        )
        is_list = Discriminator(lambda raw: str(isinstance(raw, list | tuple)))
        annotation = Annotated[Union[tagged], is_list]  # noqa: UP007
    elif get_origin(hint) in (Union, UnionType, tuple):
        members = tuple(
            m if m is Ellipsis else _validated_type(m, field, unit) for m in get_args(hint)
        )
        is_tuple = get_origin(hint) is tuple
        annotation = GenericAlias(tuple, members) if is_tuple else Union[members]  # noqa: UP007
    elif is_family(hint):
        annotation = Annotated[Any, PlainValidator(partial(_validate_member, hint))]
    elif is_dataclass(hint):
        annotation = Annotated[
            _build_model(cast(type, hint)),
            WrapValidator(partial(_construct_value, cast(type, hint))),
        ]
    else:
        raise TypeError(f"{field}: settings files cannot express {hint}")
    return annotation


def _validate_number(raw: Any, *, unit: str | None) -> float:
    if isinstance(raw, bool) or not isinstance(raw, str | int | float):
        raise PydanticCustomError("number", "not a number")
    return parse_quantity(raw if isinstance(raw, str) else repr(raw), unit)


def _integer_from_float(raw: Any) -> Any:
    """Accept 128.0 for 128, as JSON does: programs may write it."""
    is_whole = isinstance(raw, float) and raw.is_integer() and abs(raw) < 2**53
    return int(raw) if is_whole else raw


def _resolve_path(path: str, info: ValidationInfo) -> str:
    context = cast(ValidationContext, info.context)
    return path if "://" in path else str(context.folder / path)  # an address is not a path


def _validate_member(family: type[Family], raw: Any, info: ValidationInfo) -> Any:
    """Build the value of the family member that `kind` names."""
    member_settings = dict(raw) if isinstance(raw, dict) else {}
    kind = member_settings.pop("kind", None)
    member_class = family.members().get(kind) if isinstance(kind, str) else None
    if member_class is None:
        raise PydanticCustomError("kind", "not a member")
    return build_validator(Slot(member_class)).validate_python(
        member_settings, context=info.context
    )


def _construct_value(
    cls: type, raw: Any, check: Callable[[Any], BaseModel], info: ValidationInfo
) -> Any:
    """Construct the value, so that its own checks run after those of its fields."""
    context = cast(ValidationContext, info.context)
    if isinstance(raw, str) and cls in context.readers:
        try:
            return context.readers[cls](context.folder / raw)
        except InvalidFile as error:
            raise ReferencedFileError(error.mistakes) from None
    model = check(raw)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # findings report it with its path
        return cls(**{field: getattr(model, field) for field in model.model_fields_set})
