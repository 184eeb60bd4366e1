"""How exact and how fast each direction estimator is.

Errors: root mean square over trials, over the Cramer-Rao bound, at 20 dB in an element and one
snapshot, azimuths over +-60 degrees (elevations over +-25). Resolution: two equal sources one
beamwidth apart at any relative phase count as resolved where both are found within half that;
`all` over phases drawn evenly, `worst` the least of eight bands of phase. Times: a snapshot,
of 1,000 at 12 channels and 10 at 192, best of three.

    python benchmarks/angles.py [--trials 2000] [--kind music]
"""

import argparse
import os
from time import perf_counter
from typing import Any

arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
arguments.add_argument("--trials", type=int, default=2000)
arguments.add_argument("--kind", default="")
asked = arguments.parse_args()
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.bartlett import beam_power
from dechirp.process.angle.base import DirectionEstimator
from dechirp.theory.direction_bounds import direction_std_rad

SNR = 100.0


def line(n: int) -> np.ndarray:
    return np.array([(0, i / 2, 0) for i in range(n)])


def sparse(n: int, side: float, rng: np.random.Generator) -> np.ndarray:
    positions = np.zeros((n, 3))
    positions[:, 1:] = rng.uniform(0, side, (n, 2))
    return positions


def noise(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def error_ratio(estimator: Any, seen: Aperture, n: int) -> str:
    """Root mean square error over the bound, for each angle that the array tells."""
    rng = np.random.default_rng(1)
    azimuth = rng.uniform(-np.pi / 3, np.pi / 3, n) * seen.tells[0]
    elevation = rng.uniform(-0.44, 0.44, n) * seen.tells[1]
    x = np.sqrt(SNR) * seen.steering(azimuth, elevation) + noise((n, seen.n_elements), rng)
    found = estimator.directions(x[:, None], seen, np.ones(n))
    bound = np.array(
        [
            direction_std_rad(
                positions=seen.positions,
                azimuth_rad=[at[0]],
                elevation_rad=[at[1]],
                amplitudes=[np.sqrt(SNR)],
                noise_power=1.0,
                tells=seen.tells,
            )[0]
            for at in zip(azimuth, elevation, strict=True)
        ]
    )
    ratios = []
    for axis, truth in enumerate((azimuth, elevation)):
        if seen.tells[axis]:
            error = (found[axis][:, 0] - truth) / bound[:, axis]
            true = np.mean(((found[axis][:, 0] - truth) / found[axis + 2][:, 0]) ** 2)
            ratios.append(f"{np.sqrt(np.mean(error**2)):.3f} ({true:.2f})")
    return " ".join(ratios)


def resolution(make: Any, seen: Aperture, n: int) -> str:
    """Part of trials in which two sources a beamwidth apart are both found."""
    try:
        estimator = make(n_sources=2)
    except InvalidSetting:
        return "one source"
    rng = np.random.default_rng(2)
    beam = 0.886 / (np.ptp(seen.positions[:, 1]) + 0.5)
    middle = rng.uniform(-0.5, 0.5, n)
    sines = middle[:, None] + np.array([-beam / 2, beam / 2])
    turn = rng.uniform(0, 2 * np.pi, n)
    amplitudes = np.sqrt(SNR) * np.stack([np.ones(n), np.exp(1j * turn)], axis=1)
    # The phase between the sources in the middle of the array, where it matters.
    centred = Aperture(seen.positions - seen.positions.mean(axis=0), seen.field_of_view)
    x = np.einsum("nk,nki->ni", amplitudes, centred.steering(np.arcsin(sines)))
    x += noise(x.shape, rng)
    try:
        found = estimator.directions(x[:, None], seen, np.ones(n))
    except InvalidSetting as error:
        return f"refused: {error.mistakes[0].setting}"
    at = np.sort(np.sin(found.azimuth_rad), axis=1)
    both = np.all(np.abs(at - sines) < beam / 2, axis=1)
    band = (turn // (np.pi / 4)).astype(int)
    worst = min(float(both[band == k].mean()) for k in range(8))
    return f"{both.mean():.3f} {worst:.3f}"


def milliseconds(work: Any, n: int, repeats: int = 3) -> float:
    work()
    best = np.inf
    for _ in range(repeats):
        start = perf_counter()
        work()
        best = min(best, perf_counter() - start)
    return best * 1e3 / n


def time_each(estimator: Any, seen: Aperture, n: int) -> str:
    rng = np.random.default_rng(3)
    x = np.sqrt(SNR) * seen.steering(rng.uniform(-1, 1, n)) + noise((n, seen.n_elements), rng)
    x = x[:, None].astype(np.complex64)
    try:
        spent = milliseconds(lambda: estimator.directions(x, seen, np.ones(n)), n)
    except InvalidSetting:
        return "refused"
    return f"{spent:.4f}"


def main() -> None:
    line_12, line_192 = Aperture(line(12)), Aperture(line(192))
    planar = Aperture(sparse(24, 4.0, np.random.default_rng(4)))
    line_of = "{:20} {:18} {:30} {:22} {:>8} {:>8}".format
    print(line_of("kind", "line of 12", "sparse plane of 24", "resolved, worst", "ms 12", "ms 192"))
    for kind, member in DirectionEstimator.members().items():
        if asked.kind not in kind:
            continue
        estimator: Any = member()
        try:
            on_plane = error_ratio(estimator, planar, asked.trials)
        except InvalidSetting:
            on_plane = "refused"
        print(
            line_of(
                kind,
                error_ratio(estimator, line_12, asked.trials),
                on_plane,
                resolution(member, line_12, asked.trials),
                time_each(estimator, line_12, 1000),
                time_each(estimator, line_192, 10),
            ),
            flush=True,
        )
    print("\nRMSE over bound, in brackets squared error over reported variance; ms a snapshot")
    rng = np.random.default_rng(5)
    for n_elements in (12, 192):
        x = noise((1000, 1, n_elements), rng).astype(np.complex64)
        sines = np.linspace(-1, 1, 181)
        steering = Aperture(line(n_elements)).steering(np.arcsin(sines)).astype(np.complex64)
        spent = milliseconds(lambda x=x, a=steering: beam_power(x, a), 1, repeats=30)
        plain = milliseconds(lambda x=x, a=steering: np.abs(x[:, 0] @ a.conj().T) ** 2, 1, 30)
        print(
            f"Bartlett, 1,000 snapshots x 181 angles, {n_elements} channels: {spent:.2f} ms;"
            f" plain NumPy {plain:.2f} ms"
        )


if __name__ == "__main__":
    main()
