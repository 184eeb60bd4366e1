"""Raw 16-bit numbers without a header, little-endian, whose axes the user names."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_files import open_memory_mapped_array
from dechirp.recordings.arrays.named_axes import (
    check_even_byte_count,
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)
from dechirp.recordings.settings_lookup import find_recording_settings


@frozen_dataclass
class BareCube(Format):
    """Raw int16 samples without a header, whose axes the user names.

    The sizes of the axes follow from the radar, the number of frames from the size of the file.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = ("int16", "uint16-wrapped", "offset-binary")
    must_be_named: ClassVar[bool] = True

    def recognise(self, path: Path) -> MatchQuality:
        return (
            MatchQuality.POSSIBLE
            if path.is_file() and identify_non_raw_content(path) is None
            else MatchQuality.NO
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        settings = find_recording_settings(path, hints)
        n_bytes = path.stat().st_size
        check_even_byte_count(path, n_bytes)
        description = f"a file of {n_bytes} bytes (2 per number)"
        shape, findings = infer_shape_and_findings(
            path, hints.axes, settings, n_bytes // 2, description=description
        )
        encoding = hints.encoding or "int16"
        samples = open_memory_mapped_array(
            path, np.dtype("<i2" if encoding == "int16" else "<u2"), shape
        )
        complete_hints = replace(hints, settings=settings, encoding=encoding)
        return interpret_array_as_recording(
            path, samples, complete_hints, file_bytes=n_bytes, findings=findings
        )
