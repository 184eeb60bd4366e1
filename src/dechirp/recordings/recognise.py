"""Format recognition of a path, from its content and the options of the user."""

from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.recordings.foreign_files import (
    describe_foreign_file,
    identify_foreign_file,
    read_head,
    stand_in_error,
)
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    experimental_reader_warning,
    identify_non_raw_content,
)
from dechirp.recordings.readers.ros2_bag import Ros2Bag
from dechirp.recordings.samples.sample_order import choose_sample_order
from dechirp.recordings.settings.read import holds_settings

# Files of a folder that are looked at, to name the recordings among them.
_MAX_TRIED_FILES = 32


def recognise_formats(
    path: str | Path, format: str | None = None, *, given_options: Collection[str] = ()
) -> tuple[str, ...]:
    """Return the kinds of the formats that fit a path: one, or several for raw samples.

    Parameters
    ----------
    path, format
        As for `open`.
    given_options : collection of str
        Names of the specified options: of axes, encoding and iq.

    Raises
    ------
    RecordingError
        If no format fits or accepts the given options, or there is nothing to read.
    """
    path = Path(path)
    members = _load_all_formats_by_kind(path, format)
    try:
        file, inner_name = split_file_and_inner_path(path)
        options = [*given_options, "inner_name"] if inner_name is not None else given_options
        return tuple(_best_fitting_format_names(file, format, members, options))
    except OSError as error:
        raise unreadable_path_error(path, error) from None


def read_as_best_format(
    path: Path, wanted_format: str | None, hints: RecordingHints
) -> tuple[str, Contents]:
    """Return format kind and contents of a path, read as the wanted or best-fitting format."""
    formats = _load_all_formats_by_kind(path, wanted_format)
    options = {name: getattr(hints, name) for name in ("axes", "encoding", "iq", "inner_name")}
    given_options = [name for name, value in options.items() if value is not None]
    kinds = _best_fitting_format_names(path, wanted_format, formats, given_options)
    if len(kinds) == 1:
        (kind,) = kinds
        return kind, _read_as_format(path, formats[kind], hints)
    # Raw samples: the format whose energy lies in clearly the fewest beat frequencies is chosen.
    # If all fail, the first error is raised.
    contents_by_kind, errors = {}, []
    for kind in kinds:
        try:
            contents_by_kind[kind] = _read_as_format(path, formats[kind], hints)
        except RecordingError as error:
            errors.append(error)
    if not contents_by_kind:
        raise errors[0]
    names, contents = list(contents_by_kind), list(contents_by_kind.values())
    best_index, order_findings = choose_sample_order(
        names,
        [candidate.concentration or 0.0 for candidate in contents],
        n_samples=max(
            candidate.radar.frame.chirp.n_samples for candidate in contents if candidate.radar
        ),
        setting="format",
        fix="give --format",
    )
    best_contents = contents[best_index]
    return names[best_index], replace(
        best_contents, findings=best_contents.findings + order_findings
    )


def _load_all_formats_by_kind(path: Path, wanted_format: str | None) -> dict[str, Format]:
    """Return all formats by kind; raise an error if the wanted one is unknown or not loadable."""
    reason = Format.failed_plugins().get(wanted_format) if wanted_format else None
    if reason:
        raise RecordingError(
            path,
            value=f"format {wanted_format!r}, which cannot be loaded ({reason})",
            expected="a format that can be loaded",
            fix="repair or remove the package that provides it",
        )
    formats: dict[str, Format] = {
        kind: format_class() for kind, format_class in Format.members().items()
    }
    check_choice(path, "format", wanted_format, tuple(formats))
    return formats


def _best_fitting_format_names(
    path: Path,
    wanted_format: str | None,
    formats: dict[str, Format],
    given_options: Collection[str],
) -> list[str]:
    """Return the best fitting kinds that accept the given options; several for raw samples."""
    error = stand_in_error(path)
    if error is not None:
        raise error
    if not path.exists():
        # From Python 3.14 on, a name that is too long does not exist; `stat` gives the reason.
        with suppress(FileNotFoundError, NotADirectoryError, ValueError):
            path.stat()
        raise FileNotFoundError(2, "no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise OSError(0, "neither a file nor a folder")
    is_empty = path.is_file() and path.stat().st_size == 0
    if is_empty:
        qualities = {}
    else:
        candidates = [
            kind
            for kind, member in formats.items()
            if wanted_format == kind or not member.must_be_named
        ]
        qualities = {kind: formats[kind].recognise(path) for kind in candidates}
    best = (
        qualities.get(wanted_format, MatchQuality.NO)
        if wanted_format
        else max(qualities.values(), default=MatchQuality.NO)
    )
    if best > MatchQuality.NO:
        kinds = (
            [wanted_format]
            if wanted_format
            else [kind for kind, quality in qualities.items() if quality == best]
        )
        return _format_names_accepting_options(path, kinds, formats, given_options)
    content, fix = (
        ("an empty file (0 bytes)", "copy it again from its source")
        if is_empty
        else _describe_path_content_and_fix(path)
    )
    if wanted_format:
        expected = f"a recording of the format {wanted_format}"
    elif fix:
        expected = "a recording of one of the formats of `dechirp list format`"
    else:
        expected = f"a recording of one of the formats {', '.join(formats)}"
    named = "another format" if wanted_format else "its format"
    raise RecordingError(
        path,
        value=content,
        expected=expected,
        fix=fix or f"copy it again from its source, or give {named}: --format (format=...)",
    )


def _format_names_accepting_options(
    path: Path, format_names: list[str], formats: dict[str, Format], given_options: Collection[str]
) -> list[str]:
    """Return the kinds that accept all given options; raise an error if there is none."""
    accepting = [kind for kind in format_names if set(given_options) <= set(formats[kind].options)]
    if accepting:
        return accepting
    kind = format_names[0]
    name = next(name for name in given_options if name not in formats[kind].options)
    if name == "inner_name":
        raise RecordingError(
            path,
            value=f"format {kind}, with the name of an array inside it",
            expected="a format that contains several arrays",
            fix=f"give {path.name} itself",
        )
    raise RecordingError(
        path,
        value=f"format {kind}, with {name}",
        expected=f"no {name}, which this format defines itself",
        fix=f"remove {name}, or give a format that accepts it",
    )


def _read_as_format(path: Path, reader: Format, hints: RecordingHints) -> Contents:
    """Read the contents of a path with a format and the given hints."""
    check_choice(path, "encoding", hints.encoding, reader.encodings)
    try:
        contents = reader.read(path, hints)
    except RecordingError as error:
        # A file beside or inside the recording may be a pointer, as a folder's `radar.npy`.
        raise stand_in_error(Path(str(error.mistakes[0].file))) or error from None
    if not reader.experimental:
        return contents
    warning = experimental_reader_warning(reader.kind())
    return replace(contents, findings=(*contents.findings, warning))


def split_file_and_inner_path(path: Path) -> tuple[Path, str | None]:
    """Split a path into that of a file and the name of an array in it, if one is named."""
    if not path.exists():
        for parent in path.parents:
            if parent.is_file() or Ros2Bag().recognise(parent):
                return parent, path.relative_to(parent).as_posix()
    return path, None


def _describe_path_content_and_fix(path: Path) -> tuple[str, str | None]:
    """Describe a path of which no format fits, and return the fix if one is known."""
    if path.is_file():
        if holds_settings(path):
            return (
                "the settings of a recording, not its samples",
                "give the recording, and this file with --radar (radar=...)",
            )
        kind = identify_foreign_file(read_head(path))
        if kind is not None:
            return describe_foreign_file(path, kind), kind.fix
        return identify_non_raw_content(path) or "bytes without a known signature", None
    names = sorted(file.name for file in path.iterdir())
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    recognised = [file for file in sorted(path.iterdir())[:_MAX_TRIED_FILES] if _is_recording(file)]
    fix = (
        "give one file of it: " + ", ".join(file.name for file in recognised[:3])
        if recognised
        else None
    )
    return f"a folder with {', '.join(names[:8]) or 'nothing'}{more}", fix


def _is_recording(path: Path) -> bool:
    """Return whether a format fits a file of a folder."""
    try:
        return path.is_file() and not holds_settings(path) and bool(recognise_formats(path))
    except RecordingError:
        return False


def check_choice(path: Path, name: str, value: str | None, choices: tuple[str, ...]) -> None:
    """Raise `RecordingError` if a given value is not one of the choices."""
    if value is not None and value not in choices:
        raise RecordingError(
            path,
            value=f"{name} {value!r}",
            expected=f"one of {', '.join(choices)}",
            fix="choose one of them",
        )


def unreadable_path_error(path: Path, error: OSError) -> RecordingError:
    """Convert an operating-system error to a `RecordingError`."""
    return RecordingError(
        path,
        value=f"not readable ({error.strerror or error})",
        expected="a readable file or folder",
        fix="check its name and permissions",
    )
