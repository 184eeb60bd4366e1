"""Conversion of recordings between formats; the file name selects the format."""

from dataclasses import replace
from pathlib import Path

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.suggestions import did_you_mean_fix, nearest_name
from dechirp.recordings.frame_subset import renumber_frames_from_zero
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress, Writer


@check_argument_types
def write(
    recording: Recording,
    out: str | Path,
    *,
    format: str | None = None,
    progress: Progress | None = None,
) -> tuple[Path, ...]:
    """Write a recording in another format, with its radar and the tables that the format supports.

    Parameters
    ----------
    recording : Recording
        As `open` or `recording_from_cube` returns it. Selected frames become a recording of their
        own, whose first frame is number 0.
    out : path
        File or folder to write; its suffix selects the format, as `.h5`.
    format : str, optional
        Kind of the writer, if the suffix does not select it.
    progress : callable, optional
        Called with the number of completed frames and of all frames.

    Returns
    -------
    tuple of Path
        All files and folders written.

    Raises
    ------
    DechirpError
        If the format is unknown, cannot hold the recording, or cannot be written; existing files
        are then unchanged.
    """
    out = Path(out)
    writer = find_writer(out, format)
    renumbered = renumber_frames_from_zero(recording)
    writer.check_recording(renumbered)
    try:
        return writer.write(renumbered, out, progress)
    except DechirpError as error:
        if all(mistake.setting != "--out" for mistake in error.mistakes):
            raise
        mistakes = (replace(mistake, setting="path") for mistake in error.mistakes)
        raise DechirpError(*mistakes) from None


def find_writer(out: Path, format: str | None = None) -> Writer:
    """Return the writer of a format or, if none is given, of the suffix of a name.

    Raises
    ------
    DechirpError
        If no writer has that kind or suffix; the message suggests the nearest.
    """
    members: dict[str, type[Writer]] = Writer.members()
    if format is not None:
        if format in members:
            return members[format]()
        fix = did_you_mean_fix(format, members)
        raise _unknown_format_error("--to", format, f"one of {', '.join(members)}", fix)
    name = out.name.lower()
    by_suffix = {suffix: writer for writer in members.values() for suffix in writer.suffixes}
    matches = [suffix for suffix in by_suffix if name.endswith(suffix)]
    if matches:
        return by_suffix[max(matches, key=len)]()
    choices = ", ".join(f"{writer.suffixes[0]} ({kind})" for kind, writer in members.items())
    suggestion = nearest_name(out.suffix, by_suffix)
    fix = f"did you mean {suggestion}?" if suggestion else "change its suffix, or give --to FORMAT"
    raise _unknown_format_error("path", str(out), f"a name that ends in one of {choices}", fix)


def _unknown_format_error(setting: str, value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, value=value, expected=expected, fix=fix))
