"""What many tests share: one small radar, and the reference scenario."""

import os

# Two workers on two cores: threads of their own would get in each other's way.
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

import pytest
import xarray as xr
from hypothesis import settings

import dechirp as dc

# The same examples in every run; slow machines are not failures.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


@pytest.fixture(scope="session")
def radar() -> dc.Radar:
    """77 GHz, 0.29 m and 0.43 m/s a bin, 75 m and 27 m/s unambiguous, two receivers."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling="complex",
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=128, interval_s=35e-6),
        array=dc.Array(rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


@pytest.fixture(scope="session")
def reference() -> dc.Scenario:
    """77 GHz, 150 MHz, 2200 x 128 samples, one car at 50 m receding at 10 m/s."""
    return dc.reference()


@pytest.fixture(scope="session")
def clean(reference) -> xr.DataArray:
    """The reference echo without noise."""
    with pytest.warns(dc.PhysicsWarning, match="echo arrives"):
        return dc.simulate(reference.scene, reference.radar, impairments=())
