"""Zarr: native stores (`cube.zarr`, or the folder of a run that contains it) and single arrays."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.core.units import SAMPLE_UNITS, current_units
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.lazy_array import ArrayPart, convert_parser_errors
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.arrays.zarr_arrays import (
    EXPECTED,
    METADATA_NAMES,
    open_lazy_array_and_disk_bytes,
    read_json_object,
    read_small_array,
)
from dechirp.recordings.arrays.zarr_tables import ZarrTables
from dechirp.recordings.arrays.zarr_uncompressed import (
    UncompressedChunks,
    parse_uncompressed_chunks,
    scale_codes_into_samples,
)
from dechirp.recordings.description import parse_radar
from dechirp.recordings.native import (
    MAX_SCALE,
    check_device_and_iq_hints,
    lost_chirp_mask,
    measured_frame_starts_s,
)
from dechirp.recordings.readers.base import (
    IQ_ORDERS,
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    Units,
)
from dechirp.recordings.settings.base import RecordingSettings

_CUBE, _MARK = "cube.zarr", "zarr.json"
_VERSION = 1


@frozen_dataclass
class Zarr(Format):
    """Native store `cube.zarr`, or the folder of a run.

    The radar is that of the run, samples keep their units, and tables are read with them.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        folder = _find_cube_folder(path)
        if folder is None:
            return MatchQuality.NO
        try:
            attributes = read_json_object(folder / _MARK).get("attributes")
        except (OSError, ValueError, RecursionError):
            return MatchQuality.NO
        is_native = isinstance(attributes, dict) and {"format_version", "radar"} <= set(attributes)
        return MatchQuality.SELF_DESCRIBING if is_native else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        folder = _find_cube_folder(path)
        with convert_parser_errors(path, EXPECTED):
            if folder is None:
                raise FileNotFoundError(f"no {_CUBE}")
            attributes = read_json_object(folder / _MARK)["attributes"]
            cube = read_json_object(folder / "cube" / _MARK)
            cube_attributes = cube["attributes"]
            units, scale = (
                current_units(cube_attributes["units"]),
                float(cube_attributes.get("scale", 1.0)),
            )
            if not 0 < scale < MAX_SCALE:
                raise ValueError(f"its scale is {scale}")
            axes = tuple(cube.get("dimension_names") or CUBE_AXES)
            radar = None if hints.settings else attributes["radar"]
            device, iq = attributes.get("device"), attributes.get("iq")
            if not isinstance(device, str | None) or iq not in (None, *IQ_ORDERS):
                raise ValueError(f"its device is {device!r} and its order {iq!r}")
            check_device_and_iq_hints(path, hints, device=device, iq=iq)
        if attributes.get("format_version") != _VERSION or units not in SAMPLE_UNITS:
            raise RecordingError(
                path,
                value=f"format version {attributes.get('format_version')!r}, units {units!r}",
                expected=f"version {_VERSION}, units {' or '.join(SAMPLE_UNITS)}",
                fix="read them with the version of dechirp that wrote them",
            )
        settings = hints.settings or RecordingSettings(radar=parse_radar(folder / _MARK, radar))
        samples, file_bytes = open_lazy_array_and_disk_bytes(
            folder, replace(hints, inner_name="cube")
        )
        chunks = None
        if axes[: len(CUBE_AXES)] == CUBE_AXES and samples.absent_chunks is None:
            with convert_parser_errors(path, EXPECTED):
                chunks = parse_uncompressed_chunks(folder / "cube", cube, samples.dtype)
        if chunks is not None:
            samples = replace(samples, read=_make_checked_reader(path, chunks))
        cube_hints = RecordingHints(settings=settings, axes=axes, encoding="full-scale")
        contents = interpret_array_as_recording(path, samples, cube_hints, file_bytes=file_bytes)
        has_codes = samples.dtype == np.int16
        return replace(
            contents,
            decode=_make_scaled_decoder(path, contents, chunks, scale)
            if has_codes
            else contents.decode,
            units=cast(Units, units),
            scale=scale if has_codes else None,
            gaps=lost_chirp_mask(path, _read_array_or_none(path, folder / "gap"), contents),
            frame_starts_s=measured_frame_starts_s(
                _read_array_or_none(path, folder / "frame"), contents
            ),
            tables=ZarrTables(folder, without=("calibration",)),
            device=device,
            iq=iq,
        )


def _make_checked_reader(
    path: Path, chunks: UncompressedChunks
) -> Callable[[ArrayPart], np.ndarray]:
    """Return a function that reads a part of an array; it raises `RecordingError` if damaged."""

    def read(part: ArrayPart) -> np.ndarray:
        with convert_parser_errors(path, EXPECTED):
            return chunks.read_array_part(part)

    return read


def _make_scaled_decoder(
    path: Path, contents: Contents, chunks: UncompressedChunks | None, scale: float
) -> Callable[[int, np.ndarray], None]:
    """Return a function that decodes codes to scaled samples, without a second copy if possible."""
    decode, radar = contents.decode, contents.radar
    assert decode is not None and radar is not None
    n_parts = 2 if radar.frame.chirp.sampling == "complex" else 1
    row_shape = (radar.array.n_rx, radar.frame.chirp.n_samples, *(2,) * (n_parts - 1))
    step: Any = np.float32(scale)
    is_direct = chunks is not None and chunks.row_shape == row_shape

    def scaled(index: int, out: np.ndarray) -> None:
        if chunks is None or not is_direct or not out.flags.c_contiguous:
            decode(index, out)
            out *= step
            return
        with convert_parser_errors(path, EXPECTED):
            for first, rows in chunks.iter_chirp_blocks(index, 0, len(out)):
                samples = out[first : first + len(rows)].reshape(-1).view(np.float32)
                scale_codes_into_samples(rows.reshape(-1), step, samples)

    return scaled


def _read_array_or_none(path: Path, folder: Path) -> np.ndarray | None:
    """Read a small array beside the cube; None if it was not stored."""
    return read_small_array(path, folder) if (folder / _MARK).is_file() else None


def _find_cube_folder(path: Path) -> Path | None:
    """Return the folder of the cube that a path refers to; None if there is none."""
    return next((folder for folder in (path / _CUBE, path) if (folder / _MARK).is_file()), None)


@frozen_dataclass
class ZarrArray(Format):
    """Zarr arrays, whose axes the user names.

    Chunks that were never written become gaps.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        is_zarr = path.is_dir() and any((path / mark).is_file() for mark in METADATA_NAMES)
        return MatchQuality.CONTAINER if is_zarr else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        samples, file_bytes = open_lazy_array_and_disk_bytes(path, hints)
        return interpret_array_as_recording(path, samples, hints, file_bytes=file_bytes)
