"""Object-list files: readers and writers by file suffix."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.atomic_files import check_file_suffix, check_output_writable
from dechirp.results.object_lists import can_logs, osi, point_cloud_files, tables
from dechirp.results.object_lists.can_logs import read_can_log, write_can_log
from dechirp.results.object_lists.list_columns import COLUMNS, build_object_list
from dechirp.results.object_lists.osi import read_osi, write_osi
from dechirp.results.object_lists.point_cloud_files import read_points, write_points
from dechirp.results.object_lists.tables import read_object_table, write_object_table

__all__ = ["read_objects", "write_objects"]


_WRITERS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    **dict.fromkeys(can_logs.SUFFIXES, write_can_log),
    **dict.fromkeys(osi.SUFFIXES, write_osi),
    **dict.fromkeys(point_cloud_files.SUFFIXES, write_points),
    **dict.fromkeys(tables.SUFFIXES, write_object_table),
}
_READERS: dict[str, Callable[[Path], xr.Dataset]] = {
    **dict.fromkeys(can_logs.SUFFIXES, read_can_log),
    **dict.fromkeys(osi.SUFFIXES, read_osi),
    **dict.fromkeys(point_cloud_files.SUFFIXES, read_points),
    **dict.fromkeys(tables.SUFFIXES, read_object_table),
}


@check_argument_types
def write_objects(
    objects: xr.Dataset,
    path: str | Path,
    *,
    dbc: str | Path | None = None,
    mapping: str | Path | None = None,
) -> None:
    """Write an object list to a file, atomically, in the format of its suffix.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    path : path
        `.blf`, `.asc` or `.log` (candump): CAN FD frames by the DBC of the package; `.osi`: ASAM
        OSI; `.pcd`, `.ply`: points; `.csv`, `.parquet`: a table. The functions of the formats
        have further settings.
    dbc, mapping : optional
        Coding in CAN logs, as of `write_can_log`; other formats have none.

    Raises
    ------
    InvalidSetting
        If the suffix is unknown, it is not an object list, the path or the DBC cannot be used, or
        the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If objects are left out, or values exceed the range of the format.
    """
    output_path = check_file_suffix(path, _WRITERS)
    if output_path.suffix.lower() in can_logs.SUFFIXES:
        write_can_log(objects, output_path, dbc=dbc, mapping=mapping)
    else:
        _WRITERS[output_path.suffix.lower()](objects, output_path)


@check_argument_types
def read_objects(path: str | Path) -> xr.Dataset:
    """Read an object list from a file, in the format of its suffix, as `write_objects` writes it.

    Parameters
    ----------
    path : path
        A file with a suffix of `write_objects`.

    Raises
    ------
    InvalidSetting
        If the suffix is unknown, or the extra `io` is missing.
    RecordingError
        If the file cannot be read, or does not have the format of its suffix.
    """
    input_path = check_file_suffix(path, _READERS)
    return _READERS[input_path.suffix.lower()](input_path)


def check_object_list_path_writable(
    path: str | Path, *, dbc: str | Path | None = None, mapping: str | Path | None = None
) -> None:
    """Raise `InvalidSetting` if the path cannot be written; call this before a long run.

    An empty list is written to a temporary folder, to check that the required libraries are
    installed and that the DBC suits the mapping.
    """
    output_path = check_file_suffix(path, _WRITERS)
    check_output_writable(output_path)
    with TemporaryDirectory() as folder:
        empty = build_object_list(dict.fromkeys(COLUMNS, ()), (), ())
        file = Path(folder) / f"objects{output_path.suffix}"
        write_objects(empty, file, dbc=dbc, mapping=mapping)
