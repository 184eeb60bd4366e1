"""Conversion of data sets to arrays with a description, and back."""

import json

import numpy as np
import xarray as xr

from dechirp.core.dataset_arrays import dataset_from_arrays, dataset_to_arrays_and_description


def test_dataset_of_numbers_texts_and_flags_reads_back_equal():
    table = xr.Dataset(
        {
            "range": ("detection", np.array([50.0, np.nan]), {"units": "m"}),
            "label": ("detection", np.array(["Fußgänger", ""])),
            "there": (("frame", "detection"), np.array([[True, False]])),
            "ambiguity_number": ("detection", np.array([1, -2], np.int8)),
        },
        {"frame": ("frame", [0.25], {"units": "s"})},
        {"convention": "receding positive", "least": np.float64(0.5)},
    )
    columns, description = dataset_to_arrays_and_description(table)
    result = dataset_from_arrays(columns, json.loads(json.dumps(description)))
    assert result.identical(table.assign_attrs(least=0.5))
    assert all(
        result[name].dtype == table[name].dtype for name in ("range", "there", "ambiguity_number")
    )


def test_dataset_without_rows_reads_back_without_rows():
    table = xr.Dataset({"label": ("detection", np.array([], dtype="U8"))})
    columns, description = dataset_to_arrays_and_description(table)
    assert dataset_from_arrays(columns, description)["label"].shape == (0,)
