"""Tables of a recording that was written as messages, read back equal."""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.formats.base import Contents
from dechirp.formats.description import Description, of_text, tables_of
from dechirp.formats.messages.kept import ROOT, Kept
from dechirp.radar.radar import Radar

DETECTIONS = "detections"


def contents(path: Path, text: str, held: Kept, radar: Radar | None) -> Contents:
    """Detections and the other tables of a file of ours; `radar`: one that the user gave."""
    description = of_text(path, text, radar)

    def column(table: str, name: str) -> np.ndarray:
        return _column(held, description, table, name)

    tables = tables_of(path, description, column)
    n_frames = len(held.clouds.get(f"{ROOT}/{DETECTIONS}", ()))
    detections = tables.get(DETECTIONS)
    numbers = None if detections is None else detections.get("frame")
    if not n_frames or numbers is None or not ((numbers >= 0) & (numbers < n_frames)).all():
        raise RecordingError(
            path,
            got=f"with {n_frames} clouds of detections, which are not those of the table",
            need="as it was written: a cloud for each frame",
            fix="Copy it again from its source.",
        )
    return Contents(
        radar=description.radar,
        n_frames=n_frames,
        units=description.units,
        device=description.device,
        points=detections,
        tables=tables,
    )


def _column(held: Kept, description: Description, table: str, name: str) -> np.ndarray:
    """A variable of a table: an array of its own, or a field of the points of all frames."""
    said = description.tables[table]["variables"][name]
    kind = np.dtype(said["dtype"])
    if kind.kind not in "biufc":
        raise ValueError(f"{name} of type {kind}")
    topic = f"{ROOT}/{table}"
    values = held.arrays.get(f"{topic}/{name}")
    if values is None:
        parts = [cloud.points[name] for cloud in held.clouds[topic]]
        over = list(said["dims"])
        by_frame = "frame" in over
        values = np.stack(parts, axis=over.index("frame")) if by_frame else np.concatenate(parts)
        if said["is_text"] and values.ndim == len(over):  # of one byte each: no field has an axis
            values = values[..., None]
    if kind.kind == "c":  # real and imaginary parts along a last axis
        return np.ascontiguousarray(values).view(kind)[..., 0]
    return values.astype(kind)
