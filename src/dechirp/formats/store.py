"""Our own results: `cube.zarr`, or the folder of a run that holds it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from dechirp.config import files
from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.stored import parsing
from dechirp.formats.base import Contents, Fit, Format, Told, Units
from dechirp.formats.settings.base import Settings
from dechirp.formats.zarr_array import NEED, array_in, read_json
from dechirp.radar.radar import Radar

_CUBE, _MARK = "cube.zarr", "zarr.json"
_VERSION = 1
_UNITS = ("sqrt(W)", "full scale")


@value
class Store(Format):
    """Our own store: `cube.zarr`, or the folder of a run.

    The radar is that of the run; samples keep their units.
    """

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
            axes = tuple(cube.get("dimension_names") or CUBE_AXES)
            radar = None if told.settings else attributes["radar"]
        if attributes.get("format_version") != _VERSION or units not in _UNITS:
            raise RecordingError(
                path,
                got=f"results of format version {attributes.get('format_version')!r}, in units"
                f" of {units!r}",
                need=f"of version {_VERSION}, in {' or '.join(_UNITS)}",
                fix="Read them with the version of dechirp that wrote them.",
            )
        settings = told.settings or _settings(folder, radar)
        stored, file_bytes = array_in(folder, replace(told, inside="cube"))
        meant = Told(settings=settings, axes=axes, encoding="full-scale")
        held = contents(path, stored, meant, file_bytes=file_bytes)
        decode = held.decode
        assert decode is not None

        def scaled(index: int, out: np.ndarray) -> None:
            decode(index, out)
            if scale != 1:
                out *= np.float32(scale)

        return replace(held, decode=scaled, units=cast(Units, units))


def _folder(path: Path) -> Path | None:
    """Folder of the cube that a path can mean."""
    return next((one for one in (path / _CUBE, path) if (one / _MARK).is_file()), None)


def _settings(folder: Path, radar: Any) -> Settings:
    """Radar of the run, which stands in the attributes as in a settings file."""
    try:
        made = files.parse(json.dumps(radar), Radar, file=f"{folder / _MARK}: radar")
    except DechirpError as error:
        raise RecordingError(
            folder / _MARK,
            got=f"a store whose radar cannot be read ({error})",
            need="the radar that made its samples",
            fix="Give the radar: --radar FILE (radar=FILE in Python).",
        ) from None
    return Settings(radar=made)
