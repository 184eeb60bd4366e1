"""Frames of a scene one at a time, in any order, each with chance of its own."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.findings import PhysicsWarning
from dechirp.echoes.echo import arriving, checked_stages, kept_of, labelled, receivers_of
from dechirp.echoes.engine import Engine
from dechirp.echoes.impairments.base import Impairment
from dechirp.radar.radar import Radar
from dechirp.scene.possible import must_be_possible
from dechirp.scene.scene import Scene

_COMPLEX = np.dtype(np.complex64)


class FrameByFrame:
    """Cubes of single frames of a scene: to step through it, back as well, with bounded memory.

    What surprises in the scene is not said: `told_stages` says it.

    Parameters
    ----------
    scene, radar, impairments, n_frames, engine
        As for `simulate`.

    Raises
    ------
    InvalidSetting
        As `simulate`.
    """

    def __init__(
        self,
        scene: Scene,
        radar: Radar,
        *,
        impairments: Sequence[Impairment] | None = None,
        n_frames: int = 1,
        engine: Engine | None = None,
    ) -> None:
        self._scene, self._radar, self._n_frames, self._engine = scene, radar, n_frames, engine
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            self._stages = checked_stages(impairments, scene, radar)
            must_be_possible(scene, radar, n_frames=n_frames)
            self._receivers = receivers_of(self._stages, scene, radar)

    def cube(self, number: int, rng: np.random.Generator) -> xr.DataArray:
        """One frame, (frame, chirp, rx, sample) of one: what `simulate` gives of it for its chance.

        The first one is to the bit what `simulate` gives of one frame for that generator; of
        later ones everything but chance is.

        Raises
        ------
        InvalidSetting
            If the scene has no frame of that number.
        NotEnoughMemory
            If the cube would not fit.
        """
        whole("number", number, at_least=0, at_most=self._n_frames - 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            found = arriving(
                self._scene, self._radar, self._stages, [number], _COMPLEX, rng, self._engine
            )
            for receiver in self._receivers:
                receiver(found.samples, rng)
        kept = np.ascontiguousarray(kept_of(found.samples, self._radar, self._stages))
        return labelled(kept, found.kernels, self._radar, self._stages, first_frame=number)
