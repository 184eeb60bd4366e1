"""Simulation of single frames of a scene, in any order."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.checks import check_integer
from dechirp.core.findings import PhysicsWarning
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.validity import check_scene_echoes_finite
from dechirp.simulation.engine import Engine
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.simulate import (
    build_checked_stages,
    label_samples_as_cube,
    make_receiver_operations,
    sum_echoes,
    trim_receiver_margins,
)

_DTYPE = np.dtype(np.complex64)


class FrameSimulator:
    """Simulator of single frames of a scene, for stepping in both directions with bounded memory.

    Findings on the scene are suppressed; `build_stages_with_warnings` issues them.

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
            self._stages = build_checked_stages(impairments, scene, radar)
            check_scene_echoes_finite(scene, radar, n_frames=n_frames)
            self._receivers = make_receiver_operations(self._stages, scene, radar)

    def simulate_frame(self, frame_number: int, rng: np.random.Generator) -> xr.DataArray:
        """Simulate one frame, (frame, chirp, rx, sample) with a frame axis of length 1.

        The first frame is bit-identical to `simulate` of one frame with that generator; of later
        frames,
        everything except the random parts is.

        Raises
        ------
        InvalidSetting
            If the scene has no frame of that number.
        NotEnoughMemory
            If the cube would not fit.
        """
        check_integer("number", frame_number, at_least=0, at_most=self._n_frames - 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhysicsWarning)
            echoes = sum_echoes(
                self._scene, self._radar, self._stages, [frame_number], _DTYPE, rng, self._engine
            )
            for receiver in self._receivers:
                receiver(echoes.samples, rng)
        samples = np.ascontiguousarray(
            trim_receiver_margins(echoes.samples, self._radar, self._stages)
        )
        return label_samples_as_cube(
            samples, echoes.kernels, self._radar, self._stages, first_frame=frame_number
        )
