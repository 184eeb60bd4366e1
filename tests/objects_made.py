"""Object lists that several tests share."""

import numpy as np
import xarray as xr

from dechirp.results.object_lists.list_columns import MEASURED, STATUSES, build_object_list

STEPS = {"x": 0.01, "y": 0.01, "z": 0.1, "vx": 0.01, "vy": 0.01, "length": 0.1, "width": 0.1}
STEPS |= {"x_std": 0.02, "y_std": 0.02, "vx_std": 0.05, "vy_std": 0.05, "snr": 0.2}
"""Steps of the DBC that comes with the package; that of snr in dB."""


def objects_at(*n_objects: int, seed: int = 0, period_s: float = 0.05) -> xr.Dataset:
    """Object list with so many objects in each frame, within the ranges of the DBC."""
    rng = np.random.default_rng(seed)
    n = sum(n_objects)
    frame = np.repeat(np.arange(len(n_objects)), n_objects)
    columns = {name: rng.uniform(0, 10, n) for name in MEASURED}
    columns |= {name: rng.uniform(-100, 100, n) for name in ("x", "y", "z", "vx", "vy")}
    columns["snr"] = 10 ** rng.uniform(0, 6, n)
    for name in MEASURED:  # some are not told
        columns[name][rng.random(n) < 0.1] = np.nan
    columns["frame"], columns["time"] = frame, frame * period_s
    columns["number"] = np.concatenate([np.arange(n) for n in (0, *n_objects)])
    columns["status"] = rng.choice(STATUSES, n)
    cycles = np.arange(len(n_objects))
    return build_object_list(columns, cycles, cycles * period_s)


def one(**columns) -> xr.Dataset:
    """Object list of one frame and one object, 50 m ahead unless columns say otherwise."""
    row = dict.fromkeys(MEASURED, np.nan) | {"x": 50.0, "y": 0.0, "vx": -5.0, "vy": 0.0}
    row |= {"frame": 0, "time": 0.0, "number": 0, "status": "confirmed"} | columns
    return build_object_list(
        {name: np.array([cell]) for name, cell in row.items()}, [row["frame"]], [row["time"]]
    )


def must_be_equal(read: xr.Dataset, written: xr.Dataset, steps: dict[str, float]) -> None:
    """Compare in order: what is counted or named exactly, the rest to half a step."""
    for name in ("frame", "number", "status"):
        assert read[name].values.tolist() == written[name].values.tolist(), name
    for name in ("time", *MEASURED):
        got, want = read[name].values, written[name].values
        if name == "snr":
            with np.errstate(divide="ignore"):
                got, want = 10 * np.log10(got), 10 * np.log10(want)
        near = 0.5 * steps.get(name, 0.0) * (1 + 1e-6) + 1e-12
        np.testing.assert_allclose(
            got, want, rtol=steps.get("relative", 1e-14), atol=near, err_msg=name
        )
