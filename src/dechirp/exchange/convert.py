"""From one format to another: the name of what is to be written says which."""

from dataclasses import replace
from pathlib import Path

from dechirp.config.nearest import did_you_mean, nearest
from dechirp.core.errors import DechirpError, Mistake
from dechirp.exchange.part import counted_from_0
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.recording import Recording


def write(
    recording: Recording,
    out: str | Path,
    *,
    format: str | None = None,
    progress: Progress | None = None,
) -> tuple[Path, ...]:
    """Write a recording in another format, with its radar and its tables where it holds them.

    Parameters
    ----------
    recording : Recording
        As `open` gives it, or `recording_of` of a cube in memory. A part of one is written as a
        recording of its own, whose first frame is number 0.
    out : path
        What is to be written; its ending says the format, as `.h5`.
    format : str, optional
        Kind of the writer, where the ending does not say it.
    progress : callable, optional
        Called with the number of frames done and of all.

    Returns
    -------
    tuple of Path
        All that was written.

    Raises
    ------
    DechirpError
        If the format is not known, cannot hold the recording, or cannot be written: what was
        there is then as it was.
    """
    out = Path(out)
    writer = writer_of(out, format)
    own = counted_from_0(recording)
    writer.check(own)
    try:
        return writer.write(own, out, progress)
    except DechirpError as error:
        if all(one.setting != "--out" for one in error.mistakes):
            raise
        told = (replace(one, setting="path") for one in error.mistakes)
        raise DechirpError(*told) from None


def writer_of(out: Path, format: str | None = None) -> Writer:
    """Writer of a format, or without one of the ending of a name.

    Raises
    ------
    DechirpError
        If there is none of that kind or ending; it names the nearest.
    """
    members: dict[str, type[Writer]] = Writer.members()
    if format is not None:
        if format in members:
            return members[format]()
        fix = did_you_mean(format, members)
        raise _refused("--to", format, f"one of {', '.join(members)}", fix)
    name = out.name.lower()
    by_ending = {ending: made for made in members.values() for ending in made.endings}
    fits = [ending for ending in by_ending if name.endswith(ending)]
    if fits:
        return by_ending[max(fits, key=len)]()
    known = ", ".join(f"{made.endings[0]} ({kind})" for kind, made in members.items())
    meant = nearest(out.suffix, by_ending)
    fix = f"Did you mean {meant}?" if meant else "Change its ending, or say --to FORMAT."
    raise _refused("path", str(out), f"a name that ends in one of {known}", fix)


def _refused(setting: str, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, got=got, need=need, fix=fix))
