"""From one format to another: the name of what is to be written says which."""

from pathlib import Path

from dechirp.core.errors import DechirpError, Mistake
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
        As `open` gives it, or `recording_of` of a cube in memory.
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
    writer = _writer(out, format)
    writer.check(recording)
    return writer.write(recording, out, progress)


def _writer(out: Path, format: str | None) -> Writer:
    """The writer that is meant."""
    members: dict[str, type[Writer]] = Writer.members()
    if format is not None:
        if format in members:
            return members[format]()
        raise _refused("--to", format, f"one of {', '.join(members)}", "Choose one of them.")
    name = out.name.lower()
    fits = {
        ending: made
        for made in members.values()
        for ending in made.endings
        if name.endswith(ending)
    }
    if fits:
        return fits[max(fits, key=len)]()
    known = ", ".join(f"{made.endings[0]} ({kind})" for kind, made in members.items())
    raise _refused("OUT", str(out), f"a name that ends in one of {known}", "Change its ending.")


def _refused(setting: str, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, got=got, need=need, fix=fix))
