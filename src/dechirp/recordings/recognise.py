"""Format recognition of a path, from its content and the options of the user."""

import os
import re
import shlex
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import join_names
from dechirp.recordings.foreign_files import (
    examine_zip_archive,
    identify_foreign_file,
    is_text,
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
from dechirp.recordings.readers.float_points import FloatPoints
from dechirp.recordings.readers.ros2_bag import Ros2Bag
from dechirp.recordings.samples.sample_order import choose_sample_order
from dechirp.recordings.settings.read import holds_settings, read_radar
from dechirp.recordings.slow_time_files import read_slow_time

# Files of a folder that are looked at, to find the recordings among them; each takes 2 to 5 ms.
_MAX_TRIED_FILES = 256
# Samples of a chirp, or chirps, below which an array with two axes is a table.
_MIN_CHIRP_VALUES = 8
# Files that file managers of macOS and Windows leave in folders.
_FILES_OF_FILE_MANAGERS = ("thumbs.db", "desktop.ini")
_SUFFIXES_OF_TEXT_TABLES = {".csv", ".txt", ".tsv"}
_MIN_TABLE_QUANTITIES = 5
_SUFFIXES_OF_SLOW_TIME = {".csv", ".h5", ".hdf5"}
# Damaged ones have no signature, and are no raw samples either.
_SUFFIXES_WITHOUT_SAMPLES = {
    *(".bmp", ".gif", ".heic", ".jpeg", ".jpg", ".png", ".svg", ".tif", ".tiff", ".webp"),
    *(".avi", ".mkv", ".mov", ".mp4", ".pdf", ".pyc"),
}


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
    wanted_format = format_or_points(wanted_format, hints.axes)
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


def format_or_points(wanted_format: str | None, axes: Collection[str] | None) -> str | None:
    """Return the wanted format; without one, that of points if the axes name their numbers."""
    is_points = wanted_format is None and axes is not None and {"x", "y"} <= {*axes}
    return FloatPoints.kind() if is_points else wanted_format


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
        with _name_file_that_needs_extra(path):
            qualities = {kind: formats[kind].recognise(path) for kind in candidates}
    best = (
        qualities.get(wanted_format, MatchQuality.NO)
        if wanted_format
        else max(qualities.values(), default=MatchQuality.NO)
    )
    if wanted_format == FloatPoints.kind() and "axes" in given_options and not is_empty:
        best = MatchQuality.POSSIBLE  # the names of their numbers describe points of any kind
    if best > MatchQuality.NO:
        kinds = (
            [wanted_format]
            if wanted_format
            else [kind for kind, quality in qualities.items() if quality == best]
        )
        accepting = _format_names_accepting_options(path, kinds, formats, given_options)
        if best >= MatchQuality.CONTAINER and len(accepting) > 1:
            raise RecordingError(
                path,
                value=f"a recording of several formats: {join_names(accepting)}",
                expected="a single one",
                fix=f"give one of them: --format {accepting[0]} (format={accepting[0]!r})",
            )
        return accepting
    content, fix = (
        ("an empty file (0 bytes)", "copy it again from its source")
        if is_empty
        else _describe_path_content_and_fix(path)
    )
    named = "another format" if wanted_format else "its format"
    raise RecordingError(
        path,
        value=content,
        expected=f"a recording of the format {wanted_format}"
        if wanted_format
        else "a recording of one of the formats of `dechirp list format`",
        fix=fix or f"give the recording; if this is one, give {named}: --format (format=...)",
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
        with _name_file_that_needs_extra(path):
            contents = reader.read(path, hints)
    except RecordingError as error:
        # A file beside or inside the recording may be a pointer, as a folder's `radar.npy`.
        stand_in = stand_in_error(Path(str(error.mistakes[0].file)))
        raise stand_in or _slow_time_error(path) or error from None
    if not reader.experimental:
        return contents
    warning = experimental_reader_warning(reader.kind())
    return replace(contents, findings=(*contents.findings, warning))


@contextmanager
def _name_file_that_needs_extra(path: Path) -> Iterator[None]:
    """Add the path to the error of a reader whose extra is missing."""
    try:
        yield
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if mistake.setting != "recording":
            raise
        raise InvalidSetting(
            mistake.setting,
            value=mistake.value,
            expected=mistake.expected,
            fix=mistake.fix,
            file=str(path),
        ) from None


def _slow_time_error(path: Path) -> RecordingError | None:
    """Return the error of a slow-time file, opened as a recording; None for another file."""
    if path.suffix.lower() not in _SUFFIXES_OF_SLOW_TIME:
        return None
    try:
        read_slow_time(path)
    except RecordingError:
        return None
    return RecordingError(
        path,
        value="I/Q values of range cells over time, without chirps",
        expected="a recording with chirps",
        fix=f"measure breathing and heart rate: dechirp run {shlex.quote(str(path))} --vital-signs",
    )


def split_file_and_inner_path(path: Path) -> tuple[Path, str | None]:
    """Split a path into that of a file and the name of an array in it, if one is named."""
    if not path.exists():
        for parent in path.parents:
            if parent.is_file() or Ros2Bag().recognise(parent):
                return parent, path.relative_to(parent).as_posix()
    return path, None


def _describe_radar(settings_file: Path) -> str:
    """Describe the radar of a settings file, or why it cannot be read, to end a sentence."""
    try:
        radar = read_radar(settings_file)
    except DechirpError as error:
        mistake = error.mistakes[0]
        return f", and they cannot be read: {mistake.setting}: {mistake.value}"
    return f": {str(radar).removeprefix('Radar(').removesuffix(')')}"


def _describe_path_content_and_fix(path: Path) -> tuple[str, str | None]:
    """Describe a path of which no format fits, and return the fix if one is known."""
    if path.is_file():
        if holds_settings(path):
            return (
                f"the settings of a recording, not its samples{_describe_radar(path)}",
                "give the recording, and this file with --radar (radar=...)",
            )
        kind = identify_foreign_file(read_head(path))
        if kind is not None:
            kind = examine_zip_archive(path, kind)
            is_sigmf = path.suffixes[-2:-1] == [".sigmf"]  # x.sigmf.gz, .xz and .zip
            content = " of a SigMF recording" if is_sigmf else ""
            return kind.description + content, kind.fix
        if is_text(read_head(path)):
            return "a text document", "give the recording, or the folder that contains it"
        return identify_non_raw_content(path) or "bytes without a known signature", None
    return _describe_folder_and_fix(path)


def find_recording_in_folder(
    path: Path, wanted_format: str | None, hints: RecordingHints
) -> tuple[Path, tuple[Finding, ...]]:
    """Return the recording in a folder, or the first of several, and a note on the other files.

    Return the path itself if it is no folder, or a folder that a format reads as a whole. Settings,
    documents and pictures are no recordings, nor are tables of another file type that cannot be
    read as one, such as the truth.

    Raises
    ------
    RecordingError
        If the folder contains no recording that can be read as given.
    """
    try:
        return _find_recording_in_folder(path, wanted_format, hints)
    except OSError as error:
        raise unreadable_path_error(Path(error.filename or path), error) from None


def _find_recording_in_folder(
    path: Path, wanted_format: str | None, hints: RecordingHints
) -> tuple[Path, tuple[Finding, ...]]:
    """Find the recording as `find_recording_in_folder` does, which converts operating errors."""
    if not path.is_dir():
        return path, ()
    formats = _load_all_formats_by_kind(path, wanted_format)
    if any(
        member.recognise(path)
        for kind, member in formats.items()
        if wanted_format == kind or not member.must_be_named
    ):
        return path, ()
    is_points = format_or_points(wanted_format, hints.axes) == FloatPoints.kind()
    if is_points and len({file.suffix for file in _list_folder(path)}) == 1:
        return path, ()
    candidates = _list_recordings(path, wanted_format, hints)
    tables = [
        file
        for file in candidates
        if len(candidates) > 1 and _is_table(file) and _slow_time_error(file) is None
    ]
    candidates = [file for file in candidates if file not in tables]
    if len(candidates) == 1 and not tables:
        return candidates[0], ()
    unreadable = dict.fromkeys(tables, "a table of numbers")
    if len({file.suffix for file in candidates}) > 1:
        for file in candidates:
            if not file.is_file() or identify_non_raw_content(file) is None:
                continue
            try:
                read_as_best_format(file, wanted_format, hints)
            except DechirpError as error:
                unreadable[file] = error.mistakes[0].value
    readable = [file for file in candidates if file not in unreadable]
    unreadable_suffixes = {file.suffix for file in unreadable if file not in tables}
    if len(readable) == 1 and readable[0].suffix not in unreadable_suffixes:
        values = (f"{file.name} ({value})" for file, value in unreadable.items())
        note = Finding(
            level="note",
            setting="recording",
            value=f"{readable[0].name} of the folder; not read: {join_names(values)}",
            expected="one recording in the folder",
            fix="no action needed; to read another file, give its path",
        )
        return readable[0], (note,)
    if candidates:
        return _first_readable_recording(path, candidates, wanted_format, hints)
    for file in _list_folder(path)[:_MAX_TRIED_FILES]:
        stand_in = stand_in_error(file)
        if stand_in is not None:
            raise stand_in
    value, fix = _describe_folder_and_fix(path)
    raise RecordingError(path, value=value, expected="a folder with a recording", fix=fix)


def _first_readable_recording(
    folder: Path, candidates: list[Path], wanted_format: str | None, hints: RecordingHints
) -> tuple[Path, tuple[Finding, ...]]:
    """Return the first of several recordings that can be read, and a note on the others.

    Numbers in names count by their value. Files whose format was recognised but that cannot be
    read as given, such as captures of commands, are passed over.
    """
    ordered = sorted(candidates, key=_natural_order)
    errors: dict[Path, DechirpError] = {}
    for file in ordered:
        try:
            read_as_best_format(file, wanted_format, hints)
        except DechirpError as error:
            errors[file] = error
            continue
        others = [other for other in ordered if other != file]
        example = next((other for other in others if other not in errors), None)
        note = Finding(
            level="note",
            setting="recording",
            value=f"chosen {file.name}, the first of {len(ordered)} recordings of the folder"
            f"{' that can be read' if errors else ''}; others:"
            f" {join_names(other.name for other in others)}",
            expected="one recording, since each may be of another scene",
            fix="no action needed: the others cannot be read as given"
            if example is None
            else f"give the path of another one: {shlex.quote(str(example))}",
        )
        return file, (note,)
    # A capture of commands, or one that was stopped at once, is smaller than the others.
    example = max(candidates, key=lambda file: file.stat().st_size)
    raise RecordingError(
        folder,
        value=f"a folder with {len(candidates)} recordings:"
        f" {join_names(file.name for file in candidates)}",
        expected="a recording that can be read as given",
        fix=_command_for_recording(example, errors[example]),
    )


def _natural_order(file: Path) -> str:
    """Return the sort key of a name, by which walk_2 comes before walk_10."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(20), file.name)


def _command_for_recording(recording: Path, error: DechirpError) -> str:
    """Return the command for one recording of several, and what it needs beside."""
    advice = f"give one of them: dechirp run {shlex.quote(str(recording))}"
    if recording.is_dir():
        return advice
    if _slow_time_error(recording) is not None:
        return f"{advice} --vital-signs"
    return f"{advice}; for this one, {error.mistakes[0].fix}"


def _is_table(file: Path) -> bool:
    """Return True for a table of values of other quantities than samples: NumPy, or text."""
    if file.suffix.lower() == ".npy":
        return _is_table_of_numpy(file)
    return file.suffix.lower() in _SUFFIXES_OF_TEXT_TABLES and _is_text_table(file)


def _is_table_of_numpy(file: Path) -> bool:
    """Return True for a NumPy file of numbers without chirps: a column, or rows of few values.

    ADC words of 16 bits and complex samples are often stored in one column.
    """
    try:
        array = np.load(file, mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return False
    few = array.ndim < 2 or (array.ndim == 2 and min(array.shape) < _MIN_CHIRP_VALUES)
    return few and array.dtype.kind != "c" and array.dtype.itemsize > 2


def _is_text_table(file: Path) -> bool:
    """Return True for text whose heading names five quantities or more.

    Samples have at most a time, I, Q and a sync; digits only number their channels.
    """
    head = read_head(file).decode("utf-8", "replace").lstrip("\ufeff#% ")
    names = re.split(r"[,;\t]", head.partition("\n")[0])
    quantities = {re.sub(r"[\d\W_]+", "", name).lower() for name in names}
    return len(quantities - {""}) >= _MIN_TABLE_QUANTITIES and not any(map(_is_number, names))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _list_folder(path: Path) -> list[Path]:
    """Return the files and folders in a folder, without hidden ones."""
    return sorted(
        file
        for file in path.iterdir()
        if not file.name.startswith(".") and file.name.lower() not in _FILES_OF_FILE_MANAGERS
    )


def _list_recordings(path: Path, wanted_format: str | None, hints: RecordingHints) -> list[Path]:
    """Return the recordings in a folder; of several files of one recording, the leading one."""
    given_options = [name for name in ("axes", "encoding", "iq") if getattr(hints, name)]
    wanted_format = format_or_points(wanted_format, hints.axes)
    leading_files = {}
    for file in _list_folder(path)[:_MAX_TRIED_FILES]:
        if file.exists() and not os.access(file, os.R_OK):
            leading_files[file] = {file}  # may be a recording: `read` reports the reason
            continue
        try:
            # `dechirp run` writes its results into the folder in which it is called.
            is_result = (file / "run.json").is_file()
            if (
                is_result
                or file.suffix.lower() in _SUFFIXES_WITHOUT_SAMPLES
                or holds_settings(file)
            ):
                continue
            kinds = recognise_formats(file, wanted_format, given_options=given_options)
        except RecordingError:
            continue
        leading_files[file] = {Format.members()[kind]().leading_file(file, hints) for kind in kinds}
    return [
        file
        for file, leading in leading_files.items()
        if not (leading - {file}) & leading_files.keys()
    ]


def _describe_folder_and_fix(path: Path) -> tuple[str, str]:
    """Describe a folder without a recording, and how to go on."""
    members = _list_folder(path)
    settings = [file for file in members if holds_settings(file)]
    others = [file for file in members if file not in settings]
    content = join_names(file.name + _reason_for_no_content(file) for file in others)
    folders = [shlex.quote(str(file)) for file in others if file.is_dir()]
    foreign = ""
    for file in others[:_MAX_TRIED_FILES]:
        kind = identify_foreign_file(read_head(file)) if file.is_file() else None
        if kind is not None and kind.fix is not None:
            kind = examine_zip_archive(file, kind)
            foreign = f"; {file.name} is {kind.description}: {kind.fix}"
            break
    if settings:
        names = join_names(file.name for file in settings)
        is_named = bool(foreign or folders or "bytes)" in content)
        return (
            f"a folder with the settings of a recording, without its samples: {names}"
            + f"; beside {content}" * is_named,
            "copy the recording into the folder, or give it with its settings: dechirp run"
            f" {folders[0] if folders else 'RECORDING'} --radar {shlex.quote(str(settings[0]))}"
            + foreign,
        )
    value = f"a folder with {content}, no recording among them" if content else "an empty folder"
    fix = "give the recording, or the folder that contains it"
    return value, f"{fix}: dechirp run {folders[0]}" if folders else fix + foreign


def _reason_for_no_content(file: Path) -> str:
    """Return why a file has no content, in brackets; nothing for others."""
    if file.is_symlink() and not file.exists():
        return " (broken link)"
    return " (0 bytes)" if file.is_file() and file.stat().st_size == 0 else ""


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
