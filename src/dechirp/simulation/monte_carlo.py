"""Monte Carlo simulation of one scene: echoes without randomness are summed once."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.findings import PhysicsWarning
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.validity import check_scene_echoes_finite
from dechirp.simulation.engine import Engine
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.simulate import (
    SummedEchoes,
    build_checked_stages,
    draw_propagation_seeds,
    label_samples_as_cube,
    make_receiver_operations,
    sum_echoes,
    trim_receiver_margins,
)
from dechirp.simulation.stages import Stages

MAX_CACHED_BYTES = 2**28
"""Largest size of echoes that are cached between trials; larger ones are summed in each trial."""

_DTYPE = np.dtype(np.complex64)


class MonteCarloSimulator:
    """Simulator of repeated trials of one scene, each bit-identical to `simulate`.

    Echoes are cached if they contain nothing random: no target fluctuates, no path or oscillator
    draws numbers. A trial then copies them and applies the receivers. Findings on the scene are
    suppressed; `simulate` issues them.

    Parameters
    ----------
    scene, radar, impairments, n_frames, engine
        As for `simulate`.
    echo_scene
        Scene whose targets return echoes, if fewer than those of `scene`. Without targets, only the
        signals that the impairments of the whole scene add remain.

    Raises
    ------
    InvalidSetting
        As `simulate`.
    NotEnoughMemory
        If a cube would not fit.
    """

    def __init__(
        self,
        scene: Scene,
        radar: Radar,
        *,
        impairments: Sequence[Impairment] | None = None,
        n_frames: int = 1,
        engine: Engine | None = None,
        echo_scene: Scene | None = None,
    ) -> None:
        self._scene = scene if echo_scene is None else echo_scene
        self._radar, self._n_frames, self._engine = radar, n_frames, engine
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            self._stages = build_checked_stages(impairments, scene, radar)
            check_scene_echoes_finite(scene, radar, n_frames=n_frames)
            self._receivers = make_receiver_operations(self._stages, scene, radar)
            self._cached_echoes = self._sum_echoes_if_small_and_deterministic(self._scene, radar)

    def simulate_trial(
        self, rng: np.random.Generator, out: xr.DataArray | None = None
    ) -> xr.DataArray:
        """Simulate one trial, equal to `simulate` with the same generator.

        Parameters
        ----------
        rng : Generator
            Source of all random numbers.
        out : DataArray, optional
            Cube of an earlier trial, overwritten and returned: labels and fresh memory take longer
            than
            the echoes.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            samples, kernels = self._copy_cached_or_sum_echoes(rng, out)
            for receiver in self._receivers:
                receiver(samples, rng)
        trimmed = trim_receiver_margins(samples, self._radar, self._stages)
        if out is None:
            return label_samples_as_cube(
                np.ascontiguousarray(trimmed), kernels, self._radar, self._stages
            )
        if not np.shares_memory(trimmed, out.values):
            np.copyto(out.values, trimmed)
        return out

    def _copy_cached_or_sum_echoes(
        self, rng: np.random.Generator, out: xr.DataArray | None
    ) -> SummedEchoes:
        """Return the echoes of one trial in writable memory, that of `out` if it fits."""
        if self._cached_echoes is None:
            return self._sum_echoes(rng)
        for _ in range(self._n_frames):
            draw_propagation_seeds(self._stages, rng)
        samples = self._cached_echoes.samples
        fits = out is not None and out.shape == samples.shape
        memory = out.values if out is not None and fits else np.empty_like(samples)
        np.copyto(memory, samples)
        return self._cached_echoes._replace(samples=memory)

    def _sum_echoes(self, rng: np.random.Generator) -> SummedEchoes:
        numbers = range(self._n_frames)
        return sum_echoes(
            self._scene, self._radar, self._stages, numbers, _DTYPE, rng, self._engine
        )

    def _sum_echoes_if_small_and_deterministic(
        self, scene: Scene, radar: Radar
    ) -> SummedEchoes | None:
        """Return the echoes, if summing them draws only the seeds of the paths."""
        n_bytes = _sample_bytes_with_margins(radar, self._stages, self._n_frames)
        if n_bytes > MAX_CACHED_BYTES:
            return None
        rng, expected_rng = np.random.default_rng(0), np.random.default_rng(0)
        generators: list[tuple[int, np.random.Generator]] = []

        def make_rng(seed: int) -> np.random.Generator:
            generators.append((seed, np.random.default_rng(seed)))
            return generators[-1][1]

        numbers = range(self._n_frames)
        echoes = sum_echoes(
            scene, radar, self._stages, numbers, _DTYPE, rng, self._engine, make_rng=make_rng
        )
        for _ in range(self._n_frames):
            draw_propagation_seeds(self._stages, expected_rng)
        generator_pairs = [
            (rng, expected_rng),
            *((generator, np.random.default_rng(seed)) for seed, generator in generators),
        ]
        if any(a.bit_generator.state != b.bit_generator.state for a, b in generator_pairs):
            return None
        return echoes


def _sample_bytes_with_margins(radar: Radar, stages: Stages, n_frames: int) -> float:
    """Return the size of all samples, receiver margins included."""
    frame, chirp = radar.frame, radar.frame.chirp
    n_each = chirp.n_samples + sum(stages.sample_margins(radar))
    n_samples = float(n_frames) * frame.n_chirps_total * radar.array.n_rx * n_each
    return n_samples * (8 if chirp.sampling == "complex" else 4)
