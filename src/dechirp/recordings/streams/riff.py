"""WAV files: samples of several channels, read block by block, also of interrupted recordings.

libsndfile reads the header, then stands at the samples. It does not report sizes of interrupted
recorders, which are 0 or beyond the end of the file, so the samples are decoded without the header.
"""

import io
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass

_SAMPLE_BYTES = {"PCM_U8": 1, "PCM_16": 2, "PCM_24": 3, "PCM_32": 4, "FLOAT": 4, "DOUBLE": 8}
_UNKNOWN = 0xFFFFFFFF
_RF64_SIZE_OFFSET = 28  # of the size of the samples, in the chunk ds64, which is the first


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
    encoding: str
    """Name that libsndfile gives to the type of the samples."""
    has_reversed_channels: bool = False
    """Whether to return the channels in reverse order."""
    findings: tuple[Finding, ...] = ()

    def read_samples(self, first: int, n: int) -> np.ndarray:
        """Return samples (n, channel) from `first` on, float32; integers scaled to -1 ... 1."""
        size = self.n_channels * _SAMPLE_BYTES[self.encoding]
        raw = np.fromfile(self.path, np.uint8, n * size, offset=self.data_offset + first * size)
        if raw.size < n * size:
            raise RecordingError(
                self.path,
                value="the file has become shorter since it was opened",
                expected="a file that does not change while it is read",
                fix="open it again after the writing program has finished",
            )
        samples, _ = import_from_extra("io", "soundfile", setting="recording").read(
            io.BytesIO(raw.data),
            dtype="float32",
            always_2d=True,
            format="RAW",
            endian="LITTLE",
            subtype=self.encoding,
            channels=self.n_channels,
            samplerate=self.sample_rate_hz,
        )
        return samples[:, ::-1] if self.has_reversed_channels else samples


def is_wav_header(head: bytes) -> bool:
    """Return whether a file with this start is a WAV file."""
    return head[:4] in (b"RIFF", b"RF64") and head[8:12] == b"WAVE"


def parse_wav_header(path: Path) -> Wav:
    """Parse the header of a WAV file, without reading samples.

    Raises
    ------
    RecordingError
        If the header is damaged, or the samples are compressed.
    InvalidSetting
        If the extra `io` is missing.
    """
    soundfile = import_from_extra("io", "soundfile", setting="recording")
    with path.open("rb") as file:
        try:
            with soundfile.SoundFile(file) as sound:
                rate_hz, n_channels, encoding = sound.samplerate, sound.channels, sound.subtype
                data_offset = file.tell()
        except soundfile.LibsndfileError as error:
            raise _damaged_wav_error(path, error.error_string.removesuffix(".")) from None
        if encoding not in _SAMPLE_BYTES:
            raise _damaged_wav_error(path, f"samples of type {encoding}")
        declared_bytes = _read_declared_bytes(file, data_offset)
    present_bytes = path.stat().st_size - data_offset
    # An interrupted recorder does not update the size in the header.
    is_unfinished = declared_bytes in (0, _UNKNOWN) or declared_bytes > present_bytes
    n_bytes = present_bytes if is_unfinished else declared_bytes
    n_samples = n_bytes // (n_channels * _SAMPLE_BYTES[encoding])
    if not n_samples:
        raise _damaged_wav_error(path, f"{present_bytes} bytes of samples")
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
        encoding=encoding,
        findings=findings,
    )


def _read_declared_bytes(file: BinaryIO, data_offset: int) -> int:
    """Return the number of bytes of samples by the header, from before the samples or from RF64."""
    file.seek(0)
    is_rf64 = file.read(4) == b"RF64"
    file.seek(_RF64_SIZE_OFFSET if is_rf64 else data_offset - 4)
    return int.from_bytes(file.read(8 if is_rf64 else 4), "little")


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


def _damaged_wav_error(path: Path, reason: str) -> RecordingError:
    """Return the error of a file that is not a readable WAV file."""
    return RecordingError(
        path,
        value=f"an unreadable WAV file: {reason}",
        expected="an uncompressed WAV file of 8, 16, 24 or 32 bits, or floats",
        fix="copy it again from its source, or save it as PCM",
    )
