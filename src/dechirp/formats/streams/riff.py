"""WAV files: samples of several channels, read a block at a time.

Read here rather than with a library: those at hand load 24-bit samples whole, and refuse a
header that a recorder never came back to finish.
"""

import struct
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_BITS = {_PCM: (8, 16, 24, 32), _FLOAT: (32, 64)}
_MOST_CHUNKS = 1000
_UNKNOWN = 0xFFFFFFFF


@value
class Wav:
    """Where the samples of a WAV file are, and how they are written."""

    path: Path
    sample_rate_hz: int
    n_channels: int
    n_samples: int
    """Of each channel."""
    start: int
    """First byte of the samples."""
    is_float: bool
    n_bytes: int
    """Of one sample of one channel."""
    findings: tuple[Finding, ...] = ()

    def read(self, first: int, n: int) -> np.ndarray:
        """Samples (n, channel) from `first` on, float32; whole numbers within -1 to 1."""
        size = self.n_channels * self.n_bytes
        raw = np.fromfile(self.path, np.uint8, n * size, offset=self.start + first * size)
        if raw.size < n * size:
            raise RecordingError(
                self.path,
                got="shorter than when it was opened",
                need="a file that stays as it is while it is read",
                fix="Open it again, when nothing writes to it.",
            )
        return self._decoded(raw.reshape(n, self.n_channels, self.n_bytes))

    def _decoded(self, raw: np.ndarray) -> np.ndarray:
        """Make samples (n, channel) of their bytes (n, channel, byte)."""
        if self.is_float:
            with np.errstate(all="ignore"):  # what is too large is infinite, and told by the reader
                return raw.view(f"<f{self.n_bytes}")[..., 0].astype(np.float32)
        if self.n_bytes == 1:
            return (raw[..., 0].astype(np.float32) - 128) / np.float32(128)
        if self.n_bytes == 3:
            raw = np.insert(raw, 0, 0, axis=-1)
        whole = raw.view(f"<i{raw.shape[-1]}")[..., 0]
        return whole.astype(np.float32) * np.float32(2.0 ** (1 - 8 * raw.shape[-1]))


def looks_like_wav(head: bytes) -> bool:
    """Whether a file that begins so is a WAV file."""
    return head[:4] in (b"RIFF", b"RF64") and head[8:12] == b"WAVE"


def wav(path: Path) -> Wav:
    """Find the samples of a WAV file; nothing is read yet.

    Raises
    ------
    RecordingError
        If the header is damaged, or the samples are compressed.
    """
    size = path.stat().st_size
    form, long_size = b"", None
    with path.open("rb") as file:
        if not looks_like_wav(file.read(12)):
            raise _damaged(path, "which does not begin as one")
        for _ in range(_MOST_CHUNKS):
            head = file.read(8)
            if len(head) < 8:
                break
            name, n_bytes = head[:4], int.from_bytes(head[4:], "little")
            if name == b"data":
                return _samples(path, form, file.tell(), long_size or n_bytes, size)
            body = file.read(min(n_bytes, 64))
            if name == b"fmt ":
                form = body
            elif name == b"ds64" and len(body) >= 16:  # sizes beyond 32 bits: file, samples
                long_size = int.from_bytes(body[8:16], "little")
            file.seek(n_bytes + n_bytes % 2 - len(body), 1)
    raise _damaged(path, "without samples (no chunk named data)")


def _samples(path: Path, form: bytes, start: int, said: int, size: int) -> Wav:
    if len(form) < 16:
        raise _damaged(path, "whose samples come before their format")
    kind, n_channels, rate_hz, _, frame_bytes, bits = struct.unpack("<HHIIHH", form[:16])
    if kind == _EXTENSIBLE and len(form) >= 26:
        kind = int.from_bytes(form[24:26], "little")
    if bits not in _BITS.get(kind, ()):
        raise _damaged(path, f"of {bits} bits in encoding {kind}")
    if not n_channels or not rate_hz or frame_bytes != n_channels * bits // 8:
        raise _damaged(
            path, f"of {n_channels} channels, {rate_hz} Hz and {frame_bytes} bytes a sample"
        )
    there = size - start
    # A recorder that was cut off never came back to write how many bytes there are.
    unfinished = said in (0, _UNKNOWN) or said > there
    n_samples = (there if unfinished else said) // frame_bytes
    if not n_samples:
        raise _damaged(path, f"with {there} bytes of samples")
    findings = (_unfinished(said, there, n_samples / rate_hz),) if unfinished else ()
    return Wav(
        path=path,
        sample_rate_hz=rate_hz,
        n_channels=n_channels,
        n_samples=n_samples,
        start=start,
        is_float=kind == _FLOAT,
        n_bytes=bits // 8,
        findings=findings,
    )


def _unfinished(said: int, there: int, duration_s: float) -> Finding:
    return Finding(
        level="warning",
        setting="recording",
        got=f"{there} bytes of samples where its header says {said}; all of them are read,"
        f" {duration_s:.6g} s",
        need="a recorder that was stopped before the file was copied",
        fix="Copy the whole file again if it should be longer.",
    )


def _damaged(path: Path, got: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"a WAV file {got}",
        need="a whole one, of 8, 16, 24 or 32 bits or floats, not compressed",
        fix="Copy it again from its source, or save it as PCM.",
    )
