"""Snapshots for tests: far sources on an array, in white noise."""

import numpy as np

from dechirp.processing.angle.aperture import Aperture

HALF_POWER = 0.886
"""Width of the beam of a uniform line, over 1 / length, in sines."""


def line(n: int, step: float = 0.5) -> Aperture:
    """Elements along y."""
    return Aperture(positions=np.arange(n)[:, None] * [0.0, step, 0.0])


def rectangle(n_left: int, n_up: int) -> Aperture:
    """Elements half a wavelength apart."""
    left, up = np.meshgrid(np.arange(n_left), np.arange(n_up))
    return Aperture(positions=np.stack([0 * left, left, up], axis=-1).reshape(-1, 3) / 2)


def turns(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Amplitudes of one, of any phase."""
    return np.exp(2j * np.pi * rng.uniform(size=shape))


def snapshots(
    aperture: Aperture,
    amplitudes: np.ndarray,
    noise_power: float,
    rng: np.random.Generator,
    azimuth: np.ndarray,
    elevation: np.ndarray | float = 0.0,
) -> np.ndarray:
    """(n, n_looks, n_elements), of sources (n, k) with amplitudes (n, k, n_looks)."""
    steering = aperture.steering_vectors(azimuth, elevation)
    clean = np.einsum("nkl,nke->nle", amplitudes, steering)
    noise = rng.normal(size=(*clean.shape, 2)) @ [1, 1j]
    return clean + np.sqrt(noise_power / 2) * noise


def pair(aperture: Aperture, apart: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """Azimuths of n pairs so far apart in sines, (n, 2), the right one first."""
    middle = rng.uniform(-0.6, 0.6, size=(n, 1))
    return np.arcsin(middle + apart / 2 * np.array([-1, 1]))
