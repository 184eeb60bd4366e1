"""Radars with one transmitter or a TDM array, and frames of a few targets in noise."""

from pathlib import Path

import xarray as xr

import dechirp as dc
from dechirp.core.compiled_kernels import use_compiled_kernels

use_compiled_kernels()  # warm from the first call on

CROSSING = Path(__file__).parents[2] / "examples" / "crossing-tracks.yaml"


def build_radar(n_samples: int, n_chirps: int, n_tx: int, n_rx: int) -> dc.Radar:
    """Build a TDM radar with a uniform linear virtual array of half-wavelength spacing."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=10e12,
        adc_start_s=3e-6,
        ramp_duration_s=5e-6 + n_samples / 20e6,
        sample_rate_hz=20e6,
        n_samples=n_samples,
        sampling="complex",
    )
    spacing_m = chirp.wavelength_m / 2
    multiplexing = dc.multiplexing.Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp,
            n_chirps=n_chirps,
            interval_s=chirp.ramp_duration_s + 2e-6,
            multiplexing=multiplexing,
        ),
        array=dc.Array(
            tx_m=[(0, n_rx * spacing_m * k, 0) for k in range(n_tx)],
            rx_m=[(0, spacing_m * k, 0) for k in range(n_rx)],
        ),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


def simulate_frame(
    n_samples: int, n_chirps: int, n_tx: int, n_rx: int, *, n_targets: int
) -> tuple[xr.DataArray, dc.Radar]:
    """Simulate a frame of targets in noise."""
    radar = build_radar(n_samples, n_chirps, n_tx, n_rx)
    return dc.simulate(dc.Scene(targets=build_targets(n_targets)), radar, seed=1), radar


def build_targets(n: int) -> list[dc.Target]:
    return [
        dc.Target(
            position_m=(20 + 7 * k, 3 * (k % 5) - 6, 0), velocity_m_per_s=(k - 5, 0, 0), rcs_m2=10.0
        )
        for k in range(n)
    ]
