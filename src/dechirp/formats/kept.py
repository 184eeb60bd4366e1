"""What a file of ours holds: samples with their description, the chirps that were lost, tables."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.stored import Stored, parsing, written
from dechirp.formats.base import Contents, Told
from dechirp.formats.description import Description, is_ours, of_text, tables_of
from dechirp.formats.settings.base import Iq, Settings

LONGEST_TEXT = 2**24
"""Characters of a description; one of 10,000 calibrated channels has 2^20."""
LARGEST_SCALE = 1e30  # times the largest code it is still a single-precision number


def is_meant(text: str | None, told: Told) -> bool:
    """Whether a text is a description of ours, and nobody said how to read its array instead."""
    is_other = told.inside or told.axes or told.encoding
    return text is not None and is_ours(text) and not is_other


def must_agree(path: Path, told: Told, *, device: str | None, iq: Iq | None) -> None:
    """Raise `RecordingError` where a file of ours says another device or order than the user.

    A device that was told with a radar is that of the radar: where its antennas are.
    """
    chip = None if told.device is None or told.settings is not None else told.device.kind()
    for name, given, said in (("device", chip, device), ("iq", told.iq, iq)):
        if given not in (None, said):
            raise RecordingError(
                path,
                got=f"written by dechirp, with --{name} {given}",
                need=f"read as it was written: it knows its own order and device"
                f" ({name}: {said or 'none'}), and --{name} is for bare samples",
                fix=f"Leave out --{name} ({name}=... in Python).",
            )


def kept(
    path: Path,
    text: str,
    stored: Stored,
    told: Told,
    *,
    columns: Callable[[str, str], np.ndarray],
    gaps: np.ndarray | None,
    file_bytes: int,
    axes: tuple[str, ...] = CUBE_AXES,
) -> Contents:
    """Contents of a file of ours.

    Parameters
    ----------
    path : Path
        The file.
    text : str
        Its description.
    stored : Stored
        Its samples, or the codes of them where the description has a scale.
    told : Told
        A radar in it comes before that of the file.
    columns : function (table, column)
        The arrays of the tables.
    gaps : array (frame, chirp), optional
        Not zero where samples were lost.
    file_bytes : int
        Size of the samples' file.
    axes : names
        Of the samples, in their order; one more behind them, of 2, is `iq`.

    Raises
    ------
    RecordingError
        If it is damaged, or does not fit the radar.
    """
    given = None if told.settings is None else told.settings.radar
    with parsing(path, "a file with a whole description"):
        description = of_text(path, text, given)
        must_agree(path, told, device=description.device, iq=description.iq)
        _must_have_scale(path, description, stored.dtype)
        if len(stored.shape) == len(axes) + 1:
            axes = (*axes, "iq")
        settings = told.settings or Settings(radar=description.radar)
        meant = Told(settings=settings, axes=axes, encoding="full-scale")
        held = contents(path, stored, meant, file_bytes=file_bytes)
        tables = tables_of(path, description, columns)
    decode, scale = held.decode, description.scale
    assert decode is not None

    def scaled(index: int, out: np.ndarray) -> None:
        decode(index, out)
        if scale is not None:
            out *= np.float32(scale)

    return replace(
        held,
        decode=scaled,
        units=description.units,
        gaps=lost_chirps(path, gaps, held),
        scale=scale,
        tables=tables,
        device=description.device,
        iq=description.iq,
    )


def _must_have_scale(path: Path, description: Description, dtype: np.dtype) -> None:
    """Codes come with the step of their converter, samples without."""
    numbers = dtype if dtype.names is None else dtype[0]
    is_coded = numbers.kind == "i" and numbers.itemsize == 2
    scale = description.scale
    if (scale is None and numbers.kind in "fc") or (
        scale is not None and is_coded and 0 < scale < LARGEST_SCALE
    ):
        return
    raise RecordingError(
        path,
        got=f"with samples of type {dtype} and a scale of {scale}",
        need="codes of 16 bits with a positive scale, or floats without any",
        fix="Copy the file again from its source.",
    )


def lost_chirps(path: Path, gaps: np.ndarray | None, held: Contents) -> np.ndarray | None:
    """(frame, chirp), True where an array of the file says so, or samples are not there."""
    if gaps is None:
        return held.gaps
    assert held.radar is not None
    need = (held.n_frames, held.radar.frame.n_sent)
    if gaps.shape != need:
        raise RecordingError(
            path,
            got=f"with an array gap of {written(gaps.shape)}",
            need=f"of {written(need)}, frames and chirps of its samples",
            fix="Copy the file again from its source.",
        )
    lost = gaps != 0
    return lost if held.gaps is None else lost | held.gaps
