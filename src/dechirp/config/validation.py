"""Validation of settings files, and their JSON Schema for editors.

pydantic does both with a model for each value class, built from its fields.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
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
    GetJsonSchemaHandler,
    Strict,
    Tag,
    TypeAdapter,
    ValidationInfo,
    WrapValidator,
    create_model,
)
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import CoreSchema, with_info_plain_validator_function

from dechirp.config.fields import ValueType, is_family_type, is_path_field, list_settings
from dechirp.config.quantities import parse_quantity
from dechirp.config.schema import (
    REFERENCE,
    TEXT,
    Schema,
    add_kind_and_meanings,
    any_of_schema,
    quantity_schema,
    schema_by_kind,
    schema_document,
)
from dechirp.core.dimensions import DIMENSIONS
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


@dataclass(frozen=True)
class _SettingType:
    """Type of settings that a function parses; pydantic defines its JSON Schema once."""

    name: str
    parse: Callable[[Any, ValidationInfo], Any]
    build_schema: Callable[[GetJsonSchemaHandler], Schema]

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        return with_info_plain_validator_function(self.parse, ref=self.name)

    def __get_pydantic_json_schema__(
        self, _core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Schema:
        return self.build_schema(handler)


@cache
def build_validator(value_type: ValueType) -> TypeAdapter[Any]:
    """Build the validator of a type: from plain data to a value, given a `ValidationContext`."""
    return TypeAdapter(_type_with_validators(value_type.hint, value_type.field, value_type.unit))


def build_file_schema(cls: type, *, path_readable_types: Iterable[type] = ()) -> Schema:
    """Build the schema of files that describe a value of a class."""
    (name,), definitions = build_definitions([ValueType(cls)], path_readable_types)
    return schema_document(f"{cls.__name__} of dechirp", definitions.pop(name), definitions)


def build_definitions(
    value_types: Sequence[ValueType], path_readable_types: Iterable[type] = ()
) -> tuple[list[str], dict[str, Schema]]:
    """Build the schemas of types: the name of each, and the definitions by name.

    Values of `path_readable_types` may be the path of a file.
    """
    adapters = map(build_validator, [*value_types, *map(ValueType, path_readable_types)])
    schemas, document = TypeAdapter.json_schemas(
        (place, "validation", adapter) for place, adapter in enumerate(adapters)
    )
    names = [schema["$ref"].removeprefix(REFERENCE) for schema in schemas.values()]
    definitions = document["$defs"]
    for name in names[len(value_types) :]:
        definitions[name] = any_of_schema([TEXT, definitions[name]])
    return names[: len(value_types)], definitions


@cache
def _build_pydantic_model(cls: type) -> type[BaseModel]:
    model_fields: dict[str, Any] = {}
    for key, setting in list_settings(cls).items():
        hint = _type_with_validators(
            setting.value_type.hint, setting.field, setting.value_type.unit
        )
        default = ... if setting.is_required else None
        model_fields[setting.field] = (hint, Field(default, alias=key))
    # Before its version 2.10, pydantic warns of fields such as `model_time_s`.
    config = ConfigDict(
        extra="forbid",
        protected_namespaces=(),
        json_schema_extra=partial(add_kind_and_meanings, cls),
    )
    return create_model(cls.__name__, __config__=config, **model_fields)


def _type_with_validators(type_hint: Any, field: str, unit_suffix: str | None) -> Any:
    """Return the annotated type of a field with its checks."""
    annotation: Any = None
    if type_hint is float:
        annotation = _quantity_type(unit_suffix)
    elif type_hint is int:
        annotation = Annotated[int, Strict(), BeforeValidator(_whole_float_to_int)]
    elif type_hint is bool:
        annotation = Annotated[bool, Strict()]
    elif type_hint is str and is_path_field(field):
        annotation = Annotated[str, AfterValidator(_resolve_relative_path)]
    elif type_hint in (str, type(None)) or get_origin(type_hint) is Literal:
        annotation = type_hint
    elif {get_origin(argument) or argument for argument in get_args(type_hint)} == {float, tuple}:
        # A number or a list: tagged, so that a mistake in a list is reported once.
        tagged = tuple(
            Annotated[
                _type_with_validators(argument, field, unit_suffix),
                Tag(str(get_origin(argument) is tuple)),
            ]
            for argument in get_args(type_hint)
        )
        is_list = Discriminator(lambda raw: str(isinstance(raw, list | tuple)))
        annotation = Annotated[Union[tagged], is_list]  # noqa: UP007
    elif get_origin(type_hint) in (Union, UnionType, tuple):
        members = tuple(
            m if m is Ellipsis else _type_with_validators(m, field, unit_suffix)
            for m in get_args(type_hint)
        )
        is_tuple = get_origin(type_hint) is tuple
        annotation = GenericAlias(tuple, members) if is_tuple else Union[members]  # noqa: UP007
    elif is_family_type(type_hint):
        annotation = _family_type(type_hint)
    elif is_dataclass(type_hint):
        annotation = Annotated[
            _build_pydantic_model(cast(type, type_hint)),
            WrapValidator(partial(_construct_from_mapping_or_path, cast(type, type_hint))),
        ]
    else:
        raise TypeError(f"{field}: settings files cannot express {type_hint}")
    return annotation


@cache
def _quantity_type(unit_suffix: str | None) -> _SettingType:
    return _SettingType(
        unit_suffix or "ratio",
        partial(_parse_quantity_or_number, unit_suffix),
        lambda _: quantity_schema(DIMENSIONS[unit_suffix]),
    )


def _parse_quantity_or_number(unit_suffix: str | None, raw: Any, _: ValidationInfo) -> float:
    if isinstance(raw, bool) or not isinstance(raw, str | int | float):
        raise PydanticCustomError("number", "not a number")
    return parse_quantity(raw if isinstance(raw, str) else repr(raw), unit_suffix)


def _whole_float_to_int(raw: Any) -> Any:
    """Accept 128.0 for 128, as JSON does: programs may write it."""
    is_whole = isinstance(raw, float) and raw.is_integer() and abs(raw) < 2**53
    return int(raw) if is_whole else raw


def _resolve_relative_path(path: str, info: ValidationInfo) -> str:
    context = cast(ValidationContext, info.context)
    return path if "://" in path else str(context.folder / path)  # an address is not a path


@cache
def _family_type(family: type[Family]) -> _SettingType:
    return _SettingType(
        family.group.removeprefix("dechirp."),
        partial(_build_family_member, family),
        lambda handler: schema_by_kind(
            {
                kind: handler(build_validator(ValueType(member)).core_schema)
                for kind, member in family.members().items()
            }
        ),
    )


def _build_family_member(family: type[Family], raw: Any, info: ValidationInfo) -> Any:
    """Build the value of the family member that `kind` names."""
    member_settings = dict(raw) if isinstance(raw, dict) else {}
    kind = member_settings.pop("kind", None)
    member_class = family.members().get(kind) if isinstance(kind, str) else None
    if member_class is None:
        raise PydanticCustomError("kind", "not a member")
    return build_validator(ValueType(member_class)).validate_python(
        member_settings, context=info.context
    )


def _construct_from_mapping_or_path(
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
