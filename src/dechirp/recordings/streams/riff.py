"""WAV files: samples of several channels, read block by block.

Of an interrupted recorder's header with size 0, libsndfile (soundfile 0.14) reads no samples, and
it does not report a truncated file. SciPy 1.17 loads 24-bit samples whole and refuses both, and the
module wave of Python 3.11 refuses floats, WAVE_FORMAT_EXTENSIBLE and RF64 as well.
"""

import struct
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_BITS = {_PCM: (8, 16, 24, 32), _FLOAT: (32, 64)}
_MAX_CHUNKS = 1000
_UNKNOWN = 0xFFFFFFFF


@frozen_dataclass
class Wav:
    """Format and position of the samples of a WAV file."""

    path: Path
    sample_rate_hz: int
    n_channels: int
    n_samples: int
    """Samples of each channel."""
    data_offset: int
    """First byte of the samples."""
    is_float: bool
    bytes_per_sample: int
    """Bytes of one sample of one channel."""
    has_reversed_channels: bool = False
    """Whether to return the channels in reverse order."""
    findings: tuple[Finding, ...] = ()

    def read_samples(self, first: int, n: int) -> np.ndarray:
        """Return samples (n, channel) from `first` on, float32; integers scaled to -1 ... 1."""
        size = self.n_channels * self.bytes_per_sample
        raw = np.fromfile(self.path, np.uint8, n * size, offset=self.data_offset + first * size)
        if raw.size < n * size:
            raise RecordingError(
                self.path,
                value="the file has become shorter since it was opened",
                expected="a file that does not change while it is read",
                fix="open it again after the writing program has finished",
            )
        samples = self._decode_samples(raw.reshape(n, self.n_channels, self.bytes_per_sample))
        return samples[:, ::-1] if self.has_reversed_channels else samples

    def _decode_samples(self, raw: np.ndarray) -> np.ndarray:
        """Convert bytes (n, channel, byte) to samples (n, channel)."""
        if self.is_float:
            # Values too large become infinite, which the reader reports.
            with np.errstate(all="ignore"):
                return raw.view(f"<f{self.bytes_per_sample}")[..., 0].astype(np.float32)
        if self.bytes_per_sample == 1:
            return (raw[..., 0].astype(np.float32) - 128) / np.float32(128)
        if self.bytes_per_sample == 3:
            padded = np.zeros((*raw.shape[:-1], 4), np.uint8)
            for byte in range(3):  # copies of whole rows take four times as long
                padded[..., byte + 1] = raw[..., byte]
            raw = padded
        whole = raw.view(f"<i{raw.shape[-1]}")[..., 0]
        scale = np.float32(2.0 ** (1 - 8 * raw.shape[-1]))
        return np.multiply(whole, scale, dtype=np.float32, casting="same_kind")


def is_wav_header(head: bytes) -> bool:
    """Return whether a file with this start is a WAV file."""
    return head[:4] in (b"RIFF", b"RF64") and head[8:12] == b"WAVE"


def parse_wav_header(path: Path) -> Wav:
    """Parse the header of a WAV file, without reading samples.

    Raises
    ------
    RecordingError
        If the header is damaged, or the samples are compressed.
    """
    size = path.stat().st_size
    format_chunk, long_size = b"", None
    with path.open("rb") as file:
        if not is_wav_header(file.read(12)):
            raise _damaged_wav_error(path, "without its signature")
        for _ in range(_MAX_CHUNKS):
            head = file.read(8)
            if len(head) < 8:
                break
            name, n_bytes = head[:4], int.from_bytes(head[4:], "little")
            if name == b"data":
                return _wav_from_format_chunk(
                    path, format_chunk, file.tell(), long_size or n_bytes, size
                )
            body = file.read(min(n_bytes, 64))
            if name == b"fmt ":
                format_chunk = body
            elif name == b"ds64" and len(body) >= 16:  # 64-bit sizes of the file and of the samples
                long_size = int.from_bytes(body[8:16], "little")
            file.seek(n_bytes + n_bytes % 2 - len(body), 1)
    raise _damaged_wav_error(path, "without samples (no chunk named data)")


def _wav_from_format_chunk(
    path: Path, format_chunk: bytes, data_offset: int, declared_bytes: int, file_bytes: int
) -> Wav:
    """Check the format, and return the position of the samples."""
    if len(format_chunk) < 16:
        raise _damaged_wav_error(path, "whose samples come before their format")
    kind, n_channels, rate_hz, _, frame_bytes, bits = struct.unpack("<HHIIHH", format_chunk[:16])
    if kind == _EXTENSIBLE and len(format_chunk) >= 26:
        kind = int.from_bytes(format_chunk[24:26], "little")
    if bits not in _BITS.get(kind, ()):
        raise _damaged_wav_error(path, f"of {bits} bits in encoding {kind}")
    if not n_channels or not rate_hz or frame_bytes != n_channels * bits // 8:
        raise _damaged_wav_error(
            path, f"of {n_channels} channels, {rate_hz} Hz and {frame_bytes} bytes a sample"
        )
    present_bytes = file_bytes - data_offset
    # An interrupted recorder does not update the size in the header.
    is_unfinished = declared_bytes in (0, _UNKNOWN) or declared_bytes > present_bytes
    n_samples = (present_bytes if is_unfinished else declared_bytes) // frame_bytes
    if not n_samples:
        raise _damaged_wav_error(path, f"with {present_bytes} bytes of samples")
    findings = (
        (_unfinished_header_warning(declared_bytes, present_bytes, n_samples / rate_hz),)
        if is_unfinished
        else ()
    )
    return Wav(
        path=path,
        sample_rate_hz=rate_hz,
        n_channels=n_channels,
        n_samples=n_samples,
        data_offset=data_offset,
        is_float=kind == _FLOAT,
        bytes_per_sample=bits // 8,
        findings=findings,
    )


def _unfinished_header_warning(
    declared_bytes: int, present_bytes: int, duration_s: float
) -> Finding:
    """Warn that the header has a wrong size."""
    return Finding(
        level="warning",
        setting="recording",
        value=f"{present_bytes} bytes of samples instead of the {declared_bytes} of the header; all"
        f" are read, {format_si(duration_s, 's')}",
        expected="a file that its recorder has finished",
        fix="copy the whole file again if it should be longer",
    )


def _damaged_wav_error(path: Path, value: str) -> RecordingError:
    """Return the error of a file that is not a readable WAV file."""
    return RecordingError(
        path,
        value=f"a WAV file {value}",
        expected="an uncompressed WAV file of 8, 16, 24 or 32 bits, or floats",
        fix="copy it again from its source, or save it as PCM",
    )
