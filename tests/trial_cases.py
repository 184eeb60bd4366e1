"""Small radars and trials of the chain, for tests of scores."""

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
from radars import street_radar


def small_radar(n_rx: int = 1, sampling: str = "complex", n_samples: int = 64) -> dc.Radar:
    """Return a radar of 64 x 32 samples: cells of 1.17 m and 1.7 m/s, range to 75 m."""
    return street_radar(n_samples=n_samples, n_chirps=32, n_rx=n_rx, sampling=sampling)


def make_target(range_m: float = 20.0, velocity: float = 3.0, **changes) -> dc.Target:
    settings = {"rcs_m2": 1.0, **changes}
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), **settings)


def trial_context(
    radar: dc.Radar, chain: Chain, snr_db: float, *targets: dc.Target, n_frames: int = 1
) -> TrialContext:
    """Return a context with noise that gives the first target an SNR after integration."""
    scene = dc.Scene(targets=targets or (make_target(),))
    reference_snr = float(truth(scene, radar).snr[0, 0])
    noise_w = noise_power_w(radar) * reference_snr / 10 ** (snr_db / 10)
    true_states = truth(scene, radar, n_frames=n_frames, noise_power_w=noise_w)
    return TrialContext(
        scene=scene,
        radar=radar,
        chain=chain.fit_to_radar(radar),
        truth=true_states,
        noise_power_w=noise_w,
        times_s=true_states.time.values,
    )


def iter_noisy_cubes(context: TrialContext, rng: np.random.Generator):
    """Yield frames of steady targets in white noise, endlessly."""
    steady = [replace(target, fluctuation="steady") for target in context.scene.targets]
    clean = simulate_ideal_echoes(dc.Scene(targets=steady), context.radar)
    dtype = np.complex64 if np.iscomplexobj(clean.values) else np.float32
    echoes = clean.values.astype(dtype)
    while True:
        noise = rng.standard_normal((*clean.shape, np.dtype(dtype).itemsize // 4), np.float32)
        noise *= np.float32(np.sqrt(context.noise_power_w / noise.shape[-1]))
        yield clean.copy(data=echoes + noise.view(dtype)[..., 0])


def iter_trials(context: TrialContext, n_trials: int, seed: int = 1):
    """Yield the results of trials of one frame each."""
    matcher = Associator(context.truth, context.radar, context.scene)
    cubes = iter_noisy_cubes(context, np.random.default_rng(seed))
    for _ in range(n_trials):
        detections = detect(next(cubes), context.radar, context.chain)
        columns = {name: column.values for name, column in detections.items()}
        yield TrialResult(detections=columns, association=matcher(columns))


def trial_sums(score, context: TrialContext, n_trials: int, seed: int = 1) -> np.ndarray:
    """Return the sums of all trials, (n_trials, n_subjects, n_sums)."""
    return np.array(
        [score.trial_sums(trial, context) for trial in iter_trials(context, n_trials, seed)]
    )
