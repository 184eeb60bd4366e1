"""Radar simulation at radio frequency: transmitted ramps, delayed, mixed and low-pass filtered.

This module uses no formula for beat signals. A real wave of a few GHz is transmitted ramp by ramp
and arrives after the delay defined in `dechirp.simulation.kernels.base` (two-way distance to the
position of the scatterer at reception). The wave is multiplied by the current ramp and by the same
ramp shifted by a quarter of a cycle. A low-pass filter, far wider than any beat frequency, removes
the sum frequency.
"""

from typing import NamedTuple

import numpy as np

SPEED_OF_LIGHT = 299_792_458.0

# Sum frequencies reach 4.5 GHz, below half of this rate.
SAMPLE_RATE_HZ = 10e9
# 512 taps (51 ns) of a sinc with cutoff 0.9 GHz in a Kaiser window: flat within 1e-7 up to
# 0.5 GHz, attenuation to 1e-7 from 1.3 GHz.
TAPS = 512
TRANSIENT_S = TAPS / 2 / SAMPLE_RATE_HZ
_OFFSETS = np.arange(TAPS + 1) - TAPS / 2
_RESPONSE = np.sinc(2 * 0.9e9 / SAMPLE_RATE_HZ * _OFFSETS) * np.kaiser(TAPS + 1, 16.0)
_RESPONSE /= _RESPONSE.sum()


class Ramp(NamedTuple):
    """One transmitted ramp."""

    start_s: float
    duration_s: float
    weights: np.ndarray
    """Weights of the beat signal, (n_tx,); the wave has the conjugate phase."""


def simulate_received_samples(scatterers, transmission, ramps, m, k, n_samples):
    """Simulate samples of chirp m on receiver k; `ramps` are the only transmitted ramps."""
    n = np.arange(n_samples)
    on_ramp_s = transmission.adc_start_s + n / transmission.sample_rate_hz
    # Times of the filter taps around each sample.
    t = on_ramp_s[:, None] + _OFFSETS / SAMPLE_RATE_HZ
    wave = compute_arriving_wave(scatterers, transmission, ramps, k, transmission.starts_s[m] + t)
    mixer = (
        2 * np.pi * (transmission.start_frequency_hz * t + transmission.slope_hz_per_s * t**2 / 2)
    )
    in_phase, quadrature = 2 * wave * np.cos(mixer), 2 * wave * np.sin(mixer)
    return in_phase @ _RESPONSE + 1j * (quadrature @ _RESPONSE)


def compute_arriving_wave(scatterers, transmission, ramps, k, time_s):
    """Compute the real wave on one receiver at given times."""
    wave = np.zeros(time_s.shape)
    for i, amplitude in enumerate(scatterers.amplitudes):
        position_m = sum(
            term[i] * time_s[..., None] ** power for power, term in enumerate(scatterers.path_m)
        )
        rx_distance_m = np.linalg.norm(position_m - transmission.rx_m[k], axis=-1)
        for j, tx_m in enumerate(transmission.tx_m):
            tx_distance_m = np.linalg.norm(position_m - tx_m, axis=-1)
            size = amplitude * scatterers.tx_gains[j, i] * scatterers.rx_gains[k, i]
            for ramp in ramps:
                ramp_time_s = (
                    time_s - (tx_distance_m + rx_distance_m) / SPEED_OF_LIGHT - ramp.start_s
                )
                cycles = (
                    transmission.start_frequency_hz * ramp_time_s
                    + transmission.slope_hz_per_s * ramp_time_s**2 / 2
                )
                phase = 2 * np.pi * cycles - np.angle(ramp.weights[j])
                is_active = (ramp_time_s >= 0) & (ramp_time_s < ramp.duration_s)
                wave += (
                    is_active
                    * abs(ramp.weights[j])
                    * size
                    / (tx_distance_m * rx_distance_m)
                    * np.cos(phase)
                )
    return wave
