"""Errors, resolution and time of the direction estimators.

Errors: root mean square over trials, over the Cramer-Rao bound, at 20 dB in an element and one
snapshot, azimuths over +-60 degrees (elevations over +-25). Resolution: two equal sources one
beamwidth apart at any relative phase count as resolved where both are found within half that;
`all` over phases drawn evenly, `worst` the least of eight bands of phase. Times: a snapshot,
of 1,000 at 12 channels and 10 at 192, best of three.

Below, one thread, warm: times beside the largest that are options for, and ratios to bare code in
turns A B A B: for Capon and MUSIC, 1,000 and 100 snapshots to directions with standard errors,
Cholesky's factor and a triangular solve towards 181 directions for each, by LAPACK, complex64; for
Bartlett, 1,000 snapshots towards 181 directions, a product in NumPy.

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
parser.add_argument("--trials", type=int, default=2000)
parser.add_argument("--kind", default="")
options = parser.parse_args(None if __name__ == "__main__" else [])
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from sides.plain_angles import beams, covariances, solves

from dechirp.core.errors import InvalidSetting
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import beam_power
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.music import Music
from dechirp.theory.direction_bounds import direction_std_rad

SNR = 100.0


def uniform_line(n: int) -> np.ndarray:
    return np.array([(0, i / 2, 0) for i in range(n)])


def random_plane(n: int, side: float, rng: np.random.Generator) -> np.ndarray:
    positions = np.zeros((n, 3))
    positions[:, 1:] = rng.uniform(0, side, (n, 2))
    return positions


def complex_noise(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def format_error_ratio(estimator: Any, aperture: Aperture, n: int) -> str:
    """Format the RMSE over the bound, for each angle that the array resolves."""
    rng = np.random.default_rng(1)
    azimuth = rng.uniform(-np.pi / 3, np.pi / 3, n) * aperture.resolves_azimuth_and_elevation[0]
    elevation = rng.uniform(-0.44, 0.44, n) * aperture.resolves_azimuth_and_elevation[1]
    x = np.sqrt(SNR) * aperture.steering_vectors(azimuth, elevation) + complex_noise(
        (n, aperture.n_elements), rng
    )
    estimates = estimator.find_directions(x[:, None], aperture, np.ones(n))
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
            true = np.mean(((estimates[axis][:, 0] - truth) / estimates[axis + 2][:, 0]) ** 2)
            ratios.append(f"{np.sqrt(np.mean(error**2)):.3f} ({true:.2f})")
    return " ".join(ratios)


def format_resolution(make: Any, aperture: Aperture, n: int) -> str:
    """Format the fraction of trials that resolve two sources one beamwidth apart."""
    try:
        estimator = make(n_sources=2)
    except InvalidSetting:
        return "one source"
    rng = np.random.default_rng(2)
    beam = 0.886 / (np.ptp(aperture.positions[:, 1]) + 0.5)
    middle = rng.uniform(-0.5, 0.5, n)
    sines = middle[:, None] + np.array([-beam / 2, beam / 2])
    turn = rng.uniform(0, 2 * np.pi, n)
    amplitudes = np.sqrt(SNR) * np.stack([np.ones(n), np.exp(1j * turn)], axis=1)
    # The phase between the sources in the middle of the array, where it matters.
    centred = Aperture(aperture.positions - aperture.positions.mean(axis=0), aperture.field_of_view)
    x = np.einsum("nk,nki->ni", amplitudes, centred.steering_vectors(np.arcsin(sines)))
    x += complex_noise(x.shape, rng)
    try:
        estimates = estimator.find_directions(x[:, None], aperture, np.ones(n))
    except InvalidSetting as error:
        return f"refused: {error.mistakes[0].setting}"
    angles = np.sort(np.sin(estimates.azimuth_rad), axis=1)
    both = np.all(np.abs(angles - sines) < beam / 2, axis=1)
    band = (turn // (np.pi / 4)).astype(int)
    worst = min(float(both[band == k].mean()) for k in range(8))
    return f"{both.mean():.3f} {worst:.3f}"


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
    x = np.sqrt(SNR) * aperture.steering_vectors(rng.uniform(-1, 1, n)) + complex_noise(
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
    """Cholesky's factor of each covariance, and it solved for all steering vectors."""
    for covariance in covariances:
        solves(covariance, steering)


def compare(
    name: str, ours: Callable[[], object], bare: Callable[[], object], n: int, bar: float
) -> None:
    """Median over pairs of turns of both times and their ratio."""
    pairs = [(measure_ms(ours, n), measure_ms(bare, n)) for _ in range(7)]
    spent, plain = (median(times) for times in zip(*pairs, strict=True))
    ratio = median(a / b for a, b in pairs)
    print(f"{name:28} {spent:9.4f} {bar:9.4g} {spent / bar:9.2f} {plain:9.4f} {ratio:9.2f}")


def print_times() -> None:
    columns = ("ms", "bar ms", "of bar", "bare ms", "of bare")
    print(f"\n{'each':28}" + "".join(f" {column:>9}" for column in columns))
    for n_elements, n, bar in ((12, 1000, 0.03), (192, 100, 1.1)):
        aperture = Aperture(uniform_line(n_elements))
        x = simulate_one_source(aperture, n)
        towards = aperture.steering_vectors(np.arcsin(np.linspace(-1, 1, 181))).astype(np.complex64)
        bare = partial(bare_solves, covariances(x[:, 0], 1.0), np.asfortranarray(towards.conj().T))
        for member in (Capon(), Music()):
            ours = partial(member.find_directions, x, aperture, np.ones(n))
            compare(f"{member.kind()}, {n_elements} channels", ours, bare, n, bar)
        many = simulate_one_source(aperture, 1000)
        compare(
            f"beams of 1,000, {n_elements} channels",
            partial(beam_power, many, towards),
            partial(beams, many[:, 0], towards),
            1,
            {12: 0.31, 192: 1.8}[n_elements],  # the fastest of other packages
        )


def main() -> None:
    line_12, line_192 = Aperture(uniform_line(12)), Aperture(uniform_line(192))
    planar = Aperture(random_plane(24, 4.0, np.random.default_rng(4)))
    line_of = "{:20} {:18} {:30} {:22} {:>8} {:>8}".format
    print(line_of("kind", "line of 12", "sparse plane of 24", "resolved, worst", "ms 12", "ms 192"))
    for kind, member in DirectionEstimator.members().items():
        if options.kind not in kind:
            continue
        estimator: Any = member()
        try:
            on_plane = format_error_ratio(estimator, planar, options.trials)
        except InvalidSetting:
            on_plane = "refused"
        print(
            line_of(
                kind,
                format_error_ratio(estimator, line_12, options.trials),
                on_plane,
                format_resolution(member, line_12, options.trials),
                format_time(estimator, line_12, 1000),
                format_time(estimator, line_192, 10),
            ),
            flush=True,
        )
    print("\nRMSE over bound, in brackets squared error over reported variance; ms a snapshot")
    print_times()


if __name__ == "__main__":
    main()
