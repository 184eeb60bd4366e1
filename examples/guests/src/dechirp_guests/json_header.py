"""Samples after one line of JSON: a file that any logger can write in two calls.

The first line is `{"json_header": 1, "radar": ..., "step": ...}`: the radar as settings files
have it, and the step of the converter in sqrt(W), null if unknown. It is followed by codes of
16 bits, low byte first: frame, chirp, receiver, sample, and I before Q where sampling is complex.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from dechirp import Finding, RecordingError
from dechirp.extensions import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    frozen_dataclass,
    parse_radar,
)

_MARK = b'{"json_header":'
_LONGEST = 2**20  # largest first line in bytes; bounds the read of files in other formats
_FULL_SCALE = 2**15


@frozen_dataclass
class JsonHeader(Format):
    """Codes of 16 bits after a line of JSON that describes the radar."""

    def recognise(self, path: Path) -> MatchQuality:
        """Match the first bytes of the file."""
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            return (
                MatchQuality.SELF_DESCRIBING if file.read(len(_MARK)) == _MARK else MatchQuality.NO
            )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        """See `Format.read`."""
        header, first = _read_header(path)
        radar = hints.settings.radar if hints.settings else parse_radar(path, header.get("radar"))
        step = header.get("step")
        if step is not None and not (isinstance(step, int | float) and 0 < step <= 1):
            raise _damaged(path, f"a step of {step!r}", "null, or a number of sqrt(W) up to 1")
        chirp = radar.frame.chirp
        parts = 2 if chirp.sampling == "complex" else 1
        n_codes = (
            parts * chirp.n_samples * radar.array.n_rx * radar.frame.n_chirps_total
        )  # of a frame
        n_frames, n_extra_bytes = divmod(path.stat().st_size - first, 2 * n_codes)
        if not n_frames:
            raise _damaged(
                path, f"{n_extra_bytes} bytes of codes", f"at least {2 * n_codes}, of one frame"
            )
        scale = 1 / _FULL_SCALE if step is None else step

        def decode(index: int, out: np.ndarray) -> None:
            offset = first + 2 * n_codes * index
            codes = np.fromfile(path, "<i2", n_codes, offset=offset).astype(np.float32)
            codes *= np.float32(scale)
            out[...] = codes.view(out.dtype).reshape(out.shape)

        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            units="1" if step is None else "W**0.5",
            scale=scale,
            findings=extra_bytes_finding(n_extra_bytes, 2 * n_codes),
        )


def _read_header(path: Path) -> tuple[dict[str, Any], int]:
    """Read the header line; return it with the offset of the codes."""
    with path.open("rb") as file:
        line = file.readline(_LONGEST)
    try:
        header = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, f"a first line that is no JSON ({error})", "one object") from None
    if not isinstance(header, dict) or header.get("json_header") != 1 or line[-1:] != b"\n":
        raise _damaged(path, f"a first line {line[:40]!r}", "an object of version 1 and a new line")
    return header, len(line)


def extra_bytes_finding(n_bytes: int, frame_bytes: int) -> tuple[Finding, ...]:
    """Return a note about an incomplete last frame."""
    if not n_bytes:
        return ()
    value = f"{n_bytes} bytes after the last whole frame, which are left out"
    expected = f"whole frames of {frame_bytes} bytes"
    fix = "Let the logger end a frame before it stops."
    return (Finding(level="note", setting="recording", value=value, expected=expected, fix=fix),)


def _damaged(path: Path, value: str, expected: str) -> RecordingError:
    return RecordingError(path, value=value, expected=expected, fix="write the file again")
