"""Files of object lists that `dechirp run` writes, with `--objects`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from dechirp.core.findings import Finding


def check_object_files_writable(
    files: Sequence[Path], coding: Mapping[str, str | Path | None]
) -> None:
    """Raise `DechirpError` if an object list cannot be written to one of the files."""
    given = [f"--{name}" for name, item in coding.items() if item is not None]
    if not (files or given):
        return
    from dechirp.cli.errors import replace_settings_by_options  # these take 0.02 s
    from dechirp.core.errors import DechirpError, InvalidSetting
    from dechirp.results.object_lists import can_logs
    from dechirp.results.object_lists.files import check_object_list_path_writable

    if given and not any(file.suffix.lower() in can_logs.SUFFIXES for file in files):
        raise InvalidSetting(
            given[0],
            value="given without a CAN log",
            expected=f"--objects FILE with one of {', '.join(can_logs.SUFFIXES)}",
            fix=f"add the file, or leave {' and '.join(given)} out",
        )
    for file in files:
        try:
            check_object_list_path_writable(file, **coding)
        except DechirpError as error:
            options = {"path": "--objects", "objects": "--objects", "dbc": "--dbc"}
            raise replace_settings_by_options(error, options | {"mapping": "--mapping"}) from None


def write_object_files(
    build_list: "Callable[[], xr.Dataset]",
    files: Sequence[Path],
    coding: Mapping[str, str | Path | None],
) -> "list[Finding]":
    """Build an object list and write it to each file; return the findings on it."""
    from dechirp.core.findings import capture_warned_findings
    from dechirp.results.object_lists.files import write_objects

    with capture_warned_findings() as findings:
        objects = build_list()
        for file in files:
            write_objects(objects, file, **coding)
    return findings
