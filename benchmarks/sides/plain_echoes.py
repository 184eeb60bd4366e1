"""Plain echo simulation with NumPy, numba and FINUFFT, as reference for timing and accuracy."""

import importlib.util
import math
import os
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np

from dechirp.simulation.kernels.base import Scatterers, Transmission

C = 299_792_458.0
HAS_FINUFFT = importlib.util.find_spec("finufft") is not None


def direct_sum(
    scatterers: Scatterers, transmission: Transmission, n_samples: int, chirps: np.ndarray
) -> np.ndarray:
    """Sum the echoes of some chirps directly in double precision, (chirp, rx, sample)."""
    late_s = transmission.adc_start_s + np.arange(n_samples) / transmission.sample_rate_hz
    out = np.zeros((len(chirps), len(transmission.rx_m), n_samples), complex)
    for row, m in zip(out, chirps, strict=True):
        times_s = transmission.starts_s[m] + late_s
        for i in range(len(scatterers.amplitudes)):
            at_m = sum(term[i] * times_s[:, None] ** k for k, term in enumerate(scatterers.path_m))
            for k in np.flatnonzero(transmission.weights[m]):
                transmit_path_m = np.linalg.norm(at_m - transmission.tx_m[k], axis=1)
                for rx, rx_m in enumerate(transmission.rx_m):
                    receive_path_m = np.linalg.norm(at_m - rx_m, axis=1)
                    tau = (transmit_path_m + receive_path_m) / C
                    cycles = transmission.start_frequency_hz * tau
                    cycles += transmission.slope_hz_per_s * tau * (late_s - tau / 2)
                    size = (
                        transmission.weights[m, k]
                        * scatterers.amplitudes[i]
                        / (transmit_path_m * receive_path_m)
                    )
                    row[rx] += size * np.exp(2j * np.pi * (cycles % 1))
    return out


def low_rank_product(
    scatterers: Scatterers, transmission: Transmission, n_samples: int
) -> np.ndarray:
    """Sum by one complex64 matrix product, three Taylor orders of migration; cube A only."""
    tone, time_s, late_s = compute_tones(scatterers, transmission, n_samples)
    slow = tone.strength[:, None] * np.exp(2j * np.pi * tone.doppler_hz[:, None] * time_s)
    fast = np.exp(2j * np.pi * tone.range_hz[:, None] * late_s)
    cross = 2j * np.pi * tone.migration_hz_per_s
    slow_factors = [slow * (cross[:, None] * time_s) ** k / math.factorial(k) for k in range(3)]
    fast_factors = [fast * late_s**k for k in range(3)]
    return np.concatenate(slow_factors).astype(np.complex64).T @ np.concatenate(
        fast_factors
    ).astype(np.complex64)


def with_finufft(scatterers: Scatterers, transmission: Transmission, n_samples: int) -> np.ndarray:
    """Sum by non-uniform FFTs in double precision, five Taylor orders; cube A only."""
    import finufft  # optional dependency

    tone, time_s, late_s = compute_tones(scatterers, transmission, n_samples)
    step_s, interval_s = late_s[1] - late_s[0], time_s[1] - time_s[0]
    shape = (len(time_s), n_samples)
    # Modes start at -n / 2, half an interval from the middle of an even number of chirps.
    shift = np.exp(2j * np.pi * tone.doppler_hz * interval_s / 2)
    cross = 2j * np.pi * tone.migration_hz_per_s
    strengths = np.array([tone.strength * shift * cross**k / math.factorial(k) for k in range(5)])
    x, y = (
        np.mod(2 * np.pi * hz * step, 2 * np.pi)
        for hz, step in ((tone.doppler_hz, interval_s), (tone.range_hz, step_s))
    )
    fields = finufft.nufft2d1(
        x,
        y,
        strengths,
        shape,
        eps=1e-6,
        isign=1,
        nthreads=int(os.environ.get("NUMBA_NUM_THREADS", "1")),
    )
    return sum(f * (time_s[:, None] * late_s) ** k for k, f in enumerate(fields))


class Tones(NamedTuple):
    """Linearised echoes at the middle of the frame, for a monostatic radar and straight paths."""

    strength: np.ndarray
    range_hz: np.ndarray
    doppler_hz: np.ndarray
    migration_hz_per_s: np.ndarray


def compute_tones(
    scatterers: Scatterers, transmission: Transmission, n_samples: int
) -> tuple[Tones, np.ndarray, np.ndarray]:
    """Compute the tones, and times of chirps and samples relative to the middle of the frame."""
    late_s = (np.arange(n_samples) - n_samples // 2) / transmission.sample_rate_hz
    middle_s = transmission.adc_start_s - late_s[0]
    frequency_hz = transmission.start_frequency_hz + transmission.slope_hz_per_s * middle_s
    position_m, velocity = (
        scatterers.path_m[0] + middle_s * scatterers.path_m[1],
        scatterers.path_m[1],
    )
    range_m = np.linalg.norm(position_m, axis=1)
    tau, rate = 2 * range_m / C, 2 * np.sum(position_m * velocity, axis=1) / range_m / C
    cycles = frequency_hz * tau - transmission.slope_hz_per_s * tau**2 / 2
    doppler_hz = (frequency_hz - transmission.slope_hz_per_s * tau) * rate
    strength = scatterers.amplitudes / range_m**2 * np.exp(2j * np.pi * (cycles % 1))
    return (
        Tones(
            strength,
            transmission.slope_hz_per_s * tau + doppler_hz,
            doppler_hz,
            transmission.slope_hz_per_s * rate,
        ),
        transmission.starts_s,
        late_s,
    )


def recurrence(scatterers: Scatterers, transmission: Transmission, n_samples: int) -> np.ndarray:
    """Sum by phasor recurrence over the samples, with phases to second order in a chirp."""
    middle_s = transmission.adc_start_s + n_samples / 2 / transmission.sample_rate_hz
    out = np.zeros((len(transmission.starts_s), len(transmission.rx_m), n_samples), np.complex64)
    at_s = transmission.starts_s + middle_s
    position_m = sum(
        term[None] * at_s[:, None, None] ** k for k, term in enumerate(scatterers.path_m)
    )
    velocity = scatterers.path_m[1]
    for k, tx_m in enumerate(transmission.tx_m):
        chirps = np.flatnonzero(transmission.weights[:, k])
        there_m, transmit_rate = compute_path_lengths(position_m[chirps], velocity, tx_m)
        for rx, rx_m in enumerate(transmission.rx_m):
            back_m, receive_rate = compute_path_lengths(position_m[chirps], velocity, rx_m)
            tau, rate = (there_m + back_m) / C, (transmit_rate + receive_rate) / C
            size = scatterers.amplitudes / (there_m * back_m)
            # Cycles c0 + c1 t + c2 t^2 about the middle; tau = tau_0 + rate t.
            c0 = transmission.start_frequency_hz * tau + transmission.slope_hz_per_s * tau * (
                middle_s - tau / 2
            )
            c1 = transmission.slope_hz_per_s * tau
            c1 += rate * (
                transmission.start_frequency_hz + transmission.slope_hz_per_s * (middle_s - tau)
            )
            c2 = transmission.slope_hz_per_s * rate * (1 - rate / 2)
            add_phasors(out[:, rx], chirps, size, c0, c1, c2, 1 / transmission.sample_rate_hz)
    return out


def compute_path_lengths(
    position_m: np.ndarray, velocity: np.ndarray, antenna_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the distances from an antenna to scatterers, and their rates of change."""
    away = position_m - antenna_m
    range_m = np.linalg.norm(away, axis=-1)
    return range_m, np.sum(away * velocity, axis=-1) / range_m


@numba.njit
def add_phasors(
    out: np.ndarray,
    chirps: np.ndarray,
    size: np.ndarray,
    c0: np.ndarray,
    c1: np.ndarray,
    c2: np.ndarray,
    step_s: float,
) -> None:
    """Add phasors of quadratic phase to some chirps of one receiver, (chirp, scatterer) each."""
    n_samples = out.shape[1]
    sums = np.empty(n_samples, np.complex128)
    early_s = -(n_samples / 2) * step_s
    for row in range(len(chirps)):
        sums[:] = 0
        for i in range(c0.shape[1]):
            first = c0[row, i] + c1[row, i] * early_s + c2[row, i] * early_s**2
            step = (c1[row, i] + c2[row, i] * (2 * early_s + step_s)) * step_s
            z = size[row, i] * np.exp(2j * np.pi * (first % 1))
            w = np.exp(2j * np.pi * (step % 1))
            bend = np.exp(4j * np.pi * c2[row, i] * step_s**2)
            for n in range(n_samples):
                sums[n] += z
                z *= w
                w *= bend
        for n in range(n_samples):
            out[chirps[row], n] += np.complex64(sums[n])


def select_fastest(scatterers: Scatterers, n_rx: int) -> Callable[..., np.ndarray]:
    """Select the fastest function for the numbers of scatterers and receivers."""
    if n_rx > 1:
        return recurrence
    if len(scatterers.amplitudes) <= 10:
        return low_rank_product
    return with_finufft if HAS_FINUFFT else recurrence
