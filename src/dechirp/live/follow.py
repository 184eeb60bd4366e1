"""A capture that is still being written: its frames as they become whole."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.formats.base import Told, foreign
from dechirp.formats.dca1000 import SPLIT_BYTES, has_headers, next_part
from dechirp.formats.recognise import unreadable
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import FilesIn, files_in
from dechirp.live.stream import Arrived, Stream, settings_of
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

_PAUSE_S = 20e-3


class Growing(Stream):
    """Frames of a file of bare samples, while it grows; see `follow`."""

    def __init__(self, path: Path, settings: Settings, iq: Iq | None, idle_s: float) -> None:
        super().__init__(path, settings, iq, idle_s)
        self._parts = [path]
        self._identity = _identity(path)
        self._n_bytes, self._n_used = 0, 0
        self._changed: str | None = None
        self._ran_out = False

    def _arriving(self) -> Iterator[Arrived]:
        content = np.empty(self._decoder.frame_bytes, np.uint8)
        grew_s = time.monotonic()
        while not self._is_stopped:
            files = self._files()
            if files is None:
                break
            if files.n_bytes > self._n_bytes:
                self._n_bytes, grew_s = files.n_bytes, time.monotonic()
            if self._n_bytes >= self._n_used + content.size:
                if not self._n_used:
                    _must_be_bare(self._parts[0])
                files.read(self._n_used, content)
                yield Arrived(self._n_used // content.size, content, None)
                self._n_used += content.size
                grew_s = time.monotonic()
            elif time.monotonic() - grew_s > self._idle_s:
                break
            else:
                time.sleep(_PAUSE_S)
        self._ran_out = not self._is_stopped

    def _files(self) -> FilesIn | None:
        """The parts as they are now; None if what was there is no longer."""
        try:
            files = files_in(*self._parts)
            if _identity(self._parts[0]) != self._identity:
                self._changed = "was replaced by another file"
            elif files.n_bytes < self._n_bytes:
                self._changed = f"shrank from {self._n_bytes} to {files.n_bytes} bytes"
            elif (following := self._next_part(files.sizes[-1])) is not None:
                self._parts.append(following)
        except OSError as error:
            self._changed = f"cannot be read any more ({error.strerror or error})"
        return None if self._changed else files

    def _next_part(self, size: int) -> Path | None:
        """File in which the capture goes on; one that ends with a frame is whole in itself."""
        following = next_part(self._parts)
        is_split = size >= SPLIT_BYTES or self._n_bytes % self._decoder.frame_bytes
        return (
            following if following and is_split and _is_later(following, self._parts[-1]) else None
        )

    def _said(self) -> tuple[Finding, ...]:
        said = []
        if self._changed is not None:
            said.append(
                Finding(
                    level="warning",
                    setting="recording",
                    got=f"{self._parts[0].name} {self._changed}, which ended the stream",
                    need="a file to which a recorder only adds",
                    fix="Follow it again, when the recorder writes to it.",
                )
            )
        rest = self._n_bytes - self._n_used
        if self._ran_out and 0 < rest < self._decoder.frame_bytes:
            said.append(
                Finding(
                    level="note",
                    setting="recording",
                    got=f"{rest} bytes after the last whole frame, left out",
                    need=f"whole frames, {self._decoder.frame_bytes} bytes each",
                    fix="Nothing is to be done where the recorder stopped within a frame.",
                )
            )
        return tuple(said)

    def _nothing(self) -> RecordingError:
        waited = "before it was stopped" if self._was_told else f"in {self._idle_s:g} s"
        why = self._changed or f"with {self._n_bytes} bytes, and no whole frame came {waited}"
        return RecordingError(
            self._parts[0],
            got=why,
            need=f"a file that grows to at least {self._decoder.frame_bytes} bytes, a frame",
            fix="Start the recorder, check the settings of the radar, or wait longer (--idle;"
            " idle_s in Python).",
        )


def follow(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    settings: str | Path | None = None,
    device: str | None = None,
    iq: Iq | None = None,
    calibration: Calibration | str | Path | None = None,
    idle_s: float = 10.0,
) -> Growing:
    """Give the frames of a DCA1000 capture while it is written, those that are there first.

    A frame of which a part is there is waited for. Where the recorder goes on in a file of the
    next number (`x_0.bin`, `x_1.bin`), so does the stream, if that is the younger one.

    Parameters
    ----------
    path : path
        A file of bare samples (`.bin`), which may be empty.
    radar, settings, device, iq, calibration
        As `open` takes them; without radar and settings, the file beside it.
    idle_s : float
        The stream ends when the file has not grown for so long.

    Raises
    ------
    RecordingError
        If there is no such file, it is a folder, its settings are not found, or no DCA1000 can
        record the radar; while iterating, if it holds no bare samples or no frame came.
    """
    path = Path(path)
    if path.is_dir():
        raise RecordingError(
            path,
            got="a folder",
            need="one file of bare samples that a recorder writes",
            fix="Name the file in it that grows, as adc_data.bin.",
        )
    if not path.is_file():
        raise unreadable(path, FileNotFoundError(2, "no such file"))
    told = Told(settings=settings_of(radar, settings, device, calibration))
    return Growing(path, settings_for(path, told), iq, idle_s)


def _identity(path: Path) -> tuple[int, int]:
    """What stays the same while a file only grows."""
    found = path.stat()
    return found.st_dev, found.st_ino


def _is_later(following: Path, before: Path) -> bool:
    """Whether a part was written to after another: else it is of an earlier capture."""
    return following.stat().st_mtime_ns >= before.stat().st_mtime_ns


def _must_be_bare(path: Path) -> None:
    kind = "packets with their headers" if has_headers(path) else foreign(path)
    if kind is not None:
        raise RecordingError(
            path,
            got=kind,
            need="bare samples, as a DCA1000 writes them: of other files nobody knows, before they"
            " are whole, what they hold",
            fix="Wait for its end, and read it as a recording.",
        )
