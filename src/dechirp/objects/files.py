"""Object lists in files: what a suffix stands for."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

from dechirp.objects import can_logs, osi, points, tables
from dechirp.objects.can_logs import read_can_log, write_can_log
from dechirp.objects.osi import read_osi, write_osi
from dechirp.objects.points import read_points, write_points
from dechirp.objects.rows import COLUMNS, made
from dechirp.objects.tables import read_table, write_table
from dechirp.objects.whole import must_be_writable, named

_WRITERS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    **dict.fromkeys(can_logs.SUFFIXES, write_can_log),
    **dict.fromkeys(osi.SUFFIXES, write_osi),
    **dict.fromkeys(points.SUFFIXES, write_points),
    **dict.fromkeys(tables.SUFFIXES, write_table),
}
_READERS: dict[str, Callable[[Path], xr.Dataset]] = {
    **dict.fromkeys(can_logs.SUFFIXES, read_can_log),
    **dict.fromkeys(osi.SUFFIXES, read_osi),
    **dict.fromkeys(points.SUFFIXES, read_points),
    **dict.fromkeys(tables.SUFFIXES, read_table),
}


def write_objects(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list to a file, whole or not at all, in the format of its suffix.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it.
    path : path
        `.blf`, `.asc` or `.log` (candump): CAN FD frames by the DBC of the package; `.osi`: ASAM
        OSI; `.pcd`, `.ply`: points; `.csv`, `.parquet`: a table. Each format has a function of
        its own with more settings.

    Raises
    ------
    InvalidSetting
        If the suffix is unknown, it is no object list, the path cannot be written, or the
        extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If objects are left out, or values are beyond what the format can tell.
    """
    place = named(path, _WRITERS)
    _WRITERS[place.suffix.lower()](objects, place)


def read_objects(path: str | Path) -> xr.Dataset:
    """Read an object list from a file, in the format of its suffix, as `write_objects` writes it.

    Raises
    ------
    InvalidSetting
        If the suffix is unknown, or the extra `io` is missing.
    RecordingError
        If the file cannot be read, or is not what its suffix says.
    """
    place = named(path, _READERS)
    return _READERS[place.suffix.lower()](place)


def check_path(path: str | Path) -> None:
    """Raise `InvalidSetting` if nothing can be written there; to be asked before a long run.

    A list of nothing is written elsewhere, to learn whether the libraries for it are there.
    """
    place = named(path, _WRITERS)
    must_be_writable(place)
    with TemporaryDirectory() as elsewhere:
        empty = made(dict.fromkeys(COLUMNS, ()), (), ())
        write_objects(empty, Path(elsewhere) / f"objects{place.suffix}")
