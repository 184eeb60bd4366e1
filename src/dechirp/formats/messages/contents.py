"""What the messages in a file hold: a recording of ours, or the points of another radar."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.formats.arrays.stored import parsing
from dechirp.formats.base import Contents, Told
from dechirp.formats.description import is_ours
from dechirp.formats.kept import must_agree
from dechirp.formats.messages import foreign, ours
from dechirp.formats.messages.kept import kept
from dechirp.formats.messages.ros import Message, types


def contents_of(path: Path, messages: Iterable[Message], told: Told, need: str) -> Contents:
    """Read all messages.

    Raises
    ------
    RecordingError
        If they are damaged, or none are points of a radar.
    InvalidSetting
        If the extra `io` is missing.
    """
    types()  # that it is missing is no damage
    settings = told.settings
    radar = None if settings is None else settings.radar
    with parsing(path, need):
        held = kept(path, messages, told.inside)
        text = held.description
        if text is None or not is_ours(text):
            found = foreign.contents(path, held, radar, told.inside)
        elif told.inside is None:
            found = ours.contents(path, text, held, radar)
            must_agree(path, told, device=found.device, iq=found.iq)
        else:
            raise RecordingError(
                path,
                got=f"a recording of ours, with {told.inside!r} named inside",
                need="named itself: its detections and tables belong together",
                fix=f"Name {path.name}.",
            )
    said = () if settings is None else settings.findings
    return replace(found, findings=(*said, *found.findings))
