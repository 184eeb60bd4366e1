"""Snapshots for tests: far sources on an array, in white noise."""

import numpy as np

from dechirp.processing.angle.aperture import Aperture

HALF_POWER_WIDTH = 0.886
"""Half-power beamwidth of a uniform linear array, in sines, times its length."""


def uniform_linear_array(n: int, step: float = 0.5) -> Aperture:
    """Return a uniform linear array along y."""
    return Aperture(positions=np.arange(n)[:, None] * [0.0, step, 0.0])


def rectangular_array(n_columns: int, n_rows: int) -> Aperture:
    """Return a rectangular array with half a wavelength between elements."""
    columns, rows = np.meshgrid(np.arange(n_columns), np.arange(n_rows))
    return Aperture(positions=np.stack([0 * columns, columns, rows], axis=-1).reshape(-1, 3) / 2)


def random_phasors(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Draw amplitudes of magnitude one with uniform phases."""
    return np.exp(2j * np.pi * rng.uniform(size=shape))


def simulate_snapshots(
    aperture: Aperture,
    amplitudes: np.ndarray,
    noise_power: float,
    rng: np.random.Generator,
    azimuth: np.ndarray,
    elevation: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Return (n, n_snapshots, n_elements) for sources (n, k), amplitudes (n, k, n_snapshots)."""
    steering = aperture.steering_vectors(azimuth, elevation)
    clean = np.einsum("nkl,nke->nle", amplitudes, steering)
    noise = rng.normal(size=(*clean.shape, 2)) @ [1, 1j]
    return clean + np.sqrt(noise_power / 2) * noise


def random_azimuth_pairs(
    aperture: Aperture, separation: float, n: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw azimuths of n pairs with a separation in sines, (n, 2), the right one first."""
    centres = rng.uniform(-0.6, 0.6, size=(n, 1))
    return np.arcsin(centres + separation / 2 * np.array([-1, 1]))
