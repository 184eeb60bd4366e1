"""Options that several commands share."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

Json: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        show_default=False,
        help="Print a single JSON document on standard output.",
    ),
]
# Read as text: the command-line parser would accept 1.5 as an integer.
IntegerText: TypeAlias = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
Quiet: TypeAlias = Annotated[
    bool, Parameter(name="--quiet", show_default=False, help="Print only errors.")
]

Pdf: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--pdf",
        show_default=False,
        help="Also write each page as PDF; requires the extra pdf and the library Pango.",
    ),
]


@Parameter(name="*")
@dataclass(kw_only=True, frozen=True)
class RecordingOptions:
    """Options for a recording: the frames to read, and metadata missing from its file."""

    radar: Annotated[Path | None, Parameter(help="Radar settings: YAML, or a vendor's file.")] = (
        None
    )
    frames: Annotated[
        str | None,
        Parameter(help="Frames to read: N for the first N, or A:B (zero-based, B excluded)."),
    ] = None
    device: Annotated[
        str | None, Parameter(help="Chip or board of the radar, such as xwr1843.")
    ] = None
    format: Annotated[
        str | None, Parameter(help="Format of the recording, if it cannot be recognised.")
    ] = None
    axes: Annotated[
        str | None, Parameter(help="Axes of a bare array in order, such as chirp,rx,sample.")
    ] = None
    encoding: Annotated[
        str | None,
        Parameter(help="Number encoding of a bare array, such as uint16-wrapped."),
    ] = None
    iq: Annotated[
        Literal["iq", "qi"] | None, Parameter(help="Order of I and Q in a complex sample.")
    ] = None
    calibration: Annotated[
        Path | None, Parameter(help="Calibration of the array, written by dechirp calibrate.")
    ] = None

    def open_keyword_arguments(self) -> dict[str, Any]:
        """Return the given options as keyword arguments of `dechirp.open`."""
        options = {"radar": self.radar, **self.given_metadata()}
        if self.frames is None:
            return options
        from dechirp.cli.scenario_source import parse_frame_range  # 0.3 s of imports

        return {**options, "frames": parse_frame_range(self.frames)}

    def given_metadata(self) -> dict[str, Any]:
        """Return the given options that complete the metadata of the file."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.axes is not None:
            values["axes"] = tuple(self.axes.replace(",", " ").split())
        excluded = ("radar", "frames")
        return {
            name: value
            for name, value in values.items()
            if value is not None and name not in excluded
        }


NO_OPTIONS = RecordingOptions()


def parse_integer_option(option: str, text: str, at_least: int, at_most: int) -> int:
    """Parse the integer value of an option; raise `InvalidSetting` if it is not one."""
    from dechirp.core.checks import check_integer
    from dechirp.core.errors import InvalidSetting

    try:
        number = int(text)
    except ValueError:
        raise InvalidSetting(
            option,
            value=text,
            expected=f"a whole number from {at_least} to {at_most}",
            fix="write only its digits",
        ) from None
    check_integer(option, number, at_least=at_least, at_most=at_most)
    return number
