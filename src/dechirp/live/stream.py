"""Frames that are still arriving: what a stream is, and its bytes as cubes."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import number
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import must_fit
from dechirp.formats.base import Contents, Told
from dechirp.formats.dca1000 import layouts
from dechirp.formats.recording import labelled_frames, settings_told
from dechirp.formats.samples.bare import bare_contents
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.calibration import read_calibration
from dechirp.formats.streams.bytes_in import BytesIn
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.known import device as known_device
from dechirp.radar.radar import Radar


class Arrived(NamedTuple):
    """A frame that came; its bytes are used before the next one is asked for."""

    number: int
    content: np.ndarray
    """(frame_bytes,) uint8."""
    arrived: np.ndarray | None
    """(frame_bytes,) bool; None: all."""


class Stream(ABC):
    """Frames of a radar, one after the other, as they arrive.

    Iterating gives cubes (frame, chirp, rx, sample) of one frame each, as `Recording.frames` does;
    of the frame that was being taken nothing else is kept. A stream can be gone through once.

    Raises
    ------
    RecordingError
        While iterating, if it ends before a frame came.
    """

    def __init__(self, path: str | Path, settings: Settings, iq: Iq | None, idle_s: float) -> None:
        self._idle_s = number("idle_s", idle_s, above=0, at_most=1e6)
        self._decoder = _Decoder(Path(path), settings, iq)
        self._is_stopped = False
        self._was_told = False  # to stop, by whoever takes the frames
        self.number = 0
        """Of the frame that came last."""

    @property
    def radar(self) -> Radar:
        """The radar that sends."""
        return self._decoder.radar

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was assumed, and what went wrong until now."""
        return (*self._decoder.findings, *self._said())

    @property
    def has_ended(self) -> bool:
        """Whether it gives no more frames, or none after the one that is being taken."""
        return self._is_stopped

    def stop(self) -> None:
        """Let the stream end after the frame that is being taken."""
        self._is_stopped = self._was_told = True

    def close(self) -> None:
        """Let go of what it listens to; done at the end of the frames."""
        self._is_stopped = True

    def __enter__(self) -> "Stream":
        """Give the stream itself; it is closed at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def __iter__(self) -> Iterator[xr.DataArray]:
        """Give each frame when it is there."""
        n_frames = 0
        try:
            for one in self._arriving():
                self.number = one.number
                n_frames += 1
                yield self._decoder.cube(one)
        finally:
            self.close()
        if not n_frames:
            raise self._nothing()

    @abstractmethod
    def _arriving(self) -> Iterator[Arrived]:
        """Wait for frames, until nothing more comes."""

    @abstractmethod
    def _said(self) -> tuple[Finding, ...]:
        """What went wrong on the way."""

    @abstractmethod
    def _nothing(self) -> RecordingError:
        """Say that no frame came."""


class _Decoder:
    """Bytes of frames as cubes; the first frame shows the order of its samples."""

    def __init__(self, path: Path, settings: Settings, iq: Iq | None) -> None:
        # How many frames were to be sent is nothing that holds for those that come.
        self._path, self._settings = path, replace(settings, n_frames=None)
        self._iq = iq
        frame, n_rx = self.radar.frame, self.radar.array.n_rx
        sizes = {2 * one.chirp_words(frame.chirp, n_rx) for one in layouts(settings)}
        if len(sizes) > 1:
            raise RecordingError(
                path,
                got=f"bytes of {n_rx} receivers, through two lanes or through four",
                need="a stream of which the lanes are known: they say how long a chirp is",
                fix="Give the chip (device, --device), or the settings file of the vendor.",
            )
        self._chirp_bytes = sizes.pop()
        self.frame_bytes = frame.n_sent * self._chirp_bytes
        must_fit(
            "a frame of the stream",
            needed_bytes=4.0 * self.frame_bytes,  # its bytes, and twice as many as a cube
            fix="Check the settings of the radar.",
        )
        self._bytes = _Held(self.frame_bytes)
        self._read()  # what cannot be read is refused before anything comes
        self._contents: Contents | None = None

    @property
    def radar(self) -> Radar:
        return self._settings.radar

    @property
    def findings(self) -> tuple[Finding, ...]:
        return () if self._contents is None else self._contents.findings

    def cube(self, one: Arrived) -> xr.DataArray:
        """Cube of a frame, with the coordinate `gap` where bytes can be lost."""
        gap: np.ndarray | None = None
        if one.arrived is not None:
            gap = np.asarray(~one.arrived.reshape(-1, self._chirp_bytes).all(axis=1))
        if self._contents is None:
            self._bytes.content = self._whole(one.content, gap)
            self._contents = self._read()
        self._bytes.content = one.content
        frame, n_rx = self.radar.frame, self.radar.array.n_rx
        kind = np.complex64 if frame.chirp.sampling == "complex" else np.float32
        samples = np.empty((1, frame.n_sent, n_rx, frame.chirp.n_samples), kind)
        assert self._contents.decode is not None  # bare samples are samples
        self._contents.decode(0, samples[0])
        gaps = None if gap is None else gap[None]
        return labelled_frames(samples, self._contents, first=one.number, gaps=gaps)

    def _read(self) -> Contents:
        lanes, told = layouts(self._settings), Told(iq=self._iq)
        return bare_contents(self._path, self._bytes, lanes, self._settings, told)

    def _whole(self, content: np.ndarray, gap: np.ndarray | None) -> np.ndarray:
        """The chirps that are whole, as often as they fill a frame: zeros would tell nothing."""
        if gap is None or gap.all():
            return content
        chirps = content.reshape(-1, self._chirp_bytes)
        return np.resize(chirps[~gap], chirps.shape).reshape(-1)


class _Held(BytesIn):
    """The bytes of one frame, in memory."""

    def __init__(self, n_bytes: int) -> None:
        self.n_bytes = n_bytes
        self.content = np.zeros(n_bytes, np.uint8)

    def read(self, start: int, into: np.ndarray) -> None:
        """See `BytesIn.read`."""
        into[:] = self.content[start : start + into.size]


def settings_of(
    radar: Radar | str | Path | None,
    settings: str | Path | None,
    device: str | None,
    calibration: Calibration | str | Path | None,
) -> Settings | None:
    """Settings of what the user says, as `open` takes it; None: neither radar nor settings."""
    told = settings_told(radar, settings, None if device is None else known_device(device))
    if told is None or calibration is None:
        return told
    if not isinstance(calibration, Calibration):
        calibration = read_calibration(calibration)
    return replace(told, radar=replace(told.radar, calibration=calibration))
