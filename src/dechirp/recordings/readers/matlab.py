"""MATLAB files (`.mat`): an array of a workspace, or a native file.

The user names axes in the order in which MATLAB shows them. Files of version 7.3 are HDF5, in
which axes lie in the opposite order and complex numbers are pairs.

Native files contain a text `dechirp` and structures for the tables. MATLAB shows their arrays with
reversed axes: `cube` (sample, rx, chirp, frame), in MATLAB's memory order.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.core.text import join_names
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.hdf5_datasets import open_lazy_dataset
from dechirp.recordings.arrays.lazy_array import (
    ALLOWED_BYTES,
    LazyArray,
    check_plausible_size,
    choose_array_name,
    convert_parser_errors,
    reverse_axes,
)
from dechirp.recordings.arrays.mat5 import (
    EXPECTED,
    Element,
    describe_variable,
    find_numeric_variables,
    iter_elements,
    parse_numeric_variable_by_name,
)
from dechirp.recordings.arrays.mat5_values import Value, read_variable_value
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.description import is_native_description
from dechirp.recordings.native import (
    MAX_DESCRIPTION_CHARACTERS,
    is_native_without_array_hints,
    read_native_contents,
)
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

_MAT5, _MAT73 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
_CUBE, _TEXT, _GAP = "cube", "dechirp", "gap"


@frozen_dataclass
class Matlab(Format):
    """MATLAB files (version 5 to 7.3): an array whose axes the user names.

    A file written by `dechirp convert` needs no hints.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inner_name")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        head = _read_signature(path)
        if head not in (_MAT5, _MAT73):
            return MatchQuality.NO
        try:
            text = _read_native_description(path) if head == _MAT5 else None
        except Exception:  # foreign bytes: `read` reports the damage
            return MatchQuality.CONTAINER
        return (
            MatchQuality.SELF_DESCRIBING
            if text is not None and is_native_description(text)
            else MatchQuality.CONTAINER
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        if _read_signature(path) == _MAT5:
            with convert_parser_errors(path, EXPECTED):
                text = _read_native_description(path)
                if text is not None and is_native_without_array_hints(text, hints):
                    return _read_native_file(path, text, hints)
        samples = (
            _open_mat5_array(path, hints)
            if _read_signature(path) == _MAT5
            else _open_mat73_array(path, hints)
        )
        file_bytes = path.stat().st_size
        check_plausible_size(path, samples, file_bytes=file_bytes)
        return interpret_array_as_recording(path, samples, hints, file_bytes=file_bytes)


def _read_signature(path: Path) -> bytes:
    """Return the first bytes of a file; empty for a folder."""
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(len(_MAT5))


def _open_mat5_array(path: Path, hints: RecordingHints) -> LazyArray:
    """Open the array to read in a file of version 5 to 7."""
    variables = find_numeric_variables(path)
    if not variables:
        raise _no_numeric_array_error(path)
    name = choose_array_name(
        path, {key: (variable.shape, variable.dtype) for key, variable in variables.items()}, hints
    )
    return variables[name].to_lazy_array()


def _no_numeric_array_error(path: Path) -> RecordingError:
    """Return the error of a file without a numeric array, which names its variables."""
    with convert_parser_errors(path, EXPECTED):
        described = [
            text for element in iter_elements(path) if (text := describe_variable(element))
        ]
    return RecordingError(
        path,
        value=f"a file without a numeric array: {join_names(described) or 'nothing'}",
        expected="samples as a numeric array",
        fix="in MATLAB, save the samples alone: x = VARIABLE.FIELD; save('samples.mat', 'x');"
        " for points that a radar detected, give the file that its program recorded",
    )


def _open_mat73_array(path: Path, hints: RecordingHints) -> LazyArray:
    """Open the array to read in a file of version 7.3 (HDF5)."""
    return reverse_axes(open_lazy_dataset(path, hints, is_matlab_file=True))


def _read_native_description(path: Path) -> str | None:
    """Return the text of the variable `dechirp`; None if there is none."""
    for element in iter_elements(path):
        if element.name == _TEXT:
            content = read_variable_value(element, MAX_DESCRIPTION_CHARACTERS)
            return content if isinstance(content, str) else None
    return None


def _read_native_file(path: Path, description_text: str, hints: RecordingHints) -> Contents:
    """Read a file written by dechirp."""
    file_bytes = path.stat().st_size
    max_bytes = 2 * file_bytes + ALLOWED_BYTES
    elements = {element.name: element for element in iter_elements(path)}
    table_descriptions = json.loads(description_text)["tables"]
    tables: dict[str, dict[str, np.ndarray]] = {}

    def column(table: str, name: str) -> np.ndarray:
        if table not in tables:
            content = read_variable_value(elements[table], max_bytes)
            tables[table] = content if isinstance(content, dict) else {}
        description = table_descriptions[table]["variables"][name]
        return _restore_axes_from_matlab(
            tables[table][name], len(description["dims"]) + bool(description["is_text"])
        )

    gaps = read_variable_value(elements[_GAP], max_bytes) if _GAP in elements else None
    samples = _open_cube_with_restored_axes(elements[_CUBE])
    check_plausible_size(path, samples, file_bytes=file_bytes)
    return read_native_contents(
        path,
        description_text,
        samples,
        hints,
        read_column=column,
        gaps=None if gaps is None else _restore_axes_from_matlab(gaps, 2),
        file_bytes=file_bytes,
        axes=CUBE_AXES[::-1],
    )


def _open_cube_with_restored_axes(element: Element) -> LazyArray:
    """Open the cube, and restore trailing axes of length 1 that MATLAB removed."""
    (variable,) = parse_numeric_variable_by_name(element).values()
    # MATLAB drops trailing axes of length 1 when it saves the file again.
    n_missing_axes = len(CUBE_AXES) - len(variable.shape)
    return replace(variable, shape=variable.shape + (1,) * n_missing_axes).to_lazy_array()


def _restore_axes_from_matlab(content: Value, n_axes: int) -> np.ndarray:
    """Return an array in native axis order with `n_axes` axes.

    MATLAB stores at least two axes, reversed, and drops trailing ones of length 1.

    Raises
    ------
    TypeError, ValueError
        If the array cannot have that many axes.
    """
    if not isinstance(content, np.ndarray):
        raise TypeError("not an array")
    if n_axes < 2:
        return content.reshape((-1,) * n_axes)
    array = content.transpose()
    return array.reshape((1,) * (n_axes - array.ndim) + array.shape)
