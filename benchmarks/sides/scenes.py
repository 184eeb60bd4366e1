"""Scatterers and radars for the timing of echoes.

`cube_a`       77 GHz, 150 MHz bandwidth, 300 MS/s complex, 128 chirps x 2200 samples
`mimo`         three TDM transmitters, four receivers, 128 chirps per transmitter x 256 samples,
               exact path length for each pair of antennas
`long_chirp`   4 GHz in 50 us, 512 chirps x 256 samples

The speed of targets is at most 40 m/s, with `mimo` 20 m/s.
"""

import numpy as np

from dechirp.simulation.kernels.base import Scatterers, Transmission

C = 299_792_458.0
Case = tuple[Scatterers, Transmission, tuple[int, int, int]]


def cube_a(n: int, farthest_m: float, rng: np.random.Generator) -> Case:
    interval_s = 150e6 / 20.4545e12
    transmission = Transmission(
        centred_times(128, interval_s),
        np.ones((128, 1), complex),
        np.zeros((1, 3)),
        np.zeros((1, 3)),
        77e9,
        20.4545e12,
        0.0,
        300e6,
    )
    return (
        draw_scatterers(n, 3.0, farthest_m, 40.0, transmission, rng),
        transmission,
        (128, 1, 2200),
    )


def mimo(n: int, rng: np.random.Generator) -> Case:
    n_chirps, wavelength_m = 3 * 128, C / 77e9
    weights = np.zeros((n_chirps, 3), complex)
    weights[np.arange(n_chirps), np.arange(n_chirps) % 3] = 1
    transmission = Transmission(
        centred_times(n_chirps, 30e-6),
        weights,
        np.array([[0, 2 * k * wavelength_m, 0] for k in range(3)]),
        np.array([[0, k * wavelength_m / 2, 0] for k in range(4)]),
        77e9,
        1e9 / 25.6e-6,
        3e-6,
        10e6,
    )
    return draw_scatterers(n, 3.0, 38.0, 20.0, transmission, rng), transmission, (n_chirps, 4, 256)


def long_chirp(n: int, rng: np.random.Generator) -> Case:
    transmission = Transmission(
        centred_times(512, 60e-6),
        np.ones((512, 1), complex),
        np.zeros((1, 3)),
        np.zeros((1, 3)),
        77e9,
        4e9 / 50e-6,
        5e-6,
        256 / 45e-6,
    )
    return draw_scatterers(n, 2.0, 9.0, 40.0, transmission, rng), transmission, (512, 1, 256)


def centred_times(n: int, interval_s: float) -> np.ndarray:
    return (np.arange(n) - (n - 1) / 2) * interval_s


def draw_scatterers(
    n: int,
    nearest_m: float,
    farthest_m: float,
    fastest: float,
    transmission: Transmission,
    rng: np.random.Generator,
) -> Scatterers:
    """Draw scatterers uniformly in range and azimuth, with exponential cross sections."""
    range_m, azimuth = rng.uniform(nearest_m, farthest_m, n), rng.uniform(-1, 1, n)
    at_m = np.stack([range_m * np.cos(azimuth), range_m * np.sin(azimuth), rng.uniform(-1, 2, n)])
    velocity = rng.uniform(-fastest, fastest, (3, n)) * [[1.0], [0.5], [0.02]]
    return Scatterers(
        np.stack([at_m.T, velocity.T]),
        np.sqrt(rng.exponential(size=n)),
        np.ones((len(transmission.tx_m), n)),
        np.ones((len(transmission.rx_m), n)),
    )
