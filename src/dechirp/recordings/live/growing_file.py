"""Streaming of a capture file that is still being written, frame by frame."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.recordings.live.stream import ReceivedFrame, Stream, settings_from_arguments
from dechirp.recordings.readers.base import RecordingHints, identify_non_raw_content
from dechirp.recordings.readers.dca1000 import (
    SPLIT_BYTES,
    find_next_capture_part,
    has_packet_headers,
)
from dechirp.recordings.recognise import unreadable_path_error
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.byte_sources import FileSource, open_concatenated_files

_PAUSE_S = 20e-3


class GrowingFile(Stream):
    """Frames of a file of raw samples while it grows; see `follow`."""

    def __init__(
        self, path: Path, settings: RecordingSettings, iq: Iq | None, idle_s: float
    ) -> None:
        super().__init__(path, settings, iq, idle_s)
        self._parts = [path]
        self._identity = _device_and_inode(path)
        self._n_bytes, self._n_used = 0, 0
        self._changed: str | None = None
        self._ran_out = False

    def _iter_received_frames(self) -> Iterator[ReceivedFrame]:
        content = np.empty(self._decoder.frame_bytes, np.uint8)
        last_growth_s = time.monotonic()
        while not self._is_stopped:
            files = self._open_current_parts()
            if files is None:
                break
            if files.n_bytes > self._n_bytes:
                self._n_bytes, last_growth_s = files.n_bytes, time.monotonic()
            if self._n_bytes >= self._n_used + content.size:
                if not self._n_used:
                    _check_raw_samples_file(self._parts[0])
                files.read(self._n_used, content)
                yield ReceivedFrame(self._n_used // content.size, content, None)
                self._n_used += content.size
                last_growth_s = time.monotonic()
            elif time.monotonic() - last_growth_s > self._idle_s:
                break
            else:
                time.sleep(_PAUSE_S)
        self._ran_out = not self._is_stopped

    def _open_current_parts(self) -> FileSource | None:
        """Return the present parts of the capture; None if a part was removed or replaced."""
        try:
            files = open_concatenated_files(*self._parts)
            if _device_and_inode(self._parts[0]) != self._identity:
                self._changed = "was replaced by another file"
            elif files.n_bytes < self._n_bytes:
                self._changed = f"shrank from {self._n_bytes} to {files.n_bytes} bytes"
            elif (following := self._find_continuation_file(files.sizes[-1])) is not None:
                self._parts.append(following)
        except OSError as error:
            self._changed = f"cannot be read any more ({error.strerror or error})"
        return None if self._changed else files

    def _find_continuation_file(self, last_file_bytes: int) -> Path | None:
        """Return the file that continues the capture, unless this one ends with a frame."""
        following = find_next_capture_part(self._parts)
        is_split = last_file_bytes >= SPLIT_BYTES or self._n_bytes % self._decoder.frame_bytes
        return (
            following
            if following and is_split and _is_written_later(following, self._parts[-1])
            else None
        )

    def _transmission_findings(self) -> tuple[Finding, ...]:
        findings = []
        if self._changed is not None:
            findings.append(
                Finding(
                    level="warning",
                    setting="recording",
                    value=f"{self._parts[0].name} {self._changed}, which ended the stream",
                    expected="a file that only grows",
                    fix="follow it again while the recorder writes to it",
                )
            )
        rest = self._n_bytes - self._n_used
        if self._ran_out and 0 < rest < self._decoder.frame_bytes:
            findings.append(
                Finding(
                    level="note",
                    setting="recording",
                    value=f"{rest} bytes after the last complete frame, omitted",
                    expected=f"complete frames of {self._decoder.frame_bytes} bytes",
                    fix="nothing, if the recorder stopped within a frame",
                )
            )
        return tuple(findings)

    def _no_frames_error(self) -> RecordingError:
        duration = "before it was stopped" if self._was_stop_requested else f"in {self._idle_s:g} s"
        value = self._changed or f"with {self._n_bytes} bytes, and no complete frame {duration}"
        return RecordingError(
            self._parts[0],
            value=value,
            expected=f"a file that grows to at least {self._decoder.frame_bytes} bytes, a frame",
            fix="start the recorder, check the settings of the radar, or wait longer (--idle;"
            " idle_s in Python)",
        )


@check_argument_types
def follow(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    settings: str | Path | None = None,
    device: str | None = None,
    iq: Iq | None = None,
    calibration: Calibration | str | Path | None = None,
    idle_s: float = 10.0,
) -> GrowingFile:
    """Stream the frames of a DCA1000 capture while it is written, existing frames first.

    Incomplete frames are awaited. If the recorder continues in a file with the next number
    (`x_0.bin`, `x_1.bin`), the stream follows, provided that file is newer.

    Parameters
    ----------
    path : path
        A file of raw samples (`.bin`), which may be empty.
    radar, settings, device, iq, calibration
        As for `open`; without radar and settings, the settings file next to it.
    idle_s : float
        Time without growth after which the stream ends.

    Raises
    ------
    RecordingError
        If the file does not exist or is a folder, its settings are not found, or a DCA1000 cannot
        record the radar; while iterating, if it contains no raw samples or no frame arrives.
    """
    path = Path(path)
    if path.is_dir():
        raise RecordingError(
            path,
            value="a folder",
            expected="one file of raw samples",
            fix="give the growing file in it, such as adc_data.bin",
        )
    if not path.is_file():
        raise unreadable_path_error(path, FileNotFoundError(2, "no such file"))
    hints = RecordingHints(settings=settings_from_arguments(radar, settings, device, calibration))
    return GrowingFile(path, find_recording_settings(path, hints), iq, idle_s)


def _device_and_inode(path: Path) -> tuple[int, int]:
    """Return device and inode of a file, which do not change while it grows."""
    status = path.stat()
    return status.st_dev, status.st_ino


def _is_written_later(following: Path, previous: Path) -> bool:
    """Return True if a part was modified after another; else it is of an earlier capture."""
    return following.stat().st_mtime_ns >= previous.stat().st_mtime_ns


def _check_raw_samples_file(path: Path) -> None:
    kind = (
        "packets with their headers" if has_packet_headers(path) else identify_non_raw_content(path)
    )
    if kind is not None:
        raise RecordingError(
            path,
            value=kind,
            expected="raw samples of a DCA1000, since other files are read only when complete",
            fix="wait for its end and open it as a recording",
        )
