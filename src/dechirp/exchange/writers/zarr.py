"""Zarr: our own store, as `dechirp run` writes it, that xarray and zarr open."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import value
from dechirp.exchange.coded import frames, if_codes
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.arrays.json_columns import TYPES
from dechirp.formats.recording import Recording
from dechirp.store.cube import BESIDE, write_cube
from dechirp.store.whole import must_be_replaceable, whole_folder

_MARK = "zarr.json"
_TAKEN = {"cube", "frame", "chirp", "rx", "sample", "calibration", *BESIDE}

_OF_XARRAY = {"_FillValue", "coordinates"}


@value
class Zarr(Writer):
    """Zarr 3: samples one after the other, nothing compressed, with tables as groups."""

    endings: ClassVar[tuple[str, ...]] = (".zarr",)
    keeps: ClassVar[str] = "all: samples, radar, gaps, tables"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()
        said_of(recording, None)
        must_be_of(TYPES, recording.tables)
        for name, table in recording.tables.items():
            if name in _TAKEN or any(map(_is_no_folder, (name, *map(str, table.variables)))):
                raise _refused(
                    f"with a table {name!r}, or a column in it, whose name cannot be kept",
                    f"with names of folders, tables with none of {', '.join(sorted(_TAKEN))}",
                    "Rename it.",
                )
            for column, variable in table.variables.items():
                if _OF_XARRAY & set(variable.attrs):
                    raise _refused(
                        f"with a column {name}.{column} with attributes"
                        f" {', '.join(map(str, variable.attrs))}",
                        "without attributes that xarray uses itself"
                        f" ({', '.join(sorted(_OF_XARRAY))})",
                        "Leave them out.",
                    )

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        ours = {mark.parent.name for mark in out.glob(f"*/{_MARK}")}
        must_be_replaceable(out, mark=_MARK, ours={_MARK, *ours})

        def write_with(scale: float | None) -> None:
            with whole_folder(out) as made:
                write_cube(
                    made,
                    _told(frames(recording, scale), recording.n_frames, progress),
                    n_frames=recording.n_frames,
                    radar=recording.radar,
                    groups=recording.tables,
                    device=recording.contents.device,
                    iq=recording.contents.iq,
                )

        if_codes(recording, write_with)
        return (out,)


def _told(
    cubes: Iterator[xr.DataArray], n_frames: int, progress: Progress | None
) -> Iterator[xr.DataArray]:
    """The same cubes; progress is told when each is done with."""
    for done, cube in enumerate(cubes, 1):
        yield cube
        if progress is not None:
            progress(done, n_frames)


def _is_no_folder(name: str) -> bool:
    return not name or "/" in name or name.startswith((".", "__"))


def _refused(got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting="tables", got=got, need=need, fix=fix))
