"""What a settings file says of the recording beside it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.radar.radar import Radar

Iq = Literal["iq", "qi"]
"""Which comes first, the in-phase or the quadrature sample."""


@value
class Settings:
    """The radar of a recording, and what its settings file says of the layout."""

    radar: Radar
    iq: Iq | None = None
    """None where the file does not say."""
    n_frames: int | None = None
    """Frames the radar was told to send; None where the file does not say."""
    merged: bool = False
    """Whether frames of one chirp each were taken as the chirps of one frame."""
    findings: tuple[Finding, ...] = ()


@contextmanager
def values_from(file: Path) -> Iterator[None]:
    """Turn settings that cannot work into a `RecordingError` that names their file."""
    try:
        yield
    except InvalidSetting as error:
        raise RecordingError(
            file,
            got=f"settings that cannot work ({error})",
            need="those of a radar that did record",
            fix="Check whether it is the right file, or give the radar.",
        ) from None
