"""Fixture of a small radar."""

import pytest

import dechirp as dc


@pytest.fixture(scope="session")
def radar() -> dc.Radar:
    """77 GHz, 0.29 m and 0.87 m/s a cell, to 75 m and 28 m/s, two receivers."""
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
        frame=dc.Frame(chirp=chirp, n_chirps=64, interval_s=35e-6),
        array=dc.Array(rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )
