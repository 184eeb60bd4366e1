"""Errors, resolution and time of the direction estimators.

Errors: RMSE over trials, divided by the Cramer-Rao bound, with one snapshot at an SNR of 20 dB per
element. Azimuths are uniform within +-60 degrees, elevations within +-25 degrees.
Resolution: two equal sources are one beamwidth apart, with a random relative phase. They count as
resolved if both estimates are within half a beamwidth. `resolved` is the fraction over all phases,
`worst` the smallest fraction in eight bands of the phase.
Times: per snapshot, from 1,000 snapshots of 12 channels and 10 snapshots of 192, fastest of three.

The second table gives times on one thread after compilation, the largest accepted time (bar), and
ratios to bare LAPACK or NumPy code. dechirp and bare code run alternately (A B A B).
Capon and MUSIC: 1,000 snapshots of 12 channels and 100 of 192, to directions with standard errors.
Bare code: a Cholesky factorisation and a triangular solve for 181 directions per snapshot, with
LAPACK in complex64.
Bartlett: 1,000 snapshots and 181 directions. Bare code: a matrix product with NumPy.

    python benchmarks/angles.py [--trials 2000] [--kind music]
"""

import argparse
import os
from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter
from typing import Any

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--trials", type=int, default=2000, help="trials per error and resolution")
parser.add_argument("--kind", default="", help="only estimators whose kind contains this text")
options = parser.parse_args(None if __name__ == "__main__" else [])
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from sides.plain_angles import beam_power as plain_beam_power
from sides.plain_angles import covariances, solve_covariance

from dechirp.core.errors import InvalidSetting
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.music import Music
from dechirp.theory.direction_bounds import direction_std_rad

SNR = 100.0


def linear_positions(n: int) -> np.ndarray:
    return np.array([(0, i / 2, 0) for i in range(n)])


def random_planar_positions(n: int, side: float, rng: np.random.Generator) -> np.ndarray:
    positions = np.zeros((n, 3))
    positions[:, 1:] = rng.uniform(0, side, (n, 2))
    return positions


def draw_complex_noise(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def format_error_ratio(estimator: Any, aperture: Aperture, n: int) -> str:
    """Format RMSE / bound and squared error / reported variance for each resolved angle."""
    rng = np.random.default_rng(1)
    azimuth = rng.uniform(-np.pi / 3, np.pi / 3, n) * aperture.resolves_azimuth_and_elevation[0]
    elevation = rng.uniform(-0.44, 0.44, n) * aperture.resolves_azimuth_and_elevation[1]
    snapshots = np.sqrt(SNR) * aperture.steering_vectors(azimuth, elevation) + draw_complex_noise(
        (n, aperture.n_elements), rng
    )
    estimates = estimator.find_directions(snapshots[:, None], aperture, np.ones(n))
    bound = np.array(
        [
            direction_std_rad(
                positions=aperture.positions,
                azimuth_rad=[angles[0]],
                elevation_rad=[angles[1]],
                amplitudes=[np.sqrt(SNR)],
                noise_power=1.0,
                unknown=aperture.resolves_azimuth_and_elevation,
            )[0]
            for angles in zip(azimuth, elevation, strict=True)
        ]
    )
    ratios = []
    for axis, truth in enumerate((azimuth, elevation)):
        if aperture.resolves_azimuth_and_elevation[axis]:
            error = (estimates[axis][:, 0] - truth) / bound[:, axis]
            consistency = np.mean(
                ((estimates[axis][:, 0] - truth) / estimates[axis + 2][:, 0]) ** 2
            )
            ratios.append(f"{np.sqrt(np.mean(error**2)):.3f} ({consistency:.2f})")
    return " ".join(ratios)


def format_resolution(make: Any, aperture: Aperture, n: int) -> str:
    """Format the fraction of trials that resolve two sources one beamwidth apart, and the worst."""
    try:
        estimator = make(n_sources=2)
    except InvalidSetting:
        return "one source"
    rng = np.random.default_rng(2)
    beam = 0.886 / (np.ptp(aperture.positions[:, 1]) + 0.5)
    middle = rng.uniform(-0.5, 0.5, n)
    sines = middle[:, None] + np.array([-beam / 2, beam / 2])
    relative_phase = rng.uniform(0, 2 * np.pi, n)
    amplitudes = np.sqrt(SNR) * np.stack([np.ones(n), np.exp(1j * relative_phase)], axis=1)
    # The relative phase is defined at the centre of the array, where it decides the resolution.
    centred = Aperture(aperture.positions - aperture.positions.mean(axis=0), aperture.field_of_view)
    x = np.einsum("nk,nki->ni", amplitudes, centred.steering_vectors(np.arcsin(sines)))
    x += draw_complex_noise(x.shape, rng)
    try:
        estimates = estimator.find_directions(x[:, None], aperture, np.ones(n))
    except InvalidSetting as error:
        return f"refused: {error.mistakes[0].setting}"
    angles = np.sort(np.sin(estimates.azimuth_rad), axis=1)
    is_resolved = np.all(np.abs(angles - sines) < beam / 2, axis=1)
    band = (relative_phase // (np.pi / 4)).astype(int)
    worst = min(float(is_resolved[band == k].mean()) for k in range(8))
    return f"{is_resolved.mean():.3f} {worst:.3f}"


def measure_ms(work: Any, n: int, repeats: int = 3) -> float:
    work()
    best = np.inf
    for _ in range(repeats):
        start = perf_counter()
        work()
        best = min(best, perf_counter() - start)
    return best * 1e3 / n


def simulate_one_source(aperture: Aperture, n: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    x = np.sqrt(SNR) * aperture.steering_vectors(rng.uniform(-1, 1, n)) + draw_complex_noise(
        (n, aperture.n_elements), rng
    )
    return x[:, None].astype(np.complex64)


def format_time(estimator: Any, aperture: Aperture, n: int) -> str:
    x = simulate_one_source(aperture, n)
    try:
        spent = measure_ms(lambda: estimator.find_directions(x, aperture, np.ones(n)), n)
    except InvalidSetting:
        return "refused"
    return f"{spent:.4f}"


def bare_solves(covariances: np.ndarray, steering: np.ndarray) -> None:
    """Factorise each covariance (Cholesky) and solve it for all steering vectors."""
    for covariance in covariances:
        solve_covariance(covariance, steering)


def compare(
    name: str, ours: Callable[[], object], bare: Callable[[], object], n: int, bar: float
) -> None:
    """Measure both times alternately; print their medians and the median ratio."""
    pairs = [(measure_ms(ours, n), measure_ms(bare, n)) for _ in range(7)]
    spent, plain = (median(times) for times in zip(*pairs, strict=True))
    ratio = median(a / b for a, b in pairs)
    print(f"{name:28} {spent:9.4f} {bar:9.4g} {spent / bar:9.2f} {plain:9.4f} {ratio:9.2f}")


def print_times() -> None:
    columns = ("ms", "bar ms", "/ bar", "bare ms", "/ bare")
    print(f"\n{'per call or snapshot':28}" + "".join(f" {column:>9}" for column in columns))
    for n_elements, n, bar in ((12, 1000, 0.03), (192, 100, 1.1)):
        aperture = Aperture(linear_positions(n_elements))
        x = simulate_one_source(aperture, n)
        steering = aperture.steering_vectors(np.arcsin(np.linspace(-1, 1, 181))).astype(
            np.complex64
        )
        bare = partial(bare_solves, covariances(x[:, 0], 1.0), np.asfortranarray(steering.conj().T))
        for member in (Capon(), Music()):
            ours = partial(member.find_directions, x, aperture, np.ones(n))
            compare(f"{member.kind()}, {n_elements} channels", ours, bare, n, bar)
        thousand_snapshots = simulate_one_source(aperture, 1000)
        compare(
            f"1,000 beams, {n_elements} channels",
            partial(bartlett_spectrum, thousand_snapshots, steering),
            partial(plain_beam_power, thousand_snapshots[:, 0], steering),
            1,
            {12: 0.31, 192: 1.8}[n_elements],  # time of the fastest other package
        )


def main() -> None:
    linear_12, linear_192 = Aperture(linear_positions(12)), Aperture(linear_positions(192))
    planar = Aperture(random_planar_positions(24, 4.0, np.random.default_rng(4)))
    format_line = "{:20} {:18} {:30} {:22} {:>8} {:>8}".format
    print(
        format_line("kind", "12, linear", "24, sparse planar", "resolved, worst", "ms 12", "ms 192")
    )
    for kind, member in DirectionEstimator.members().items():
        if options.kind not in kind:
            continue
        estimator: Any = member()
        try:
            on_plane = format_error_ratio(estimator, planar, options.trials)
        except InvalidSetting:
            on_plane = "refused"
        print(
            format_line(
                kind,
                format_error_ratio(estimator, linear_12, options.trials),
                on_plane,
                format_resolution(member, linear_12, options.trials),
                format_time(estimator, linear_12, 1000),
                format_time(estimator, linear_192, 10),
            ),
            flush=True,
        )
    print("\nRMSE / bound (squared error / reported variance); times in ms per snapshot")
    print_times()


if __name__ == "__main__":
    main()
