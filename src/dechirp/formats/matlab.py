"""MATLAB files (`.mat`): one array of a workspace holds the samples.

Axes are named in the order in which MATLAB shows them. Files of version 7.3 are HDF5, where
they lie in the opposite order and complex numbers are pairs.

Files of ours have a text `dechirp`, too, and structures for the tables. MATLAB shows their arrays
with axes in the opposite order: `cube` (sample, rx, chirp, frame), as it lays them.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.hdf5_datasets import dataset_in
from dechirp.formats.arrays.mat5 import NEED, Element, elements, variable, variables
from dechirp.formats.arrays.mat5_values import Value, value_of
from dechirp.formats.arrays.stored import (
    ALLOWED_BYTES,
    Stored,
    chosen,
    must_be_plausible,
    parsing,
    reversed_axes,
)
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.description import is_ours
from dechirp.formats.kept import LONGEST_TEXT, is_meant, kept

_OLD, _NEW = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
_CUBE, _TEXT, _GAP = "cube", "dechirp", "gap"


@value
class Matlab(Format):
    """MATLAB files: an array whose axes the user names, or a file of ours.

    Files of version 5 to 7.3, which other programs write, too.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inside")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes, ours by its description."""
        head = _head(path)
        if head not in (_OLD, _NEW):
            return Fit.NO
        try:
            text = _text(path) if head == _OLD else None
        except Exception:  # foreign bytes: `read` says what is wrong with them
            return Fit.CONTAINER
        return Fit.OWN if text is not None and is_ours(text) else Fit.CONTAINER

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        if _head(path) == _OLD:
            with parsing(path, NEED):
                text = _text(path)
                if text is not None and is_meant(text, told):
                    return _own(path, text, told)
        stored = _old(path, told) if _head(path) == _OLD else _new(path, told)
        file_bytes = path.stat().st_size
        must_be_plausible(path, stored, file_bytes=file_bytes)
        return contents(path, stored, told, file_bytes=file_bytes)


def _head(path: Path) -> bytes:
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(len(_OLD))


def _old(path: Path, told: Told) -> Stored:
    found = variables(path)
    name = chosen(path, {key: (one.shape, one.dtype) for key, one in found.items()}, told)
    return found[name].stored()


def _new(path: Path, told: Told) -> Stored:
    return reversed_axes(dataset_in(path, told, of_matlab=True))


def _text(path: Path) -> str | None:
    """Text of the variable `dechirp`; None if there is no such text."""
    for one in elements(path):
        if one.name == _TEXT:
            held = value_of(one, LONGEST_TEXT)
            return held if isinstance(held, str) else None
    return None


def _own(path: Path, text: str, told: Told) -> Contents:
    """What a file of ours holds."""
    file_bytes = path.stat().st_size
    most = 2 * file_bytes + ALLOWED_BYTES
    found = {one.name: one for one in elements(path)}
    said = json.loads(text)["tables"]
    tables: dict[str, dict[str, np.ndarray]] = {}

    def column(table: str, name: str) -> np.ndarray:
        if table not in tables:
            held = value_of(found[table], most)
            tables[table] = held if isinstance(held, dict) else {}
        about = said[table]["variables"][name]
        return _with_axes(tables[table][name], len(about["dims"]) + bool(about["is_text"]))

    gaps = value_of(found[_GAP], most) if _GAP in found else None
    stored = _cube(found[_CUBE])
    must_be_plausible(path, stored, file_bytes=file_bytes)
    return kept(
        path,
        text,
        stored,
        told,
        columns=column,
        gaps=None if gaps is None else _with_axes(gaps, 2),
        file_bytes=file_bytes,
        axes=CUBE_AXES[::-1],
    )


def _cube(one: Element) -> Stored:
    (found,) = variable(one).values()
    # MATLAB leaves out axes of 1 at the end when it saves the file again.
    missing = len(CUBE_AXES) - len(found.shape)
    return replace(found, shape=found.shape + (1,) * missing).stored()


def _with_axes(held: Value, n_axes: int) -> np.ndarray:
    """An array with its axes in our order, of which MATLAB has two at least, and none of 1 last.

    Raises
    ------
    TypeError, ValueError
        If it has not so many.
    """
    if not isinstance(held, np.ndarray):
        raise TypeError("it is no array")
    if n_axes < 2:
        return held.reshape((-1,) * n_axes)
    turned = held.transpose()
    return turned.reshape((1,) * (n_axes - turned.ndim) + turned.shape)
