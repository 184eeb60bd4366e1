"""MATLAB files of version 5 (`.mat`) for MATLAB and Octave: `load x.mat`.

Arrays have reversed axes, as in MATLAB's memory and as its `h5read` returns those of native
`.h5` files: `cube` is (sample, rx, chirp, frame), complex single, single, or int16 codes of
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

from dechirp.core.atomic_files import atomic_file
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.json_columns import NUMBERS
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.adc_samples import (
    iter_code_or_float_arrays,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)

_RESERVED_NAMES = ("cube", "dechirp", "gap")
_VALID_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
_MAX_VARIABLE_BYTES = 2**31 - 2**16  # bytes of a variable, without its headers
_MATRIX, _FLAGS, _SIZES, _LETTERS = 14, 6, 5, 1
_COMPLEX = 0x0800
# Class number, and number of the storage type.
_KINDS = {"float32": (7, 7), "int16": (10, 3)}


@frozen_dataclass
class Matlab(Writer):
    """MATLAB files of version 5: samples, radar, lost chirps, and tables as structures."""

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    summary: ClassVar[str] = "samples, radar, gaps, tables; up to 2 GiB"

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()
        is_complex = recording.radar.frame.chirp.sampling == "complex"
        # Size as floats: codes are only detected while reading.
        _check_variable_size("cube", prod(recording.sizes.values()) * (8 if is_complex else 4))
        _, tables = recording_description_and_columns(recording, None)
        check_column_types(NUMBERS, recording.tables)
        for name, columns in tables.items():
            if name in _RESERVED_NAMES or not _VALID_NAME.fullmatch(name):
                raise _setting_error(
                    "tables",
                    value=f"a table named {name!r}",
                    expected="names of letters, digits and _, other than"
                    f" {', '.join(_RESERVED_NAMES)}",
                    fix="rename it, or write an .h5 file, which accepts more names",
                )
            _check_variable_size(name, sum(column.nbytes for column in columns.values()))
            for column in columns:
                _check_column_name(name, column)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        from scipy.io import savemat

        def write_with(scale: float | None) -> None:
            with atomic_file(out) as temporary:
                variables = _variables_without_cube(recording, scale)
                savemat(
                    temporary, variables, appendmat=False, oned_as="column", long_field_names=True
                )
                with temporary.open("r+b") as file:
                    _write_cube(file, recording, scale, progress)

        write_as_codes_else_floats(recording, write_with)
        return (out,)


def _variables_without_cube(recording: Recording, scale: float | None) -> dict[str, Any]:
    """Return all variables except the samples."""
    description, tables = recording_description_and_columns(recording, scale)
    gaps = recording.contents.gaps
    gap_variable = {} if gaps is None else {"gap": gaps.astype(np.uint8).transpose()}
    return {"dechirp": description.json_text, **gap_variable} | {
        name: {column: values.transpose() for column, values in columns.items()}
        for name, columns in tables.items()
    }


def _write_cube(
    file: IO[bytes], recording: Recording, scale: float | None, progress: Progress | None
) -> None:
    """Append the variable `cube`, with each frame written to its position.

    All real parts come first, then all imaginary ones: since one frame is held at a time, each is
    written in two places.
    """
    is_complex = recording.radar.frame.chirp.sampling == "complex"
    n_parts = 2 if is_complex else 1
    class_number, number_type = _KINDS["float32" if scale is None else "int16"]
    part_bytes = prod(recording.sizes.values()) * (4 if scale is None else 2)
    part_size = 8 + -(-part_bytes // 8) * 8  # with its tag, padded
    flags = struct.pack("<II", class_number | (_COMPLEX if is_complex else 0), 0)
    sizes = struct.pack("<4i", *reversed(recording.sizes.values()))
    header = (
        _encode_mat5_element(_FLAGS, flags)
        + _encode_mat5_element(_SIZES, sizes)
        + _encode_mat5_element(_LETTERS, b"cube")
    )
    start = file.seek(0, 2) + 8 + len(header)
    file.write(struct.pack("<II", _MATRIX, len(header) + n_parts * part_size) + header)
    file.truncate(start + n_parts * part_size)
    for part in range(n_parts):
        file.seek(start + part * part_size)
        file.write(struct.pack("<II", number_type, part_bytes))
    for index, frame in enumerate(iter_code_or_float_arrays(recording, scale)):
        for part, values in enumerate(_real_and_imaginary(frame, is_complex=is_complex)):
            file.seek(start + part * part_size + 8 + index * values.nbytes)
            file.write(np.ascontiguousarray(values).data)
        if progress is not None:
            progress(index + 1, recording.n_frames)


def _real_and_imaginary(frame: np.ndarray, *, is_complex: bool) -> list[np.ndarray]:
    if not is_complex:
        return [frame]
    if np.iscomplexobj(frame):
        return [frame.real, frame.imag]
    return [frame[..., 0], frame[..., 1]]


def _encode_mat5_element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _check_column_name(table: str, name: str) -> None:
    """Raise `DechirpError` unless a structure field can have that name."""
    if not _VALID_NAME.fullmatch(name):
        raise _setting_error(
            f"tables.{table}",
            value=f"a column named {name!r}",
            expected="names of at most 63 letters, digits and _, starting with a letter",
            fix="rename it, or write an .h5 file, which accepts more names",
        )


def _check_variable_size(name: str, n_bytes: int) -> None:
    if n_bytes > _MAX_VARIABLE_BYTES:
        raise _setting_error(
            "recording",
            value=f"{name} of {n_bytes} bytes",
            expected=f"at most {_MAX_VARIABLE_BYTES} bytes a variable, as in .mat version 5",
            fix="write an .h5 file, which MATLAB reads with h5read, or fewer frames",
        )


def _setting_error(setting: str, *, value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, value=value, expected=expected, fix=fix))
