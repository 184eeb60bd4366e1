"""Our own results: `cube.zarr`, or the folder of a run that holds it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.stored import parsing
from dechirp.formats.arrays.zarr_plain import PlainChunks, plain_chunks, scale_codes
from dechirp.formats.base import IQ_ORDERS, Contents, Fit, Format, Told, Units
from dechirp.formats.description import UNITS, radar_of
from dechirp.formats.kept import LARGEST_SCALE, lost_chirps, must_agree
from dechirp.formats.settings.base import Settings
from dechirp.formats.zarr_array import NEED, array_in, read_array, read_json
from dechirp.formats.zarr_tables import Tables

_CUBE, _MARK = "cube.zarr", "zarr.json"
_VERSION = 1


@value
class Store(Format):
    """Our own store: `cube.zarr`, or the folder of a run.

    The radar is that of the run; samples keep their units, and tables lie beside them.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by the attributes that a run writes."""
        folder = _folder(path)
        if folder is None:
            return Fit.NO
        try:
            attributes = read_json(folder / _MARK).get("attributes")
        except (OSError, ValueError, RecursionError):
            return Fit.NO
        ours = isinstance(attributes, dict) and {"format_version", "radar"} <= set(attributes)
        return Fit.OWN if ours else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        folder = _folder(path)
        with parsing(path, NEED):
            if folder is None:
                raise FileNotFoundError(f"no {_CUBE}")
            attributes = read_json(folder / _MARK)["attributes"]
            cube = read_json(folder / "cube" / _MARK)
            said = cube["attributes"]
            units, scale = said["units"], float(said.get("scale", 1.0))
            if not 0 < scale < LARGEST_SCALE:
                raise ValueError(f"its scale is {scale}")
            axes = tuple(cube.get("dimension_names") or CUBE_AXES)
            radar = None if told.settings else attributes["radar"]
            device, iq = attributes.get("device"), attributes.get("iq")
            if not isinstance(device, str | None) or iq not in (None, *IQ_ORDERS):
                raise ValueError(f"its device is {device!r} and its order {iq!r}")
            must_agree(path, told, device=device, iq=iq)
        if attributes.get("format_version") != _VERSION or units not in UNITS:
            raise RecordingError(
                path,
                got=f"results of format version {attributes.get('format_version')!r}, in units"
                f" of {units!r}",
                need=f"of version {_VERSION}, in {' or '.join(UNITS)}",
                fix="Read them with the version of dechirp that wrote them.",
            )
        settings = told.settings or Settings(radar=radar_of(folder / _MARK, radar))
        stored, file_bytes = array_in(folder, replace(told, inside="cube"))
        plain = None
        if axes[: len(CUBE_AXES)] == CUBE_AXES and stored.absent is None:
            with parsing(path, NEED):
                plain = plain_chunks(folder / "cube", cube, stored.dtype)
        if plain is not None:
            stored = replace(stored, read=plain.part)
        meant = Told(settings=settings, axes=axes, encoding="full-scale")
        held = contents(path, stored, meant, file_bytes=file_bytes)
        has_codes = stored.dtype == np.int16
        return replace(
            held,
            decode=_scaled(path, held, plain, scale) if has_codes else held.decode,
            units=cast(Units, units),
            scale=scale if has_codes else None,
            gaps=lost_chirps(path, _gaps(path, folder / "gap"), held),
            tables=Tables(folder, without=("calibration",)),
            device=device,
            iq=iq,
        )


def _scaled(
    path: Path, held: Contents, plain: PlainChunks | None, scale: float
) -> Callable[[int, np.ndarray], None]:
    """Fill a frame with samples of codes; those in plain chunks without a copy of all of it."""
    decode, radar = held.decode, held.radar
    assert decode is not None and radar is not None
    n_parts = 2 if radar.frame.chirp.sampling == "complex" else 1
    row_shape = (radar.array.n_rx, radar.frame.chirp.n_samples, *(2,) * (n_parts - 1))
    step: Any = np.float32(scale)
    is_quick = plain is not None and plain.row_shape == row_shape

    def scaled(index: int, out: np.ndarray) -> None:
        if plain is None or not is_quick or not out.flags.c_contiguous:
            decode(index, out)
            out *= step
            return
        with parsing(path, NEED):
            for first, rows in plain.read(index, 0, len(out)):
                samples = out[first : first + len(rows)].reshape(-1).view(np.float32)
                scale_codes(rows.reshape(-1), step, samples)

    return scaled


def _gaps(path: Path, folder: Path) -> np.ndarray | None:
    """(frame, chirp), not zero where samples were lost; None where nothing is said of it."""
    return read_array(path, folder) if (folder / _MARK).is_file() else None


def _folder(path: Path) -> Path | None:
    """Folder of the cube that a path can mean."""
    return next((one for one in (path / _CUBE, path) if (one / _MARK).is_file()), None)
