"""Tables of a recording that dechirp wrote as messages."""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.radar.radar import Radar
from dechirp.recordings.description import Description, parse_description, read_described_tables
from dechirp.recordings.messages.message_arrays import ROOT, MessageArrays
from dechirp.recordings.readers.base import Contents

DETECTIONS = "detections"


def read_native_message_contents(
    path: Path, description_text: str, arrays: MessageArrays, radar: Radar | None
) -> Contents:
    """Return detections and other tables of a native file.

    A `radar` given by the user has priority over that of the file.
    """
    description = parse_description(path, description_text, radar)

    def column(table: str, name: str) -> np.ndarray:
        return _read_table_column(arrays, description, table, name)

    tables = read_described_tables(path, description, column)
    n_frames = len(arrays.clouds.get(f"{ROOT}/{DETECTIONS}", ()))
    detections = tables.get(DETECTIONS)
    frame_numbers = None if detections is None else detections.get("frame")
    if (
        not n_frames
        or frame_numbers is None
        or not ((frame_numbers >= 0) & (frame_numbers < n_frames)).all()
    ):
        raise RecordingError(
            path,
            value=f"{n_frames} clouds of detections, which do not match the table",
            expected="a cloud for each frame",
            fix="copy it again from its source",
        )
    return Contents(
        radar=description.radar,
        n_frames=n_frames,
        units=description.units,
        device=description.device,
        points=detections,
        tables=tables,
    )


def _read_table_column(
    arrays: MessageArrays, description: Description, table: str, name: str
) -> np.ndarray:
    """Return a column of a table: a separate array, or a field of the points of all frames."""
    variable = description.tables[table]["variables"][name]
    dtype = np.dtype(variable["dtype"])
    if dtype.kind not in "biufc":
        raise ValueError(f"{name} of type {dtype}")
    topic = f"{ROOT}/{table}"
    values = arrays.arrays.get(f"{topic}/{name}")
    if values is None:
        parts = [cloud.points[name] for cloud in arrays.clouds[topic]]
        dims = list(variable["dims"])
        has_frame_axis = "frame" in dims
        values = (
            np.stack(parts, axis=dims.index("frame")) if has_frame_axis else np.concatenate(parts)
        )
        # Texts of one byte: no field has a further axis.
        if variable["is_text"] and values.ndim == len(dims):
            values = values[..., None]
    if dtype.kind == "c":  # real and imaginary parts along a last axis
        return np.ascontiguousarray(values).view(dtype)[..., 0]
    return values.astype(dtype)
