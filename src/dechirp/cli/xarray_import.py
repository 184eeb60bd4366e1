"""Import of xarray without Dask, of which `dechirp run` uses nothing."""

import sys


def import_xarray_without_dask() -> None:
    """Import xarray so that it does without Dask; change nothing if either has been imported.

    xarray imports Dask where it is installed, and so parts of SciPy, when the first array is
    labelled: 0.3 s of processor time. Dask is hidden only until then, as None in `sys.modules`;
    an extension of dechirp can import it afterwards.
    """
    if {"xarray", "dask"} & sys.modules.keys():
        return
    sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        import xarray as xr

        xr.Variable((), 0.0)
    finally:
        del sys.modules["dask"]
