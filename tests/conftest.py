"""Fixtures of many tests: a small radar, and the reference scenario."""

import os

# Two workers on two cores: more threads would compete for them.
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

import pytest
import xarray as xr
from hypothesis import settings

import dechirp as dc
from radars import street_radar

# The same examples in every run; slow machines are not failures.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


@pytest.fixture(scope="session")
def radar() -> dc.Radar:
    """77 GHz, 0.29 m and 0.43 m/s a bin, 75 m and 27 m/s unambiguous, two receivers."""
    return street_radar(n_samples=256, n_chirps=128)


@pytest.fixture(scope="session")
def reference() -> dc.Scenario:
    """77 GHz, 150 MHz, 2200 x 128 samples, one car at 50 m receding at 10 m/s."""
    return dc.reference()


@pytest.fixture(scope="session")
def clean(reference) -> xr.DataArray:
    """The reference echo without noise."""
    return dc.simulate(reference.scene, reference.radar, impairments=())
