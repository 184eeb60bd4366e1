"""Streams: frames that arrive one by one, decoded from bytes to cubes."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import check_number
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import check_free_memory
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, RecordingHints
from dechirp.recordings.readers.dca1000 import possible_word_layouts
from dechirp.recordings.recording import combine_radar_and_layout_settings, label_frames_as_cube
from dechirp.recordings.samples.raw_samples import interpret_raw_samples
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.recordings.streams.byte_sources import ByteSource


class ReceivedFrame(NamedTuple):
    """Received frame; its bytes are valid until the next one is requested."""

    number: int
    content: np.ndarray
    """(frame_bytes,) uint8."""
    received_mask: np.ndarray | None
    """(frame_bytes,) bool; None: all bytes were received."""


class Stream(ABC):
    """Frames of a radar in the order of arrival.

    Iteration yields cubes (frame, chirp, rx, sample) of one frame each, as `Recording.frames` does;
    earlier frames are not kept. A stream can be iterated once.

    Raises
    ------
    RecordingError
        While iterating, if it ends before the first frame.
    """

    def __init__(
        self, path: str | Path, settings: RecordingSettings, iq: Iq | None, idle_s: float
    ) -> None:
        self._idle_s = check_number("idle_s", idle_s, above=0, at_most=1e6)
        self._decoder = _FrameDecoder(Path(path), settings, iq)
        self._is_stopped = False
        self._was_stop_requested = False  # by the consumer
        self.number = 0
        """Number of the last frame."""

    @property
    def radar(self) -> Radar:
        """The transmitting radar."""
        return self._decoder.radar

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Assumptions and transmission problems so far."""
        return (*self._decoder.findings, *self._transmission_findings())

    @property
    def has_ended(self) -> bool:
        """True if no frame follows the current one."""
        return self._is_stopped

    def stop(self) -> None:
        """End the stream after the current frame."""
        self._is_stopped = self._was_stop_requested = True

    def close(self) -> None:
        """Close the source; called automatically after the last frame."""
        self._is_stopped = True

    def __enter__(self) -> "Stream":
        """Return the stream; leaving the context closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[xr.DataArray]:
        """Yield the cube of each frame as it arrives."""
        n_frames = 0
        try:
            for received in self._iter_received_frames():
                self.number = received.number
                n_frames += 1
                yield self._decoder.decode_frame(received)
        finally:
            self.close()
        if not n_frames:
            raise self._no_frames_error()

    @abstractmethod
    def _iter_received_frames(self) -> Iterator[ReceivedFrame]:
        """Yield frames until the source ends."""

    @abstractmethod
    def _transmission_findings(self) -> tuple[Finding, ...]:
        """Return findings about the transmission."""

    @abstractmethod
    def _no_frames_error(self) -> RecordingError:
        """Return the error for a stream without frames."""


class _FrameDecoder:
    """Decoder from frame bytes to cubes; the first frame determines the sample order."""

    def __init__(self, path: Path, settings: RecordingSettings, iq: Iq | None) -> None:
        # The configured number of frames does not limit the stream.
        self._path, self._settings = path, replace(settings, n_frames=None)
        self._iq = iq
        frame, n_rx = self.radar.frame, self.radar.array.n_rx
        if settings.sub_frames:
            raise RecordingError(
                path,
                value=f"frames of {len(settings.sub_frames)} sub-frames",
                expected="a stream of frames with equal chirps",
                fix="record to a file and open it, or stream a single sub-frame",
            )
        sizes = {
            2 * layout.words_per_chirp(frame.chirp, n_rx)
            for layout in possible_word_layouts(settings)
        }
        if len(sizes) > 1:
            raise RecordingError(
                path,
                value=f"samples of {n_rx} receivers on two or four lanes",
                expected="a known number of lanes, which determines the bytes of a chirp",
                fix="give the chip (device, --device), or the settings file of the vendor",
            )
        self._chirp_bytes = sizes.pop()
        self.frame_bytes = frame.n_chirps_total * self._chirp_bytes
        check_free_memory(
            "a frame of the stream",
            needed_bytes=4.0 * self.frame_bytes,  # its bytes, and a cube of twice the size
            fix="check the settings of the radar",
        )
        self._bytes = _FrameBuffer(self.frame_bytes)
        self._infer_sample_layout()  # rejects unreadable settings before packets arrive
        self._contents: Contents | None = None

    @property
    def radar(self) -> Radar:
        return self._settings.radar

    @property
    def findings(self) -> tuple[Finding, ...]:
        return () if self._contents is None else self._contents.findings

    def decode_frame(self, received: ReceivedFrame) -> xr.DataArray:
        """Decode a frame to a cube, with the coordinate `gap` if bytes can be lost."""
        gap: np.ndarray | None = None
        if received.received_mask is not None:
            gap = np.asarray(~received.received_mask.reshape(-1, self._chirp_bytes).all(axis=1))
        if self._contents is None:
            self._bytes.content = self._fill_frame_with_complete_chirps(received.content, gap)
            self._contents = self._infer_sample_layout()
        self._bytes.content = received.content
        frame, n_rx = self.radar.frame, self.radar.array.n_rx
        sample_dtype = np.complex64 if frame.chirp.sampling == "complex" else np.float32
        samples = np.empty((1, frame.n_chirps_total, n_rx, frame.chirp.n_samples), sample_dtype)
        assert self._contents.decode is not None  # bare samples are samples
        self._contents.decode(0, samples[0])
        gaps = None if gap is None else gap[None]
        return label_frames_as_cube(samples, self._contents, first_frame=received.number, gaps=gaps)

    def _infer_sample_layout(self) -> Contents:
        lanes, hints = possible_word_layouts(self._settings), RecordingHints(iq=self._iq)
        return interpret_raw_samples(self._path, self._bytes, lanes, self._settings, hints)

    def _fill_frame_with_complete_chirps(
        self, content: np.ndarray, is_chirp_lost: np.ndarray | None
    ) -> np.ndarray:
        """Return the complete chirps, repeated to fill a frame; zeros carry no information."""
        if is_chirp_lost is None or is_chirp_lost.all():
            return content
        chirps = content.reshape(-1, self._chirp_bytes)
        return np.resize(chirps[~is_chirp_lost], chirps.shape).reshape(-1)


class _FrameBuffer(ByteSource):
    """Bytes of one frame in memory."""

    def __init__(self, n_bytes: int) -> None:
        self.n_bytes = n_bytes
        self.content = np.zeros(n_bytes, np.uint8)

    def read(self, start: int, into: np.ndarray) -> None:
        into[:] = self.content[start : start + into.size]


def settings_from_arguments(
    radar: Radar | str | Path | None,
    settings: str | Path | None,
    device: str | None,
    calibration: Calibration | str | Path | None,
) -> RecordingSettings | None:
    """Return the settings from arguments as of `open`; None without radar and settings."""
    given_settings = combine_radar_and_layout_settings(
        radar, settings, None if device is None else known_device(device)
    )
    if given_settings is None or calibration is None:
        return given_settings
    if not isinstance(calibration, Calibration):
        calibration = read_calibration(calibration)
    return replace(given_settings, radar=replace(given_settings.radar, calibration=calibration))
