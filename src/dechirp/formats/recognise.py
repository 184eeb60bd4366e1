"""Which format reads a path: the content decides, and what the user said."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.ros2_bag import Ros2Bag
from dechirp.formats.samples.sample_order import choose
from dechirp.formats.settings.read import holds_settings


def recognised(
    path: str | Path, format: str | None = None, *, given: Collection[str] = ()
) -> tuple[str, ...]:
    """Kinds of the formats that fit the content of a path: one, or several of bare samples.

    Parameters
    ----------
    path, format
        As `open` takes them.
    given : collection of str
        Which of axes, encoding and iq are given.

    Raises
    ------
    RecordingError
        If none does, or takes what is given, or there is nothing to be read.
    """
    path = Path(path)
    members = _formats(path, format)
    try:
        file, inside = inside_of(path)
        asked = [*given, "inside"] if inside is not None else given
        return tuple(_fitting(file, format, members, asked))
    except OSError as error:
        raise unreadable(path, error) from None


def contents_of(path: Path, wanted: str | None, told: Told) -> tuple[str, Contents]:
    """Kind of the format of a path, and what it holds: the wanted one, else the best fit."""
    formats = _formats(path, wanted)
    said = {name: getattr(told, name) for name in ("axes", "encoding", "iq", "inside")}
    given = [name for name, value in said.items() if value is not None]
    kinds = _fitting(path, wanted, formats, given)
    if len(kinds) == 1:
        (kind,) = kinds
        return kind, _read(path, formats[kind], told)
    # Bare samples: each format that they fit is tried, and the one is taken that leaves the
    # energy in clearly the fewest beat frequencies. If none fits, the first says why.
    found, refused = {}, []
    for kind in kinds:
        try:
            found[kind] = _read(path, formats[kind], told)
        except RecordingError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    names, contents = list(found), list(found.values())
    place, chosen = choose(
        names,
        [one.concentration or 0.0 for one in contents],
        n_samples=max(one.radar.frame.chirp.n_samples for one in contents if one.radar),
        setting="format",
        fix="give --format.",
    )
    best = contents[place]
    return names[place], replace(best, findings=best.findings + chosen)


def _formats(path: Path, wanted: str | None) -> dict[str, Format]:
    """Every format by its kind; an error if the wanted one is none, or cannot be loaded."""
    why = Format.missing_guests().get(wanted) if wanted else None
    if why:
        raise RecordingError(
            path,
            got=f"given with format {wanted!r}, which cannot be loaded ({why})",
            need="given with a format that can be loaded",
            fix="Mend or remove the package that has it.",
        )
    formats: dict[str, Format] = {kind: made() for kind, made in Format.members().items()}
    must_be_one_of(path, "format", wanted, tuple(formats))
    return formats


def _fitting(
    path: Path, wanted: str | None, formats: dict[str, Format], given: Collection[str]
) -> list[str]:
    """Kinds that fit the content best and take what is given; several of bare samples."""
    if not path.exists():
        raise FileNotFoundError(2, "no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise OSError(0, "neither a file nor a folder")
    if path.is_file() and path.stat().st_size == 0:
        got, fits = "an empty file (0 bytes)", {}
    else:
        got = _looks(path)
        asked = [kind for kind, member in formats.items() if wanted == kind or not member.only_told]
        fits = {kind: formats[kind].recognise(path) for kind in asked}
    best = fits.get(wanted, Fit.NO) if wanted else max(fits.values(), default=Fit.NO)
    if best > Fit.NO:
        kinds = [wanted] if wanted else [kind for kind, fit in fits.items() if fit == best]
        return _taking(path, kinds, formats, given)
    fix = "Copy it again from its source, or name what it is with --format (format=...)."
    if path.is_file() and holds_settings(path):
        fix = "Give the recording, and this file with --radar (radar=...)."
    raise RecordingError(
        path,
        got=got,
        need=f"a recording of the format {wanted}, as it is said to be"
        if wanted
        else f"a recording of a format that is read: {', '.join(formats)}",
        fix=fix,
    )


def _taking(
    path: Path, kinds: list[str], formats: dict[str, Format], given: Collection[str]
) -> list[str]:
    """Those kinds that take all that is given; an error if none does."""
    takes = [kind for kind in kinds if set(given) <= set(formats[kind].options)]
    if takes:
        return takes
    kind = kinds[0]
    name = next(name for name in given if name not in formats[kind].options)
    if name == "inside":
        raise RecordingError(
            path,
            got=f"of the format {kind}, with an array named inside",
            need="of a format that holds several",
            fix=f"Name {path.name} itself.",
        )
    raise RecordingError(
        path,
        got=f"in the format {kind}, with {name} given",
        need=f"given without {name}: the format has its own",
        fix=f"Leave out {name}, or name the format it is meant for.",
    )


def _read(path: Path, reader: Format, told: Told) -> Contents:
    """Contents of a path, read by a format that takes what was said of it."""
    must_be_one_of(path, "encoding", told.encoding, reader.encodings)
    return reader.read(path, told)


def inside_of(path: Path) -> tuple[Path, str | None]:
    """Path on disk, and the name of an array in it where one is named below it."""
    if not path.exists():
        for above in path.parents:
            if above.is_file() or Ros2Bag().recognise(above):
                return above, path.relative_to(above).as_posix()
    return path, None


def _looks(path: Path) -> str:
    if path.is_file():
        if holds_settings(path):
            return "the settings of a recording, not its samples"
        return foreign(path) or "bytes without a mark of their kind"
    names = sorted(file.name for file in path.iterdir())
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return f"a folder with {', '.join(names[:8]) or 'nothing'}{more}"


def must_be_one_of(path: Path, name: str, got: str | None, choices: tuple[str, ...]) -> None:
    """Raise `RecordingError` if something was given that is none of the choices."""
    if got is not None and got not in choices:
        raise RecordingError(
            path,
            got=f"given with {name} {got!r}",
            need=f"given with {name} one of {', '.join(choices)}",
            fix="Choose one of them.",
        )


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Say in our words why the system did not let it be read."""
    return RecordingError(
        path,
        got=f"not readable ({error.strerror or error})",
        need="a file or folder that can be read",
        fix="Check its name and who may read it.",
    )
