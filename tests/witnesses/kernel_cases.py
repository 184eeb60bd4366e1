"""Waveforms, arrays and scatterers for tests of simulation kernels."""

import numpy as np

from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.direct import add_echoes

HALF_WAVELENGTH_M = 1.9e-3
WAVEFORMS = {
    # 77 GHz, 150 MHz in 7.3 us, 128 chirps.
    "short": (128, 2200, 77e9, 20.4545e12, 0.0, 300e6, 7.3333e-6),
    # 400 MHz in 25.6 us, with some time before the first sample.
    "middle": (96, 256, 76e9, 15.6e12, 3e-6, 10e6, 36e-6),
    # 4 GHz in 50 us, 512 chirps.
    "long": (512, 256, 77e9, 80e12, 0.0, 5.12e6, 60e-6),
    # A falling ramp, slowly sampled.
    "falling": (16, 700, 24.25e9, -0.25e12, 5e-6, 0.8e6, 1e-3),
}


def make_transmission(name, rng, *, n_tx=1, n_rx=1, spacing_m=HALF_WAVELENGTH_M, n_chirps=None):
    """Make a transmission of a waveform with random weights for each chirp and transmitter."""
    m, n_samples, f0, slope, adc_start_s, sample_rate_hz, interval_s = WAVEFORMS[name]
    m = n_chirps or m
    axis = np.array([0.1, 1.0, 0.2])
    transmission = Transmission(
        starts_s=(np.arange(m) - m / 2) * interval_s,
        weights=rng.normal(size=(m, n_tx)) + 1j * rng.normal(size=(m, n_tx)),
        tx_m=np.outer(np.arange(n_tx) * n_rx, axis) * spacing_m,
        rx_m=np.outer(np.arange(n_rx), axis[[0, 2, 1]]) * spacing_m,
        start_frequency_hz=f0,
        slope_hz_per_s=slope,
        adc_start_s=adc_start_s,
        sample_rate_hz=sample_rate_hz,
    )
    return transmission, n_samples


def make_scatterers(transmission, rng, *, n, ranges_m, speed_m_per_s, n_terms=2, varied=False):
    """Make random scatterers around the radar; each power of time moves them by some metres."""
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    path_m = np.zeros((n_terms, n, 3))
    path_m[0] = directions * rng.uniform(*ranges_m, size=n)[:, None]
    path_m[1] = speed_m_per_s * rng.uniform(-1, 1, (n, 3))
    for term in range(2, n_terms):
        # Accelerations of 10 m/s^2; each higher power moves as far within 10 ms.
        path_m[term] = 10 * 100 ** (term - 2) * rng.uniform(-1, 1, (n, 3))
    m, n_tx = transmission.weights.shape
    return Scatterers(
        path_m=path_m,
        amplitudes=rng.uniform(0.1, 1, n) * np.linalg.norm(path_m[0], axis=1) ** 2,
        tx_gains=rng.uniform(0.1, 1, (n_tx, n)),
        rx_gains=rng.uniform(0.1, 1, (len(transmission.rx_m), n)),
        chirp_factors=rng.exponential(size=(m, n)) if varied else None,
    )


def simulate_echoes(scatterers, transmission, n_samples, *, dtype=complex, **options):
    """Simulate echoes with the direct kernel, (chirp, rx, sample)."""
    out = np.zeros((len(transmission.starts_s), len(transmission.rx_m), n_samples), dtype)
    add_echoes(out, scatterers, transmission, **options)
    return out


COMMON_CASES = {
    "many at once": (
        "middle",
        {"n_tx": 3, "n_rx": 4},
        {"n": 9, "ranges_m": (2, 200), "speed_m_per_s": 60, "varied": True},
    ),
    "near field": (
        "middle",
        {"n_tx": 2, "n_rx": 3, "spacing_m": 0.11},
        {"n": 4, "ranges_m": (0.7, 2), "speed_m_per_s": 20},
    ),
    "accelerated": (
        "middle",
        {"n_rx": 2},
        {"n": 4, "ranges_m": (3, 60), "speed_m_per_s": 40, "n_terms": 3},
    ),
    "fast and long": ("long", {}, {"n": 3, "ranges_m": (1, 40), "speed_m_per_s": 40}),
    "falling": (
        "falling",
        {"n_tx": 2},
        {"n": 3, "ranges_m": (5, 100), "speed_m_per_s": 60, "n_terms": 3},
    ),
}
"""Waveform, array and scatterers of the cases common to all kernels."""
