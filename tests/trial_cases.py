"""Small radars, and trials of the chain with them, for tests of scores."""

from dataclasses import replace

import numpy as np

import dechirp as dc
from dechirp.evaluation.association import Associator
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.radar.budget import noise_power_w
from dechirp.scene.truth import truth
from dechirp.simulation.simulate import simulate_ideal_echoes
from radars import of_street


def small(n_rx: int = 1, sampling: str = "complex", n_samples: int = 64) -> dc.Radar:
    """64 x 32 samples: 1.17 m and 1.7 m/s a cell, 75 m."""
    return of_street(n_samples=n_samples, n_chirps=32, n_rx=n_rx, sampling=sampling)


def target(range_m: float = 20.0, velocity: float = 3.0, **changed) -> dc.Target:
    settings = {"rcs_m2": 1.0, **changed}
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), **settings)


def case_of(
    radar: dc.Radar, chain: Chain, snr_db: float, *targets: dc.Target, n_frames: int = 1
) -> TrialContext:
    """With so much noise that the first target has that ratio after integration."""
    scene = dc.Scene(targets=targets or (target(),))
    own = float(truth(scene, radar).snr[0, 0])
    noise_w = noise_power_w(radar) * own / 10 ** (snr_db / 10)
    known = truth(scene, radar, n_frames=n_frames, noise_power_w=noise_w)
    return TrialContext(
        scene=scene,
        radar=radar,
        chain=chain.fit_to_radar(radar),
        truth=known,
        noise_power_w=noise_w,
        times_s=known.time.values,
    )


def cubes(case: TrialContext, rng: np.random.Generator):
    """Frames of steady targets in white noise, without end."""
    steady = [replace(one, fluctuation="steady") for one in case.scene.targets]
    clean = simulate_ideal_echoes(dc.Scene(targets=steady), case.radar)
    kind = np.complex64 if np.iscomplexobj(clean.values) else np.float32
    echoes = clean.values.astype(kind)
    while True:
        noise = rng.standard_normal((*clean.shape, np.dtype(kind).itemsize // 4), np.float32)
        noise *= np.float32(np.sqrt(case.noise_power_w / noise.shape[-1]))
        yield clean.copy(data=echoes + noise.view(kind)[..., 0])


def looks(case: TrialContext, n_trials: int, seed: int = 1):
    """What so many trials of one frame show."""
    matcher = Associator(case.truth, case.radar, case.scene)
    each = cubes(case, np.random.default_rng(seed))
    for _ in range(n_trials):
        found = detect(next(each), case.radar, case.chain)
        columns = {name: column.values for name, column in found.items()}
        yield TrialResult(detections=columns, association=matcher(columns))


def sums(score, case: TrialContext, n_trials: int, seed: int = 1) -> np.ndarray:
    """Of all trials, (n_trials, n_subjects, n_sums)."""
    return np.array([score.trial_sums(look, case) for look in looks(case, n_trials, seed)])
