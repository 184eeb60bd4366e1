"""Sample object lists for tests."""

import numpy as np
import xarray as xr

from dechirp.results.object_lists.list_columns import MEASURED, STATUSES, build_object_list

DBC_STEPS = {"x": 0.01, "y": 0.01, "z": 0.1, "vx": 0.01, "vy": 0.01, "length": 0.1, "width": 0.1}
DBC_STEPS |= {"x_std": 0.02, "y_std": 0.02, "vx_std": 0.05, "vy_std": 0.05, "snr": 0.2}
"""Quantisation steps of the packaged DBC; the step of snr in dB."""


def random_object_list(*n_objects: int, seed: int = 0, period_s: float = 0.05) -> xr.Dataset:
    """Return an object list with the given counts per frame, within the ranges of the DBC."""
    rng = np.random.default_rng(seed)
    n = sum(n_objects)
    frame = np.repeat(np.arange(len(n_objects)), n_objects)
    columns = {name: rng.uniform(0, 10, n) for name in MEASURED}
    columns |= {name: rng.uniform(-100, 100, n) for name in ("x", "y", "z", "vx", "vy")}
    columns["snr"] = 10 ** rng.uniform(0, 6, n)
    for name in MEASURED:  # a tenth of the values are unknown
        columns[name][rng.random(n) < 0.1] = np.nan
    columns["frame"], columns["time"] = frame, frame * period_s
    columns["number"] = np.concatenate([np.arange(n) for n in (0, *n_objects)])
    columns["status"] = rng.choice(STATUSES, n)
    cycles = np.arange(len(n_objects))
    return build_object_list(columns, cycles, cycles * period_s)


def single_object_list(**columns) -> xr.Dataset:
    """Return an object list of one frame and one object, 50 m ahead by default."""
    row = dict.fromkeys(MEASURED, np.nan) | {"x": 50.0, "y": 0.0, "vx": -5.0, "vy": 0.0}
    row |= {"frame": 0, "time": 0.0, "number": 0, "status": "confirmed"} | columns
    return build_object_list(
        {name: np.array([cell]) for name, cell in row.items()}, [row["frame"]], [row["time"]]
    )


def longest_object_list(status: str, n_objects: int, frame: int = 0) -> xr.Dataset:
    """Return a list of one frame that takes as many bytes in OSI as so many objects can."""
    columns = {name: np.full(n_objects, 1.5) for name in MEASURED}
    columns["number"] = 2**53 - np.arange(n_objects)
    columns["status"] = np.full(n_objects, status)
    columns["frame"], columns["time"] = np.full(n_objects, frame), np.full(n_objects, 1e8)
    return build_object_list(columns, [frame], [1e8])


def check_object_lists_agree(
    result: xr.Dataset, expected: xr.Dataset, steps: dict[str, float]
) -> None:
    """Compare two lists row by row: integers and names exactly, quantities to half a step."""
    for name in ("frame", "number", "status"):
        assert result[name].values.tolist() == expected[name].values.tolist(), name
    for name in ("time", *MEASURED):
        actual_values, expected_values = result[name].values, expected[name].values
        if name == "snr":
            with np.errstate(divide="ignore"):
                actual_values, expected_values = (
                    10 * np.log10(actual_values),
                    10 * np.log10(expected_values),
                )
        tolerance = 0.5 * steps.get(name, 0.0) * (1 + 1e-6) + 1e-12
        np.testing.assert_allclose(
            actual_values,
            expected_values,
            rtol=steps.get("relative", 1e-14),
            atol=tolerance,
            err_msg=name,
        )
