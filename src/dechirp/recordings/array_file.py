"""All numeric arrays of a file: NumPy's `.npy` and `.npz`, MATLAB's `.mat`, also of version 7.3."""

import math
import shlex
from pathlib import Path

import numpy as np

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.memory import check_free_memory
from dechirp.recordings.arrays.hdf5_datasets import open_matlab_arrays
from dechirp.recordings.arrays.lazy_array import (
    LazyArray,
    check_plausible_size,
    complex_field_names,
)
from dechirp.recordings.arrays.mat5 import find_numeric_variables
from dechirp.recordings.readers.npy import MAGIC as NPY_MAGIC
from dechirp.recordings.readers.npy import open_npy_array
from dechirp.recordings.readers.npz import MAGIC as NPZ_MAGIC
from dechirp.recordings.readers.npz import open_npz_arrays
from dechirp.recordings.recognise import recognise_formats

_MAT5_MAGIC, _MAT73_MAGIC = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
_FORMATS_OF_MAPS = {"hdf5", "text-columns"}  # contain maps as often as recordings


def read_array_file(path: Path) -> dict[str, np.ndarray]:
    """Read all numeric arrays of a file by name; the name of the only array of `.npy` is empty.

    Raises
    ------
    RecordingError
        If the file is missing, damaged or in another format.
    NotEnoughMemory
        If the arrays do not fit into the free memory.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAT5_MAGIC))
    except OSError as error:
        raise RecordingError(
            path,
            value=f"not readable ({error.strerror or error})",
            expected="a file with arrays",
            fix="check the path",
        ) from None
    if head.startswith(NPY_MAGIC):
        arrays = {"": open_npy_array(path)}
    elif head.startswith(NPZ_MAGIC):
        arrays = open_npz_arrays(path)
    elif head == _MAT5_MAGIC:
        variables = find_numeric_variables(path)
        arrays = {name: variable.to_lazy_array() for name, variable in variables.items()}
    elif head == _MAT73_MAGIC:
        arrays = open_matlab_arrays(path)
    else:
        raise RecordingError(
            path,
            value="neither a NumPy file nor a MATLAB file",
            expected="an array in .npy, or arrays with names in .npz or .mat",
            fix=_suggest_fix_for_other_format(path),
        )
    return {name: _read_whole(path, array) for name, array in arrays.items()}


def _suggest_fix_for_other_format(path: Path) -> str:
    """Return how to go on with a file without arrays: a recording has a command of its own."""
    try:
        may_contain_map = not _FORMATS_OF_MAPS.isdisjoint(recognise_formats(path))
    except InvalidSetting:  # a recording that needs an extra
        may_contain_map = False
    except RecordingError:
        may_contain_map = True
    if may_contain_map:
        return "save it with numpy.savez, or in MATLAB with save"
    return (
        f"for the contents and faults of a recording: dechirp inspect {shlex.quote(str(path))};"
        " if it has samples, save one frame (rx, chirp, sample) with numpy.save to diagnose them"
    )


def _read_whole(path: Path, array: LazyArray) -> np.ndarray:
    """Read an array; complex pairs of fields become complex numbers."""
    check_plausible_size(path, array, file_bytes=path.stat().st_size)
    check_free_memory(
        f"an array of {path}",
        needed_bytes=16.0 * math.prod(array.shape),
        fix="save one frame",
    )
    values = np.array(array.read(tuple(slice(0, size) for size in array.shape)))
    fields = complex_field_names(values.dtype)
    return values if fields is None else values[fields[0]] + 1j * values[fields[1]]
