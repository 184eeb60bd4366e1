"""Tables of results as text: CSV and JSON."""

import csv
import io
import json
import math

import xarray as xr

from dechirp.core.columns import columns


def csv_text(dataset: xr.Dataset) -> str:
    """The table with a line of names above it; empty where nothing was estimated."""
    table = columns(dataset)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return stream.getvalue()


def json_text(content: object) -> str:
    """JSON of lists, mappings and plain values; null for numbers that JSON does not have.

    In ASCII: the same in every encoding that a terminal may have, and for names of files that
    are no text.
    """
    return json.dumps(_finite(content), indent=2, allow_nan=False) + "\n"


def _finite(content: object) -> object:
    if isinstance(content, dict):
        return {name: _finite(inside) for name, inside in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(inside) for inside in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
