"""Base classes of impairments, in three stages in the order of the signal.

An oscillator adds a phase error to the transmitted wave and to the local oscillator. Propagation
adds and attenuates echoes. A receiver changes samples.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np

from dechirp.core.families import Family
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow

RampSupport = Literal["any", "rising", "alike", "even"]
"""Ramps of a modulation that an impairment supports."""


class Impairment(Family):
    """Impairment of one stage; within a stage, impairments act in the order of the list."""

    group: ClassVar[str] = "dechirp.impairment"
    supported_ramps: ClassVar[RampSupport] = "any"
    """Modulations for which it is accurate: any; only rising ramps; ramps that all equal the
    chirp's; equal ramps at equal intervals, as without a modulation."""

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise `InvalidSetting` if it is not applicable; warn about surprising results.

        The setting in the error is a field of this impairment, named as in settings files.
        """

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return the mean power of the noise that it adds to each sample, W; 0 by default."""
        return 0.0


class Preset(Impairment):
    """Group of several impairments with matching settings."""

    @abstractmethod
    def impairments(self, radar: Radar) -> tuple[Impairment, ...]:
        """Return the impairments of the preset for a radar."""


class Oscillator(Impairment):
    """Phase error of the transmitted wave, which the mixer subtracts again one delay later."""

    # The deskew filter that delays all echoes at once has a single slope.
    supported_ramps: ClassVar[RampSupport] = "rising"

    @abstractmethod
    def phase_error_rad(
        self, window: SampleWindow, radar: Radar, rng: np.random.Generator
    ) -> np.ndarray:
        """Return the phase error at the times of the window, (n_chirps, n_times), rad.

        All transmitters and receivers share the error within a frame. If echoes are late, the
        window
        begins before the ramp; there the frequency error is that at the start of the ramp.
        """


class Propagation(Impairment):
    """Change of the echoes on their paths: additional, or attenuated ones."""

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Return the echo groups to sum in place of `groups`."""
        return list(groups)

    def outbound_amplitude_gain(self, radar: Radar) -> float:
        """Return the amplitude gain on the outbound path to all scatterers of a frame.

        It also applies to scatterers that impairments later in the list add.
        """
        return 1.0

    def added_delay_bounds_s(self, radar: Radar) -> tuple[float, float] | None:
        """Return the least and largest delay of the signals of `add_signals`.

        None if they carry no delayed phase.
        """
        return None

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Add signals without scatterers to complex samples, (n_chirps, n_rx, n_times), in place.

        It is called before the oscillator's phase error, with successive chirps of a frame, and
        each time
        with an identically seeded generator: random values of the frame are the same in all calls.
        """


class Receiver(Impairment):
    """Change of the samples, real or complex as the radar samples them."""

    def sample_margins(self, radar: Radar) -> tuple[int, int]:
        """Return how many extra samples it needs before and after the kept ones."""
        return 0, 0

    @abstractmethod
    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Change samples, (n_frames, n_chirps, n_rx, n_samples), sqrt(W), in place."""

    def make_sample_operation(
        self, scene: Scene, radar: Radar
    ) -> Callable[[np.ndarray, np.random.Generator], None]:
        """Return `apply_to_samples` for one scene and radar, with precomputed constants."""
        return lambda samples, rng: self.apply_to_samples(samples, scene, radar, rng)

    def cube_attributes(self, radar: Radar) -> dict[str, object]:
        """Return attributes of the cube, used if no later receiver changes the samples."""
        return {}
