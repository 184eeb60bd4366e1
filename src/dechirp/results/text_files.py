"""Text of result tables (CSV, JSON), and folders of small files, written atomically."""

import csv
import io
import json
import math
from collections.abc import Collection, Mapping
from pathlib import Path

import xarray as xr

from dechirp.core.atomic_files import atomic_folder, check_output_folder_replaceable
from dechirp.core.table_columns import dataset_to_columns


def dataset_to_csv(dataset: xr.Dataset) -> str:
    """Return the table as CSV with a header of names; undetermined values are empty."""
    table = dataset_to_columns(dataset)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return stream.getvalue()


def to_json_text(content: object) -> str:
    """Return lists, mappings and plain values as JSON; non-finite numbers become null.

    The text is ASCII, so it is the same in every terminal encoding and holds file names that are
    not valid Unicode.
    """
    return json.dumps(_replace_non_finite_by_none(content), indent=2, allow_nan=False) + "\n"


def _replace_non_finite_by_none(content: object) -> object:
    if isinstance(content, dict):
        return {name: _replace_non_finite_by_none(item) for name, item in content.items()}
    if isinstance(content, list | tuple):
        return [_replace_non_finite_by_none(item) for item in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def check_folder_replaceable(out: Path, names: Collection[str]) -> None:
    """Raise `DechirpError` if a folder cannot take files of these names.

    The folder must be absent, empty or hold only earlier files of these names, the first name among
    them. Call this before a long run.
    """
    check_output_folder_replaceable(out, marker_file=next(iter(names)), own_names=names)


def write_files_into_folder(out: Path, contents: Mapping[str, bytes]) -> None:
    """Write each content under its name into a folder that `check_folder_replaceable` accepted.

    Raises
    ------
    DechirpError
        If the folder cannot be written. It is then unchanged.
    """
    with atomic_folder(out) as made:
        for name, content in contents.items():
            (made / name).write_bytes(content)
