"""Cubes of noise, and echoes with added noise, for tests."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

import dechirp as dc
from dechirp.core.gaussian_noise import add_white_noise


def add_noise(clean: xr.DataArray, snr_db: float, rng: np.random.Generator) -> xr.DataArray:
    """Return the echo with white noise at an SNR per sample."""
    cube = clean.copy()
    echo_w = float(np.mean(abs(clean.values) ** 2))
    add_white_noise(cube.values, echo_w / 10 ** (snr_db / 10), rng)
    return cube


def iter_noisy_trials(
    clean: xr.DataArray, snr_db: float, rng: np.random.Generator, n: int
) -> Iterator[xr.DataArray]:
    """Yield n trials of the echo with independent noise, in one reused buffer."""
    cube = clean.copy()
    noise_w = float(np.mean(abs(clean.values) ** 2)) / 10 ** (snr_db / 10)
    for _ in range(n):
        cube.values[...] = clean.values
        add_white_noise(cube.values, noise_w, rng)
        yield cube


def simulate_noise_cube(radar: dc.Radar, rng: np.random.Generator) -> xr.DataArray:
    """Return one frame of white noise of unit power."""
    chirp = radar.frame.chirp
    shape = (1, radar.frame.n_chirps_total, radar.array.n_rx, chirp.n_samples)
    dtype = np.complex64 if chirp.sampling == "complex" else np.float32
    cube = xr.DataArray(np.zeros(shape, dtype), dims=("frame", "chirp", "rx", "sample"))
    add_white_noise(cube.values, 1.0, rng)
    return cube


def count_false_alarms(
    radar: dc.Radar, rng: np.random.Generator, *, n_frames: int
) -> tuple[int, int]:
    """Count cells over the threshold at a false-alarm rate of 1e-3, and all cells."""
    chain = dc.Chain(
        range_window="rectangular",
        doppler_window="rectangular",
        cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-3),
    )
    hits = trials = 0
    for _ in range(n_frames):
        power = dc.power_map(simulate_noise_cube(radar, rng).isel(frame=0), radar, chain)
        hits += int((power > dc.threshold_map(power, radar, chain)).sum())
        trials += power.size
    return hits, trials
