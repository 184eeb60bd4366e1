"""Native Zarr store, as `dechirp run` writes it, for xarray and zarr."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import xarray as xr

from dechirp.core.atomic_files import atomic_folder, check_output_folder_replaceable
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.json_columns import TYPES
from dechirp.recordings.cube_store import NON_AXIS_COORDINATES, write_cube_store
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.adc_samples import (
    iter_frames_as_codes_or_floats,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)

_MARK = "zarr.json"
_RESERVED_NAMES = {"cube", "frame", "chirp", "rx", "sample", "calibration", *NON_AXIS_COORDINATES}

_XARRAY_ATTRIBUTES = {"_FillValue", "coordinates"}


@frozen_dataclass
class Zarr(Writer):
    """Zarr 3: samples one after the other, nothing compressed, with tables as groups."""

    suffixes: ClassVar[tuple[str, ...]] = (".zarr",)
    summary: ClassVar[str] = "all: samples, radar, gaps, tables"

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()
        recording_description_and_columns(recording, None)
        check_column_types(TYPES, recording.tables)
        for name, table in recording.tables.items():
            if name in _RESERVED_NAMES or any(
                map(_is_invalid_folder_name, (name, *map(str, table.variables)))
            ):
                raise _unwritable_table_error(
                    f"a table {name!r} with an unsupported name, or an unsupported column name",
                    "valid folder names, and tables other than"
                    f" {', '.join(sorted(_RESERVED_NAMES))}",
                    "rename it",
                )
            for column, variable in table.variables.items():
                if _XARRAY_ATTRIBUTES & set(variable.attrs):
                    raise _unwritable_table_error(
                        f"a column {name}.{column} with attributes"
                        f" {', '.join(map(str, variable.attrs))}",
                        "no attributes that xarray reserves"
                        f" ({', '.join(sorted(_XARRAY_ATTRIBUTES))})",
                        "leave them out",
                    )

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        native_names = {mark.parent.name for mark in out.glob(f"*/{_MARK}")}
        check_output_folder_replaceable(out, marker_file=_MARK, own_names={_MARK, *native_names})

        def write_with(scale: float | None) -> None:
            with atomic_folder(out) as temporary:
                write_cube_store(
                    temporary,
                    _iter_with_progress(
                        iter_frames_as_codes_or_floats(recording, scale),
                        recording.n_frames,
                        progress,
                    ),
                    n_frames=recording.n_frames,
                    radar=recording.radar,
                    groups=recording.tables,
                    device=recording.contents.device,
                    iq=recording.contents.iq,
                )

        write_as_codes_else_floats(recording, write_with)
        return (out,)


def _iter_with_progress(
    cubes: Iterator[xr.DataArray], n_frames: int, progress: Progress | None
) -> Iterator[xr.DataArray]:
    """Yield the same cubes and report progress after each."""
    for n_done, cube in enumerate(cubes, 1):
        yield cube
        if progress is not None:
            progress(n_done, n_frames)


def _is_invalid_folder_name(name: str) -> bool:
    return not name or "/" in name or name.startswith((".", "__"))


def _unwritable_table_error(value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting="tables", value=value, expected=expected, fix=fix))
