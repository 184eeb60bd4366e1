"""Options that several commands take."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

Json: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        show_default=False,
        help="Print one JSON document, and nothing else, on standard output.",
    ),
]
# Read as text: the parser of the command line would take 1.5 for a whole number.
Whole: TypeAlias = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
Quiet: TypeAlias = Annotated[
    bool, Parameter(name="--quiet", show_default=False, help="Print nothing but mistakes.")
]

Pdf: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--pdf",
        show_default=False,
        help="Write each page as PDF as well; needs the extra pdf.",
    ),
]


@Parameter(name="*")
@dataclass(kw_only=True, frozen=True)
class Told:
    """What a call says of a recording, where its file does not say it, and what it reads."""

    radar: Annotated[
        Path | None, Parameter(help="Settings of the radar: YAML, or a vendor's file.")
    ] = None
    frames: Annotated[
        str | None,
        Parameter(help="N, the first so many, or A:B, from A to before B; counted from 0."),
    ] = None
    device: Annotated[str | None, Parameter(help="Chip or board of the radar, as xwr1843.")] = None
    format: Annotated[
        str | None, Parameter(help="Kind of the recording, where it does not tell.")
    ] = None
    axes: Annotated[
        str | None, Parameter(help="Axes of a bare array in order, as chirp,rx,sample.")
    ] = None
    encoding: Annotated[
        str | None,
        Parameter(help="How the numbers of a bare array are meant, as uint16-wrapped."),
    ] = None
    iq: Annotated[
        Literal["iq", "qi"] | None, Parameter(help="Part of a complex sample that comes first.")
    ] = None
    calibration: Annotated[
        Path | None, Parameter(help="Calibration of the array, a file of dechirp calibrate.")
    ] = None

    def given(self) -> dict[str, Any]:
        """Options that were given, as `dechirp.open` takes them."""
        from dechirp.cli.sources import frames_of

        part = {} if self.frames is None else {"frames": frames_of(self.frames)}
        return {"radar": self.radar, **self.of_file(), **part}

    def of_file(self) -> dict[str, Any]:
        """Those of them that say what the file does not."""
        made = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.axes is not None:
            made["axes"] = tuple(self.axes.replace(",", " ").split())
        apart = ("radar", "frames")
        return {name: of for name, of in made.items() if of is not None and name not in apart}


NOTHING_TOLD = Told()


def whole_number(option: str, text: str, at_least: int, at_most: int) -> int:
    """Whole number of an option; raises `InvalidSetting` for anything else."""
    from dechirp.core.checks import whole
    from dechirp.core.errors import InvalidSetting

    try:
        number = int(text)
    except ValueError:
        raise InvalidSetting(
            option,
            got=text,
            need=f"a whole number from {at_least} to {at_most}",
            fix="Write its digits alone.",
        ) from None
    whole(option, number, at_least=at_least, at_most=at_most)
    return number
