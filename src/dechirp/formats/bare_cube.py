"""Bare numbers of 16 bits without a header, low byte first: the user names their axes."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents, must_be_words, shape_in
from dechirp.formats.arrays.on_disk import mapped
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.settings_for import settings_for


@value
class BareCube(Format):
    """int16 samples in a file without a header, whose axes the user names.

    Sizes of the axes follow from the radar, the number of frames from that of the file.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = ("int16", "uint16-wrapped", "offset-binary")
    only_told: ClassVar[bool] = True

    def recognise(self, path: Path) -> Fit:
        """Tell by nothing in the content being of another kind."""
        return Fit.POSSIBLE if path.is_file() and foreign(path) is None else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        settings = settings_for(path, told)
        n_bytes = path.stat().st_size
        must_be_words(path, n_bytes)
        what = f"a file of {n_bytes} bytes, 2 for each number,"
        shape, findings = shape_in(path, told.axes, settings, n_bytes // 2, what=what)
        encoding = told.encoding or "int16"
        stored = mapped(path, np.dtype("<i2" if encoding == "int16" else "<u2"), shape)
        known = replace(told, settings=settings, encoding=encoding)
        return contents(path, stored, known, file_bytes=n_bytes, findings=findings)
