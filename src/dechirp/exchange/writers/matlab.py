"""MATLAB files of version 5 (`.mat`), that MATLAB and Octave open: `load x.mat`.

Arrays have their axes in the opposite order, as MATLAB lays them and as its `h5read` shows those
of our `.h5` files: `cube` is (sample, rx, chirp, frame), complex single, single, or int16 codes of
a converter. `dechirp` is the description, a text; `gap` (chirp, frame) is 1 where a chirp was lost;
each table is a structure.

MathWorks, MAT-File Format, level 5.
"""

import re
import struct
from math import prod
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import value
from dechirp.exchange.coded import if_codes, numbers
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.arrays.json_columns import NUMBERS
from dechirp.formats.recording import Recording
from dechirp.store.whole import whole_file

_OURS = ("cube", "dechirp", "gap")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
_LARGEST = 2**31 - 2**16  # bytes of a variable, less what goes before its numbers
_MATRIX, _FLAGS, _SIZES, _LETTERS = 14, 6, 5, 1
_COMPLEX = 0x0800
# Number of the class, and of the type in which its numbers are kept.
_KINDS = {"float32": (7, 7), "int16": (10, 3)}


@value
class Matlab(Writer):
    """MATLAB files of version 5: samples, radar, lost chirps, and tables as structures."""

    endings: ClassVar[tuple[str, ...]] = (".mat",)
    keeps: ClassVar[str] = "samples, radar, gaps, tables; up to 2 GiB"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()
        is_complex = recording.radar.frame.chirp.sampling == "complex"
        # As floats: whether samples are codes shows when they are read.
        _must_be_small("cube", prod(recording.sizes.values()) * (8 if is_complex else 4))
        _, tables = said_of(recording, None)
        must_be_of(NUMBERS, recording.tables)
        for name, columns in tables.items():
            if name in _OURS or not _NAME.fullmatch(name):
                raise _refused(
                    "tables",
                    got=f"with a table named {name!r}",
                    need=f"with names of letters, digits and _, other than {', '.join(_OURS)}",
                    fix="Name it otherwise, or write an .h5 file, which takes more names.",
                )
            _must_be_small(name, sum(column.nbytes for column in columns.values()))
            for column in columns:
                _must_be_named(name, column)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        from scipy.io import savemat

        def write_with(scale: float | None) -> None:
            with whole_file(out) as made:
                small = _small(recording, scale)
                savemat(made, small, appendmat=False, oned_as="column", long_field_names=True)
                with made.open("r+b") as file:
                    _write_cube(file, recording, scale, progress)

        if_codes(recording, write_with)
        return (out,)


def _small(recording: Recording, scale: float | None) -> dict[str, Any]:
    """All variables but the samples."""
    description, tables = said_of(recording, scale)
    gaps = recording.contents.gaps
    lost = {} if gaps is None else {"gap": gaps.astype(np.uint8).transpose()}
    return {"dechirp": description.text, **lost} | {
        name: {column: values.transpose() for column, values in columns.items()}
        for name, columns in tables.items()
    }


def _write_cube(
    file: IO[bytes], recording: Recording, scale: float | None, progress: Progress | None
) -> None:
    """Write the variable `cube` at the end, each frame where it belongs.

    All real parts come first, then all imaginary ones: so that one frame is held at a time, each
    is written in two places.
    """
    is_complex = recording.radar.frame.chirp.sampling == "complex"
    n_parts = 2 if is_complex else 1
    kind, numbers_kind = _KINDS["float32" if scale is None else "int16"]
    part_bytes = prod(recording.sizes.values()) * (4 if scale is None else 2)
    held = 8 + -(-part_bytes // 8) * 8  # with its tag, padded
    flags = struct.pack("<II", kind | (_COMPLEX if is_complex else 0), 0)
    sizes = struct.pack("<4i", *reversed(recording.sizes.values()))
    head = _element(_FLAGS, flags) + _element(_SIZES, sizes) + _element(_LETTERS, b"cube")
    start = file.seek(0, 2) + 8 + len(head)
    file.write(struct.pack("<II", _MATRIX, len(head) + n_parts * held) + head)
    file.truncate(start + n_parts * held)
    for part in range(n_parts):
        file.seek(start + part * held)
        file.write(struct.pack("<II", numbers_kind, part_bytes))
    for index, frame in enumerate(numbers(recording, scale)):
        for part, values in enumerate(_parts(frame, is_complex=is_complex)):
            file.seek(start + part * held + 8 + index * values.nbytes)
            file.write(np.ascontiguousarray(values).data)
        if progress is not None:
            progress(index + 1, recording.n_frames)


def _parts(frame: np.ndarray, *, is_complex: bool) -> list[np.ndarray]:
    if not is_complex:
        return [frame]
    if np.iscomplexobj(frame):
        return [frame.real, frame.imag]
    return [frame[..., 0], frame[..., 1]]


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _must_be_named(table: str, name: str) -> None:
    """Raise `DechirpError` unless a field can have that name."""
    if not _NAME.fullmatch(name):
        raise _refused(
            f"tables.{table}",
            got=f"with a column named {name!r}",
            need="with names of letters, digits and _, of which a letter comes first, at most 63",
            fix="Name it otherwise, or write an .h5 file, which takes more names.",
        )


def _must_be_small(name: str, n_bytes: int) -> None:
    if n_bytes > _LARGEST:
        raise _refused(
            "recording",
            got=f"with {name} of {n_bytes} bytes",
            need=f"of at most {_LARGEST} bytes in each variable, as .mat files of version 5 have",
            fix="Write an .h5 file, which MATLAB reads with h5read, or fewer frames.",
        )


def _refused(setting: str, *, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, got=got, need=need, fix=fix))
