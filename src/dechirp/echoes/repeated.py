"""One scene simulated many times: what is the same in every trial is summed once."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.findings import PhysicsWarning
from dechirp.echoes.echo import (
    Arriving,
    arriving,
    checked_stages,
    kept_of,
    labelled,
    path_seeds,
    receivers_of,
)
from dechirp.echoes.engine import Engine
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.stages import Stages
from dechirp.radar.radar import Radar
from dechirp.scene.possible import must_be_possible
from dechirp.scene.scene import Scene

MOST_KEPT_BYTES = 2**28
"""Echoes of so many bytes are kept from trial to trial; more are summed anew in each."""

_COMPLEX = np.dtype(np.complex64)


class Repeated:
    """Cubes of one scene, each with noise and chance of its own, to the bit as of `simulate`.

    Echoes are kept if nothing in them is drawn: no target fluctuates, no path or oscillator is
    random. Then a trial takes a copy and what the receiver does. What surprises in the scene is
    not said: `simulate` says it.

    Parameters
    ----------
    scene, radar, impairments, n_frames, engine
        As for `simulate`.
    echoes_of
        What sends echoes back, where that is less than the scene: of the scene without its
        targets there is what the impairments of the whole scene add.

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
        echoes_of: Scene | None = None,
    ) -> None:
        self._scene = scene if echoes_of is None else echoes_of
        self._radar, self._n_frames, self._engine = radar, n_frames, engine
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            self._stages = checked_stages(impairments, scene, radar)
            must_be_possible(scene, radar, n_frames=n_frames)
            self._receivers = receivers_of(self._stages, scene, radar)
            self._kept = self._if_the_same(self._scene, radar)

    def cube(self, rng: np.random.Generator, out: xr.DataArray | None = None) -> xr.DataArray:
        """One trial: what `simulate` gives for that generator, drawing the same from it.

        Parameters
        ----------
        rng : Generator
            All chance comes from it.
        out : DataArray, optional
            A cube of an earlier trial, which is written over and returned: labels and fresh
            memory take longer than the echoes.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            samples, kernels = self._echoes(rng, out)
            for receiver in self._receivers:
                receiver(samples, rng)
        kept = kept_of(samples, self._radar, self._stages)
        if out is None:
            return labelled(np.ascontiguousarray(kept), kernels, self._radar, self._stages)
        if not np.shares_memory(kept, out.values):
            np.copyto(out.values, kept)
        return out

    def _echoes(self, rng: np.random.Generator, out: xr.DataArray | None) -> Arriving:
        """Echoes of one trial, in memory that may be written over: of `out`, if it fits."""
        if self._kept is None:
            return self._arriving(rng)
        for _ in range(self._n_frames):
            path_seeds(self._stages, rng)
        samples = self._kept.samples
        fits = out is not None and out.shape == samples.shape
        own = out.values if out is not None and fits else np.empty_like(samples)
        np.copyto(own, samples)
        return self._kept._replace(samples=own)

    def _arriving(self, rng: np.random.Generator) -> Arriving:
        numbers = range(self._n_frames)
        return arriving(
            self._scene, self._radar, self._stages, numbers, _COMPLEX, rng, self._engine
        )

    def _if_the_same(self, scene: Scene, radar: Radar) -> Arriving | None:
        """Echoes, if they may be kept: nothing was drawn for them but the seeds of the paths."""
        n_bytes = _bytes(radar, self._stages, self._n_frames)
        if n_bytes > MOST_KEPT_BYTES:
            return None
        rng, alike = np.random.default_rng(0), np.random.default_rng(0)
        made: list[tuple[int, np.random.Generator]] = []

        def seeded(seed: int) -> np.random.Generator:
            made.append((seed, np.random.default_rng(seed)))
            return made[-1][1]

        numbers = range(self._n_frames)
        found = arriving(
            scene, radar, self._stages, numbers, _COMPLEX, rng, self._engine, seeded=seeded
        )
        for _ in range(self._n_frames):
            path_seeds(self._stages, alike)
        untouched = [(rng, alike), *((one, np.random.default_rng(seed)) for seed, one in made)]
        if any(a.bit_generator.state != b.bit_generator.state for a, b in untouched):
            return None
        return found


def _bytes(radar: Radar, stages: Stages, n_frames: int) -> float:
    """Of all samples, with those that receivers need before and after."""
    frame, chirp = radar.frame, radar.frame.chirp
    n_each = chirp.n_samples + sum(stages.margins(radar))
    n_samples = float(n_frames) * frame.n_sent * radar.array.n_rx * n_each
    return n_samples * (8 if chirp.sampling == "complex" else 4)
