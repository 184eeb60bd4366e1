"""The checks of a settings file: a pydantic model for each value class, made from its fields."""

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

from dechirp.config.fields import Slot, is_family, is_path, settings
from dechirp.config.quantities import quantity
from dechirp.core.errors import InvalidFile, Mistake
from dechirp.core.families import Family
from dechirp.core.findings import PhysicsWarning

Readers = Mapping[type, Callable[[Path], Any]]


@dataclass(frozen=True)
class Context:
    """What checking needs to know beside the settings."""

    base: Path
    """Folder that relative paths start from."""
    readers: Readers
    """How to read a value that is given as a path."""


class ElsewhereError(ValueError):
    """Another settings file, which this one names, has mistakes."""

    def __init__(self, mistakes: tuple[Mistake, ...]) -> None:
        super().__init__()
        self.mistakes = mistakes


@cache
def checker(slot: Slot) -> TypeAdapter[Any]:
    """Prepare what makes of plain settings what may stand in a slot, given a `Context`."""
    return TypeAdapter(_checked(slot.hint, slot.field, slot.unit))


@cache
def _model(cls: type) -> type[BaseModel]:
    wanted: dict[str, Any] = {}
    for key, setting in settings(cls).items():
        hint = _checked(setting.slot.hint, setting.field, setting.slot.unit)
        default = ... if setting.required else None
        wanted[setting.field] = (hint, Field(default, alias=key))
    return create_model(cls.__name__, __config__=ConfigDict(extra="forbid"), **wanted)


def _checked(hint: Any, field: str, unit: str | None) -> Any:
    """Type of a field, with the checks that belong to it."""
    made: Any = None
    if hint is float:
        made = Annotated[Any, PlainValidator(partial(_number, unit=unit))]
    elif hint is int:
        made = Annotated[int, Strict(), BeforeValidator(_whole)]
    elif hint is bool:
        made = Annotated[bool, Strict()]
    elif hint is str and is_path(field):
        made = Annotated[str, AfterValidator(_beside_the_file)]
    elif hint in (str, type(None)) or get_origin(hint) is Literal:
        made = hint
    elif {get_origin(one) or one for one in get_args(hint)} == {float, tuple}:
        # One number or a list: what is wrong in a list is not told of one number as well.
        tagged = tuple(
            Annotated[_checked(one, field, unit), Tag(str(get_origin(one) is tuple))]
            for one in get_args(hint)
        )
        is_list = Discriminator(lambda raw: str(isinstance(raw, list | tuple)))
        made = Annotated[Union[tagged], is_list]  # noqa: UP007
    elif get_origin(hint) in (Union, UnionType, tuple):
        members = tuple(m if m is Ellipsis else _checked(m, field, unit) for m in get_args(hint))
        whole = get_origin(hint) is tuple
        made = GenericAlias(tuple, members) if whole else Union[members]  # noqa: UP007
    elif is_family(hint):
        made = Annotated[Any, PlainValidator(partial(_member, hint))]
    elif is_dataclass(hint):
        made = Annotated[_model(cast(type, hint)), WrapValidator(partial(_made, cast(type, hint)))]
    else:
        raise TypeError(f"{field}: a settings file has no words for {hint}")
    return made


def _number(raw: Any, *, unit: str | None) -> float:
    if isinstance(raw, bool) or not isinstance(raw, str | int | float):
        raise PydanticCustomError("number", "not a number")
    return quantity(raw if isinstance(raw, str) else repr(raw), unit)


def _whole(raw: Any) -> Any:
    """Take 128.0 for 128, as JSON does: programs that write files may."""
    is_whole = isinstance(raw, float) and raw.is_integer() and abs(raw) < 2**53
    return int(raw) if is_whole else raw


def _beside_the_file(path: str, info: ValidationInfo) -> str:
    context = cast(Context, info.context)
    return path if "://" in path else str(context.base / path)  # an address is no path


def _member(family: type[Family], raw: Any, info: ValidationInfo) -> Any:
    """Make the value of the member of a family that `kind` names."""
    rest = dict(raw) if isinstance(raw, dict) else {}
    kind = rest.pop("kind", None)
    chosen = family.members().get(kind) if isinstance(kind, str) else None
    if chosen is None:
        raise PydanticCustomError("kind", "not a member")
    return checker(Slot(chosen)).validate_python(rest, context=info.context)


def _made(cls: type, raw: Any, check: Callable[[Any], BaseModel], info: ValidationInfo) -> Any:
    """Make the value itself, so that its own checks run once its fields are right."""
    context = cast(Context, info.context)
    if isinstance(raw, str) and cls in context.readers:
        try:
            return context.readers[cls](context.base / raw)
        except InvalidFile as error:
            raise ElsewhereError(error.mistakes) from None
    model = check(raw)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # findings tell it by the setting's path
        return cls(**{field: getattr(model, field) for field in model.model_fields_set})
