"""CSV and JSON text of result tables."""

import csv
import io
import json
import math

import xarray as xr

from dechirp.core.table_columns import dataset_to_columns


def csv_text(dataset: xr.Dataset) -> str:
    """Return the table as CSV with a header of names; undetermined values are empty."""
    table = dataset_to_columns(dataset)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return stream.getvalue()


def json_text(content: object) -> str:
    """Return lists, mappings and plain values as JSON; non-finite numbers become null.

    The text is ASCII, so it is the same in every terminal encoding and holds file names that are
    not valid Unicode.
    """
    return json.dumps(_replace_non_finite(content), indent=2, allow_nan=False) + "\n"


def _replace_non_finite(content: object) -> object:
    if isinstance(content, dict):
        return {name: _replace_non_finite(item) for name, item in content.items()}
    if isinstance(content, list | tuple):
        return [_replace_non_finite(item) for item in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
