"""Where frames come from: a scene, or a recording; both are walked through alike."""

from dataclasses import replace
from typing import Protocol

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, heard
from dechirp.echoes.echo import told_stages
from dechirp.echoes.frame_by_frame import FrameByFrame
from dechirp.experiment.link import added_noise_w
from dechirp.experiment.run import opened_recording
from dechirp.experiment.scenario import Scenario
from dechirp.radar.radar import Radar
from dechirp.scene.truth import truth
from dechirp.studio.advice import advised, for_page
from dechirp.studio.settings import Limits, must_be_small


class Frames(Protocol):
    """Frames in a row, any of which may be asked for."""

    @property
    def radar(self) -> Radar:
        """Of all of them."""
        ...

    @property
    def n_frames(self) -> int:
        """Frames, until they go round."""
        ...

    @property
    def findings(self) -> tuple[Finding, ...]:
        """On the source as a whole."""
        ...

    def number(self, step: int) -> int:
        """Of the frame that a step shows."""
        ...

    def cube(self, step: int) -> xr.DataArray:
        """Its samples, (frame, chirp, rx, sample) of one frame."""
        ...

    def truth(self, step: int) -> xr.Dataset | None:
        """Truth about that frame alone, over `target` and `frame`; None where nobody knows it."""
        ...


def frames_of(scenario: Scenario, limits: Limits) -> Frames:
    """The frames of a scenario; raises as `dc.run` where a setting cannot work."""
    return RecordingFrames(scenario, limits) if scenario.scene is None else SceneFrames(scenario)


class SceneFrames:
    """Frames of a scene, each simulated when it is asked for.

    Chance is drawn by the seed and the step, so that a step is the same to the bit whenever it is
    looked at; step 0 is the frame of `dechirp run` with n_frames=1.
    """

    def __init__(self, scenario: Scenario) -> None:
        assert scenario.scene is not None and scenario.radar is not None
        self.radar, self.n_frames = scenario.radar, scenario.n_frames
        self._scene, self._seed = scenario.scene, scenario.seed
        with heard() as findings:
            told_stages(scenario.impairments, self._scene, self.radar, n_frames=self.n_frames)
        self.findings = tuple(findings)
        self._frames = FrameByFrame(
            self._scene,
            self.radar,
            impairments=scenario.impairments,
            n_frames=self.n_frames,
            engine=scenario.engine,
        )
        self._noise_w = added_noise_w(scenario, self.radar)

    def number(self, step: int) -> int:
        """Of the frame that a step shows."""
        return step % self.n_frames

    def cube(self, step: int) -> xr.DataArray:
        """Its samples, (frame, chirp, rx, sample) of one frame."""
        seed = np.random.SeedSequence(self._seed, spawn_key=(step,) if step else ())
        return self._frames.cube(self.number(step), np.random.default_rng(seed))

    def truth(self, step: int) -> xr.Dataset:
        """Truth about that frame, over `target` and `frame`."""
        number = self.number(step)
        return truth(self._scene, self.radar, first=number, noise_power_w=self._noise_w)


class RecordingFrames:
    """Frames of a recording, each decoded when it is asked for.

    Only the file says how large they are, so they are held to the limits here.
    """

    def __init__(self, scenario: Scenario, limits: Limits) -> None:
        with advised():
            self._recording = opened_recording(scenario)
        must_be_small({"radar": self._recording.radar, "chain": scenario.chain}, limits)
        self.radar, self.n_frames = self._recording.radar, self._recording.n_frames
        self.findings = tuple(
            replace(one, fix=for_page(one.fix)) for one in self._recording.findings
        )

    def number(self, step: int) -> int:
        """Of the frame that a step shows."""
        return self._recording.frame_numbers[step % self.n_frames]

    def cube(self, step: int) -> xr.DataArray:
        """Its samples, (frame, chirp, rx, sample) of one frame."""
        number = self.number(step)
        return next(self._recording.part(number, number + 1).frames())

    def truth(self, step: int) -> None:
        """Nobody knows it."""
